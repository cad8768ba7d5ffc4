"""Two-byte codes of ranges, rounded outward: boxes of profiles at half the memory traffic.

Code ``FLOAT`` is the upper part of the number itself (4 bits of exponent, 12 of mantissa: steps of 0.024 % from 1.6 cm
to 1 km), which decodes by a shift. Code ``LOG`` counts equal steps of the logarithm (0.017 %) and decodes into it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import extending, njit, types

intrinsic: Any = extending.intrinsic  # for type checkers: what it returns is called without the typing context

LEAST, MOST = 2.0**-6, 2.0**10 * (1.0 - 2.0**-12)
"""Ranges outside this are clamped, m."""
FLOAT_SHIFT = 11
FLOAT_BASE = (127 - 6) << 23  # bits of LEAST
LOG_LEAST = math.log(LEAST)
LOG_STEP = 16.0 * math.log(2.0) / 65535.0
"""Step of code ``LOG`` in log range."""


@intrinsic
def _as_float(typing_context, bits):  # type: ignore[no-untyped-def]
    """The float32 with these bits (uint32)."""
    return types.float32(types.uint32), lambda c, builder, s, arguments: builder.bitcast(arguments[0], ir.FloatType())


@intrinsic
def _as_bits(typing_context, value):  # type: ignore[no-untyped-def]
    """The bits of a float32, as uint32."""
    return types.uint32(types.float32), lambda c, builder, s, arguments: builder.bitcast(arguments[0], ir.IntType(32))


@njit(inline="always")
def float_code(value, up):  # type: ignore[no-untyped-def]
    """Code of a range (float32, m), rounded down or up."""
    clamped = np.float32(min(max(value, np.float32(LEAST)), np.float32(MOST)))
    bits = np.int64(_as_bits(clamped)) - FLOAT_BASE
    return np.uint16((bits + (1 << FLOAT_SHIFT) - 1) >> FLOAT_SHIFT) if up else np.uint16(bits >> FLOAT_SHIFT)


@njit(inline="always")
def from_float_code(code):  # type: ignore[no-untyped-def]
    """Range of a code, float32 m."""
    return _as_float(np.uint32((np.uint32(code) << np.uint32(FLOAT_SHIFT)) + np.uint32(FLOAT_BASE)))


@njit(inline="always")
def log_code(value, up):  # type: ignore[no-untyped-def]
    """Code of the logarithm of a range (float32, m), rounded down or up."""
    clamped = min(max(np.float64(value), LEAST), MOST)
    step = (math.log(clamped) - LOG_LEAST) / LOG_STEP
    # A step is 1.7e-4, so this is 3e-6: float32 logarithms and codes that are compared err by less.
    return np.uint16(min(math.ceil(step + 2e-2), 65535.0)) if up else np.uint16(max(math.floor(step - 2e-2), 0.0))


@njit(inline="always")
def from_log_code(code):  # type: ignore[no-untyped-def]
    """Log range of a code, float32."""
    return np.float32(LOG_LEAST) + np.float32(LOG_STEP) * np.float32(code)
