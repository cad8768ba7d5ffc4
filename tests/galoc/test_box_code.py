"""Two-byte codes of ranges: what is decoded encloses what was encoded, tightly."""

import math

import numpy as np
import pytest
from numba import njit

from galoc._box_code import LEAST, LOG_STEP, MOST, float_code, from_float_code, from_log_code, log_code


@njit
def _float(values):  # type: ignore[no-untyped-def]
    out = np.empty((2, len(values)), np.float32)
    for i in range(len(values)):
        out[0, i] = from_float_code(float_code(values[i], False))
        out[1, i] = from_float_code(float_code(values[i], True))
    return out


@njit
def _log(values):  # type: ignore[no-untyped-def]
    out = np.empty((2, len(values)), np.float32)
    for i in range(len(values)):
        out[0, i] = from_log_code(log_code(values[i], False))
        out[1, i] = from_log_code(log_code(values[i], True))
    return out


@njit
def _codes(value, log):  # type: ignore[no-untyped-def]
    if log:
        return np.int64(log_code(value, False)), np.int64(log_code(value, True))
    return np.int64(float_code(value, False)), np.int64(float_code(value, True))


@pytest.fixture
def ranges(rng: np.random.Generator) -> np.ndarray:
    drawn = np.exp(rng.uniform(math.log(LEAST), math.log(MOST), 20_000)).astype(np.float32)
    powers = np.float32(2.0) ** np.arange(-6, 10, dtype=np.float32)  # where the step of code FLOAT doubles
    return np.concatenate([drawn, powers, np.nextafter(powers, np.float32(0))[1:], np.nextafter(powers, np.inf)])


def test_float_code_encloses_a_range_within_one_step(ranges: np.ndarray) -> None:
    low, high = _float(ranges)
    assert np.all(low <= ranges) and np.all(ranges <= high)
    assert np.all(high - low <= 2.0**-12 * ranges * (1 + 1e-6))  # a step is 2^-12 of the power of two below


def test_float_code_keeps_what_it_can_say_exactly(ranges: np.ndarray) -> None:
    low = _float(ranges)[0]
    again = _float(low)
    assert np.array_equal(again[0], low) and np.array_equal(again[1], low)


def test_log_code_encloses_the_logarithm_with_room_for_float32(ranges: np.ndarray) -> None:
    low, high = _log(ranges).astype(np.float64)
    exact = np.log(ranges.astype(np.float64))
    inner = (ranges > LEAST * 1.001) & (ranges < MOST * 0.999)  # the ends are clamped
    # Kernels take the logarithm in float32: of up to log 1024 = 6.9 it errs by up to 5e-7.
    assert np.all((low < exact - 5e-7)[inner]) and np.all((exact + 5e-7 < high)[inner])
    assert np.all(low <= exact + 1e-6) and np.all(exact - 1e-6 <= high)
    assert np.max(high - low) <= 2.05 * LOG_STEP


@pytest.mark.parametrize("log", [False, True])
def test_codes_rise_with_the_range_and_stop_at_both_ends(log: bool, ranges: np.ndarray) -> None:
    codes = np.array([_codes(v, log) for v in np.sort(ranges)[::20]])
    assert np.all(np.diff(codes, axis=0) >= 0)
    for value, end in ((1e-3, 0), (0.0, 0), (2000.0, 65535), (np.inf, 65535)):
        down, up = _codes(np.float32(value), log)
        assert abs(down - end) <= 2 and abs(up - end) <= 2  # MOST lies 1.4 steps of code LOG below its last
        assert 0 <= down <= up <= 65535
