import math

import numpy as np
import pytest

from galoc_env import sensors


def test_tilt_is_bounded_smooth_and_really_tilts():
    amplitude = math.radians(8)
    tilt = sensors.Tilt.random(amplitude, np.random.default_rng(0))
    series = np.array([tilt.at(t) for t in range(400)])
    assert np.abs(series).max() <= amplitude
    assert np.abs(series).max(axis=0).min() > 0.5 * amplitude
    # Largest slope of the two sines: sum of weight * 2 pi / shortest period.
    assert np.abs(np.diff(series, axis=0)).max() <= amplitude * 2 * math.pi * (0.6 / 12 + 0.4 / 4)


def test_zero_noise_is_the_truth_to_the_bit():
    rng = np.random.default_rng(0)
    gravity, odometry = (0.1, -0.2), np.array([0.3, 0.01, 0.5])
    assert sensors.measure_gravity(gravity, 0.0, rng).tobytes() == np.array(gravity).tobytes()
    assert sensors.measure_odometry(odometry, 0.0, rng).tobytes() == odometry.tobytes()
    assert sensors.Tilt.random(0.0, rng).at(7) == (0.0, 0.0)


def test_noise_does_not_change_how_often_the_stream_is_read():
    streams = [np.random.default_rng(3) for _ in range(2)]
    for rng, noise in zip(streams, (0.0, 0.5), strict=True):
        sensors.measure_gravity((0.0, 0.0), noise, rng)
        sensors.measure_odometry(np.ones(3), noise, rng)
    assert streams[0].random() == streams[1].random()


def test_noise_has_the_documented_spread():
    rng = np.random.default_rng(1)
    n, sd = 4000, math.radians(0.5)
    readings = np.array([sensors.measure_gravity((0.1, 0.2), sd, rng) for _ in range(n)])
    # The sd of n draws is off by 1 / sqrt(2 n) = 1.1 %; 5 % is more than four times that.
    assert readings.std(axis=0) == pytest.approx([sd, sd], rel=0.05)
    assert readings.mean(axis=0) == pytest.approx([0.1, 0.2], abs=4 * sd / math.sqrt(n))
    truth = np.array([0.3, 0.4, 0.2])
    moved = np.array([sensors.measure_odometry(truth, 0.1, rng) for _ in range(n)])
    turn_sd = 0.1 * math.hypot(0.2, 0.1 * 0.5)
    assert moved.std(axis=0) == pytest.approx([0.05, 0.05, turn_sd], rel=0.05)


def test_standing_still_is_measured_exactly():
    assert not sensors.measure_odometry(np.zeros(3), 0.5, np.random.default_rng(0)).any()
