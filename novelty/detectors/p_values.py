"""Many p-values at once: which of them are discoveries, and one for a pair out of those of its components."""

from __future__ import annotations

import torch
from torch import Tensor

from novelty.detectors.base import ComponentNovelty

NORMAL_NODES = torch.linspace(-4, 4, 81, dtype=torch.float64)
NORMAL_WEIGHTS = (-0.5 * NORMAL_NODES.square()).softmax(0)
"""Averages over a standard Gaussian; so many because p-values of many cells are a step."""


def least_p_value(*directions: ComponentNovelty) -> Tensor:
    """Bonferroni's p-value over all components of both scans (P,); NaN where there is none."""
    p_values = torch.cat([d.p_values for d in directions if d.p_values is not None], dim=1)  # (P, K + K')
    tests = (~p_values.isnan()).sum(dim=1)
    least = p_values.nan_to_num(torch.inf).amin(dim=1)
    return torch.where(tests > 0, (least * tests).clamp_max(1.0), torch.nan)


def discoveries(p_values: Tensor, rate: float) -> Tensor:
    """Tests that are rejected so that the false discovery rate is at most `rate` in every row (P, K).

    Benjamini & Hochberg (1995): the i-th least of m p-values is compared with i / m times the rate, and all up to the
    last that is not above it are rejected. Equals `scipy.stats.false_discovery_control(p) <= rate`; NaN is no test.
    """
    tests = (~p_values.isnan()).sum(dim=1, keepdim=True)
    ordered, places = p_values.nan_to_num(torch.inf).sort(dim=1)
    ranks = torch.arange(1, p_values.shape[1] + 1, device=p_values.device)
    below = ordered <= rate * ranks / tests.clamp_min(1)
    rejected = below.flip(1).cummax(dim=1).values.flip(1)  # and all that are less
    return torch.zeros_like(rejected).scatter_(1, places, rejected)
