"""The paper's figures in our numbers: which pictures stand beside each other, and what is said under them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from novelty.report.views import ADDED
from novelty.reproduction import printed
from novelty.reproduction.drawing import (
    CLUSTERS,
    DARK,
    GREY,
    Picture,
    View,
    cluster_colours,
    truth_colours,
)
from novelty.reproduction.methods import ALONE, EMD
from novelty.reproduction.scoring import Example, Outcome
from novelty.reproduction.segmentation import TITLES, Segmentations
from novelty.reproduction.sensitivity import BOX_SIZE, SELECTED, VIEWPOINT
from novelty.reproduction.simplification import LIMIT, SimplificationExample
from novelty.scan import CHANGED

SMALL = 15.0
"""Size of the writing in pictures of which five stand in a row."""

MOST_POINTS = 25_000
"""Points drawn in a picture at most, evenly taken."""


@dataclass(frozen=True)
class Panel:
    """One picture: its source, what stands under it, and what it shows in words."""

    source: str
    caption: str
    alternative: str


@dataclass(frozen=True)
class Figure:
    """Rows of pictures under one heading; a row has one picture per column."""

    title: str
    text: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Panel, ...]], ...]


STEPS = ("changes in the scan", "its mixture", "what is called novel")
"""The columns of Fig. 11, 12, 16 and 17: (b), (c) and (d)."""

MARKS = (
    "Changed points and novel components are orange; ellipses are drawn at 1.5 standard deviations, but for those at "
    "the ceiling, which is cut off."
)


def static_figure(outcome: Outcome) -> Figure:
    """Fig. 11."""
    cases = ("door opened", "person", "door closed")
    rows = [(f"{case}, {method.title}", example) for case in cases for method in (EMD, ALONE[0])
            for example in outcome.examples_of("static_platform", case, "K_max 20", method.key)[:1]]  # fmt: skip
    return _steps("Fig. 11: the static platform", f"K_max = 20. {MARKS}", rows)


def mobile_figure(outcome: Outcome) -> Figure:
    """Fig. 12, on the area of interest."""
    cases = ("cylinder", "person", "box")
    rows = [(f"{case}, {method.title}", example) for case in cases for method in (EMD, ALONE[0])
            for example in outcome.examples_of("mobile_platform", case, printed.AREA, method.key)[:1]]  # fmt: skip
    return _steps("Fig. 12: the mobile platform, up to 1.5 m", f"K_max = 20. {MARKS}", rows)


def sensitivity_figure(outcome: Outcome, experiment: str) -> Figure:
    """Fig. 16 (boxes) or 17 (viewpoints): the first map and the last."""
    case, title = {
        BOX_SIZE: ("box", "Fig. 16: boxes of two sizes"),
        VIEWPOINT: ("person", "Fig. 17: a person from two viewpoints"),
    }[experiment]
    found = outcome.examples_of(experiment, case, SELECTED.name, EMD.key)
    rows = [(_told(example), example) for example in found]
    return _steps(title, f"{EMD.title}, order selected by MDL below 20. {MARKS}", rows)


def corridor_figure(outcome: Outcome) -> Figure:
    """Fig. 5."""
    found = outcome.examples_of("ideal_corridor", "box", "K_max 20", EMD.key)[:1]
    return _steps("Fig. 5: the synthetic corridor", f"{EMD.title}. {MARKS}", [("box", e) for e in found])


def frontal_figure(outcome: Outcome) -> Figure:
    """Fig. 15: the complete data from the front; the ceiling takes most of the Gaussians."""
    panels = []
    for example in outcome.examples_of("mobile_platform", "person", printed.COMPLETE, EMD.key)[:1]:
        points = example.scan.points
        view = View.from_front(points)
        weights = example.mixture.means[0, :, 2].numpy() > 0.8 * np.percentile(points[:, 2], 99)
        above = int(weights.sum())
        colours = {
            k: ADDED if bool(example.novel[k]) else DARK
            for k in range(int(example.mixture.num_components[0]))
        }
        picture = Picture(view).points(points, truth_colours(_changed(example)), every=_every(points))
        source = picture.ellipses(example.mixture, colours).source(points)
        caption = f"{above} of {len(colours)} components lie at the ceiling."
        panels.append(Panel(source, caption, "Mixture of a corridor seen from its end, with the ceiling."))
    return Figure(
        "Fig. 15: the complete data from the front",
        "K_max = 16.",
        ("",),
        tuple(("person", (panel,)) for panel in panels),
    )


def segmentation_figure(segmentations: Segmentations) -> Figure:
    """Fig. 13 and 14: every segmentation of every static scene."""
    cases = tuple(dict.fromkeys(example.case for example in segmentations.examples))
    rows = []
    for case in cases:
        own = [example for example in segmentations.examples if example.case == case]
        view = View.from_corner(own[0].points)
        truth = Picture(view, SMALL).points(
            own[0].points, truth_colours(own[0].changed), size=4, every=_every(own[0].points)
        )
        panels = [
            Panel(
                truth.source(own[0].points),
                f"{own[0].changed.sum()} points",
                f"Scan of {case}, the change marked.",
            )
        ]
        for example in own:
            picture = Picture(view, SMALL).points(
                example.points, cluster_colours(example.clusters), size=4, every=_every(example.points)
            )
            row = next(r for r in segmentations.rows if (r.case, r.method) == (case, example.method))
            caption = f"{row.clusters} clusters, attainable κ {row.kappa:.2f}, {row.seconds:.2f} s"
            alternative = f"Scan of {case} in clusters: {TITLES[example.method]}."
            panels.append(Panel(picture.source(example.points), caption, alternative))
        rows.append((case, tuple(panels)))
    return Figure(
        "Fig. 13 and 14: mixtures beside Loménie's partition",
        "Every cluster has a colour. The attainable κ is that of the clusters which are best called novel, knowing the "
        "truth: near 0, the change shares its cluster with the wall.",
        ("the change", *TITLES.values()),
        tuple(rows),
    )


def simplification_figure(example: SimplificationExample) -> Figure:
    """Fig. 4: the original cloud in yellow, the simplified one in black."""
    view = View.from_corner(example.points, cut_ceiling=False)
    picture = (
        Picture(view).points(example.points, "#e5b800", every=1).points(example.kept, "#222222", size=2.5)
    )
    share = len(example.kept) / len(example.points)
    caption = f"{len(example.points)} points, of which {share:.0%} are kept at σ_max = {LIMIT:g}."
    panel = Panel(picture.source(example.points), caption, "Hills of points, denser where they are curved.")
    return Figure(
        "Fig. 4: simplification",
        "Original points are yellow, those that are kept dark.",
        ("",),
        (("", (panel,)),),
    )


def _steps(title: str, text: str, rows: Sequence[tuple[str, Example]]) -> Figure:
    return Figure(title, text, STEPS, tuple((name, _step_panels(example)) for name, example in rows))


def _step_panels(example: Example) -> tuple[Panel, ...]:
    points, changed = example.scan.points, _changed(example)
    view, every = View.from_corner(points), _every(points)
    count = int(example.mixture.num_components[0])
    novel = [k for k in range(count) if bool(example.novel[k])]
    scan = Picture(view).points(points[~changed], GREY, every=every).points(points[changed], ADDED, size=3)
    colours = {k: ADDED if k in novel else CLUSTERS[k % len(CLUSTERS)] for k in range(count)}
    mixture = (
        Picture(view).points(points, "#aab2bb", size=0.9, every=every).ellipses(example.mixture, colours)
    )
    called = example.labels
    found = (
        Picture(view)
        .points(points[~called], "#b9c0c8", size=0.9, every=every)
        .points(points[called], ADDED, size=2.4)
    )
    found.ellipses(example.mixture, dict.fromkeys(novel, ADDED), filled=False)
    what = example.member.case.name
    return (
        Panel(scan.source(points), f"{int(changed.sum())} points have changed", f"Scan: {what}."),
        Panel(mixture.source(points), _counted(count), f"Mixture of the scan: {what}."),
        Panel(
            found.source(points),
            f"{_counted(len(novel))}, {int(called.sum())} points",
            f"What is called novel: {what}.",
        ),
    )


def _counted(components: int) -> str:
    return f"{components} component{'' if components == 1 else 's'}"


def _changed(example: Example) -> NDArray[np.bool_]:
    assert example.scan.labels is not None
    return example.scan.labels == CHANGED


def _every(points: NDArray[np.float64]) -> int:
    return max(1, round(len(points) / MOST_POINTS))


def _told(example: Example) -> str:
    varied = example.member.case.varied
    if "object_size" in varied:
        return f"box of {varied['object_size']:g} m"
    ahead, left, turn = varied["viewpoint"]
    return f"sensor {ahead:g} m ahead, {left:g} m to the left, turned by {turn:g}°"
