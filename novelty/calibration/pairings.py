"""Pairings of components that are known to be right or wrong, from which U_T and U_R are learnt (section 3.2).

A pairing of a component of one mixture with one of the other is *valid* when both hold unchanged points and the same
place, and *invalid* when they hold different places. Every pairing has a distance d (eq. 9), and with every valid
pairing beside it a relative difference delta (eqs. 11-12).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gmmtorch import GaussianMixtures, PointClouds
from gmmtorch.distances import covariance_distance, mean_distance
from novelty.calibration.fitted import FittedPair
from novelty.detectors import StructuralMatching
from novelty.detectors.resolution import blurred, cell_resolution
from novelty.detectors.scaled_graphs import relative_terms, scaled_mean_distance
from novelty.matching import Components, arc_terms
from novelty.preprocess import PreparedScans
from novelty.scan import UNCHANGED, Scan

Array = NDArray[np.float64]

UNCHANGED_SHARE = 0.8
"""A component is unchanged when at least this share of its points is labelled so."""

SAME_PLACE = 0.5
"""Two components hold the same place when each claims more than this share of the other's points."""


@dataclass(frozen=True, eq=False)
class Pairings:
    """Distance d and relative difference delta, one row (d, delta) per pairing and valid pairing beside it.

    Attributes:
        valid: (V, 2).
        invalid: (W, 2).
    """

    valid: Array
    invalid: Array


def pairings_of(fitted: FittedPair, detector: StructuralMatching) -> Pairings:
    """The pairings of one labelled pair, under the detector's own distances."""
    a, b = _components(fitted, detector)
    means = _mean_distances(detector)
    table = torch.maximum(means(a, b), covariance_distance(a.covariances, b.covariances))[0].numpy()
    valid, invalid = _judged(fitted)
    differences = np.maximum(
        _differences(means(a, a), means(b, b), valid, detector),
        _differences(
            covariance_distance(a.covariances, a.covariances),
            covariance_distance(b.covariances, b.covariances),
            valid,
            detector,
        ),
    )  # (K, K', V): of every pairing to every valid one
    rows = np.stack(np.broadcast_arrays(table[..., None], differences), axis=-1)
    beside = _beside(table.shape, valid)
    return Pairings(rows[valid[..., None] & beside], rows[invalid[..., None] & beside])


def _components(fitted: FittedPair, detector: StructuralMatching) -> tuple[Components, Components]:
    """The components of the current and of the reference mixture as the detector compares them."""
    resolution = cell_resolution(fitted.batch)
    if detector.resolution_floor == "none":
        resolution = torch.zeros_like(resolution)

    def floored(mixtures: GaussianMixtures) -> Components:
        return Components(mixtures.weights, mixtures.means, blurred(mixtures.covariances, resolution))

    return floored(fitted.models.current.mixtures), floored(fitted.models.reference.mixtures)


def _mean_distances(detector: StructuralMatching) -> Callable[[Components, Components], Tensor]:
    """The distance between means that the detector's scale asks for."""
    if detector.scale == "component":
        return scaled_mean_distance
    return lambda a, b: mean_distance(a.means, b.means) / detector.length_scale


def _differences(
    inner_a: Tensor, inner_b: Tensor, valid: NDArray[np.bool_], detector: StructuralMatching
) -> Array:
    """Eq. 12 of every pairing (i, j) with every valid pairing (k, l): (K, K', V)."""
    rows, columns = np.nonzero(valid)
    first = arc_terms(inner_a[0], detector.arc_terms)[:, None, rows]
    second = arc_terms(inner_b[0], detector.arc_terms)[None, :, columns]
    squared = relative_terms(first, second) if detector.scale == "component" else (first - second).abs()
    return squared.sqrt().numpy()


def _beside(shape: tuple[int, ...], valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether a pairing shares no component with a valid one (K, K', V)."""
    rows, columns = np.nonzero(valid)
    other_row = np.arange(shape[0])[:, None, None] != rows
    other_column = np.arange(shape[1])[None, :, None] != columns
    return other_row & other_column


def _judged(fitted: FittedPair) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which pairings (K, K') are valid, and which are invalid; what shares a place in part is neither."""
    current, reference = fitted.models.current.mixtures, fitted.models.reference.mixtures
    forth = _claimed(fitted.batch.current.cells, current, reference)
    back = _claimed(fitted.batch.reference.cells, reference, current).T
    exists = np.outer(current.mask[0].numpy(), reference.mask[0].numpy())
    unchanged = np.outer(
        _unchanged(fitted.pair.current, fitted.batch.current, current),
        _unchanged(fitted.pair.reference, fitted.batch.reference, reference),
    )
    valid = exists & unchanged & (np.minimum(forth, back) > SAME_PLACE)
    invalid = exists & (np.maximum(forth, back) < 1 - SAME_PLACE)
    return valid, invalid


def _claimed(cells: PointClouds, own: GaussianMixtures, other: GaussianMixtures) -> Array:
    """Share of the points of each own component that each component of the other mixture claims (K, K')."""
    held = own.responsibilities(cells) * cells.weights[:, None]
    shared = held.T @ other.responsibilities(cells)
    return (shared / held.sum(0)[:, None].clamp_min(torch.finfo(held.dtype).tiny)).numpy()


def _unchanged(scan: Scan, prepared: PreparedScans, mixtures: GaussianMixtures) -> NDArray[np.bool_]:
    """Whether the labelled points of each component (K,) are unchanged."""
    assert scan.labels is not None  # checked before the fit
    slots = mixtures.num_slots
    owner = mixtures.assign(prepared.points).numpy()
    stayed = scan.labels[prepared.kept[0]] == UNCHANGED
    counts = np.bincount(owner, minlength=slots)
    return np.bincount(owner, stayed, minlength=slots) >= UNCHANGED_SHARE * np.maximum(counts, 1)
