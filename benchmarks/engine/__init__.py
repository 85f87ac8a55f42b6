"""The engine against its peers, timed side by side in the same run: `python -m benchmarks.engine`."""
