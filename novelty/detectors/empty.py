"""What is said when one side of a pair has nothing to compare."""

from __future__ import annotations

from novelty.preprocess.prepared import PreparedPairs


def empty_side_notes(batch: PreparedPairs) -> tuple[tuple[str, ...], ...]:
    """For each pair, a note per scan of which nothing is left to examine."""
    sizes = zip(batch.reference.cells.sizes, batch.current.cells.sizes, strict=True)
    return tuple(_notes(reference, current) for reference, current in sizes)


def _notes(reference: int, current: int) -> tuple[str, ...]:
    notes = []
    if not reference:
        notes.append("Nothing of the reference scan is left to examine, so nothing can be called added.")
    if not current:
        notes.append("Nothing of the current scan is left to examine, so nothing can be called removed.")
    return tuple(notes)
