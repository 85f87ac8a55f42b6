"""Sections 3.2 to 3.4 and 4: thresholds, the static platform, Lomenie's method, removal."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

from novelty.evaluation import Interval, proportion_interval, t_interval
from novelty.reproduction.findings.finding import STRONG, Finding, by_case, of_methods, weighed
from novelty.reproduction.findings.verdict import Condition
from novelty.reproduction.methods import CALIBRATED, EMD, OURS, STRUCTURAL, Method
from novelty.reproduction.rows import Row, matching
from novelty.reproduction.segmentation import AUTOMATIC, MIXTURE_9, MIXTURE_20, NINE, SegmentationRow
from novelty.reproduction.thresholds import Thresholds

DOOR = "door closed"

SLACK = 0.05
"""Thresholds are as good as the best when their probability of error is greater by less than this."""


def thresholds_are_the_least_error(found: Thresholds) -> Finding:
    """Section 3.2."""
    rows = found.rows
    near, alike = (t_interval([getattr(row, name) for row in rows]) for name in ("near", "alike"))
    printed = STRUCTURAL.config.structural_matching
    return weighed(
        "U_T = 3.5 and U_R = 1.0 have the least probability of error (3.2).",
        "40 maps",
        f"least P_err, {found.error:.2f}, at U_T = {found.node:g} and U_R = {found.arc:g} ({len(rows)} maps). At the "
        f"printed ones {near.mean:.0%} of valid pairings are nearer than U_T = {printed.node_threshold:g}, but only "
        f"{alike.mean:.0%} agree in shape (eq. 12) up to U_R = {printed.arc_threshold:g}",
        [
            Condition(
                "P_err at the printed thresholds",
                t_interval([row.error for row in rows]),
                high=found.error + SLACK,
            )
        ],
    )


def changes_are_segmented(rows: Sequence[Row]) -> Finding:
    """Section 3.3."""
    claim = "All three changes seen by the static platform are segmented (3.3, Fig. 11)."
    return _strong_in_every_case(claim, "shown in pictures", rows)


def few_clusters(segmentations: Sequence[SegmentationRow]) -> Finding:
    """Section 3.4: what Lomenie's method chooses by itself."""
    rows = [row for row in segmentations if row.method == AUTOMATIC]
    counts = [row.clusters for row in rows]
    density, volume = (
        statistics.mean(getattr(row, name) for row in rows)
        for name in ("by_average_density", "by_hypervolume")
    )
    return weighed(
        "Loménie's method by itself takes too few clusters to show the change (3.4, Fig. 13 a-c).",
        "3, 2 and 2 clusters",
        f"{statistics.mean(counts):.1f} clusters on average ({min(counts)} to {max(counts)}) of nine allowed, by the "
        f"partition density; by the average density {density:.1f}, by the fuzzy hypervolume {volume:.1f}",
        [
            Condition("clusters", t_interval(counts), high=5),
            Condition("share of scans with clusters for the change", _told(rows), high=0.5),
        ],
    )


def nine_do_not_tell_the_door(segmentations: Sequence[SegmentationRow]) -> Finding:
    """Section 3.4: with nine clusters."""
    told = {name: _told(_door(segmentations, name)) for name in (NINE, MIXTURE_9)}
    return weighed(
        "With nine clusters neither Loménie's method nor the mixture tells the closed door from the wall "
        "(3.4, Fig. 13 f, i).",
        "door and wall in one segment",
        f"told apart in {_of(told[NINE])} scans by Loménie's nine, in {_of(told[MIXTURE_9])} by the mixture",
        [
            Condition("share by Loménie's nine", told[NINE], high=0.5),
            Condition("share by the mixture", told[MIXTURE_9], high=0.5),
        ],
    )


def twenty_tell_the_door(segmentations: Sequence[SegmentationRow]) -> Finding:
    """Section 3.4: with K_max = 20."""
    rows = _door(segmentations, MIXTURE_20)
    told = _told(rows)
    return weighed(
        "The mixture with K_max = 20 gives the door a Gaussian of its own (3.4, Fig. 14).",
        "shown in a picture",
        f"told apart in {_of(told)} scans, mean attainable κ {statistics.mean(row.kappa for row in rows):.2f}",
        [Condition("share of scans", told, low=0.5)],
    )


def mixture_is_faster(segmentations: Sequence[SegmentationRow]) -> Finding:
    """Section 3.4: seconds, one timing per scene."""
    seconds = {
        method: {row.case: row.seconds for row in segmentations if row.method == method}
        for method in (AUTOMATIC, NINE, MIXTURE_9, MIXTURE_20)
    }

    def ratio(slow: str, fast: str) -> Interval:
        logs = t_interval([math.log(seconds[slow][case] / seconds[fast][case]) for case in seconds[fast]])
        return Interval(math.exp(logs.mean), math.exp(logs.low), math.exp(logs.high), logs.count)

    medians = {method: statistics.median(by.values()) for method, by in seconds.items()}
    return weighed(
        "The mixture takes 60 s, Loménie's method 2 minutes by itself and an hour with nine clusters (3.4).",
        "ratios 2 and 60",
        f"mixture {medians[MIXTURE_9]:.2f} s (K_max 9) and {medians[MIXTURE_20]:.2f} s (K_max 20), Loménie 1 to 9 "
        f"{medians[AUTOMATIC]:.1f} s",
        [
            Condition("Loménie 1 to 9 against K_max 20", ratio(AUTOMATIC, MIXTURE_20), low=1),
            Condition("Loménie's nine against K_max 9", ratio(NINE, MIXTURE_9), low=1),
        ],
    )


def removal_is_found(rows: Sequence[Row]) -> Finding:
    """Section 4."""
    claim = "What was removed is found with the scans exchanged (section 4)."
    return _strong_in_every_case(claim, "stated", rows)


def _strong_in_every_case(claim: str, printed: str, rows: Sequence[Row]) -> Finding:
    ours = of_methods(rows, (EMD, CALIBRATED, OURS[0]))
    return weighed(claim, printed, ours, *(_strong(rows, method) for method in (EMD, CALIBRATED)))


def _strong(rows: Sequence[Row], method: Method) -> list[Condition]:
    spans = by_case(matching(rows, method=method.key))
    return [Condition(f"κ, {case}", span, low=STRONG) for case, span in spans.items()]


def _door(segmentations: Sequence[SegmentationRow], method: str) -> list[SegmentationRow]:
    return [row for row in segmentations if (row.method, row.case) == (method, DOOR)]


def _told(rows: Sequence[SegmentationRow]) -> Interval:
    """In which share of the scans clusters of its own hold the change."""
    return proportion_interval([row.kappa > STRONG for row in rows])


def _of(share: Interval) -> str:
    return f"{round(share.mean * share.count)} of {share.count}"
