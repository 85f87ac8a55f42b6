"""Centre and scale every cloud before any arithmetic, and set its covariance floor.

Maps live at 5e5 m: in float32, E[xx] - mm would give a variance of 1e7 instead of 4 there. Every cloud is moved to its
coordinate-wise median and divided by its robust extent (the median distance to that centre, not the RMS, which one
far outlier would inflate). Both are read from at most 1 024 points, evenly spaced in the cloud's order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from gmmtorch.clouds import PointClouds
from gmmtorch.errors import Status

__all__ = ["NormalizedClouds", "normalize", "subsample"]

_SAMPLE = 1024
_SMALLEST_FLOOR = 1e-10  # of the extent: below it, float64 covariances of exact planes lose their last digit


@dataclass(frozen=True)
class NormalizedClouds:
    """Clouds in units of their own extent, without the points that do not count.

    Attributes:
        clouds: points of positive weight, centred and scaled; empty for clouds that cannot be fitted.
        center: what was subtracted (B, D), m.
        scale: what the points were divided by (B,), m.
        floor: standard deviation delta of the covariance floor (B,), in units of the extent.
        status: outcome so far (B,), on the host.
    """

    clouds: PointClouds
    center: Tensor
    scale: Tensor
    floor: Tensor
    status: tuple[Status, ...]

    def take(self, clouds: Sequence[int]) -> NormalizedClouds:
        """These clouds (B',), in this order; a cloud may repeat."""
        rows = torch.tensor(clouds, device=self.scale.device)
        status = tuple(self.status[b] for b in clouds)
        return NormalizedClouds(
            self.clouds.select(clouds), self.center[rows], self.scale[rows], self.floor[rows], status
        )

    @property
    def log_volume(self) -> Tensor:
        """Nats per unit weight by which a density per m^D is below one per extent^D (B,)."""
        return self.clouds.dim * self.scale.log()


def normalize(clouds: PointClouds, min_std: float | None, relative_floor: float) -> NormalizedClouds:
    """Centre, scale and clean a batch; synchronises the device, once per call.

    Args:
        clouds: the batch, m.
        min_std: absolute covariance floor, m; None for none.
        relative_floor: covariance floor in units of the cloud's robust extent.
    """
    cleaned, status = _drop_useless_points(clouds)
    center, extent = _center_and_extent(cleaned)
    status = tuple(
        Status.IDENTICAL_POINTS if s is Status.OK and e == 0 else s
        for s, e in zip(status, extent.tolist(), strict=True)
    )
    scale = torch.where(extent > 0, extent, 1.0)
    floor = torch.full_like(scale, max(relative_floor, _SMALLEST_FLOOR))
    if min_std is not None:
        floor = torch.maximum(floor, min_std / scale)
    index = cleaned.cloud_index
    points = (cleaned.points - center[index]) / scale[index, None]
    spreads = None if cleaned.spreads is None else cleaned.spreads / scale[index, None, None] ** 2
    moved = PointClouds(points, cleaned.weights, spreads, cleaned.offsets, cleaned.dtype)
    return NormalizedClouds(moved, center, scale, floor, status)


def subsample(clouds: PointClouds, size: int) -> tuple[Tensor, Tensor]:
    """Point indices floor(s N_b / S_b), s < S_b = min(size, N_b), of every cloud.

    Returns:
        Packed point indices (B, S) int64, 0 where there is none, and their mask (B, S) bool.
    """
    sizes = torch.tensor(clouds.sizes, device=clouds.device)[:, None]
    starts = torch.tensor(clouds.offsets[:-1], device=clouds.device)[:, None]
    length = min(size, max(clouds.sizes))
    counts = sizes.clamp_max(length)
    steps = torch.arange(length, device=clouds.device)
    mask = steps < counts
    index = starts + steps * sizes // counts.clamp_min(1)
    return torch.where(mask, index, 0), mask


def weighted_median(values: Tensor, weights: Tensor) -> Tensor:
    """Smallest value with at least half of the weight at or below it, along axis 1: (B, S, ...) -> (B, ...)."""
    ordered, order = values.sort(dim=1)
    weights = weights.reshape(weights.shape + (1,) * (values.ndim - 2)).expand_as(values)
    cumulative = torch.take_along_dim(weights, order, dim=1).cumsum(1)
    below = (cumulative < 0.5 * cumulative[:, -1:]).sum(1, keepdim=True)
    return torch.take_along_dim(ordered, below.clamp_max(values.shape[1] - 1), dim=1).squeeze(1)


def _drop_useless_points(clouds: PointClouds) -> tuple[PointClouds, tuple[Status, ...]]:
    """Drop points of weight 0, and all points of clouds that hold a value that is not finite."""
    finite = clouds.points.isfinite().all(1) & clouds.weights.isfinite()
    if clouds.spreads is not None:
        finite &= clouds.spreads.isfinite().all(-1).all(-1)
    positive = clouds.weights > 0
    broken = [
        bool((~f & (w != 0)).any()) for f, w in zip(clouds.split(finite), clouds.split(positive), strict=True)
    ]
    keep = positive & ~torch.tensor(broken, dtype=torch.bool, device=clouds.device)[clouds.cloud_index]
    sizes = [int(k.sum()) for k in clouds.split(keep)]
    status = tuple(
        Status.NON_FINITE if bad else Status.EMPTY if n == 0 else Status.OK
        for bad, n in zip(broken, sizes, strict=True)
    )
    if sum(sizes) == clouds.points.shape[0]:
        return clouds, status
    offsets = [0]
    for n in sizes:
        offsets.append(offsets[-1] + n)
    spreads = None if clouds.spreads is None else clouds.spreads[keep]
    return PointClouds(
        clouds.points[keep], clouds.weights[keep], spreads, tuple(offsets), clouds.dtype
    ), status


def _center_and_extent(clouds: PointClouds) -> tuple[Tensor, Tensor]:
    """Robust centre (B, D) and extent (B,) of every cloud, m; an extent of 0 means that all points are one."""
    center = clouds.points.new_zeros(clouds.batch_size, clouds.dim)
    if max(clouds.sizes) == 0:
        return center, center[:, 0]
    index, mask = subsample(clouds, _SAMPLE)
    weights = torch.where(mask, clouds.weights[index], 0.0)
    center = weighted_median(torch.where(mask[..., None], clouds.points[index], torch.inf), weights)
    center = torch.where(mask.any(1, keepdim=True), center, 0.0)
    squared = (clouds.points[index] - center[:, None]).square().sum(-1)  # (B, S)
    if clouds.spreads is not None:
        squared = squared + clouds.spreads.diagonal(dim1=1, dim2=2).sum(-1)[index]
    extent = weighted_median(torch.where(mask, squared, torch.inf), weights).sqrt()
    if bool((extent == 0).any()):
        extent = torch.where(extent > 0, extent, _root_mean_square(clouds, center))
    return center, torch.where(mask.any(1), extent, 0.0)


def _root_mean_square(clouds: PointClouds, center: Tensor) -> Tensor:
    """RMS distance of all points to the centre (B,), m: the extent when half of the points are one and the same."""
    squared = (clouds.points - center[clouds.cloud_index]).square().sum(1)
    if clouds.spreads is not None:
        squared = squared + clouds.spreads.diagonal(dim1=1, dim2=2).sum(-1)
    weighted = torch.stack([v.sum() for v in clouds.split(squared * clouds.weights)])
    return (weighted / clouds.total_weights.clamp_min(torch.finfo(torch.float64).tiny)).sqrt()
