"""How often a moved thing is called moved, and another thing by mistake: `python -m benchmarks.moves [--seeds 10]`.

In every simulated scene one thing is moved; in others one is taken away and something else put down. Parameters were
chosen on seeds 40 to 61.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from rich.console import Console
from rich.table import Table
from scipy.stats import binomtest

from benchmarks.accuracy_cases import FIRST_REPORTED, PLAIN, SCENES
from novelty import InputError, NoveltyResult, ScanPair, detect_many
from novelty.scan import CHANGED
from novelty.simulation import simulate_pair

MOVED = ("move",)
OTHERS = (("box", "remove"), ("cylinder", "remove"), ("person", "remove"))
LEAST_POINTS = 50
"""Points that either scan must have of what changed, for a shape to be there."""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10, help="scenes of each kind (10)")
    parser.add_argument("--first", type=int, default=FIRST_REPORTED, help="their first seed (100)")
    given = parser.parse_args()
    table = Table("scene", "what happened", "pairs", "called moved [95 %]", title="Moved things")
    for scene in SCENES:
        for changes in (MOVED, *OTHERS):
            pairs = list(_pairs(scene, changes, range(given.first, given.first + given.seeds)))
            results = [result for pair in pairs for result in detect_many([pair])]
            table.add_row(scene, " and ".join(changes), str(len(pairs)), _share(results))
    Console(width=100, highlight=False).print(table)


def _pairs(scene: str, changes: tuple[str, ...], seeds: range) -> Iterator[ScanPair]:
    """The pairs of the seeds whose scene has room for the changes, if both scans show enough of them."""
    for seed in seeds:
        try:
            pair = simulate_pair(scene, seed, changes, **PLAIN).scans
        except InputError:
            continue
        if all((scan.labels == CHANGED).sum() >= LEAST_POINTS for scan in (pair.reference, pair.current)):
            yield pair


def _share(results: list[NoveltyResult]) -> str:
    if not results:
        return "–"
    called = sum(any(thing.kind == "moved" for thing in result.added.objects) for result in results)
    span = binomtest(called, len(results)).proportion_ci(method="wilson")
    return f"{called} [{span.low:.0%}, {span.high:.0%}]"


if __name__ == "__main__":
    main()
