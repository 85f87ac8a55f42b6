"""One p-value for a pair out of those of its components."""

from __future__ import annotations

import torch
from torch import Tensor

from novelty.detectors.base import ComponentNovelty


def least_p_value(*directions: ComponentNovelty) -> Tensor:
    """Bonferroni's p-value over all components of both scans (P,); NaN where there is none."""
    p_values = torch.cat([d.p_values for d in directions if d.p_values is not None], dim=1)  # (P, K + K')
    tests = (~p_values.isnan()).sum(dim=1)
    least = p_values.nan_to_num(torch.inf).amin(dim=1)
    return torch.where(tests > 0, (least * tests).clamp_max(1.0), torch.nan)
