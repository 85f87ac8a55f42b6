"""The resolution floor: what lies below the size of a cell is noise and sampling, not shape."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from novelty.preprocess.prepared import PreparedPairs


def cell_resolution(batch: PreparedPairs) -> Tensor:
    """Standard deviation r of one axis of a cell, the coarser scan of each pair, as misaligned as it is, m (P,).

    A cell's root-mean-square extent counts all three axes, hence the sqrt(3). Cells of the size of a single
    point have no extent; the spacing of the points then stands for it. 0 where nothing is known.
    """
    sides = [
        torch.maximum(scans.cell_size, scans.spacing).nan_to_num(0.0)
        for scans in (batch.reference, batch.current)
    ]
    return batch.with_misalignment(torch.maximum(*sides) / math.sqrt(3))


def blurred(covariances: Tensor, resolution: Tensor) -> Tensor:
    """S_k + r^2 I (P, K, 3, 3): every component as a sensor of resolution r would see it.

    Args:
        covariances: (P, K, 3, 3), m^2.
        resolution: r of each pair (P,), m.
    """
    identity = torch.eye(covariances.shape[-1], dtype=covariances.dtype, device=covariances.device)
    return covariances + resolution.to(covariances).square()[:, None, None, None] * identity
