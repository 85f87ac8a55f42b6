"""Novelty by counts: components of one mixture for both scans that one of the scans hardly fills.

Each component has two expected counts of points. Where nothing changed they stand in one ratio, that of the scans'
densities, up to what viewpoint and sampling do to it. How far ratios stray without a change is read off the stable
components themselves: 100 000 correlated points would reject anything if they were taken as independent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from pydantic import Field
from scipy.special import betainc, expit
from torch import Tensor

from gmmtorch import GaussianMixtures
from gmmtorch.distances import hellinger_distance, mean_distance
from novelty.detectors.balance import balanced_median, log_density_ratio, pooled_cells, pooled_counts
from novelty.detectors.base import Comparison, ComponentNovelty, Detector
from novelty.detectors.empty import empty_side_notes
from novelty.detectors.p_values import NORMAL_NODES, NORMAL_WEIGHTS, least_p_value
from novelty.detectors.quantiles import MAD_TO_STD
from novelty.detectors.shared_mixture import fit_shared
from novelty.fitting import FitPlan, Models
from novelty.preprocess.prepared import PreparedPairs
from novelty.section import section


@section
class JointMixture(Detector):
    """A component of one mixture for both scans is novel when one of them hardly fills it (beyond the paper)."""

    share: float = Field(
        default=0.2,
        gt=0,
        lt=0.5,
        description="A component is novel when the other scan has less than this share of its points, after both "
        "scans are brought to one density; 0.5 is no change.",
    )
    significance: float = Field(
        default=0.05,
        gt=0,
        lt=1,
        description="A novel component's share must also be this improbable among the stable components.",
    )
    split_distance: float = Field(
        default=0.3,
        gt=0,
        le=1,
        description="Hellinger distance (0 to 1) between the two scans' points inside one component above which it "
        "becomes two.",
    )
    max_splits: int = Field(
        default=0,
        ge=0,
        description="Rounds of splits and EM; 0: the mixture as MDL leaves it, old and new in one component.",
    )

    def fit(self, batch: PreparedPairs, plan: FitPlan) -> Models:
        """Fit one mixture to both scans of every pair."""
        return fit_shared(batch, plan, self.split_distance, self.max_splits)

    def compare(self, batch: PreparedPairs, models: Models) -> Comparison:
        """Compare each component's two counts; mixtures that share no components are pooled into one dictionary."""
        reference, current = models.reference.mixtures, models.current.mixtures
        counts = _Counts.of(batch, models)
        slots = current.num_slots
        added = self._told(counts.only(slice(None, slots)), current, reference)
        removed = self._told(counts.only(slice(slots, None)).exchanged(), reference, current)
        return Comparison(
            added=added,
            removed=removed,
            distance=torch.full_like(batch.current.cell_size, torch.nan),
            p_value=least_p_value(added, removed),
            notes=empty_side_notes(batch),
        )

    def _told(
        self, counts: _Counts, mixtures: GaussianMixtures, others: GaussianMixtures
    ) -> ComponentNovelty:
        shares, p_values = counts.shares(), counts.p_values()
        novel = (shares > 1 - self.share) & (p_values < self.significance)
        matches, distances = _nearest(mixtures, others, novel)
        return ComponentNovelty(
            novel=novel,
            scores=shares,
            matches=matches,
            distances=distances,
            reasons=tuple(
                tuple(map(self._reason, *(row[:k] for row in rows)))
                for k, *rows in zip(
                    mixtures.num_components.tolist(),
                    novel.tolist(),
                    shares.tolist(),
                    p_values.tolist(),
                    matches.tolist(),
                    strict=True,
                )
            ),
            p_values=p_values,
        )

    def _reason(self, novel: bool, share: float, p_value: float, match: int) -> str:
        if math.isnan(share):
            return "Claims no points, or there is nothing to compare it with."
        other = f"the other scan has {1 - share:.1%} of its points"
        if novel:
            return f"Novel: {other}, less than {self.share:.0%}; without a change p = {p_value:.2g}."
        if share > 1 - self.share:
            return f"Kept: {other}, but ratios of unchanged components stray as far (p = {p_value:.2g})."
        return f"Filled by both scans, as component {match} of the other mixture: {other} (50% is no change)."


@dataclass(frozen=True, eq=False)
class _Counts:
    """Expected counts of both scans in every component (P, K), brought to one density and counted in cells.

    `spread` (P,) is the standard deviation of the stable components' log-ratios.
    """

    own: Tensor
    other: Tensor
    spread: Tensor

    @classmethod
    def of(cls, batch: PreparedPairs, models: Models) -> _Counts:
        """Counts under the current mixtures' components followed by the reference mixtures'."""
        own, other = pooled_counts(batch, models)
        # One density for both: half of the log-ratio goes to either side.
        half = 0.5 * log_density_ratio(own, other)[:, None]
        own, other = own * (-half).exp(), other * half.exp()
        # In every component's own cells: those of a small thing have fewer points than a wall's.
        cells_per_point = (pooled_cells(batch, models) / (own + other)).nan_to_num(0.0)
        own, other = own * cells_per_point, other * cells_per_point
        return cls(own, other, _spread(own, other))

    def only(self, components: slice) -> _Counts:
        """The counts in some of the components."""
        return _Counts(self.own[:, components], self.other[:, components], self.spread)

    def exchanged(self) -> _Counts:
        """The counts with the roles exchanged."""
        return _Counts(self.other, self.own, self.spread)

    def shares(self) -> Tensor:
        """Own share of the points of every component (P, K); NaN where there are none."""
        return self.own / (self.own + self.other)

    def p_values(self) -> Tensor:
        """Probability of a share at least this high without any change (P, K).

        Points of one cell are no independent evidence. Of n cells as many are the own scan's as of n coins show heads;
        the coins' log-odds stray from 0 as the log-ratios of the stable components do. So it is the binomial tail
        I_p(own, other + 1), averaged over log p / (1 - p) ~ N(0, spread^2): with 4 cells and none 1/16, with 5 1/32.
        """
        own, other, spread = (
            counts.cpu().numpy()[..., None] for counts in (self.own, self.other, self.spread)
        )
        heads = expit(spread[..., None] * NORMAL_NODES.numpy())  # (P, 1, Q)
        tails = betainc(own.clip(_NO_CELLS), other + 1, heads) @ NORMAL_WEIGHTS.numpy()
        return torch.where(self.own + self.other > 0, torch.from_numpy(tails).to(self.own), torch.nan)


_NO_CELLS = 1e-9
"""What I_p takes for no cells at all; its limit there is 1."""


def _spread(own: Tensor, other: Tensor) -> Tensor:
    """Robust standard deviation of the log-ratios of components that both scans fill (P,)."""
    ratios = (own / other).log()
    stable = (ratios.abs() < math.log(4)).to(ratios)  # neither scan has less than a fifth
    return MAD_TO_STD * balanced_median(ratios.abs(), stable)


def _nearest(mixtures: GaussianMixtures, others: GaussianMixtures, novel: Tensor) -> tuple[Tensor, Tensor]:
    """For components (P, K) that are not novel: the most similar other one, and how far its mean is, m."""
    apart = hellinger_distance(mixtures.means, mixtures.covariances, others.means, others.covariances)
    apart = apart.masked_fill(~others.mask[:, None, :], torch.inf)
    least, matches = apart.min(dim=2)
    matched = least.isfinite() & ~novel & mixtures.mask
    distances = mean_distance(mixtures.means, others.means).gather(2, matches[..., None]).squeeze(2)
    return torch.where(matched, matches, -1), torch.where(matched, distances, torch.nan)
