"""The answer in words: one headline, what it does not cover, and the notes under it."""

from __future__ import annotations

import itertools
import math

from novelty.report.tables import probability, thousands
from novelty.result import Change, NoveltyResult, PointState, ResultStatus

BOTH = "both scans: "

LARGE_SHARE = 0.05
"""Share of a scan's examined points from which on it is said that they could not be judged."""


def headline(result: NoveltyResult) -> str:
    """One line that says whether anything changed, and how much: "Changed: 2 objects added, 1 removed"."""
    if result.status is ResultStatus.FAILED:
        return "No answer"
    if not result.changed and not min(result.added.num_examined, result.removed.num_examined):
        return "Nothing was compared: no point is left to examine"
    if not result.changed:
        return "No change found where both scans saw" if unseen(result) else "No change found"
    kinds = [record.kind for record in (*result.added.objects, *result.removed.objects)]
    # A moved object stands on both sides.
    counts = {
        "moved": kinds.count("moved") // 2,
        "added": kinds.count("added"),
        "removed": kinds.count("removed"),
    }
    parts = [f"{count} {kind}" for kind, count in counts.items() if count]
    if not parts:
        return "Changed"
    first, *others = parts
    count, kind = first.split()
    return f"Changed: {', '.join([f'{_objects(int(count))} {kind}', *others])}"


def evidence(result: NoveltyResult) -> str:
    """How strong the evidence is, for detectors that can tell; empty for the others."""
    parts = []
    if not math.isnan(result.p_value):
        parts.append(f"p-value {probability(result.p_value)}")
    if not math.isnan(result.distance):
        parts.append(f"distance between the mixtures {result.distance:.3g}")
    return ", ".join(parts)


def unseen(result: NoveltyResult) -> list[str]:
    """One sentence per scan of which a large share could not be judged: it may have changed, and was not seen."""
    sides = (("reference", "current", result.removed), ("current", "reference", result.added))
    return [line for scan, other, change in sides if (line := _unseen(scan, other, change))]


def notes(result: NoveltyResult) -> list[str]:
    """What a reader must know beside the answer, one sentence or list of them per line."""
    return note_lines(result.message)


def note_lines(message: str) -> list[str]:
    """The notes in `NoveltyResult.message`, what holds for both scans once."""
    lines = [line.strip() for line in message.splitlines() if line.strip()]
    said = set(lines)
    for first, second in itertools.permutations(("reference scan: ", "current scan: ")):
        lines = [
            BOTH + note if (note := line.removeprefix(first)) != line and second + note in said else line
            for line in lines
        ]
    return list(dict.fromkeys(lines))


def _unseen(scan: str, other: str, change: Change) -> str:
    hidden, outside = (change.count(state) for state in (PointState.OCCLUDED, PointState.UNOBSERVED))
    count = hidden + outside
    share = count / max(change.num_examined, 1)
    if share < LARGE_SHARE:
        return ""
    reasons = {
        f"nothing there{f' ({thousands(outside)})' if hidden else ''}": outside,
        f"something in front of them{f' ({thousands(hidden)})' if outside else ''}": hidden,
    }
    why = " or ".join(reason for reason, points in reasons.items() if points)
    whose = f"{thousands(count)} points of the {scan} scan ({100 * share:.0f} %)"
    return f"{whose} have no counterpart, but the {other} scan saw {why}."


def _objects(count: int) -> str:
    return f"{count} object" if count == 1 else f"{count} objects"
