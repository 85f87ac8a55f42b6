"""Cells, rays and mixtures as small arrays.

Centres of cells keep float32 about the middle of the map, a hundredth of a millimetre in a hall. Spreads keep float16
by their factors L, S = L L^T: these stay positive whatever the rounding, and hold a thin wall's thickness as precisely
as its width.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from gmmtorch import FitResult, GaussianMixtures, PointClouds
from novelty.maps.storage import Arrays
from novelty.maps.views import View

LARGEST_FACTOR = 1000.0
"""What the largest entry of a factor L becomes: float16 then holds entries 1e7 times smaller."""

LOWER = np.tril_indices(3)


def pack_cells(name: str, cells: PointClouds) -> Arrays:
    """The cells of one cloud: 26 bytes each."""
    assert cells.spreads is not None
    means = cells.points.numpy()
    centre = means.mean(axis=0)
    factors = _factors(cells.spreads)[:, *LOWER]
    scale = float(np.abs(factors).max(initial=0.0)) / LARGEST_FACTOR or 1.0
    counts = cells.weights.numpy()
    return {
        f"{name}.centre": centre,
        f"{name}.means": (means - centre).astype(np.float32),
        f"{name}.counts": counts.astype(np.uint16 if counts.max(initial=0) < 2**16 else np.uint32),
        f"{name}.factor_scale": np.array([scale]),
        f"{name}.factors": (factors / scale).astype(np.float16),
    }


def unpack_cells(name: str, arrays: Arrays) -> PointClouds:
    """What `pack_cells` packed."""
    packed = arrays[f"{name}.factors"].astype(np.float64) * arrays[f"{name}.factor_scale"]
    factors = np.zeros((len(packed), 3, 3))
    factors[:, *LOWER] = packed
    return PointClouds.from_list(
        [arrays[f"{name}.means"].astype(np.float64) + arrays[f"{name}.centre"]],
        weights=[arrays[f"{name}.counts"].astype(np.float64)],
        spreads=[factors @ factors.transpose(0, 2, 1)],
    )


def _factors(spreads: torch.Tensor) -> NDArray[np.float64]:
    """Lower triangular L with L L^T = S, for singular S too: (M, 3, 3) -> (M, 3, 3)."""
    values, vectors = torch.linalg.eigh(spreads)
    root = vectors * values.clamp_min(0).sqrt()[:, None, :]
    upper: NDArray[np.float64] = torch.linalg.qr(root.mT)[1].numpy()
    return upper.transpose(0, 2, 1)


def pack_views(views: tuple[View, ...]) -> Arrays:
    """The origin and the cells of every view."""
    arrays: Arrays = {}
    for row, view in enumerate(views):
        arrays[f"view.{row}.origin"] = view.origin
        arrays |= pack_cells(f"view.{row}.ends", view.ends)
    return arrays


def unpack_views(arrays: Arrays, number: int) -> tuple[View, ...]:
    """What `pack_views` packed."""
    return tuple(
        View(arrays[f"view.{row}.origin"], unpack_cells(f"view.{row}.ends", arrays)) for row in range(number)
    )


def pack_model(model: FitResult) -> Arrays:
    """The fit of one cloud."""
    mixtures = model.mixtures
    values: dict[str, torch.Tensor] = {
        "weights": mixtures.weights,
        "means": mixtures.means,
        "covariances": mixtures.covariances,
        "num_components": mixtures.num_components,
        "mdl": model.mdl,
        "mdl_path": model.mdl_path,
        "log_likelihood": model.log_likelihood,
        "status": model.status,
        "num_iterations": model.num_iterations,
    }
    return {f"model.{name}": value.numpy() for name, value in values.items()}


def unpack_model(arrays: Arrays) -> FitResult:
    """What `pack_model` packed."""
    names = ("weights", "means", "covariances", "num_components")
    figures: dict[str, Any] = {
        name: torch.from_numpy(arrays[f"model.{name}"])
        for name in ("mdl", "mdl_path", "log_likelihood", "status", "num_iterations")
    }
    mixtures = GaussianMixtures.from_arrays(*(arrays[f"model.{name}"] for name in names))
    return FitResult(mixtures=mixtures, **figures)
