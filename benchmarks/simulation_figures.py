"""What the sensors' figures are checked by: range errors beside the data sheets, a picture of each platform's scan.

Writes `range_noise.csv` (measured standard deviation and what the data sheet says, per sensor and distance),
`range_noise.png` and `platforms.png`. Needs matplotlib.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from novelty.scan import AMBIGUOUS, CHANGED, SEEN_ONCE, UNCHANGED
from novelty.simulation import (
    RayScene,
    SimulatedPair,
    World,
    get_sensor,
    load_experiment,
    measure,
    simulate_pair,
)
from novelty.simulation.shapes import box, sphere

COLOURS = {UNCHANGED: "#8d99ae", CHANGED: "#d90429", SEEN_ONCE: "#4895ef", AMBIGUOUS: "#111111"}

MEANINGS = ("unchanged", "changed", "seen in one scan only", "not scored (glass, mixed pixels)")


@dataclass(frozen=True)
class Sheet:
    """What a data sheet says of the error of one reading.

    Attributes:
        distance: Where it says so, m.
        std: Standard deviation, or what is compared with it, m.
        words: The figure as printed.
        bound: Whether the sheet gives an upper bound of the standard deviation, not the deviation itself.
    """

    distance: float
    std: float
    words: str
    bound: bool = False


SHEETS = {
    "urg_04lx": (Sheet(1.0, 0.01, "±10 mm to 1 m"), Sheet(4.0, 0.04, "±1 % beyond")),
    "utm_30lx": (
        Sheet(5.0, 0.01, "σ < 10 mm to 10 m", True),
        Sheet(20.0, 0.03, "σ < 30 mm to 30 m", True),
    ),
    "lms_200": (Sheet(4.0, 0.005, "5 mm, 1 σ"), Sheet(8.0, 0.005, "5 mm, 1 σ")),
    "vlp_16": (Sheet(10.0, 0.012, "±3 cm typical (2.5 σ)"),),
    "hdl_32e": (Sheet(25.0, 0.02, "2 cm, 1 σ at 25 m"),),
    "kinect": (Sheet(2.0, 0.0057, "1.425 mm z²: 5.7 mm"), Sheet(4.5, 0.0289, "1.425 mm z²: 28.9 mm")),
}


def range_errors(name: str, distance: float) -> np.ndarray:
    """Errors of the readings of a surface that is everywhere at `distance`, m: a sphere; of a camera, a plane."""
    sensor = get_sensor(name)
    if name == "kinect":
        world = World().add("wall", box((distance, -9, -9), (distance + 0.1, 9, 9)))
        scan = measure(RayScene(world), sensor, np.eye(4)[None], np.random.default_rng(0))
        return scan.points[:, 0] - distance
    poses = np.repeat(np.eye(4)[None], 40 if name == "lms_200" else 1, axis=0)
    world = World().add("shell", sphere((0.0, 0.0, 0.0), 0.98 * distance))
    scan = measure(RayScene(world), sensor, poses, np.random.default_rng(0))
    return np.linalg.norm(scan.points, axis=1) - scan.ranges


def write_figures(folder: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    folder.mkdir(parents=True, exist_ok=True)
    _write_noise(folder)
    _write_platforms(folder / "platforms.png")
    print(f"\nwritten to {folder}: range_noise.csv, range_noise.png, platforms.png")


def _write_noise(folder: Path) -> None:
    from matplotlib import pyplot as plt

    panels = [(name, sheet) for name, sheets in SHEETS.items() for sheet in sheets]
    figure, axes = plt.subplots(2, -(-len(panels) // 2), figsize=(17, 6))
    with (folder / "range_noise.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(("sensor", "distance_m", "measured_std_mm", "data_sheet_mm", "data_sheet"))
        for axis, (name, sheet) in zip(axes.ravel(), panels, strict=False):
            errors = 1000 * range_errors(name, sheet.distance)
            row = (name, sheet.distance, f"{errors.std():.2f}", f"{1000 * sheet.std:.1f}", sheet.words)
            table.writerow(row)
            _histogram(axis, errors, sheet, f"{name}, {sheet.distance:g} m: {errors.std():.1f} mm")
    for axis in axes.ravel()[len(panels) :]:
        axis.set_axis_off()
    figure.tight_layout()
    figure.savefig(folder / "range_noise.png", dpi=80)


def _histogram(axis: Any, errors: np.ndarray, sheet: Sheet, title: str) -> None:
    """Errors in mm, and the normal curve (or, of a bound, its two lines) that the data sheet stands for."""
    std = 1000 * sheet.std
    span = np.linspace(-4 * std, 4 * std, 200)
    axis.hist(errors, bins=np.linspace(-4 * std, 4 * std, 61), density=True, color="#8d99ae")
    if sheet.bound:
        for side in (-std, std):
            axis.axvline(side, color="#d90429", ls="--")
    else:
        axis.plot(span, np.exp(-(span**2) / (2 * std**2)) / (std * np.sqrt(2 * np.pi)), color="#d90429")
    axis.set(title=title, xlabel=f"error, mm; data sheet: {sheet.words}", yticks=[])
    axis.title.set_fontsize(9)
    axis.xaxis.label.set_fontsize(8)


def _platform_scans() -> dict[str, SimulatedPair]:
    """A pair of every platform; the paper's three as their experiments make them."""

    def of(experiment: str, case: str) -> SimulatedPair:
        return next(pair for pair in load_experiment(experiment).pairs() if pair.case.name == case).simulate()

    return {
        "URG-04LX on a pan-tilt unit, corridor": of("static_platform", "door opened"),
        "UTM-30LX rolling, office": of("viewpoint", "person"),
        "LMS-200 push-broom, hall": of("mobile_platform", "person"),
        "VLP-16, hall": simulate_pair("hall", 100, ("person", "box"), sensor="vlp_16"),
        "HDL-32E, hall": simulate_pair("hall", 100, ("person", "box"), sensor="hdl_32e"),
        "Kinect, room": simulate_pair("room", 100, ("person", "box"), sensor="kinect"),
    }


def _write_platforms(path: Path) -> None:
    """Seen from above at a slant without the ceiling; the last panel looks along the push-broom's doubled ceiling."""
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(2, 4, figsize=(18, 8.5))
    panels = axes.ravel()
    for axis, (title, pair) in zip(panels, _platform_scans().items(), strict=False):
        scan = pair.scans.current
        below = scan.points[:, 2] < 2.3
        _draw(axis, _slanted(scan.points[below]), scan.labels[below], f"{title}\n{scan.num_points} points")
        if "push-broom" in title:
            lines = (scan.points[:, 0] > 4) & (scan.points[:, 0] < 7)
            _draw(panels[6], scan.points[lines][:, [1, 2]], scan.labels[lines], "push-broom, along the hall")
    for colour, meaning in zip(COLOURS.values(), MEANINGS, strict=True):
        panels[7].scatter([], [], c=colour, label=meaning)
    panels[7].legend(loc="center", frameon=False, markerscale=2, fontsize=11)
    panels[7].set_axis_off()
    figure.tight_layout()
    figure.savefig(path, dpi=70)


def _slanted(points: np.ndarray) -> np.ndarray:
    """Parallel projection (N, 2) from the right, 35 degrees above the horizon; far points first."""
    azimuth, elevation = np.radians([-60, 35])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    toward = np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    return np.stack([points @ right, points @ np.cross(toward, right)], axis=1)


def _draw(axis: Any, places: np.ndarray, labels: np.ndarray, title: str) -> None:
    for label, colour in COLOURS.items():
        chosen = places[labels == label]
        axis.scatter(chosen[:, 0], chosen[:, 1], s=0.4 if label == UNCHANGED else 2.0, c=colour, lw=0)
    left, bottom = places.min(axis=0)
    axis.plot([left, left + 1], [bottom - 0.25] * 2, color="#111111", lw=1.5)
    axis.annotate(
        "1 m", (left + 0.5, bottom - 0.25), (0, 2), textcoords="offset points", ha="center", fontsize=8
    )
    axis.set_title(title)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_axis_off()
