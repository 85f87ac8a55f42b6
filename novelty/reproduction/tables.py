"""The tables of the page."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

from novelty.evaluation import Agreement, Interval, t_interval
from novelty.report.tables import Column, Table
from novelty.report.tables import Row as Line
from novelty.reproduction import printed
from novelty.reproduction.methods import (
    ALONE,
    CALIBRATED,
    CLUSTERINGS,
    M3C2,
    OURS,
    POINTWISE,
    PRINTED,
    STEPS,
    STRUCTURAL,
    Method,
)
from novelty.reproduction.rows import STAGES, Row, grouped, interval, matching
from novelty.reproduction.scoring import MethodTest
from novelty.reproduction.segmentation import TITLES, SegmentationRow
from novelty.reproduction.thresholds import ThresholdRow, Thresholds

METHODS = {
    method.key: method
    for method in (*PRINTED, CALIBRATED, *STEPS, *ALONE, *OURS, *CLUSTERINGS, *POINTWISE, M3C2)
}
"""Every method by its key."""

_STEPS = {method.key for method in STEPS}

GROUPS = {
    "mobile, complete": ("mobile_platform", printed.COMPLETE),
    "mobile, up to 1.5 m": ("mobile_platform", printed.AREA),
    "static": ("static_platform", "K_max 20"),
    "removal": ("removal", "K_max 20"),
}
"""The experiments over which steps from the printed methods to ours are followed."""


def table_2(rows: Sequence[Row], analysis: str) -> Table:
    """One half of Table 2: objects and methods, V, U and kappa with the level of agreement, printed values beside."""
    columns = (
        Column("object", numeric=False),
        Column("method", numeric=False),
        Column("V"),
        Column("U"),
        Column("κ [95 %]"),
        Column("agreement", numeric=False),
        Column("attainable κ"),
        Column("printed V, U, κ"),
    )
    own = [
        row
        for row in matching(rows, experiment="mobile_platform", analysis=analysis)
        if row.method not in _STEPS
    ]
    lines = [
        _table_2_line(case, METHODS[key], part)
        for (case, key), part in grouped(own, lambda row: (row.case, row.method)).items()
    ]
    return Table(columns, tuple(lines))


def _table_2_line(case: str, method: Method, rows: Sequence[Row]) -> Line:
    place = (case, rows[0].analysis, method.config.detector)
    cell = printed.TABLE_2.get(place) if method in (*PRINTED, CALIBRATED) else None
    kappa = interval(rows)
    cells = (
        case,
        method.title,
        f"{interval(rows, 'cramers_v').mean:.3f}",
        f"{interval(rows, 'uncertainty').mean:.3f}",
        spanned(kappa),
        str(Agreement.of(kappa.mean)),
        f"{interval(rows, 'attainable').mean:.3f}",
        f"{cell.cramers_v:.3f}, {cell.uncertainty:.3f}, {cell.kappa:.3f}" if cell else "",
    )
    return Line(cells, "printed" if method in PRINTED else "")


def case_table(rows: Sequence[Row], experiment: str) -> Table:
    """Kappa of every method on every case of an experiment, and what its components could attain."""
    own = [row for row in matching(rows, experiment=experiment) if row.method not in _STEPS]
    cases = list(dict.fromkeys(row.case for row in own))
    columns = (
        Column("method", numeric=False),
        *(Column(f"{case}: κ [95 %]") for case in cases),
        Column("attainable κ"),
        Column("s per pair"),
    )
    lines = []
    for key, part in grouped(own, lambda row: row.method).items():
        spans = [spanned(interval(matching(part, case=case))) for case in cases]
        attainable = "" if METHODS[key] in (*POINTWISE, M3C2) else f"{interval(part, 'attainable').mean:.3f}"
        lines.append(
            Line(
                (METHODS[key].title, *spans, attainable, f"{statistics.median(r.seconds for r in part):.2f}")
            )
        )
    return Table(columns, tuple(lines))


def step_table(rows: Sequence[Row]) -> Table:
    """From the printed methods to ours: mean kappa over all cases of every experiment, and what was attainable."""
    columns = (Column("method", numeric=False), *(Column(name) for name in GROUPS))
    lines = []
    steps = ("paper", "calibrated", "common", "shapes", "both", "own", "alone")
    for family in ("emd", "structural"):
        keys = [f"{family}_{step}" for step in steps] + [family]
        for key in (key for key in keys if key in METHODS):
            part = matching(rows, method=key)
            groups = [
                matching(part, experiment=name, analysis=analysis) for name, analysis in GROUPS.values()
            ]
            cells = [f"{interval(g).mean:.2f} ({interval(g, 'attainable').mean:.2f})" for g in groups]
            lines.append(Line((METHODS[key].title, *cells), "printed" if METHODS[key] in PRINTED else ""))
    return Table(columns, tuple(lines))


def test_tables(tests: Sequence[MethodTest]) -> list[tuple[str, Table]]:
    """McNemar's tests, a table for every two methods."""
    tables = []
    for first, second in dict.fromkeys((test.first, test.second) for test in tests):
        own = [test for test in tests if (test.first, test.second) == (first, second)]
        tables.append((f"{METHODS[first].title}, against {METHODS[second].title}", _test_table(own)))
    return tables


def _test_table(tests: Sequence[MethodTest]) -> Table:
    columns = (
        Column("experiment", numeric=False),
        Column("case", numeric=False),
        Column("data", numeric=False),
        Column("scans"),
        Column("points that only the first has right"),
        Column("only the second"),
        Column("p, points"),
        Column("p, scans"),
    )
    lines = [
        Line(
            (
                test.experiment.replace("_", " "),
                test.case,
                test.analysis,
                str(test.scans),
                _spaced(test.first_only),
                _spaced(test.second_only),
                _probability(test.p_value),
                _probability(test.p_over_scans),
            )
        )
        for test in tests
    ]
    return Table(columns, tuple(lines))


def threshold_table(found: Thresholds) -> Table:
    """Section 3.2 by scene: what the printed thresholds let pass of valid pairings, and of invalid ones."""
    printed = STRUCTURAL.config.structural_matching
    columns = (
        Column("scene", numeric=False),
        Column("maps"),
        Column("valid pairings per map"),
        Column(f"d < {printed.node_threshold:g}"),
        Column(f"alike in shape: ω ≤ {printed.arc_threshold:g}"),
        Column("valid let pass"),
        Column("invalid let pass"),
        Column("P_err"),
    )
    groups: dict[str, list[ThresholdRow]] = {}
    for row in found.rows:
        groups.setdefault(row.scene.replace("_", " "), []).append(row)
    lines = [_threshold_line(name, part) for name, part in {**groups, "all": found.rows}.items()]
    return Table(columns, tuple(lines))


def _threshold_line(name: str, rows: Sequence[ThresholdRow]) -> Line:
    shares = [
        t_interval([getattr(row, key) for row in rows]).mean for key in ("near", "alike", "valid", "invalid")
    ]
    pairings = statistics.mean(row.valid_pairings for row in rows)
    error = t_interval([row.error for row in rows]).mean
    cells = (name, str(len(rows)), f"{pairings:.1f}", *(f"{share:.1%}" for share in shares), f"{error:.2f}")
    return Line(cells, "printed" if name == "all" else "")


def _probability(value: float) -> str:
    return "< 1e-16" if value < 1e-16 else f"{value:.2g}"


def segmentation_table(segmentations: Sequence[SegmentationRow]) -> Table:
    """Clusters, attainable kappa in every scene, seconds."""
    cases = list(dict.fromkeys(row.case for row in segmentations))
    columns = (
        Column("segmentation", numeric=False),
        Column("clusters"),
        *(Column(f"κ, {case}") for case in cases),
        Column("s per scan"),
        Column("printed"),
    )
    beside = {
        "fuzzy_automatic": "2 min; 3, 2, 2 clusters",
        "fuzzy_9": "1 h",
        "mixture_9": "60 s",
        "mixture_20": "60 s",
    }
    lines = []
    for method, title in TITLES.items():
        part = [row for row in segmentations if row.method == method]
        counts = [row.clusters for row in part]
        means = [statistics.mean(row.kappa for row in part if row.case == case) for case in cases]
        span = f"{min(counts)}–{max(counts)}" if min(counts) < max(counts) else str(counts[0])
        seconds = statistics.median(row.seconds for row in part)
        lines.append(
            Line((title, span, *(f"{mean:.2f}" for mean in means), f"{seconds:.2f}", beside[method]))
        )
    return Table(columns, tuple(lines))


def time_table(rows: Sequence[Row]) -> Table:
    """Median seconds per pair of every stage, for the platforms and the methods as printed and by default."""
    columns = (
        Column("data", numeric=False),
        Column("method", numeric=False),
        Column("points"),
        *(Column(stage) for stage in STAGES),
        Column("total"),
    )
    lines = []
    for experiment in ("static_platform", "mobile_platform", "box_size", "viewpoint"):
        for method in (*PRINTED, OURS[-1]):
            part = [row for row in matching(rows, experiment=experiment, method=method.key) if not row.order]
            lines += [_time_line(experiment, method, part)] if part else []
    return Table(columns, tuple(lines))


def _time_line(experiment: str, method: Method, rows: Sequence[Row]) -> Line:
    stages = [statistics.median(getattr(row, stage) for row in rows) for stage in STAGES]
    return Line(
        (
            experiment.replace("_", " "),
            method.title,
            _spaced(round(statistics.median(row.points for row in rows))),
            *(f"{seconds:.2f}" for seconds in stages),
            f"{statistics.median(row.seconds for row in rows):.2f}",
        )
    )


def spanned(span: Interval) -> str:
    """A mean and its interval: 0.870 [0.801, 0.939]."""
    if math.isnan(span.mean):
        return "–"
    if math.isnan(span.low):
        return f"{span.mean:.3f}"
    return f"{span.mean:.3f} [{span.low:.3f}, {span.high:.3f}]"


def _spaced(value: int) -> str:
    return f"{value:,}".replace(",", " ")
