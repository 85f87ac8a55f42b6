"""Moments of groups of points, and the mixtures made of them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from gmmtorch import GaussianMixtures
from gmmtorch.components import Components


@dataclass(frozen=True, eq=False)
class Moments:
    """Moments of K groups of points of every of P scans.

    Attributes:
        counts: expected number of points (P, K); 0 for a group that is not there.
        means: (P, K, 3), m.
        covariances: (P, K, 3, 3), m^2.
    """

    counts: Tensor
    means: Tensor
    covariances: Tensor

    def only(self, chosen: Tensor) -> Moments:
        """These moments with the counts of all other groups 0; `chosen` bool (P, K)."""
        return Moments(torch.where(chosen, self.counts, 0.0), self.means, self.covariances)


def moments_of(mixtures: GaussianMixtures, points: Tensor) -> Moments:
    """Mixtures of that many points, (P,)."""
    return Moments(mixtures.weights * points[:, None], mixtures.means, mixtures.covariances)


def mixtures_of(*parts: Moments) -> GaussianMixtures:
    """One component per group of all parts, weighted by its points; the parts keep their order."""
    return packed_mixtures(
        Components.create(
            torch.cat([part.counts for part in parts], 1),
            torch.cat([part.means for part in parts], 1),
            torch.cat([part.covariances for part in parts], 1),
        )
    )


def packed_mixtures(components: Components) -> GaussianMixtures:
    """The components that are present, in order."""
    packed = components.compact(components.weights.shape[1])
    return GaussianMixtures(packed.weights, packed.means, packed.covariances, packed.num_components).trim()
