"""3D views of the runs at the ends of the scale, where the sweep kept their labels and mixtures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from novelty.report.frame import Frame
from novelty.report.sweep.extremes import Extreme
from novelty.report.sweep.runs import SweepRuns
from novelty.report.views import SMALL, scan_figure


def pair_views(runs: SweepRuns, ends: Sequence[Extreme]) -> dict[str, dict[str, Any]]:
    """Figures of both directions, by the row of the run; nothing for runs that were not kept."""
    return {
        str(extreme.row): {
            direction: scan_figure(
                scan, extreme.kept.changes[direction], direction, frame, extreme.kept.unit, SMALL
            )
            for direction, scan in extreme.kept.scans.items()
        }
        for extreme in ends
        if extreme.kept is not None
        for frame in [Frame.around([scan.points for scan in extreme.kept.scans.values()]).below_ceiling()]
    }
