"""Pictures of many views: from pose to bytes, one kernel call for all of a worker's lanes."""

import math

import numpy as np
from numba import njit

from galoc_env.render._edges_kernel import smooth
from galoc_env.render._gloss_kernel import mirror, reflect
from galoc_env.render._shading_kernel import shade
from galoc_env.render._visibility_kernel import visible


@njit(cache=True, nogil=True, error_model="numpy")
def look(pose, height_m, gravity, origin, camera, view):  # type: ignore[no-untyped-def]
    """Fill a view (16,): world from camera at a pose, seen from a home's origin, and fx, fy, cx, cy.

    The rotation is that of ``galoc_env.render.world_from_camera``: heading, then R_x(pitch) @ R_z(roll).
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    cr, sr, cp, sp = math.cos(gravity[0]), math.sin(gravity[0]), math.cos(gravity[1]), math.sin(gravity[1])
    # Columns are the camera's x, y and z axes in the levelled frame (x right, y down, z ahead).
    level = ((cr, -sr, 0.0), (cp * sr, cp * cr, -sp), (sp * sr, sp * cr, cp))
    for k in range(3):
        view[k] = s * level[0][k] + c * level[2][k]
        view[3 + k] = -c * level[0][k] + s * level[2][k]
        view[6 + k] = -level[1][k]
    view[9], view[10], view[11] = pose[0] - origin[0], pose[1] - origin[1], height_m - origin[2]
    view[12:16] = camera


@njit(cache=True, nogil=True, error_model="numpy")
def picture(  # type: ignore[no-untyped-def]
    view,
    width,
    height,
    stride,
    finest,
    home,
    scene,
    work,
    plain,
    rgb,
    depth,
    instance,
    semantic,
):
    """One picture; ``plain`` is None for smooth edges and textures. The kernels are compiled for both."""
    used = visible(view, width, height, stride, home, scene, work)
    work.ready[:used] = False
    shade(view, width, height, stride, finest, plain, scene, work, rgb, depth, instance, semantic)
    if plain is None:
        smooth(width, height, stride, work, rgb)


@njit(cache=True, nogil=True, error_model="numpy")
def halve(width, height, fine, rgb):  # type: ignore[no-untyped-def]
    """Mean of 2 x 2 pixels of a picture twice as wide and high; of squares, close to the mean of light."""
    for y in range(height):
        for x in range(width):
            for k in range(3):
                total = np.int32(0)
                for j in range(2):
                    for i in range(2):
                        value = np.int32(fine[3 * ((2 * y + j) * 2 * width + 2 * x + i) + k])
                        total += value * value
                rgb[3 * (y * width + x) + k] = np.uint8(math.sqrt(total * 0.25) + 0.5)


@njit(cache=True, nogil=True, error_model="numpy")
def draw(first, last, lanes, camera, size, homes, scene, work, outputs):  # type: ignore[no-untyped-def]
    """Draw the lanes from ``first`` to ``last``.

    Args:
        first: lane.
        last: lane after the last.
        lanes: home (L,), pose (L, 3), height (L,), gravity (L, 2).
        camera: (4,) fx, fy, cx, cy.
        size: width, height, length of a buffer's row; 0 for plain edges, 1 for smooth ones, 2 for a picture that is
            also drawn twice as fine and averaged, with glossy floors; largest mip level that textures have.
        homes: ``Homes``, and
        scene: ``SceneArrays``, both of ``galoc_env.render.drawable``.
        work: buffers, see ``galoc_env.render.workspace``.
        outputs: rgb (L, H * W * 3), depth, instance and semantic (L, H * W), the last three empty when not wanted.
    """
    width, height, stride, quality, finest = size
    which, poses, heights, gravities = lanes
    rgb, depth, instance, semantic = outputs
    view, below = np.empty(16), np.empty(16)
    with_ids = depth.shape[1] + instance.shape[1] + semantic.shape[1] > 0
    for lane in range(first, last):
        home = which[lane]
        look(poses[lane], heights[lane], gravities[lane], homes.origin[home], camera, view)
        clusters = homes.clusters[home]
        maps = depth[lane], instance[lane], semantic[lane]
        if quality == 1:
            picture(view, width, height, stride, finest, clusters, scene, work, None, rgb[lane], *maps)
        elif quality == 0 or with_ids:
            picture(view, width, height, stride, finest, clusters, scene, work, True, rgb[lane], *maps)
        if quality == 2:
            for k in range(4):  # pixel i becomes the pixels 2 i and 2 i + 1
                view[12 + k] = 2.0 * camera[k] + (0.5 if k > 1 else 0.0)
            w, h, wide, floor = 2 * width, 2 * height, -(-2 * width // 16) * 16, -homes.origin[home, 2]
            maps = depth[lane, :0], instance[lane, :0], semantic[lane, :0]
            glossy = homes.glossy[home] and view[11] > floor + 0.05
            if glossy:
                mirror(view, floor, below)
                picture(below, w, h, wide, finest, clusters, scene, work, True, work.reflection, *maps)
            picture(view, w, h, wide, finest, clusters, scene, work, None, work.fine, *maps)
            if glossy:
                reflect(view, w, h, wide, floor, scene.numbers, work, work.fine)
            halve(width, height, work.fine, rgb[lane])
