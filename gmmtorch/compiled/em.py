"""EM of a batch in compiled code: `gmmtorch.em` with its steps made cloud by cloud, in place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from gmmtorch.compiled.batch import Batch, Parameters
from gmmtorch.compiled.mixtures import accept, maximize
from gmmtorch.components import Components
from gmmtorch.linalg import num_lifted
from gmmtorch.problem import Workload
from gmmtorch.tiles import Tiles

__all__ = ["Iterations", "expect", "iterate"]

Array = np.ndarray


class Iterations:
    """Where EM stands, as arrays (B,) that the loops write to; the fields of `gmmtorch.em.EMState`."""

    def __init__(self, start: Components) -> None:
        batch, num_components, dim = start.means.shape
        self.mixtures = Parameters(start)
        self.statistics = np.zeros((batch, num_components, num_lifted(dim)))
        self.totals = np.zeros((batch, 2))  # objective, log-likelihood
        self.gain = np.zeros(batch)
        self.num_iterations = np.zeros(batch, np.int64)
        self.converged = np.zeros(batch, np.bool_)
        self.step = np.ones(batch)


def iterate(workload: Workload, start: Components, max_iterations: int, members: Sequence[int]) -> Iterations:
    """EM of these clouds (host-known) until their gain is at most the tolerance; the others stay as they are."""
    state, proposal = Iterations(start), Iterations(start)
    batch = Batch(workload.tiles, workload.floor.numpy(), start.weights.shape[1], workload.tiles.dtype)
    total, starved, added = (t.numpy() for t in (workload.total, workload.starved, workload.added))
    tolerance = np.full(len(total), np.nan) if workload.tolerance is None else workload.tolerance.numpy()
    running = np.array(members, np.int64)
    batch.expect(running, state.mixtures, state.statistics, state.totals)
    for _ in range(max_iterations):
        maximize(
            running, state.step, total, starved, added, state.statistics,
            *state.mixtures.arrays, *proposal.mixtures.arrays,
        )  # fmt: skip
        batch.expect(running, proposal.mixtures, proposal.statistics, proposal.totals)
        accept(
            running, workload.relaxation, tolerance, proposal.totals, proposal.statistics,
            *proposal.mixtures.arrays, state.totals, state.statistics, *state.mixtures.arrays,
            state.gain, state.num_iterations, state.converged, state.step,
        )  # fmt: skip
        running = running[~state.converged[running]]
        if not len(running):
            break
    return state


def expect(
    tiles: Tiles, components: Components, floor: Tensor, precision: torch.dtype
) -> tuple[Tensor, Tensor]:
    """E-step of all clouds: statistics [N_k, first, second] (B, K, M), objectives and log-likelihoods (B, 2), nats."""
    state = Iterations(components)
    batch = Batch(tiles, floor.numpy(), components.weights.shape[1], precision)
    clouds = np.array([b for b, count in enumerate(tiles.counts) if count], np.int64)
    if len(clouds):
        batch.expect(clouds, state.mixtures, state.statistics, state.totals)
    return torch.from_numpy(state.statistics), torch.from_numpy(state.totals)
