"""Sixteen lanes at once do what numpy does one by one."""

import numpy as np
import pytest
from numba import njit

from galoc_env.render import _lanes as lanes

RNG = np.random.default_rng(5)
A, B = RNG.normal(size=(2, 16)).astype(np.float32)
P, Q = RNG.integers(-5000, 5000, size=(2, 16)).astype(np.int32)


@njit
def _floats(a, b, out):
    x, y = lanes.load(a, 0), lanes.load(b, 0)
    lanes.store(out[0], 0, x + y)
    lanes.store(out[1], 0, x - y)
    lanes.store(out[2], 0, x * y)
    lanes.store(out[3], 0, x / y)
    lanes.store(out[4], 0, lanes.choose(lanes.greater(x, y), x, y))
    lanes.store(out[5], 0, lanes.ramp() * lanes.spread(np.float32(0.5)))


@njit
def _ints(a, b, out):
    x, y, three = lanes.load(a, 0), lanes.load(b, 0), lanes.spread_int(np.int32(3))
    lanes.store(out[0], 0, x + y)
    lanes.store(out[1], 0, x - y)
    lanes.store(out[2], 0, x * y)
    lanes.store(out[3], 0, (x & y) | three)
    lanes.store(out[4], 0, (x << three) >> lanes.spread_int(np.int32(1)))
    lanes.store(out[5], 0, lanes.whole(lanes.real(x) / lanes.spread(np.float32(7.0))))
    inside = lanes.between(lanes.ramp_int(), three, lanes.spread_int(np.int32(9)))
    lanes.store(out[6], 0, lanes.choose(inside, x, y))


@njit
def _read(values, index, out):
    lanes.store(out, 0, lanes.gather(values, lanes.load(index, 0)))


@njit
def _summaries(a, p, q):
    return lanes.least(lanes.load(a, 0)), lanes.differ(lanes.load(p, 0), lanes.load(q, 0))


@njit
def _first(bits):
    return lanes.first_bit(bits)


@njit
def _colours(a, b, c, d, across, down, light, out):
    top = lanes.blend(lanes.load(a, 0), lanes.load(b, 0), lanes.load(across, 0))
    bottom = lanes.blend(lanes.load(c, 0), lanes.load(d, 0), lanes.load(across, 0))
    lanes.store(out, 0, lanes.lit(lanes.blend_again(top, bottom, lanes.load(down, 0)), lanes.load(light, 0)))


@njit
def _bytes(pixels, rgb, narrow):
    lanes.store_rgb(rgb, 1, lanes.load(pixels, 0))
    lanes.store_bytes(narrow, 1, lanes.load(pixels, 0))


def test_floats():
    out = np.empty((6, 16), np.float32)
    _floats(A, B, out)
    expected = [A + B, A - B, A * B, A / B, np.maximum(A, B), 0.5 * np.arange(16, dtype=np.float32)]
    np.testing.assert_array_equal(out, expected)  # to the bit


def test_ints():
    out = np.empty((7, 16), np.int32)
    _ints(P, Q, out)
    inside = (np.arange(16) >= 3) & (np.arange(16) <= 9)
    expected = [P + Q, P - Q, P * Q, (P & Q) | 3, (P << 3) >> 1, np.trunc(P / np.float32(7)), np.where(inside, P, Q)]
    np.testing.assert_array_equal(out, expected)


def test_gather():
    values = RNG.integers(0, 1 << 31, size=50).astype(np.int32)
    index = RNG.integers(0, 50, size=16).astype(np.int32)
    got = np.empty(16, np.int32)
    _read(values, index, got)
    np.testing.assert_array_equal(got, values[index])


@pytest.mark.parametrize("at", [0, 7, 15])
def test_summaries(at):
    a = np.full(16, 2.5, np.float32)
    a[at] = 0.25
    other = P.copy()
    other[at] += 1
    assert _summaries(a, P, other) == (0.25, 1 << at)
    assert _first(np.uint32(1 << at | 1 << 15)) == at
    assert _first(np.uint32(0)) == 32


def test_pixels_become_bytes():
    pixels = RNG.integers(0, 1 << 24, size=16).astype(np.int32)
    rgb, narrow = np.full(50, 9, np.uint8), np.full(18, 9, np.uint8)
    _bytes(pixels, rgb, narrow)
    colours = np.stack([pixels & 255, pixels >> 8 & 255, pixels >> 16], axis=1)
    np.testing.assert_array_equal(rgb, [9, *colours.ravel(), 9])
    np.testing.assert_array_equal(narrow, [9, *colours[:, 0], 9])


@pytest.mark.parametrize("light", [0, 300, 2065, 4095])
def test_colours_are_bilinear_times_light(light):
    """Within 2 of 255 of the exact value: weights have 7 bits, products are cut."""
    corners = RNG.integers(0, 256, size=(4, 2, 16))
    across, down = RNG.integers(0, 128, size=(2, 16))
    pack = [(c[0] | c[1] << 16).astype(np.int32) for c in corners]
    both = [(w | w << 16).astype(np.int32) for w in (across, down)]
    out = np.empty(16, np.int32)
    lit = np.full(16, (16 * light) | (16 * light) << 16, np.uint32).view(np.int32)
    _colours(*pack, *both, lit, out)
    u, v = across / 128.0, down / 127.0
    exact = (corners[0] * (1 - u) + corners[1] * u) * (1 - v) + (corners[2] * (1 - u) + corners[3] * u) * v
    exact = np.minimum(exact * light / 2065.0, 255.0)
    assert np.abs(np.stack([out & 0xFFFF, out >> 16]) - exact).max() < 2.0


def test_white_stays_white():
    white = np.full(16, 255 | 255 << 16, np.int32)
    out = np.empty(16, np.int32)
    for w in (0, 64, 127):
        weight = np.full(16, w | w << 16, np.int32)
        unit = np.full(16, (16 * 2065) | (16 * 2065) << 16, np.uint32).view(np.int32)
        _colours(white, white, white, white, weight, weight, unit, out)
        np.testing.assert_array_equal(out, white)
