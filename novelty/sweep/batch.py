"""A batch: the pairs and settings that are computed together, and whose rows are one shard."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from novelty.sweep.inputs import HashedPair, run_key
from novelty.sweep.settings import Setting


@dataclass(frozen=True, eq=False)
class Batch:
    """Every one of these pairs under every one of these settings.

    Attributes:
        name: Unique in the sweep.
        pairs: All in one unit.
        settings: What is run on each.
        attempts: Number of this attempt by key, for runs that failed before.
        lost: How often a worker was lost over it.
    """

    name: str
    pairs: tuple[HashedPair, ...]
    settings: tuple[Setting, ...]
    attempts: Mapping[str, int] = field(default_factory=dict)
    lost: int = 0

    @property
    def unit(self) -> str | None:
        """Unit of its pairs; None: what each configuration says."""
        return self.pairs[0].pair.unit

    @property
    def num_runs(self) -> int:
        """Number of rows that it makes."""
        return len(self.pairs) * len(self.settings)

    def runs(self) -> Iterator[tuple[HashedPair, Setting]]:
        """Every run."""
        return ((pair, setting) for pair in self.pairs for setting in self.settings)

    def attempt(self, pair: HashedPair, setting: Setting) -> int:
        """1, or more after failures."""
        return self.attempts.get(run_key(pair, setting), 1)

    def halves(self) -> tuple[Batch, Batch]:
        """Two parts of a batch of several runs: half of its pairs each, or of its settings where it has one pair."""
        if len(self.pairs) > 1:
            middle = len(self.pairs) // 2
            parts = [(self.pairs[:middle], self.settings), (self.pairs[middle:], self.settings)]
        else:
            middle = len(self.settings) // 2
            parts = [(self.pairs, self.settings[:middle]), (self.pairs, self.settings[middle:])]
        first, second = (
            replace(self, name=f"{self.name}.{number}", pairs=pairs, settings=settings, lost=0)
            for number, (pairs, settings) in enumerate(parts)
        )
        return first, second
