"""The pipeline that one would write first: Open3D to preprocess, scikit-learn's mixtures with the order by BIC, POT.

It answers the same question by the paper's Algorithm 2, with each library used as its documentation shows.
"""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from novelty.scan import Scan, ScanPair

Array = NDArray[np.float64]

VOXEL = 0.05  # m, of the variant that thins the points out first
GROUND_DISTANCE = 0.03  # m
LEAST_GROUND = 0.15  # share of the points below which a plane is not called ground


@dataclass
class PeerAnswer:
    """Labels of both scans, and seconds per stage."""

    added: NDArray[np.bool_]
    removed: NDArray[np.bool_]
    seconds: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class _Mixture:
    weights: Array
    means: Array
    predict: object


class PeerPipeline:
    """Call it with a pair; `voxel` None fits all points."""

    def __init__(self, max_components: int = 20, voxel: float | None = VOXEL) -> None:
        self.max_components, self.voxel = max_components, voxel
        self.seconds: dict[str, float] = {}

    def __call__(self, pair: ScanPair) -> PeerAnswer:
        """Label both scans of a pair."""
        self.seconds = {}
        with self._stage("preprocess"):
            reference, current = (self._examined(scan) for scan in (pair.reference, pair.current))
        with self._stage("fit"):
            before, after = (self._fit(scan.points[kept]) for scan, kept in
                             ((pair.reference, reference), (pair.current, current)))  # fmt: skip
        with self._stage("compare"):
            added, removed = _removals(after, before), _removals(before, after)
        with self._stage("segment"):
            answer = PeerAnswer(
                _labels(pair.current, current, after, added),
                _labels(pair.reference, reference, before, removed),
            )
        answer.seconds = self.seconds
        return answer

    def _examined(self, scan: Scan) -> NDArray[np.int64]:
        """Points that are neither outliers nor ground."""
        import open3d as o3d

        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(scan.points.copy()))
        cloud, kept = cloud.remove_statistical_outlier(nb_neighbors=20, std_ratio=2.0)
        kept = np.asarray(kept)
        plane, inliers = cloud.segment_plane(
            distance_threshold=GROUND_DISTANCE, ransac_n=3, num_iterations=500
        )
        if abs(plane[2]) > 0.9 and len(inliers) > LEAST_GROUND * len(kept):
            kept = np.delete(kept, inliers)
        return kept

    def _fit(self, points: Array) -> _Mixture:
        """The mixture of least BIC among the orders 1 to K_max."""
        import open3d as o3d
        from sklearn.mixture import GaussianMixture

        if self.voxel is not None:
            cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.copy()))
            points = np.asarray(cloud.voxel_down_sample(self.voxel).points)
        fits = [GaussianMixture(k, random_state=0).fit(points) for k in range(1, self.max_components + 1)]
        best = min(fits, key=lambda fit: fit.bic(points))
        return _Mixture(best.weights_, best.means_, best.predict)

    @contextmanager
    def _stage(self, name: str):
        start = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - start


def _removals(mixture: _Mixture, other: _Mixture) -> list[int]:
    """Algorithm 2: remove the component whose removal leaves the least earth mover's distance, while it falls."""
    import ot

    costs = ot.dist(mixture.means, other.means, metric="euclidean")
    left = list(range(len(mixture.weights)))
    removed: list[int] = []
    distance = _emd(ot, mixture, other, costs, left)
    while len(left) > 1:
        candidates = [(_emd(ot, mixture, other, costs, [k for k in left if k != out]), out) for out in left]
        least, out = min(candidates)
        if least >= distance:
            break
        distance = least
        left.remove(out)
        removed.append(out)
    return removed


def _emd(ot, mixture: _Mixture, other: _Mixture, costs: Array, left: list[int]) -> float:
    weights = mixture.weights[left] / mixture.weights[left].sum()
    return float(ot.emd2(weights, other.weights / other.weights.sum(), np.ascontiguousarray(costs[left])))


def _labels(scan: Scan, kept: NDArray[np.int64], mixture: _Mixture, novel: list[int]) -> NDArray[np.bool_]:
    labels = np.zeros(scan.num_points, dtype=bool)
    labels[kept] = np.isin(mixture.predict(scan.points[kept]), novel)
    return labels
