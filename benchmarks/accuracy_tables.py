"""The seven accuracy tables: which cases and variants each takes, and how its rows are told."""

from __future__ import annotations

import importlib.util
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import binomtest

from benchmarks import accuracy_cases as cases
from benchmarks.accuracy_rows import Row, Variant, grouped, interval, recorded, scored
from benchmarks.accuracy_throughput import K_MAX, Comparing
from novelty import Config
from novelty.config import detector_names
from novelty.evaluation import Interval, bootstrap_interval
from novelty.section import section_fields

console = Console(width=128, highlight=False)


@dataclass(frozen=True)
class Options:
    """What was asked for on the command line; `file` takes the rows of the table."""

    seeds: Sequence[int]
    objects: int
    detectors: Sequence[str]
    batch: int
    workers: int
    final: bool
    conditions: Sequence[str]
    file: Path


def detector_variants(options: Options) -> list[Variant]:
    """Every detector as it comes."""
    return [Variant(name, Config(detector=name)) for name in options.detectors]


def unrefined_variants(options: Options) -> list[Variant]:
    """Every detector alone: no label is refined, and what was hidden is still not new."""
    return [
        Variant(f"{v.name}, unrefined", v.config.replace(**{"refine.method": "none"}))
        for v in detector_variants(options)
    ]


def default_and_unrefined(options: Options) -> list[Variant]:
    """The default as it comes, then every detector without the refinement that makes their labels alike."""
    return [Variant("default", Config()), *unrefined_variants(options)]


def paper_variants() -> list[Variant]:
    """The paper's two criteria with every choice as printed."""
    paper = Config.preset("paper")
    return [
        Variant(f"{name}, preset paper", paper.replace(detector=name))
        for name in ("greedy_emd", "structural_matching")
    ]


DISTANCES = (0.01, 0.02, 0.04, 0.1, 0.2)
VOXELS = (0.02, 0.05, 0.1, 0.2)
RADII = (0.02, 0.05, 0.1)
"""Settings of the baselines, m: a user would have to choose one of each row."""


def baseline_variants() -> list[Variant]:
    """The baselines, each with several settings."""
    near = [_variant(f"NN {100 * d:g} cm", "nearest_neighbour", distance=d) for d in DISTANCES]
    voxels = [_variant(f"voxel {100 * s:g} cm", "voxel_difference", voxel_size=s) for s in VOXELS]
    if importlib.util.find_spec("py4dgeo") is None:
        console.print("M3C2 is left out: pip install 'novelty-gmm\\[baselines]'")
        return [*near, *voxels]
    return [*near, *voxels, *(_m3c2(radius) for radius in RADII)]


def _m3c2(radius: float) -> Variant:
    """M3C2 at one scale: every length follows the radius of the cylinder."""
    return _variant(
        f"M3C2 {100 * radius:g} cm",
        "m3c2",
        cylinder_radius=radius,
        normal_radius=2 * radius,
        core_spacing=radius / 2,
        max_distance=4 * radius,
        registration_error=radius / 4,
    )


def _variant(name: str, detector: str, **lengths: float) -> Variant:
    keys = {f"{detector}.{key}": value for key, value in lengths.items()}
    return Variant(name, Config(detector=detector).replace(**keys))


def mosd(options: Options) -> list[Row]:
    """1. Real pairs: every detector with and without refinement; mean [95 %]."""
    variants = [*detector_variants(options), *unrefined_variants(options), *paper_variants()]
    rows = recorded(
        options.file, scored(cases.real_pairs(options.final), variants, options.batch, options.workers)
    )
    for (condition,), part in grouped(rows, lambda row: (row.condition,)).items():
        _show_mosd(f"1. mosd, pairs-{condition}", part)
    return rows


def _show_mosd(title: str, rows: list[Row]) -> None:
    table = _table(title, "detector", "added", "removed", "worst", "seen once", "points novel", "s per pair")
    for (name,), part in grouped(rows, lambda row: (row.variant,)).items():
        kappas = [kappa for row in part for kappa in (row.kappa_added, row.kappa_removed)]
        spans = [interval(part, column) for column in ("kappa_added", "kappa_removed")]
        shares = [_percent(interval(part, column).mean) for column in ("seen_once", "flagged")]
        table.add_row(
            name,
            *map(_short, spans),
            _number(np.nanmin(kappas)),
            *shares,
            f"{interval(part, 'seconds').mean:.2f}",
        )
    console.print(table)


def baselines(options: Options) -> list[Row]:
    """2. Beside baselines, on all data sets; a user has one setting."""
    chosen = Config().detector
    variants = [
        *(v for v in detector_variants(options) if v.name == chosen),
        *paper_variants(),
        *baseline_variants(),
    ]
    plain = {cases.UNDISTURBED: {}}
    pairs = chain(cases.real_pairs(options.final), cases.simulated(options.seeds, plain, options.objects))
    rows = recorded(options.file, scored(pairs, variants, options.batch, options.workers))
    sets = list(dict.fromkeys(row.data for row in rows))
    table = _table("2. kappa of both scans together, mean [95 %]", "method", *sets, "all sets", "worst pair")
    overall = {}
    for (name,), part in grouped(rows, lambda row: (row.variant,)).items():
        spans = [interval(row for row in part if row.data == data) for data in sets]
        overall[name] = statistics.fmean(span.mean for span in spans)
        worst = np.nanmin([row.kappa for row in part])
        table.add_row(
            name,
            *map(_short, spans),
            _number(overall[name]),
            _number(worst),
            style="bold" if name == chosen else "",
        )
    console.print(table)
    for family in ("NN", "M3C2", "voxel"):
        rivals = [name for name in overall if name.startswith(family)]
        if rivals and chosen in overall:
            best = max(rivals, key=lambda name: overall[name])
            console.print(f"   {chosen} minus {best}, pair by pair: {_difference(rows, chosen, best)}")
    return rows


def _difference(rows: list[Row], first: str, second: str) -> str:
    kappas = {(row.variant, row.data, row.pair): row.kappa for row in rows}
    places = [(row.data, row.pair) for row in rows if row.variant == first]
    return str(bootstrap_interval([kappas[first, *place] - kappas[second, *place] for place in places]))


def disturbances(options: Options) -> list[Row]:
    """3. Simulated scenes under disturbances: the default, and every detector without refinement."""
    wanted = {name: cases.DISTURBANCES[name] for name in options.conditions}
    variants = default_and_unrefined(options)
    pairs = cases.simulated(options.seeds, wanted, options.objects)
    rows = recorded(options.file, scored(pairs, variants, options.batch, options.workers))
    names = [variant.name for variant in variants]
    for scene in cases.SCENES:
        part = [row for row in rows if row.data == scene]
        table = _table(f"3. {scene}: kappa of both scans together, mean [95 %]", "disturbance", *names)
        for (condition,), lines in grouped(part, lambda row: (row.condition,)).items():
            spans = [interval(row for row in lines if row.variant == name) for name in names]
            table.add_row(condition, *map(_short, spans))
        console.print(table)
    return rows


def falsealarms(options: Options) -> list[Row]:
    """4. Scenes in which nothing changed; and how many of the objects reported elsewhere are wrong."""
    changed = cases.simulated(options.seeds, {cases.UNDISTURBED: {}}, 1)
    pairs = chain(cases.twice(options.seeds), cases.split_halves(options.seeds[:2]), cases.outdoor(), changed)
    rows = recorded(options.file, scored(pairs, detector_variants(options), options.batch, options.workers))
    still = [row for row in rows if row.condition != cases.UNDISTURBED]
    table = _table(
        "4. nothing changed: points flagged / pairs with any object [95 %] / points / components with p <= 0.05",
        "pairs",
        "n",
        *options.detectors,
    )
    for (data, condition), part in grouped(still, lambda row: (row.data, row.condition)).items():
        by_name = {name: [row for row in part if row.variant == name] for name in options.detectors}
        told = [
            f"{_percent(interval(lines, 'flagged').mean)} / {_alarmed(lines)} / "
            f"{_percent(interval(lines, 'at_level').mean)} / "
            f"{_percent(interval(lines, 'components_at_level').mean)}"
            for lines in by_name.values()
        ]
        table.add_row(f"{data}, {condition}", str(len(part) // len(by_name)), *told)
    console.print(table)
    _show_discoveries([row for row in rows if row.condition == cases.UNDISTURBED], options)
    return rows


def _alarmed(rows: list[Row]) -> str:
    """Share of the pairs with any object, with Wilson's interval."""
    found = binomtest(sum(row.objects > 0 for row in rows), len(rows))
    span = found.proportion_ci(method="wilson")
    return f"{found.statistic:.0%} [{span.low:.0%}, {span.high:.0%}]"


def _show_discoveries(rows: list[Row], options: Options) -> None:
    table = _table(
        "4. false discoveries where something changed", "detector", "objects", "false", "observed", "claimed"
    )
    for name in options.detectors:
        part = [row for row in rows if row.variant == name and not row.failure]
        found, wrong = (sum(getattr(row, column) for row in part) for column in ("objects", "false_objects"))
        settings = getattr(Config(), name)
        claims = [getattr(settings, key) for key in section_fields(type(settings)) if "discovery" in key]
        table.add_row(
            name,
            f"{found:g}",
            f"{wrong:g}",
            _percent(wrong / found if found else 0),
            _percent(claims[0]) if claims else "–",
        )
    console.print(table)


def order(options: Options) -> list[Row]:
    """5. Seeds of the fit and K_max."""
    seeds = [
        Variant(f"{name}, seed {s}", _seeded(name, s))
        for name in options.detectors
        for s in range(len(options.seeds))
    ]
    orders = [
        Variant(f"{name}, K_max {k}", Config(detector=name, max_components=k))
        for name in options.detectors
        for k in (8, 12, 16, 20, 25, 30)
    ]
    few = cases.simulated(options.seeds[:2], {cases.UNDISTURBED: {}}, 1)
    rows = recorded(
        options.file,
        scored(chain(cases.real_pairs(), few), [*seeds, *orders], options.batch, options.workers),
    )
    table = _table(
        "5. mean kappa over all pairs",
        "detector",
        "what varies",
        "least",
        "greatest",
        "spread",
        "worst pair's spread",
    )
    for name in options.detectors:
        for what in ("seed", "K_max"):
            part = [row for row in rows if row.variant.startswith(f"{name}, {what}")]
            means = [interval(lines).mean for lines in grouped(part, lambda row: (row.variant,)).values()]
            spreads = [
                np.ptp([row.kappa for row in lines])
                for lines in grouped(part, lambda row: (row.pair,)).values()
            ]
            table.add_row(name, what, *map(_number, (min(means), max(means), np.ptp(means), max(spreads))))
    console.print(table)
    return rows


def _seeded(name: str, seed: int) -> Config:
    """Everything random in a run starts from the seed: the fit, and the ground's RANSAC."""
    return Config(detector=name, seed=seed).replace(**{"preprocess.seed": seed})


def throughput(options: Options) -> list[Row]:
    """6. The comparison alone, scans prepared and mixtures given: in one process, and with a worker per core."""
    found = cases.simulated(options.seeds, {cases.UNDISTURBED: {}}, options.objects)
    pairs = [case.pair for case in found][: 4 * options.batch]
    columns = ("pairs", "mean K", "ms per pair", "pairs per second", f"of {options.workers} workers")
    table = _table(f"6. comparison alone, K_max = {K_MAX}", "detector", *columns)
    rows = []
    for name in options.detectors:
        comparing = Comparing.of(name, pairs)
        alone, together = comparing.seconds(), comparing.seconds_with(options.workers)
        table.add_row(
            name,
            str(len(pairs)),
            f"{comparing.mean_components:.1f}",
            f"{1e3 * alone:.2f}",
            *(f"{1 / seconds:.0f}" for seconds in (alone, together)),
        )
        for how, seconds in (("one process", alone), (f"{options.workers} workers", together)):
            told = f"{len(pairs)} pairs, {how}"
            rows.append(Row("simulated", f"K_max {K_MAX}", 0, told, name, compare_seconds=seconds))
    console.print(table)
    return recorded(options.file, rows)


def ablation(options: Options) -> list[Row]:
    """7. What each ingredient gains: the default and each detector without it."""
    conditions = {
        name: cases.DISTURBANCES[name] for name in (cases.UNDISTURBED, "pose 5 cm 1 deg", "viewpoint 1.5 m")
    }
    pairs = chain(cases.real_pairs(), cases.simulated(options.seeds, conditions, options.objects))
    variants = [variant for name in options.detectors for variant in _without_each(name)]
    rows = recorded(options.file, scored(pairs, variants, options.batch, options.workers))
    columns = list(grouped(rows, lambda row: (row.data, row.condition)))
    heads = [f"{data}\n{condition}" for data, condition in columns]
    table = _table("7. kappa of both scans together, mean [95 %]", "variant", *heads)
    for (name,), part in grouped(rows, lambda row: (row.variant,)).items():
        spans = [interval(row for row in part if (row.data, row.condition) == column) for column in columns]
        table.add_row(name, *map(_short, spans), style="" if " without " in name else "bold")
    console.print(table)
    return rows


INGREDIENTS: dict[str, dict[str, Any]] = {
    "coupled fit": {"{}.fits": "independent"},
    "coupled fit, with merging": {"{}.fits": "independent", "{}.merging": True},
    "components of its own": {"fit.unexplained_components": 0},
    "merged start": {"fit.initializer": "evenly_spaced"},
    "floor": {"{}.resolution_floor": "none"},
    "refinement": {"refine.method": "none"},
    "registration": {"registration.method": "none"},
    "visibility": {"visibility.method": "none"},
    "feet": {"preprocess.feet": False},
    "ground removal": {"preprocess.ground": "none"},
}
"""Keys of the configuration, {} standing for the detector's section, and their values without the ingredient."""


def _without_each(name: str) -> Iterator[Variant]:
    whole = Config(detector=name)
    yield Variant(name, whole)
    known = section_fields(type(getattr(whole, name)))
    for ingredient, changes in INGREDIENTS.items():
        own = [key.removeprefix("{}.") for key in changes if key.startswith("{}.")]
        if all(key in known for key in own):
            changed = whole.replace(**{key.format(name): value for key, value in changes.items()})
            yield Variant(f"{name} without {ingredient}", changed)


TABLES: dict[str, Callable[[Options], list[Row]]] = {
    "mosd": mosd,
    "baselines": baselines,
    "disturbances": disturbances,
    "falsealarms": falsealarms,
    "order": order,
    "throughput": throughput,
    "ablation": ablation,
}
"""By the names under which the command line knows them; a new table is one function and one line here."""


def _table(title: str, first: str, *others: str) -> Table:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column(first, overflow="fold")
    for name in others:
        table.add_column(name.replace("_", " "), justify="right", overflow="fold")
    return table


def _number(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.3f}"


def _percent(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.2%}"


def _short(span: Interval) -> str:
    return _number(span.mean) if np.isnan(span.low) else f"{span.mean:.3f}\n[{span.low:.2f}, {span.high:.2f}]"


def default_detectors() -> list[str]:
    """Every detector of the registry, the default first."""
    return sorted(detector_names(), key=lambda name: name != Config().detector)
