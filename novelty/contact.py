"""Things in contact: groups of small patches that touch, patch by patch, whatever their size and density."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

REACH = 2.5
"""Two patches touch when their centres are nearer than this many times the sum of their extents."""

NEIGHBOURS = 12
"""Nearest patches that a patch may touch; more would only cost time, contact being passed on."""


def contact_groups(centres: NDArray[np.float64], extents: NDArray[np.float64]) -> NDArray[np.int32]:
    """Number of the group that each patch is in, int32 (C,).

    Contact scales with the patches' own extents, so that a surface stays whole where a sensor's lines lie far apart.

    Args:
        centres: (C, 3) m.
        extents: (C,) m, root-mean-square.
    """
    neighbours = min(NEIGHBOURS + 1, len(centres))
    if not neighbours:
        return np.empty(0, dtype=np.int32)
    distances, others = cKDTree(centres).query(centres, k=[*range(1, neighbours + 1)])
    touching = distances < REACH * (extents[:, None] + extents[others])
    rows = np.broadcast_to(np.arange(len(centres))[:, None], others.shape)[touching]
    links = coo_array((np.ones(len(rows)), (rows, others[touching])), shape=(len(centres), len(centres)))
    groups: NDArray[np.int32] = connected_components(links, directed=False)[1]
    return groups
