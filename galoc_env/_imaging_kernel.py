"""Pixel loops of the imaging stage: where each pixel's light comes from, and what the sensor makes of it."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

# Without these nothing vectorises; sums keep their order, so that the bytes do not depend on the processor.
_FAST = {"nnan", "ninf", "nsz"}


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def source_maps(
    focal: np.ndarray,
    centre: np.ndarray,
    vertical: np.ndarray,
    turn: np.ndarray,
    distortion: float,
    map_u: np.ndarray,
    map_v: np.ndarray,
) -> None:
    """Pixel of the still, undistorted picture that each pixel of the real one shows.

    Args:
        focal: (2,) fx, fy, px.
        centre: (2,) cx, cy, px.
        vertical: (3,) gravity's direction in the camera frame, unit length.
        turn: (H,) how far the camera had turned left when it exposed a row, rad.
        distortion: as in ``Imaging``.
        map_u: (H, W) float32, filled: columns, px.
        map_v: (H, W) float32, filled: rows, px.
    """
    height, width = map_u.shape
    fx, fy, cx, cy = np.float32(focal[0]), np.float32(focal[1]), np.float32(centre[0]), np.float32(centre[1])
    bend = np.float32(4.0 * distortion / (width * width + height * height))
    m = np.empty((3, 3), np.float32)
    for row in range(height):
        # Rodrigues' formula. What is at azimuth a now was at a - turn before: azimuth is positive to the right.
        s, c = math.sin(-turn[row]), math.cos(-turn[row])
        gx, gy, gz = vertical[0], vertical[1], vertical[2]
        k = 1.0 - c
        m[0, 0], m[0, 1], m[0, 2] = c + k * gx * gx, k * gx * gy - s * gz, k * gx * gz + s * gy
        m[1, 0], m[1, 1], m[1, 2] = k * gx * gy + s * gz, c + k * gy * gy, k * gy * gz - s * gx
        m[2, 0], m[2, 1], m[2, 2] = k * gx * gz - s * gy, k * gy * gz + s * gx, c + k * gz * gz
        dv = np.float32(row) - cy
        for col in range(width):
            du = np.float32(col) - cx
            straight = np.float32(1.0) - bend * (du * du + dv * dv)
            x, y = du * straight / fx, dv * straight / fy
            # A ray that turns behind the camera shows nothing of the picture: the border, far out.
            z = max(m[2, 0] * x + m[2, 1] * y + m[2, 2], np.float32(1e-3))
            map_u[row, col] = cx + fx * (m[0, 0] * x + m[0, 1] * y + m[0, 2]) / z
            map_v[row, col] = cy + fy * (m[1, 0] * x + m[1, 1] * y + m[1, 2]) / z


@njit(cache=True, inline="always")
def _mixed(z):  # type: ignore[no-untyped-def]
    """Splitmix64's finaliser: 64 random bits from a counter."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(cache=True, fastmath=_FAST, error_model="numpy")
def develop(
    light: np.ndarray,
    gains: np.ndarray,
    vignette: float,
    shot: float,
    read: float,
    seed: np.uint64,
    normal: np.ndarray,
    codes: np.ndarray,
    out: np.ndarray,
) -> None:
    """Expose, add noise and look up the file's codes.

    Args:
        light: (H, W, 3) float32, linear, 1 at white.
        gains: (3,) float32 factors on red, green and blue.
        vignette: share of the light that the corners lose.
        shot: sd of the noise at white that grows with the root of the light.
        read: sd of the noise that does not depend on the light.
        seed: of the noise, uint64.
        normal: (4096,) float32 quantiles of the normal distribution.
        codes: (N,) uint8 code of each of N equal steps of light from 0 to 1.
        out: (H, W, 3) uint8, filled.
    """
    height, width = light.shape[:2]
    cx, cy = np.float32(0.5 * (width - 1)), np.float32(0.5 * (height - 1))
    loss = np.float32(4.0 * vignette / (width * width + height * height))
    shot2, read2 = np.float32(shot * shot), np.float32(read * read)
    noisy = shot > 0.0 or read > 0.0
    one, zero, top = np.float32(1.0), np.float32(0.0), np.float32(len(codes) - 1)
    step = np.uint64(0x9E3779B97F4A7C15)
    counter = np.uint64(seed)
    for row in range(height):
        dv = np.float32(row) - cy
        for col in range(width):
            du = np.float32(col) - cx
            kept = one - loss * (du * du + dv * dv)
            counter += step
            bits = _mixed(counter)
            for channel in range(3):
                value = light[row, col, channel] * kept * gains[channel]
                if noisy:
                    value += math.sqrt(shot2 * value + read2) * normal[bits & np.uint64(4095)]
                    bits = bits >> np.uint64(12)
                out[row, col, channel] = codes[np.int64(min(max(value, zero), one) * top + np.float32(0.5))]
