"""The layout of a sweep's folder.

DIR/
  sweep.yaml          the sweep, every default written out; rows of other sweeps may lie beside its own
  starts/*.json       one per start of the command: when, the command line, versions, machine, plan
  rows/*.parquet      shards of finished runs, each complete and never changed (`novelty.sweep.rows.SCHEMA`)
  damaged/            shards that could not be read, set aside; their runs were computed again
  inputs.jsonl        hashes of the scans' files by path, size and time, so that a start reads none twice
  scans/INPUTS.npz    on request (`keep`): the points and the ground truth of a pair, once for all its runs
  results/KEY.npz     on request (`keep`): the labels and the mixtures of a run
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class SweepFolder:
    """Where everything of one sweep lies."""

    root: Path

    @property
    def sweep_file(self) -> Path:
        """The sweep itself, every default written out."""
        return self.root / "sweep.yaml"

    @property
    def starts(self) -> Path:
        """One JSON file per start of the command."""
        return self.root / "starts"

    @property
    def rows(self) -> Path:
        """The shards."""
        return self.root / "rows"

    @property
    def damaged(self) -> Path:
        """Shards that could not be read."""
        return self.root / "damaged"

    @property
    def inputs_file(self) -> Path:
        """Hashes of files that were read before."""
        return self.root / "inputs.jsonl"

    def scans_file(self, inputs: str) -> Path:
        """Points and truth of the pair with this hash (column `inputs`).

        Arrays: `reference_points`, `current_points` float32 (N, 3), m, less `center` float64 (3,);
        `reference_truth`, `current_truth` uint8 (N,), absent where unknown.
        """
        return self.root / "scans" / f"{inputs}.npz"

    def result_file(self, key: str) -> Path:
        """Labels and mixtures of the run with this key.

        Arrays, `added` for the current scan and `removed` for the reference: `{direction}_states` uint8 (N,),
        `{direction}_scores` float32 (N,), `{direction}_components` int16 (N,); and of the mixture of that scan
        `{direction}_weights` (K,), `{direction}_means` (K, 3), `{direction}_covariances` (K, 3, 3), in the unit of the
        scan, `{direction}_novel` bool (K,).
        """
        return self.root / "results" / f"{key}.npz"
