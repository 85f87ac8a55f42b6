"""The direction away from the ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from novelty.errors import ConfigError
from novelty.preprocess.settings import Preprocess


def up_vector(settings: Preprocess) -> NDArray[np.float64]:
    """`settings.up` as a unit vector, (3,).

    Raises:
        ConfigError: It has no direction.
    """
    up = np.asarray(settings.up, dtype=np.float64)
    length = float(np.linalg.norm(up))
    if not 0 < length < np.inf:
        raise ConfigError(f"preprocess.up must be a direction such as [0, 0, 1]; got {list(settings.up)}.")
    return up / length
