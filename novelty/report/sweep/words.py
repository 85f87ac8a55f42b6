"""What a sweep found, in words."""

from __future__ import annotations

import json
import math
from datetime import timedelta

from novelty.report.sweep.analysis import SweepAnalysis
from novelty.report.sweep.runs import Factor
from novelty.report.tables import thousands


def facts(analysis: SweepAnalysis) -> list[tuple[str, str]]:
    """Numbers to begin with, and what they count."""
    runs = analysis.runs
    failed = int(runs.failed.sum())
    return [
        (thousands(len(runs)), "runs"),
        (thousands(len(set(runs.pair_codes.tolist()))), "pairs"),
        *((str(len(factor.values)), _many(factor)) for factor in runs.factors[:3]),
        (thousands(failed), "failed"),
        (_duration(analysis.costs.clock), "on the clock"),
    ]


def answer(analysis: SweepAnalysis) -> str:
    """One sentence: which runs have the highest kappa."""
    if not analysis.scored:
        return "There was no ground truth, so there are no scores; what was found is in the rows."
    study = analysis.scored[0]
    group = max(study.groups, key=lambda group: _known(group.spreads["kappa"].interval.mean))
    factors = [factor for factor in (study.series, study.axis) if factor is not None]
    names = [f"{f.label} {f.text(place)}" for f, place in zip(factors, group.places, strict=True)]
    interval = group.spreads["kappa"].interval
    ends = "" if math.isnan(interval.low) else f" (95 % interval {interval.low:.3f} to {interval.high:.3f})"
    where = f" with {', '.join(names)}" if names else ""
    return f"Highest mean κ{where}: {interval.mean:.3f}{ends}."


def caution(analysis: SweepAnalysis) -> str:
    """What a comparison of the detectors must reckon with; empty where there is nothing to say."""
    runs = analysis.runs
    if runs.factor("detector") is None:
        return ""
    configurations = map(json.loads, runs.distinct("configuration"))
    if all(config.get("refine", {}).get("method", "none") == "none" for config in configurations):
        return ""
    return (
        "Labels were refined: whatever a detector calls novel is judged again, point by point and for all of them "
        "alike, so that they differ less than they would alone. To compare the detectors themselves, run with "
        "refine.method=none."
    )


def clock(analysis: SweepAnalysis) -> str:
    """One sentence: how long it took, and on how much."""
    spent, runs = analysis.costs, len(analysis.runs)
    parts = [f"{_duration(spent.total)} of computing"]
    if spent.clock > 0:
        parts.append(f"{_duration(spent.clock)} on the clock: {runs / spent.clock:.3g} runs per second")
    parts.append(f"{spent.workers} {'process' if spent.workers == 1 else 'processes'}")
    if not math.isnan(spent.peak_memory):
        parts.append(f"at most {spent.peak_memory / 1e9:.1f} GB of memory in a process")
    return ", ".join(parts) + "."


def _many(factor: Factor) -> str:
    return "detectors" if factor.key == "detector" else f"values of {factor.label}"


def _known(value: float) -> float:
    return -math.inf if math.isnan(value) else value


def _duration(seconds: float) -> str:
    if math.isnan(seconds):
        return "–"
    return f"{seconds:.1f} s" if seconds < 60 else str(timedelta(seconds=round(seconds)))
