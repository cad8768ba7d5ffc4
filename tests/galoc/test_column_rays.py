"""Rays straight from columns: exact where the columns are, honest where they are not."""

from dataclasses import replace

import numpy as np
import pytest

from galoc import Camera, Floorplan, Localizer, LocalizerConfig, solve_layout
from galoc.column_rays import column_rays
from galoc.detect.decode import decode
from galoc.heights import Heights
from galoc.rays import cast_rays
from galoc_env.truth_columns import true_columns

BOX = np.array([[0, 0, 6, 0], [6, 0, 6, 4], [6, 4, 0, 4], [0, 4, 0, 0], [3.5, 0, 3.5, 1.2]], float)
CAMERA = Camera.from_hfov(640, 480, 100.0)
POSE = (1.5, 2.0, 0.2)
HEIGHT = 1.3


@pytest.fixture(scope="module")
def plan():
    return Floorplan.from_segments(BOX, 2.6)


def seen(plan, gravity=(0.0, 0.0), measured=None, **noise):
    columns = true_columns(plan, CAMERA, POSE, HEIGHT, gravity, measured=measured, **noise)
    measured = gravity if measured is None else measured
    layout = solve_layout(decode(columns, CAMERA, measured), CAMERA, measured, heights=Heights.known(HEIGHT, 2.6))
    return columns, layout, measured


def true_ranges(plan, rays):
    from galoc_env.truth_kernel import nearest_hit

    bearings = POSE[2] + rays.bearings_rad
    return np.array([nearest_hit(plan.segments, POSE[0], POSE[1], np.cos(b), np.sin(b))[0] for b in bearings])


def test_exact_columns_give_true_ranges(plan):
    columns, layout, gravity = seen(plan)
    rays = column_rays(columns, layout, CAMERA, gravity)
    error = np.abs(np.log(rays.range) - np.log(true_ranges(plan, rays)))[rays.known]
    assert rays.known.mean() > 0.9
    # Columns and rays are half a degree apart: a ray beside a step is between two walls.
    assert np.median(error) < 0.01 and np.mean(error < 0.03) > 0.93


def test_deviations_hold_what_they_say(plan):
    """Whitened errors of noisy columns: 95 % within two standard deviations, up to the noise of some 700 rays."""
    inside = []
    for k in range(8):
        columns, layout, gravity = seen(plan, noise_rad=np.radians(0.5), rng=np.random.default_rng(k))
        rays = column_rays(columns, layout, CAMERA, gravity)
        off = np.log(rays.range) - np.log(true_ranges(plan, rays))
        off = off - np.nanmedian(off)  # the scale is the layout's affair
        inside.append(np.abs(off[rays.known]) < 2.0 * np.sqrt(rays.variance[rays.known]))
    share = np.concatenate(inside).mean()
    assert share > 0.85


def test_columns_are_levelled_again_with_the_refined_gravity(plan):
    measured = (np.radians(1.5), np.radians(1.5))
    columns, layout, _ = seen(plan, measured=measured)
    layout = replace(layout, heights=np.array([2.6 - HEIGHT, HEIGHT]))
    rays = column_rays(columns, replace(layout, gravity=np.zeros(2)), CAMERA, measured)
    wrong = column_rays(columns, replace(layout, gravity=np.array(measured)), CAMERA, measured)
    truth = np.log(true_ranges(plan, rays))

    def typical(r):  # rays beside a step do not count
        return float(np.nanmedian(np.abs(np.log(r.range) - truth)))

    assert typical(rays) < 1e-3 and typical(wrong) > 4e-3


def test_unsure_columns_are_unknown_and_keep_the_limit(plan):
    columns, layout, gravity = seen(plan)
    blind = replace(columns, sure=np.full_like(columns.sure, 0.01))
    rays = column_rays(blind, layout, CAMERA, gravity)
    assert not rays.known.any()
    cast = cast_rays(layout, CAMERA)
    assert rays.limit is not None and np.array_equal(np.isfinite(rays.limit), np.isfinite(cast.limit))


def test_a_disputed_column_is_trusted_less(plan):
    columns, layout, gravity = seen(plan)
    elevation = columns.elevation.copy()
    middle = len(columns) // 2
    elevation[1, middle - 3 : middle + 3] *= 1.6
    calm = column_rays(columns, layout, CAMERA, gravity)
    disputed = column_rays(replace(columns, elevation=elevation), layout, CAMERA, gravity)
    centre = len(calm.known) // 2
    assert not disputed.known[centre] or disputed.variance[centre] > 4.0 * calm.variance[centre]


def test_the_localizer_takes_columns_or_walls(plan):
    columns, _, gravity = seen(plan)
    wireframe = decode(columns, CAMERA, gravity)
    assert wireframe.columns is columns
    for use in (True, False):
        localizer = Localizer(plan, CAMERA, config=LocalizerConfig(columns=use, heights=(HEIGHT, 2.6)))
        estimate = localizer.locate(wireframe, gravity)
        assert np.hypot(*(estimate.pose[:2] - POSE[:2])) < 0.1
        layout, rays = localizer.observe(wireframe, gravity)
        same = np.allclose(rays.variance, cast_rays(layout, CAMERA).variance, equal_nan=True)
        assert same is not use
