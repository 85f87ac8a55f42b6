"""A scan compared with a map: the stages of `novelty.detect` with the map in the place of the reference scan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from novelty.config import Config
from novelty.errors import ConfigError, InputError
from novelty.fitting import FitPlan
from novelty.maps.scene_map import SceneMap
from novelty.pipeline import Clock, compare_prepared
from novelty.preprocess import PreparedPairs, PreparedScans, check_scan, metres_per, prepare
from novelty.result import Change, NoveltyResult, PointState
from novelty.scan import Scan, ScanPair


@dataclass(frozen=True, eq=False)
class MapComparison:
    """A scan compared with a map: the scan as it was prepared, in its own frame, and the answer."""

    current: PreparedScans
    result: NoveltyResult


def detect_against(scene_map: SceneMap, scan: Scan, config: Config | None = None) -> NoveltyResult:
    """Find what is new and what is gone in a scan of a place of which there is a map.

    Args:
        scene_map: The place as it was.
        scan: The place as it is now, in the frame and the unit of the map.
        config: Settings of the comparison; how the scan is prepared is the map's affair.

    Returns:
        What `novelty.detect` gives, but `removed` speaks of the map's cells: its arrays have one entry for each of the
        M points of `scene_map.as_scan()`. Objects count the points that the cells stand for.

    Raises:
        InputError: The scan has no answer, or its unit is not the map's.
        ConfigError: The settings prepare scans otherwise than the map was made.
    """
    return compare(scene_map, scan, config).result


def compare(scene_map: SceneMap, scan: Scan, config: Config | None = None) -> MapComparison:
    """What `detect_against` does, with the prepared scan."""
    config = scene_map.config if config is None else _agreed(scene_map, config)
    check_scan(scan)
    clock = Clock()
    with clock.stage("preprocess"):
        current = prepare([scan], config.preprocess, config.unit, [scene_map.ground])
        reference = scene_map.prepared()
    plan = FitPlan(config.fit, config.max_components, config.seed, reference=scene_map.model)
    drawn = Scan(reference.points.points.numpy() / metres_per(config.unit), name=scene_map.name)
    pair = ScanPair(drawn, scan, scan.name)
    result = compare_prepared([pair], PreparedPairs(reference, current), plan, config, clock)[0]
    removed = _by_cell(result.removed, reference.cell_of_point.numpy())
    return MapComparison(current, replace(result, removed=removed))


def _agreed(scene_map: SceneMap, config: Config) -> Config:
    """The settings with the map's way of preparing scans."""
    if config.unit != scene_map.unit:
        raise InputError(
            f"the map {scene_map.name!r} was made from scans in {scene_map.unit}, the settings say {config.unit}; set "
            f"unit to {scene_map.unit}, or make a map from scans in {config.unit}."
        )
    if config.preprocess not in (Config().preprocess, scene_map.config.preprocess):
        raise ConfigError(
            "preprocess: a map brings the settings it was made with; leave them out, or make the map again with these."
        )
    return replace(config, preprocess=scene_map.config.preprocess)


def _by_cell(change: Change, cell: NDArray[np.int64]) -> Change:
    """What holds for most of the points of every cell; components and objects stay."""
    size = np.bincount(cell)
    states = most_common(change.point_states, cell).astype(np.uint8)
    return replace(
        change,
        point_labels=(states == PointState.NOVEL) | (states == PointState.MOVED),
        point_states=states,
        point_scores=np.bincount(cell, change.point_scores) / size,
        point_p_values=np.bincount(cell, change.point_p_values) / size,
        point_components=most_common(change.point_components, cell),
        point_objects=most_common(change.point_objects, cell),
    )


def most_common(values: NDArray[np.generic], cell: NDArray[np.int64]) -> NDArray[np.int64]:
    """The value that most of the points of every cell have: (N,), (N,) -> (M,)."""
    kinds, kind = np.unique(values, return_inverse=True)
    counts = np.zeros((int(cell.max(initial=-1)) + 1, len(kinds)), dtype=np.int64)
    np.add.at(counts, (cell, kind), 1)
    return kinds[counts.argmax(axis=1)].astype(np.int64)
