"""Exponential and logarithm without branches, so that loops over them become vector code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numba.extending import overload

__all__ = ["exp", "log"]

_LOG2_E, _LN2_HIGH, _LN2_LOW, _HALF, _ONE = (
    np.float32(v) for v in (1.4426950408889634, 0.693359375, -2.12194440e-4, 0.5, 1.0)
)
_F7, _F6, _F5, _F4, _F3 = (np.float32(1 / v) for v in (5040, 720, 120, 24, 6))
_I23, _I127 = np.int32(23), np.int32(127)


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)
def _exp_double(x: Any) -> Any:
    """Exp of x in [-700, 0], to 2e-16 relative."""
    n = np.int32(x * 1.4426950408889634 - 0.5)
    r = x - n * 0.693147180369123816490
    r = r - n * 1.90821492927058770002e-10
    p = 1 / 479001600.0
    p = p * r + 1 / 39916800.0
    p = p * r + 1 / 3628800.0
    p = p * r + 1 / 362880.0
    p = p * r + 1 / 40320.0
    p = p * r + 1 / 5040.0
    p = p * r + 1 / 720.0
    p = p * r + 1 / 120.0
    p = p * r + 1 / 24.0
    p = p * r + 1 / 6.0
    p = p * r + 0.5
    p = p * r + 1.0
    p = p * r + 1.0
    return p * np.int64((np.int64(n) + 1023) << 52).view(np.float64)


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)
def _exp_single(x: Any) -> Any:
    """Return the same in float32, x in [-80, 0], to 2e-7."""
    n = np.int32(x * _LOG2_E - _HALF)
    step = np.float32(n)
    r = x - step * _LN2_HIGH
    r = r - step * _LN2_LOW
    p = _F7
    p = p * r + _F6
    p = p * r + _F5
    p = p * r + _F4
    p = p * r + _F3
    p = p * r + _HALF
    p = p * r + _ONE
    p = p * r + _ONE
    return p * np.int32(np.int32(n + _I127) << _I23).view(np.float32)


@njit(nogil=True, error_model="numpy", fastmath={"contract"}, cache=True)
def log(x: Any) -> Any:
    """Log of a normal x > 0 in float64, to 3e-16 absolute or relative."""
    bits = np.float64(x).view(np.int64)
    # x = 2^e m, m in [sqrt(1/2), sqrt(2))
    e = (bits - 0x3FE6A09E667F3BCD) >> 52
    m = np.int64(bits - (e << 52)).view(np.float64)
    s = (m - 1.0) / (m + 1.0)
    q = s * s
    p = 1 / 21.0
    p = p * q + 1 / 19.0
    p = p * q + 1 / 17.0
    p = p * q + 1 / 15.0
    p = p * q + 1 / 13.0
    p = p * q + 1 / 11.0
    p = p * q + 1 / 9.0
    p = p * q + 1 / 7.0
    p = p * q + 1 / 5.0
    p = p * q + 1 / 3.0
    p = p * q * s + s
    return np.float64(e) * 0.6931471805599453 + 2.0 * p


def exp(x: Any) -> Any:
    """Exp of x in x's own precision: in [-700, 0] in float64, in [-80, 0] in float32."""
    return np.exp(x)


@overload(exp, strict=False)
def _exp_by_type(x: Any) -> Callable[[Any], Any]:
    def single(x: Any) -> Any:
        return _exp_single(x)

    def double(x: Any) -> Any:
        return _exp_double(x)

    return single if x.bitwidth == 32 else double
