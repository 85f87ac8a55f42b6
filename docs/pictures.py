"""The pictures of `docs/method.md`: `python docs/pictures.py` writes them to `docs/images`.

One simulated corridor before and after a person and a box appear; what every step makes of it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from gmmtorch import GaussianMixtures
from novelty import Config, detect
from novelty.config import detector_names
from novelty.fitting import FitPlan
from novelty.preprocess import PreparedPairs, prepare_pairs
from novelty.report.views import ADDED
from novelty.reproduction.drawing import CLUSTERS, GREY, Picture, View
from novelty.scan import CHANGED
from novelty.simulation import corridor_pair

IMAGES = Path(__file__).parent / "images"


def main() -> None:
    """Write all pictures."""
    pair = corridor_pair(seed=3, changes=("person", "box"), noise=0.01, density=0.5)
    batch = prepare_pairs([pair], Config().preprocess)
    points = batch.current.points.points.numpy()
    changed = pair.current.labels[batch.current.kept[0]] == CHANGED
    view = View.from_corner(points)
    scan = Picture(view).points(points[~changed], GREY).points(points[changed], ADDED, size=3)
    write("scan", scan, points)
    cells = batch.current.cells
    shades = np.where(cells.weights.numpy() > 10, "#3b4754", "#c07a2c")
    write("cells", Picture(view).points(cells.points.numpy(), shades, size=6), points)
    for name, config in {
        "independent": Config.preset("paper"),
        "coupled": Config(detector="greedy_emd"),
    }.items():
        write(name, mixture(view, points, batch, config), points)
    for name in detector_names():
        write(name, scores(view, points, batch, Config(detector=name)), points)
    labels = detect(pair).added.point_labels
    given = pair.current.points
    answer = Picture(view).points(given[~labels], "#b9c0c8", size=0.9).points(given[labels], ADDED, size=3)
    write("answer", answer, points)


def mixture(view: View, points: np.ndarray, batch: PreparedPairs, config: Config) -> Picture:
    """The components of the current scan."""
    models = config.chosen_detector.fit(batch, FitPlan(config.fit, config.max_components, config.seed))
    fitted = models.current.mixtures
    colours = {k: CLUSTERS[k % len(CLUSTERS)] for k in range(int(fitted.num_components[0]))}
    return Picture(view).points(points, "#aab2bb", size=0.9).ellipses(fitted, colours)


def scores(view: View, points: np.ndarray, batch: PreparedPairs, config: Config) -> Picture:
    """The components of the current scan, shaded by their scores; novel ones are filled."""
    detector = config.chosen_detector
    models = detector.fit(batch, FitPlan(config.fit, config.max_components, config.seed))
    added = detector.compare(batch, models).added
    picture = Picture(view).points(points, "#b9c0c8", size=0.9)
    fitted: GaussianMixtures = models.current.mixtures
    shades = shaded(added.scores[0, : int(fitted.num_components[0])])
    novel = {k: shade for k, shade in enumerate(shades) if bool(added.novel[0, k])}
    picture.ellipses(fitted, {k: shade for k, shade in enumerate(shades) if k not in novel}, filled=False)
    return picture.ellipses(fitted, novel)


def shaded(values: torch.Tensor) -> list[str]:
    """From blue for the least value to orange for the greatest, by rank."""
    from matplotlib.colors import LinearSegmentedColormap, to_hex

    ranks = values.nan_to_num(-torch.inf).argsort().argsort().double() / max(len(values) - 1, 1)
    colours = LinearSegmentedColormap.from_list("scores", ["#2b7de9", "#9aa3ad", ADDED])
    return [to_hex(colours(rank)) for rank in ranks.tolist()]


def write(name: str, picture: Picture, points: np.ndarray) -> None:
    """Write one picture."""
    IMAGES.mkdir(exist_ok=True)
    (IMAGES / f"method-{name.replace('_', '-')}.png").write_bytes(picture.encoded(points, "png"))


if __name__ == "__main__":
    main()
