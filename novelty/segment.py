"""From novel components to novel points: ChoosePtsfromGaussian of Algorithm 2, over all pairs at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import torch
from pydantic import Field

from gmmtorch import GaussianMixtures, PointClouds
from novelty.detectors import ComponentNovelty, PointNovelty
from novelty.result import PointState
from novelty.section import section


@section
class Segment:
    """How points follow the components (ChoosePtsfromGaussian)."""

    rule: Literal["map", "posterior"] = Field(
        default="map",
        description="A point is novel when its most probable component is (map), or when the posterior of a novel "
        "component exceeds `posterior_threshold` (posterior).",
    )
    posterior_threshold: float = Field(
        default=0.5, ge=0, lt=1, description="Threshold of the rule `posterior`."
    )
    min_points: int = Field(
        default=20,
        ge=1,
        description="Novel points that touch fewer others than this are taken for noise and called unchanged.",
    )


@dataclass(frozen=True, eq=False)
class SegmentedPoints:
    """The examined points of B scans, packed as in the clouds they came from.

    Attributes:
        states: uint8 (N,), see `PointState`.
        scores: float64 (N,), higher = more novel.
        p_values: float64 (N,), probability of a score at least as high without any change; NaN where not known.
        components: int64 (N,), argmax_k of the responsibilities, -1 where points were judged without components.
        overlaps: float64 (B, K, K), sum_n r_nk r_nl / min(sum_n r_nk, sum_n r_nl): what two components share.
        counts: int64 (B, K), points whose most probable component is k.
    """

    states: torch.Tensor
    scores: torch.Tensor
    p_values: torch.Tensor
    components: torch.Tensor
    overlaps: torch.Tensor
    counts: torch.Tensor

    @property
    def labels(self) -> torch.Tensor:
        """Bool (N,), True for novel points."""
        return (self.states == PointState.NOVEL) | (self.states == PointState.MOVED)


def segment_points(
    points: PointClouds, mixtures: GaussianMixtures, novelty: ComponentNovelty, settings: Segment
) -> SegmentedPoints:
    """Label every examined point by the component it belongs to (ChoosePtsfromGaussian, Algorithm 2, line 10)."""
    posterior = mixtures.posterior(points)
    responsibilities, components = (
        posterior.responsibilities,
        posterior.components.clamp_min(0),
    )  # (N, K), (N,)
    owner = points.cloud_index  # (N,)
    if settings.rule == "map":
        labels = novelty.novel[owner, components]
    else:
        above = responsibilities > settings.posterior_threshold
        labels = (above & novelty.novel[owner]).any(dim=1)
    scores = novelty.point_scores
    return SegmentedPoints(
        states=states_of(labels),
        scores=novelty.scores[owner, components] if scores is None else scores,
        p_values=_p_values(novelty, owner, components),
        components=components,
        overlaps=_overlaps(points, responsibilities),
        counts=_counts(owner, components, mixtures),
    )


def label_points(points: PointClouds, novelty: PointNovelty) -> SegmentedPoints:
    """Take over the labels of a comparison that was made point by point; no point has a component."""
    none = novelty.scores.new_zeros((len(points), 1))
    return SegmentedPoints(
        states=states_of(novelty.novel),
        scores=novelty.scores,
        p_values=torch.full_like(novelty.scores, torch.nan),
        components=torch.full(novelty.novel.shape, -1),
        overlaps=none[:, :, None],
        counts=none.long(),
    )


def states_of(labels: torch.Tensor) -> torch.Tensor:
    """`PointState` NOVEL where True, UNCHANGED elsewhere, uint8 (N,)."""
    return torch.where(labels, int(PointState.NOVEL), int(PointState.UNCHANGED)).to(torch.uint8)


def _p_values(novelty: ComponentNovelty, owner: torch.Tensor, components: torch.Tensor) -> torch.Tensor:
    """P-values of points (N,): their own, those of their components, or NaN."""
    if novelty.point_p_values is not None:
        return novelty.point_p_values
    if novelty.p_values is not None:
        return novelty.p_values[owner, components]
    return torch.full(owner.shape, torch.nan, dtype=novelty.scores.dtype)


def _overlaps(points: PointClouds, responsibilities: torch.Tensor) -> torch.Tensor:
    pieces = points.split(responsibilities)
    shared = torch.stack([piece.T @ piece for piece in pieces])  # (B, K, K)
    mass = torch.stack([piece.sum(dim=0) for piece in pieces])  # (B, K)
    least = torch.minimum(mass[:, :, None], mass[:, None, :])
    return torch.where(least > 0, shared / least, torch.zeros_like(shared))


def _counts(owner: torch.Tensor, components: torch.Tensor, mixtures: GaussianMixtures) -> torch.Tensor:
    batch_size, num_components = mixtures.weights.shape
    flat = torch.bincount(owner * num_components + components, minlength=batch_size * num_components)
    return flat.reshape(batch_size, num_components)
