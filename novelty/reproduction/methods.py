"""What is compared: the paper's two methods as printed, ours, and those that both are measured against."""

from __future__ import annotations

from dataclasses import dataclass

from novelty.config import Config


@dataclass(frozen=True)
class Method:
    """One line of a table.

    Attributes:
        key: In rows and files.
        title: In the report.
        config: Its settings; an experiment's analysis changes them further.
        mixtures: Methods of the same word, settings of preprocessing and K_max are compared on the same mixtures, which
            are then fitted once; empty: on its own.
    """

    key: str
    title: str
    config: Config
    mixtures: str = ""


def _paper(detector: str) -> Config:
    return Config.preset("paper").replace(detector=detector)


EMD = Method("emd_paper", "EMD, as printed", _paper("greedy_emd"), "printed")
STRUCTURAL = Method("structural_paper", "Str. matching, as printed", _paper("structural_matching"), "printed")
PRINTED = (EMD, STRUCTURAL)
"""The paper's methods with its own choices throughout (`--preset paper`)."""

CALIBRATED = Method(
    "structural_calibrated",
    "Str. matching, thresholds found here",
    Config.preset("paper_calibrated"),
    "printed",
)
"""Structural matching as printed with thresholds from the printed procedure (section 3.2), see `thresholds`. Those of
the preset (`--preset paper_calibrated`) come from all the maps."""


def _step(detector: str, **settings: str) -> Config:
    return _paper(detector).replace(**{f"{detector}.{key}": value for key, value in settings.items()})


SHAPES = {
    "greedy_emd": {"ground_distance": "hellinger", "resolution_floor": "cell"},
    "structural_matching": {"scale": "component", "resolution_floor": "cell"},
}
"""Distances between components that know their shapes and the resolution of the scan."""

OWN = {"fit.unexplained_components": Config().fit.unexplained_components}
"""Components of their own for what the other scan does not explain."""


def _steps(key: str, title: str, detector: str) -> tuple[Method, ...]:
    """The printed method with one choice changed, with both, and with components of their own beside both."""
    both = _step(detector, fits="coupled", **SHAPES[detector])
    return (
        Method(
            f"{key}_common", f"{title}, + common mixture", _step(detector, fits="coupled"), "printed, common"
        ),
        Method(
            f"{key}_shapes", f"{title}, + distances of shapes", _step(detector, **SHAPES[detector]), "printed"
        ),
        Method(f"{key}_both", f"{title}, + both", both, "printed, common"),
        Method(
            f"{key}_own", f"{title}, + both + own components", both.replace(**OWN), "printed, common, own"
        ),
    )


STEPS = (
    *_steps("emd", "EMD", "greedy_emd"),
    *_steps("structural", "Str. matching", "structural_matching"),
)
"""From the printed methods towards ours."""


def _alone(detector: str) -> Config:
    settings = {"refine.method": "none", "visibility.method": "none"}
    return Config(detector=detector).replace(**settings)


ALONE = (
    Method("emd_alone", "EMD, ours unrefined", _alone("greedy_emd"), "coupled"),
    Method("structural_alone", "Str. matching, ours unrefined", _alone("structural_matching"), "coupled"),
)
"""Both with our mixtures and distances, on registered scans; every point follows its component."""

OURS = (
    Method("emd", "EMD, ours", Config(detector="greedy_emd"), "coupled"),
    Method("structural", "Str. matching, ours", Config(detector="structural_matching"), "coupled"),
    Method(Config().detector, f"{Config().detector}, the default", Config()),
)
"""The same two and the default detector as `novelty detect` runs them: refined, and judged by visibility."""

CLUSTERINGS = (
    Method("kmeans_paper", "k-means clusters + EMD", _paper("kmeans_mixture")),
    Method("fuzzy_paper", "Loménie's clusters + EMD", _paper("fuzzy_partition")),
)
"""Other clusterings in the place of the mixtures, compared by Algorithm 2 as printed."""

POINTWISE = (
    Method("nearest_neighbour", "nearest neighbour (C2C)", Config(detector="nearest_neighbour")),
    Method("voxel_difference", "voxel difference", Config(detector="voxel_difference")),
)
"""Comparisons of points."""

M3C2 = Method("m3c2", "M3C2", Config(detector="m3c2"))
"""Another, where the extra [baselines] is installed."""
