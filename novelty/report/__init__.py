"""What is handed to people: the page, the record of a run, and the scans with their labels."""
