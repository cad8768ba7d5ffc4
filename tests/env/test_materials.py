"""Textures: seamless, the same for the same seed, different for another, and made with little work."""

import subprocess
import sys
import time

import numpy as np
import pytest

from galoc_env.materials import NAMES, SIZE, material
from galoc_env.materials.noise import Canvas

NOT_REPEATED_UPWARDS = ("mirror", "outdoors")
"""Top and bottom differ by their nature: a room has floor and ceiling, and the outdoors sky and ground."""


@pytest.mark.parametrize("name", [*NAMES, "art.1", "art.3"])
def test_textures_are_seamless(name):
    """The step across the border is not larger than steps inside, over several variants."""
    for seed in range(4):
        skin = material(name, seed)
        assert skin.name == name and skin.size_m > 0
        assert skin.image.shape == (SIZE, SIZE, 3) and skin.image.dtype == np.uint8
        image = skin.image.astype(float)
        for axis in (0, 1):
            if axis == 0 and name in NOT_REPEATED_UPWARDS:
                continue
            steps = np.abs(np.diff(image, axis=axis)).mean(axis=(1 - axis, 2))
            border = np.abs(np.take(image, 0, axis) - np.take(image, -1, axis)).mean()
            # Of tiles as few as two joints lie inside, and the one at the border may have more contrast.
            assert border <= 1.35 * steps.max() + 1.0


@pytest.mark.parametrize("name", NAMES)
def test_a_seed_decides_all_and_seeds_differ(name):
    first = material(name, 1)
    again = material.__wrapped__(name, 1)
    np.testing.assert_array_equal(first.image, again.image)
    assert first.size_m == again.size_m
    assert not first.image.flags.writeable
    others = [material(name, seed).image for seed in range(2, 6)]
    assert all(np.any(first.image != other) for other in others)


def test_another_process_draws_the_same_bytes():
    names = ("art.2", "herringbone", "outdoors", "floral")
    script = f"""
import hashlib
from galoc_env.materials import material
print(hashlib.sha256(b"".join(material(n, 7).image.tobytes() for n in {names!r})).hexdigest())
"""
    runs = [
        subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=True, env={"PYTHONHASHSEED": seed}
        ).stdout
        for seed in ("1", "2")
    ]
    assert runs[0] == runs[1] and len(runs[0]) == 65


def test_copies_of_a_name_are_different_pictures():
    images = [material(f"art.{k}", 3).image.astype(float) for k in range(4)]
    for k, image in enumerate(images):
        assert image.std() > 8  # of 255: something to see
        for other in images[:k]:
            assert np.abs(image - other).mean() > 5


def test_variants_of_a_wall_differ_in_tone():
    """Over seeds, the mean colours of wallpapers spread by far more than noise of a texture could move them."""
    for name in ("stripes", "damask", "floral", "geometric", "brick", "tiles"):
        mean = np.array([material(name, seed).image.mean(axis=(0, 1)) for seed in range(12)])
        assert mean.std(axis=0).max() > 8


def test_unknown_names_fail():
    with pytest.raises(KeyError):
        material("unobtainium", 0)


def test_noise_is_periodic_and_never_the_same_twice():
    canvas = Canvas(np.random.default_rng(0))
    first, second = canvas.noise("soft"), canvas.noise("soft")
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.5
    assert first.std() == pytest.approx(1.0, abs=1e-3)
    inside = np.abs(np.diff(first, axis=0)).max()
    assert np.abs(first[0] - first[-1]).max() <= inside


def test_noise_is_shared():
    """A texture costs less than the noise fields of the bank would, by a wide margin."""
    from galoc_env.materials.noise import _bank

    material("plaster", 0)

    def cost(call):
        times = []
        for _ in range(5):
            start = time.process_time()
            call()
            times.append(time.process_time() - start)
        return sorted(times)[2]

    assert cost(lambda: material.__wrapped__("plaster", 1)) < 0.5 * cost(_bank.__wrapped__)
