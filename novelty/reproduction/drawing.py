"""Pictures of scans and mixtures, seen from a corner without perspective, drawn by Matplotlib."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmmtorch import GaussianMixtures
from novelty.errors import MissingDependencyError
from novelty.report.frame import AXES, Frame
from novelty.report.views import ADDED, SIGMAS

WIDTH, DPI = 4.6, 110
"""Of a picture: inches, dots per inch."""

GREY, DARK = "#7d8894", "#3b4754"
CLUSTERS = (
    "#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#bbbbbb", "#7a5c3e", "#5d4a9e", "#8fbf6f",
    "#994455", "#6699cc", "#997700", "#004488", "#ee99aa", "#44aa99", "#ddcc77", "#882255", "#117733", "#cc6677",
)  # fmt: skip
"""Told apart by most people with a deficiency of colour vision, as far as twenty colours can be (Tol 2021)."""


@dataclass(frozen=True, eq=False)
class View:
    """From where a scene is seen: two unit vectors of the picture (2, 3), and the height above which it is cut off."""

    axes: NDArray[np.float64]
    top: float

    @classmethod
    def from_corner(cls, points: NDArray[np.float64], cut_ceiling: bool = True) -> View:
        """The view that a report takes of these points (N, 3), without the ceiling unless asked otherwise."""
        frame = Frame.around([points])
        camera = frame.layout("m")["camera"]
        eye, up = (np.array([camera[name][axis] for axis in AXES]) for name in ("eye", "up"))
        return cls(_picture_axes(eye, up), frame.top + frame.shift[2] if cut_ceiling else np.inf)

    @classmethod
    def from_front(cls, points: NDArray[np.float64]) -> View:
        """Along the longer side of the scene, a little from above, ceiling included."""
        size = np.ptp(points[:, :2], axis=0)
        eye = np.array([-1.0, 0.25, 0.35]) if size[0] >= size[1] else np.array([0.25, -1.0, 0.35])
        return cls(_picture_axes(eye, np.array([0.0, 0.0, 1.0])), np.inf)

    def below(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which of the points (N, 3) are shown."""
        return points[:, 2] <= self.top

    def project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places (N, 2) of points (N, 3) in the picture, m."""
        return points @ self.axes.T


class Picture:
    """One picture, drawn layer by layer; its scale is written in points of `text_size`."""

    def __init__(self, view: View, text_size: float = 9.0) -> None:
        self.view = view
        self.text_size = text_size
        figure = matplotlib_figure()
        self._figure = figure(figsize=(WIDTH, WIDTH), dpi=DPI)
        self._axes = self._figure.add_axes((0, 0, 1, 1))
        self._axes.set_aspect("equal")
        self._axes.axis("off")

    def points(self, points: NDArray[np.float64], colour: Any, size: float = 1.6, every: int = 1) -> Picture:
        """Points (N, 3) in one colour, or a colour each (N,)."""
        shown = self.view.below(points)
        places = self.view.project(points[shown])[::every]
        colours = colour if isinstance(colour, str) else np.asarray(colour)[shown][::every]
        self._axes.scatter(*places.T, s=size, c=colours, marker=".", linewidths=0, rasterized=True)
        return self

    def ellipses(self, mixture: GaussianMixtures, colours: dict[int, str], filled: bool = True) -> Picture:
        """Components (of a batch of one) at 1.5 standard deviations, those whose number has a colour."""
        from matplotlib.patches import Ellipse

        means, covariances = mixture.means[0].numpy(), mixture.covariances[0].numpy()
        places, flat = self.view.project(means), self.view.axes @ covariances @ self.view.axes.T
        for k, colour in colours.items():
            if means[k, 2] > self.view.top:
                continue
            variances, axes = np.linalg.eigh(flat[k])
            width, height = 2 * SIGMAS * np.sqrt(np.maximum(variances, 0))
            angle = float(np.degrees(np.arctan2(axes[1, 0], axes[0, 0])))
            face = (*_rgb(colour), 0.28) if filled else "none"
            self._axes.add_patch(Ellipse(places[k], width, height, angle=angle, fc=face, ec=colour, lw=1.1))
        return self

    def encoded(self, frame_of: NDArray[np.float64], kind: str = "webp") -> bytes:
        """The picture as a file, `webp` or `png`.

        Args:
            frame_of: Points (N, 3) that have to be in it, so that pictures of one scene agree.
            kind: Of file.
        """
        self._fit(self.view.project(frame_of[self.view.below(frame_of)]))
        buffer = io.BytesIO()
        options = {"quality": 85, "method": 3} if kind == "webp" else {}
        self._figure.savefig(buffer, format=kind, transparent=kind == "webp", pil_kwargs=options)
        return buffer.getvalue()

    def source(self, frame_of: NDArray[np.float64]) -> str:
        """The picture as the source of an image in a page that stands alone."""
        return f"data:image/webp;base64,{base64.b64encode(self.encoded(frame_of)).decode('ascii')}"

    def _scale_bar(self, left: float, bottom: float, most: float) -> None:
        """A line of a round length, m, at the lower left; true for lengths that lie in the plane of the picture."""
        length = _round_length(most)
        self._axes.plot([left, left + length], [bottom, bottom], color=DARK, lw=1.6, solid_capstyle="butt")
        self._axes.annotate(
            f"{length:g} m",
            (left + length / 2, bottom),
            (0, 3),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=self.text_size,
            color=DARK,
        )

    def _fit(self, places: NDArray[np.float64]) -> None:
        """Cut the picture to what it shows."""
        low, high = np.percentile(places, (0.5, 99.5), axis=0)
        margin = 0.04 * (high - low).max()
        (left, bottom), (right, top) = low - margin, high + margin
        self._axes.set_xlim(left, right)
        self._axes.set_ylim(bottom, top)
        self._scale_bar(left + margin / 2, bottom + margin / 2, 0.2 * (right - left))
        self._figure.set_size_inches(WIDTH, WIDTH * min((top - bottom) / (right - left), 1.2))


def _round_length(most: float) -> float:
    """The greatest of 1, 2 and 5 times a power of ten up to a length, m."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(max(step * power for step in (1, 2, 5) if step * power <= most))


def cluster_colours(clusters: NDArray[np.int64]) -> NDArray[np.str_]:
    """The colour of every point by its cluster; grey for points without one (-1)."""
    palette = np.array([*CLUSTERS, GREY])
    return palette[np.where(clusters < 0, len(CLUSTERS), clusters % len(CLUSTERS))]


def truth_colours(changed: NDArray[np.bool_]) -> NDArray[np.str_]:
    """Changed points in the colour of what was added, the others grey."""
    return np.where(changed, ADDED, GREY)


def _picture_axes(eye: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    ahead = -eye / np.linalg.norm(eye)
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(right, ahead)])


def _rgb(colour: str) -> tuple[float, ...]:
    return tuple(int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))


def matplotlib_figure() -> Any:
    """Matplotlib's figure, without a window.

    Raises:
        MissingDependencyError: It is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError(
            "Pictures need Matplotlib. Run: pip install 'novelty-gmm[figures]'"
        ) from error
    return Figure
