"""Quantiles of weighted values, group by group, for packed batches."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

MAD_TO_STD = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""


def weighted_quantiles(
    values: Tensor, weights: Tensor, groups: Tensor, num_groups: int, level: float
) -> Tensor:
    """Lower weighted quantile of every group: its least value at which `level` of the weight is reached.

    Equals `numpy.quantile(values, level, method="inverted_cdf")` for equal weights and one group.

    Args:
        values: (N,).
        weights: >= 0 (N,); a value without weight is never a quantile.
        groups: group of every value, int64 (N,); -1 takes no part.
        num_groups: G.
        level: Share of a group's weight, in [0, 1]; 0 is its least value.

    Returns:
        Quantiles (G,), NaN for a group without weight.
    """
    if not len(values):
        return values.new_full((num_groups,), torch.nan)
    takes_part = (groups >= 0) & (weights > 0)
    groups = torch.where(takes_part, groups, num_groups)  # the others stand behind
    order = grouped_order(values, groups)
    totals = torch.bincount(groups, weights, minlength=num_groups + 1)[:num_groups]
    ends = totals.cumsum(0)
    wanted = ends - totals + level * totals * (1 - 1e-12)  # rounding must not push it past the last value
    reached = weights.index_select(0, order).cumsum(0)
    sizes = torch.bincount(groups, minlength=num_groups + 1)[:num_groups]
    behind = sizes.cumsum(0)  # place after the last value of each group
    place = torch.searchsorted(reached, wanted).minimum(behind - 1).maximum(behind - sizes)
    return torch.where(totals > 0, values[order[place.clamp_max(len(values) - 1)]], torch.nan)


def grouped_order(values: Tensor, groups: Tensor) -> Tensor:
    """Places of the values (N,), group by group and ascending inside each; on the host.

    NumPy sorts numbers with vector instructions and small integers by their digits: a fifth of torch's time.
    """
    order = np.argsort(values.detach().cpu().numpy())
    labels = groups.cpu().numpy()
    narrow = labels.astype(np.int16 if len(labels) and labels.max() < 2**15 else np.int64)
    return torch.from_numpy(order[np.argsort(narrow[order], kind="stable")]).to(values.device)
