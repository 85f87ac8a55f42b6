"""What agrees with the paper and what does not, decided by the rows and nothing else."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from novelty.evaluation import Interval
from novelty.reproduction import printed
from novelty.reproduction.methods import ALONE, EMD, OURS, PRINTED, STRUCTURAL, Method
from novelty.reproduction.rows import Row, interval, matching, paired_difference
from novelty.reproduction.segmentation import AUTOMATIC, MIXTURE_9, MIXTURE_20, NINE, SegmentationRow
from novelty.reproduction.sensitivity import BOX_SIZE, VIEWPOINT

OBJECTS = ("cylinder", "person", "box")
ALMOST_COMPLETE, STRONG, CLEAR = 0.8, 0.6, 0.4
"""Kappas above which Table 1 calls agreement almost complete, strong, or clear."""

ALIKE = 0.05
"""Mean kappas nearer than this are called the same."""

ALPHA = 0.01
"""Significance of the associations in Table 2."""


class Verdict(StrEnum):
    """How our numbers stand to a sentence of the paper."""

    AGREES = "agrees"
    PARTLY = "partly"
    DIFFERS = "differs"


@dataclass(frozen=True)
class Finding:
    """One sentence of the paper beside our numbers.

    Attributes:
        claim: What the paper says, and where.
        printed: Its numbers.
        ours: What ours say.
        verdict: How they agree, for the methods as printed.
    """

    claim: str
    printed: str
    ours: str
    verdict: Verdict


def find(rows: Sequence[Row], segmentations: Sequence[SegmentationRow]) -> list[Finding]:
    """Every sentence of section 3 that numbers can support, in the order of the section."""
    table = matching(rows, experiment="mobile_platform")
    return [
        _static_changes_are_found(matching(rows, experiment="static_platform")),
        _few_clusters(segmentations),
        _nine_do_not_tell_the_door(segmentations),
        _twenty_tell_the_door(segmentations),
        _mixture_is_faster(segmentations),
        _all_significant(table),
        _person_is_easier(table),
        _ceiling_takes_the_mixture(table),
        _area_repairs(table),
        _emd_ahead(table),
        _identical_in_the_area(table),
        *(_best_orders(rows, name) for name in (BOX_SIZE, VIEWPOINT)),
        _alike_at_every_order(rows),
        _removal_is_found(matching(rows, experiment="removal")),
    ]


def _static_changes_are_found(rows: Sequence[Row]) -> Finding:
    told = {method: _by_case(matching(rows, method=method.key)) for method in (EMD, OURS[0])}
    return Finding(
        "All three changes seen by the static platform are segmented (3.3, Fig. 11).",
        "shown in pictures",
        "; ".join(f"{method.title}: κ {_listed(spans)}" for method, spans in told.items()),
        _graded([span.mean > STRONG for span in told[EMD].values()]),
    )


def _few_clusters(segmentations: Sequence[SegmentationRow]) -> Finding:
    rows = [row for row in segmentations if row.method == AUTOMATIC]
    counts = [row.clusters for row in rows]
    found = [row.kappa > STRONG for row in rows]
    return Finding(
        "Loménie's method by itself takes too few clusters to show the change (3.4, Fig. 13 a-c).",
        "3, 2 and 2 clusters",
        f"{statistics.mean(counts):.1f} clusters on average ({min(counts)} to {max(counts)}); the change has "
        f"clusters of its own in {sum(found)} of {len(found)} scans",
        _graded([statistics.mean(counts) < 5, not any(found)]),
    )


def _nine_do_not_tell_the_door(segmentations: Sequence[SegmentationRow]) -> Finding:
    told = {method: _told(segmentations, method, "door closed") for method in (NINE, MIXTURE_9)}
    return Finding(
        "With nine clusters neither Loménie's method nor the mixture tells the closed door from the wall "
        "(3.4, Fig. 13 f, i).",
        "door and wall in one segment",
        f"told apart in {_of(told[NINE])} scans by Loménie's nine, in {_of(told[MIXTURE_9])} by the mixture",
        _graded([not any(told[NINE]), not any(told[MIXTURE_9])]),
    )


def _twenty_tell_the_door(segmentations: Sequence[SegmentationRow]) -> Finding:
    told = _told(segmentations, MIXTURE_20, "door closed")
    kappas = [row.kappa for row in segmentations if row.method == MIXTURE_20 and row.case == "door closed"]
    share = statistics.mean(told)
    return Finding(
        "The mixture with K_max = 20 gives the door a Gaussian of its own (3.4, Fig. 14).",
        "shown in a picture",
        f"told apart in {_of(told)} scans, mean attainable κ {statistics.mean(kappas):.2f}",
        Verdict.AGREES if share > 0.8 else Verdict.PARTLY if share > 0.2 else Verdict.DIFFERS,
    )


def _mixture_is_faster(segmentations: Sequence[SegmentationRow]) -> Finding:
    seconds = {
        method: statistics.median(row.seconds for row in segmentations if row.method == method)
        for method in (AUTOMATIC, NINE, MIXTURE_9, MIXTURE_20)
    }
    return Finding(
        "The mixture takes 60 s, Loménie's method 2 minutes by itself and an hour with nine clusters (3.4).",
        "ratios 2 and 60",
        f"mixture {seconds[MIXTURE_9]:.2f} s (K_max 9) and {seconds[MIXTURE_20]:.2f} s (K_max 20), Loménie 1 to 9 "
        f"{seconds[AUTOMATIC]:.1f} s: {seconds[AUTOMATIC] / seconds[MIXTURE_20]:.0f} times the mixture of K_max 20",
        _graded([seconds[MIXTURE_20] < seconds[AUTOMATIC], seconds[MIXTURE_9] < seconds[NINE]]),
    )


def _all_significant(rows: Sequence[Row]) -> Finding:
    shares = {method: _share_significant(matching(rows, method=method.key)) for method in (*PRINTED, *OURS)}
    least = min(shares[method] for method in PRINTED)
    return Finding(
        "Every result of Table 2 is significant, p ≤ 0.01 (χ²).",
        "all",
        "; ".join(f"{method.title} {share:.0%}" for method, share in shares.items())
        + " (p ≤ 0.01 and better than chance)",
        Verdict.AGREES if least > 0.9 else Verdict.PARTLY if least > 0.5 else Verdict.DIFFERS,
    )


def _share_significant(rows: Sequence[Row]) -> float:
    return statistics.mean(row.p_value <= ALPHA and row.kappa > 0 for row in rows)


def _person_is_easier(rows: Sequence[Row]) -> Finding:
    complete = matching(rows, analysis=printed.COMPLETE)
    told, better = [], []
    for method in (EMD, ALONE[0], OURS[0]):
        part = matching(complete, method=method.key)
        means = {case: interval(matching(part, case=case)).mean for case in OBJECTS}
        told.append(f"{method.title} {_numbers(means)}")
        better.append(means["person"] - max(means["cylinder"], means["box"]))
    return Finding(
        "On the complete data the person is found far better than the cylinder and the box (3.5, Table 2).",
        "κ by EMD: cylinder 0.25, person 1.00, box 0.50",
        "; ".join(told),
        Verdict.AGREES if better[0] > 0.2 else Verdict.PARTLY if better[0] > ALIKE else Verdict.DIFFERS,
    )


def _ceiling_takes_the_mixture(rows: Sequence[Row]) -> Finding:
    spans = {}
    for analysis in (printed.COMPLETE, printed.AREA):
        spans[analysis] = interval(matching(rows, method=EMD.key, analysis=analysis), "attainable")
    before, after = spans[printed.COMPLETE], spans[printed.AREA]
    repaired = after.mean > STRONG
    return Finding(
        "The ceiling spoils the mixture of the complete data, of which it takes most Gaussians; without it the "
        "changes have Gaussians of their own (3.5, Fig. 15).",
        "shown in pictures",
        f"attainable κ {before.mean:.2f} on the complete data, {after.mean:.2f} up to 1.5 m",
        Verdict.AGREES
        if repaired and before.mean < STRONG
        else Verdict.PARTLY
        if after.low > before.high
        else Verdict.DIFFERS,
    )


def _area_repairs(rows: Sequence[Row]) -> Finding:
    told, gained, reached = [], [], []
    for method in (EMD, STRUCTURAL, ALONE[0]):
        part = [row for row in matching(rows, method=method.key) if row.case != "person"]
        before, after = (matching(part, analysis=name) for name in (printed.COMPLETE, printed.AREA))
        gain = paired_difference(after, before, ("case", "repetition"))
        told.append(
            f"{method.title} {interval(before).mean:.2f} → {interval(after).mean:.2f} (change {_signed(gain)})"
        )
        gained.append(gain.low > 0)
        reached.append(interval(after).mean > ALMOST_COMPLETE)
    verdict = Verdict.AGREES if gained[0] and reached[0] else Verdict.PARTLY if gained[0] else Verdict.DIFFERS
    return Finding(
        "Without what is above 1.5 m, cylinder and box are found as well (3.5, Table 2).",
        "κ by EMD 0.38 → 0.99 on average",
        "; ".join(told),
        verdict,
    )


def _emd_ahead(rows: Sequence[Row]) -> Finding:
    complete = matching(rows, analysis=printed.COMPLETE)
    return Finding(
        "EMD is slightly ahead of structural matching on the complete data (3.5, Table 2).",
        "κ 0.58 against 0.52 on average",
        _comparison(complete, PRINTED) + "; " + _comparison(complete, ALONE),
        _sign_verdict(_difference(complete, PRINTED)),
    )


def _identical_in_the_area(rows: Sequence[Row]) -> Finding:
    area = matching(rows, analysis=printed.AREA)
    gap = _difference(area, PRINTED)
    ours = _difference(area, OURS[:2])
    alike = abs(gap.mean) < ALIKE
    good = min(interval(matching(area, method=method.key)).mean for method in PRINTED) > ALMOST_COMPLETE
    return Finding(
        "Below 1.5 m both methods give the same, nearly perfect answer (3.5, Table 2).",
        "κ 0.99, difference 0",
        f"{_comparison(area, PRINTED)}; ours: difference {_signed(ours)}",
        Verdict.AGREES if alike and good else Verdict.PARTLY if alike else Verdict.DIFFERS,
    )


def _best_orders(rows: Sequence[Row], experiment: str) -> Finding:
    what = {BOX_SIZE: "a box of twelve sizes", VIEWPOINT: "a person from twelve viewpoints"}[experiment]
    told, near = [], []
    for method in PRINTED:
        curve = order_curve(rows, experiment, method)
        best = max(curve, key=lambda k: curve[k].mean)
        named = ", ".join(f"{curve[k].mean:.2f} at {k}" for k in (*printed.BEST_ORDERS, max(curve)))
        told.append(f"{method.title} best at K = {best} (κ {curve[best].mean:.2f}; {named})")
        near.append(curve[best].mean > CLEAR and min(abs(best - k) for k in printed.BEST_ORDERS) <= 1)
    return Finding(
        f"Changes are found best with K = 8 and K = 12 (3.6, Fig. 18): {what}.",
        "K = 8 and 12",
        "; ".join(told),
        _graded(near),
    )


def _alike_at_every_order(rows: Sequence[Row]) -> Finding:
    gaps = []
    for experiment in (BOX_SIZE, VIEWPOINT):
        curves = [order_curve(rows, experiment, method) for method in PRINTED]
        gaps += [curves[0][k].mean - curves[1][k].mean for k in curves[0]]
    return Finding(
        "EMD and structural matching give similar averages at every K (3.6, Fig. 18).",
        "shown in a plot",
        f"difference of mean κ between {min(gaps):+.2f} and {max(gaps):+.2f}, {statistics.mean(gaps):+.2f} on average",
        _graded([max(abs(gap) for gap in gaps) < 0.1, abs(statistics.mean(gaps)) < ALIKE]),
    )


def _removal_is_found(rows: Sequence[Row]) -> Finding:
    told = {method: _by_case(matching(rows, method=method.key)) for method in (EMD, OURS[0])}
    return Finding(
        "What was removed is found with the scans exchanged (section 4).",
        "stated",
        "; ".join(f"{method.title}: κ {_listed(spans)}" for method, spans in told.items()),
        _graded([span.mean > STRONG for span in told[EMD].values()]),
    )


def order_curve(rows: Sequence[Row], experiment: str, method: Method) -> dict[int, Interval]:
    """Mean kappa and its interval over the maps at every prescribed K."""
    part = [row for row in matching(rows, experiment=experiment, method=method.key) if row.order]
    return {order: interval(matching(part, order=order)) for order in sorted({row.order for row in part})}


def _difference(rows: Sequence[Row], methods: Sequence[Method]) -> Interval:
    first, second = (matching(rows, method=method.key) for method in methods)
    return paired_difference(first, second, ("case", "repetition"))


def _comparison(rows: Sequence[Row], methods: Sequence[Method]) -> str:
    means = [interval(matching(rows, method=method.key)).mean for method in methods]
    names = " against ".join(
        f"{method.title} {mean:.2f}" for method, mean in zip(methods, means, strict=True)
    )
    return f"{names} (difference {_signed(_difference(rows, methods))})"


def _sign_verdict(gap: Interval) -> Verdict:
    if gap.low > 0:
        return Verdict.AGREES
    return Verdict.PARTLY if gap.mean > 0 else Verdict.DIFFERS


def _by_case(rows: Sequence[Row]) -> dict[str, Interval]:
    return {case: interval(matching(rows, case=case)) for case in dict.fromkeys(row.case for row in rows)}


def _told(segmentations: Sequence[SegmentationRow], method: str, case: str) -> list[bool]:
    """Whether clusters of its own hold the change, scan by scan."""
    return [row.kappa > STRONG for row in segmentations if (row.method, row.case) == (method, case)]


def _graded(conditions: Sequence[bool]) -> Verdict:
    if all(conditions):
        return Verdict.AGREES
    return Verdict.PARTLY if any(conditions) else Verdict.DIFFERS


def _listed(spans: dict[str, Interval]) -> str:
    return _numbers({case: span.mean for case, span in spans.items()})


def _numbers(means: dict[str, float]) -> str:
    return ", ".join(f"{case} {mean:.2f}" for case, mean in means.items())


def _of(told: Sequence[bool]) -> str:
    return f"{sum(told)} of {len(told)}"


def _signed(span: Interval) -> str:
    if math.isnan(span.low):
        return f"{span.mean:+.2f}"
    return f"{span.mean:+.2f} [{span.low:+.2f}, {span.high:+.2f}]"
