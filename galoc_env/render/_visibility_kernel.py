"""What each pixel sees: convex facets drawn as spans into buffers of inverse depth and slot, nearest cluster first.

A slot is a facet that is drawn in this frame. Inverse depth is linear over the image for a plane, which is what makes
spans cheap and depth exact at any tilt.
"""

import math

import numpy as np
from numba import njit

from galoc_env.render._lanes import (
    LANES,
    between,
    choose,
    greater,
    least,
    load,
    ramp,
    ramp_int,
    real,
    spread,
    spread_int,
    store,
    whole,
)

f4, i4 = np.float32, np.int32
NEAR = 0.005
"""What is nearer than this is cut off, m: so little that a camera which touches a wall sees that wall."""
TILE_ROWS = 8
"""The coarse depth map has one value for 16 x 8 pixels."""
OVERLAP = 0.004
"""Facets are drawn this much larger, px, so that rounding leaves no crack where the edges of two only touch."""
MOST = 40
"""Corners of a facet after clipping, at most."""
FAR_AWAY = f4(1e30)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def clear(width, height, stride, inverse, slots):  # type: ignore[no-untyped-def]
    """Empty the buffers; the padding of each row counts as filled, so that it keeps no tile from hiding things."""
    zero, none, full = spread(f4(0.0)), spread_int(i4(-1)), spread(FAR_AWAY)
    edge = spread_int(i4(width))
    last = spread_int(i4(1 << 30))
    for y in range(height):
        for x in range(0, stride, LANES):
            padding = between(spread_int(i4(x)) + ramp_int(), edge, last)
            store(inverse, y * stride + x, choose(padding, full, zero))
            store(slots, y * stride + x, none)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def frustum(view, width, height, planes):  # type: ignore[no-untyped-def]
    """The five planes n . p + d >= 0 that bound what the camera sees, one pixel wider, in the facets' frame."""
    fx, fy, cx, cy = view[12], view[13], view[14], view[15]
    camera = np.empty((5, 3))
    camera[0] = fx, 0.0, cx + 1.5
    camera[1] = -fx, 0.0, width - cx + 0.5
    camera[2] = 0.0, fy, cy + 1.5
    camera[3] = 0.0, -fy, height - cy + 0.5
    camera[4] = 0.0, 0.0, 1.0
    for k in range(5):
        shift = 0.0
        for i in range(3):
            planes[k, i] = view[3 * i] * camera[k, 0] + view[3 * i + 1] * camera[k, 1] + view[3 * i + 2] * camera[k, 2]
            shift += planes[k, i] * view[9 + i]
        planes[k, 3] = -shift
    planes[4, 3] -= NEAR


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def nearest_first(view, planes, boxes, first, last, order, distance):  # type: ignore[no-untyped-def]
    """Clusters that reach into the frustum, by their distance; returns how many."""
    count = 0
    for c in range(first, last):
        seen = True
        for k in range(5):
            top = planes[k, 3]
            for i in range(3):  # the corner of the box that lies farthest along the plane's normal
                n = planes[k, i]
                top += n * (boxes[c, 1, i] if n > 0.0 else boxes[c, 0, i])
            if top < 0.0:
                seen = False
                break
        if not seen:
            continue
        d = 0.0
        for i in range(3):
            gap = max(boxes[c, 0, i] - view[9 + i], view[9 + i] - boxes[c, 1, i], 0.0)
            d += gap * gap
        at = count
        while at > 0 and distance[at - 1] > d:
            distance[at], order[at] = distance[at - 1], order[at - 1]
            at -= 1
        distance[at], order[at] = d, c
        count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def coarse(height, stride, inverse, tiles):  # type: ignore[no-untyped-def]
    """Least inverse depth of each tile: what lies farther is hidden there."""
    columns = stride // LANES
    for row in range(0, height, TILE_ROWS):
        for column in range(columns):
            at = row * stride + column * LANES
            low = load(inverse, at)
            for _ in range(1, min(TILE_ROWS, height - row)):
                at += stride
                value = load(inverse, at)
                low = choose(greater(low, value), value, low)
            tiles[(row // TILE_ROWS) * columns + column] = least(low)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def covered_by(left, right, top, bottom, nearest, width, height, stride, tiles):  # type: ignore[no-untyped-def]
    """Whether what was drawn so far hides everything in a rectangle of the image that is ``nearest`` m away or more."""
    columns = stride // LANES
    x0, x1 = int(max(left - 1.0, 0.0)) // LANES, int(min(right + 1.0, width - 1.0)) // LANES
    y0, y1 = int(max(top - 1.0, 0.0)) // TILE_ROWS, int(min(bottom + 1.0, height - 1.0)) // TILE_ROWS
    bound = f4(1.00001 / nearest)
    for row in range(y0, y1 + 1):
        for column in range(x0, x1 + 1):
            if tiles[row * columns + column] < bound:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def hidden(view, boxes, c, width, height, stride, tiles):  # type: ignore[no-untyped-def]
    """Whether what was drawn so far hides all of a cluster's box."""
    fx, fy, cx, cy = view[12], view[13], view[14], view[15]
    left, right, top, bottom, nearest = 1e9, -1e9, 1e9, -1e9, 1e9
    for corner in range(8):
        p = boxes[c, corner & 1, 0] - view[9]
        q = boxes[c, (corner >> 1) & 1, 1] - view[10]
        r = boxes[c, corner >> 2, 2] - view[11]
        z = view[2] * p + view[5] * q + view[8] * r
        if z < NEAR:
            return False
        u = fx * (view[0] * p + view[3] * q + view[6] * r) / z + cx
        v = fy * (view[1] * p + view[4] * q + view[7] * r) / z + cy
        left, right, top, bottom, nearest = min(left, u), max(right, u), min(top, v), max(bottom, v), min(nearest, z)
    return covered_by(left, right, top, bottom, nearest, width, height, stride, tiles)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def project(view, vertices, first, last, corners):  # type: ignore[no-untyped-def]
    """Vertices in the camera's frame, x and y times the focal lengths, and in pixels: five rows of ``corners``."""
    fx, fy = view[12], view[13]
    x0, x1, x2 = spread(f4(fx * view[0])), spread(f4(fx * view[3])), spread(f4(fx * view[6]))
    y0, y1, y2 = spread(f4(fy * view[1])), spread(f4(fy * view[4])), spread(f4(fy * view[7]))
    z0, z1, z2 = spread(f4(view[2])), spread(f4(view[5])), spread(f4(view[8]))
    px, py, pz = spread(f4(view[9])), spread(f4(view[10])), spread(f4(view[11]))
    cx, cy, one = spread(f4(view[14])), spread(f4(view[15])), spread(f4(1.0))
    for k in range(first, last, LANES):
        a, b, c = load(vertices[0], k) - px, load(vertices[1], k) - py, load(vertices[2], k) - pz
        x, y, z = x0 * a + x1 * b + x2 * c, y0 * a + y1 * b + y2 * c, z0 * a + z1 * b + z2 * c
        at, inverse = k - first, one / z
        store(corners[0], at, x)
        store(corners[1], at, y)
        store(corners[2], at, z)
        store(corners[3], at, x * inverse + cx)
        store(corners[4], at, y * inverse + cy)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def clip(view, corners, first, count, outline):  # type: ignore[no-untyped-def]
    """Cut a facet at the near plane; its outline in pixels, and the number of its corners."""
    kept = 0
    for k in range(count):
        here, after = first + k, first + (k + 1 if k + 1 < count else 0)
        z, w = corners[2, here], corners[2, after]
        if z >= NEAR:
            outline[kept, 0], outline[kept, 1] = corners[3, here], corners[4, here]
            kept += 1
        if (z >= NEAR) != (w >= NEAR):
            # The same point from both ends, so that neighbours that share this edge stay tight.
            low, high = (here, after) if z < w else (after, here)
            share = (NEAR - corners[2, low]) / (float(corners[2, high]) - corners[2, low])
            x = corners[0, low] + share * (float(corners[0, high]) - corners[0, low])
            y = corners[1, low] + share * (float(corners[1, high]) - corners[1, low])
            outline[kept, 0], outline[kept, 1] = x / NEAR + view[14], y / NEAR + view[15]
            kept += 1
    return kept


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def spans(count, outline, first, last, width, left, right):  # type: ignore[no-untyped-def]
    """First and last pixel of a convex outline in each image row from ``first`` to ``last``; first > last for none."""
    for k in range(count):
        after = k + 1 if k + 1 < count else 0
        low, high = (k, after) if outline[k, 1] < outline[after, 1] else (after, k)
        rise = outline[high, 1] - outline[low, 1]
        outline[k, 2], outline[k, 3], outline[k, 4] = outline[low, 0], outline[low, 1], outline[high, 1]
        outline[k, 5] = (outline[high, 0] - outline[low, 0]) / max(rise, 1e-6)
    far, shift, over = spread(f4(1e6)), spread(f4(width + 16)), spread(f4(OVERLAP))
    beyond, before, sixteen = spread(f4(width + 8)), spread(f4(-8.0)), spread(f4(16.0))
    end = spread_int(i4(width - 1))
    for y in range(first, last + 1, LANES):
        row = spread(f4(y)) + ramp()
        west, east = far, spread(f4(-1e6))
        for k in range(count):
            low, high = outline[k, 3], outline[k, 4]
            if low - OVERLAP > y + (LANES - 1) or high + OVERLAP < y:
                continue
            top, bottom = spread(f4(low)), spread(f4(high))
            inside = choose(greater(row, bottom), bottom, choose(greater(top, row), top, row))
            x = spread(f4(outline[k, 2])) + (inside - top) * spread(f4(outline[k, 5]))
            reached = greater(row + over, top) & greater(bottom + over, row)
            west = choose(reached & greater(west, x), x, west)
            east = choose(reached & greater(x, east), x, east)
        # Rounded up and down as whole numbers of positive ones.
        west = choose(greater(west, beyond), beyond, west - over)
        west = choose(greater(before, west), before, west)
        east = choose(greater(before, east), before, east + over)
        east = choose(greater(east, beyond), beyond, east)
        start = spread_int(i4(width + 16)) - whole(shift - west)
        stop = whole(east + sixteen) - spread_int(i4(16))
        store(left, y - first, choose(greater(real(start), spread(f4(0.0))), start, spread_int(i4(0))))
        store(right, y - first, choose(greater(real(stop), real(end)), end, stop))


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def fill(  # type: ignore[no-untyped-def]
    first,
    last,
    left,
    right,
    stride,
    at_corner,
    along_x,
    along_y,
    slot,
    inverse,
    slots,
):
    """Draw spans where they are nearer than what is there; returns the number of pixels they cover."""
    step, number, lane = spread(f4(along_x)) * ramp(), spread_int(i4(slot)), ramp_int()
    covered = 0
    for y in range(first, last + 1):
        a, b = int(left[y - first]), int(right[y - first])
        if a > b:
            continue
        covered += b - a + 1
        row = at_corner + along_y * y
        low, high = spread_int(i4(a)), spread_int(i4(b))
        for x in range(a & -LANES, b + 1, LANES):
            at = y * stride + x
            value = spread(f4(row + along_x * x)) + step
            before = load(inverse, at)
            wins = greater(value, before) & between(spread_int(i4(x)) + lane, low, high)
            store(inverse, at, choose(wins, value, before))
            store(slots, at, choose(wins, number, load(slots, at)))
    return covered


@njit(cache=True, nogil=True, error_model="numpy")
def visible(view, width, height, stride, home, scene, work):  # type: ignore[no-untyped-def]
    """Fill the buffers for one view of one home; returns the number of slots used.

    Args:
        view: (16,) rotation facets' frame from camera (row by row), position, fx, fy, cx, cy.
        width: px.
        height: px.
        stride: length of a row of the buffers, a multiple of 16.
        home: (2,) its first cluster, and the next home's.
        scene: arrays of the homes, see ``galoc_env.render.drawable``.
        work: buffers, see ``galoc_env.render.workspace``.
    """
    vertices, table, numbers = scene.vertices, scene.table, scene.numbers
    boxes, cluster_first = scene.boxes, scene.cluster_first
    inverse, slots, tiles, order, corners = work.inverse, work.slots, work.tiles, work.order, work.corners
    planes, outlines, outline, left, right = work.planes, work.outlines, work.outline, work.left, work.right
    clear(width, height, stride, inverse, slots)
    bounds = np.empty((5, 4))
    frustum(view, width, height, bounds)
    clusters = nearest_first(view, bounds, boxes, home[0], home[1], order, work.distance)
    fx, fy, cx, cy = view[12], view[13], view[14], view[15]
    slot, drawn, refresh, mapped = 0, 0, width * height // 4, False
    for k in range(clusters):
        if drawn >= refresh:
            coarse(height, stride, inverse, tiles)
            drawn, mapped = 0, True
        c = order[k]
        if mapped and hidden(view, boxes, c, width, height, stride, tiles):
            continue
        vertex = numbers[cluster_first[c], 0]
        project(view, vertices, vertex, numbers[cluster_first[c + 1] - 1, 1], corners)
        for i in range(cluster_first[c], cluster_first[c + 1]):
            n0, n1, n2 = table[i, 0], table[i, 1], table[i, 2]
            d = table[i, 3] - (n0 * view[9] + n1 * view[10] + n2 * view[11])
            if d >= -1e-6:
                continue  # seen from behind, or edge on
            start, count = numbers[i, 0] - vertex, numbers[i, 1] - numbers[i, 0]
            inside, nearest = 0, f4(1e30)
            for j in range(start, start + count):
                inside += corners[2, j] >= NEAR
                nearest = min(nearest, corners[2, j])
            if inside == 0:
                continue
            if inside == count:
                for j in range(count):
                    outline[j, 0], outline[j, 1] = corners[3, start + j], corners[4, start + j]
            else:
                count = clip(view, corners, start, count, outline)
            west, east, north, south = outline[0, 0], outline[0, 0], outline[0, 1], outline[0, 1]
            for j in range(1, count):
                west, east = min(west, outline[j, 0]), max(east, outline[j, 0])
                north, south = min(north, outline[j, 1]), max(south, outline[j, 1])
            # Many a facet lies beside the image, or between the centres of pixels.
            first = int(math.ceil(max(north - OVERLAP, 0.0)))
            last = int(math.floor(min(south + OVERLAP, height - 1.0)))
            if first > last or max(west - OVERLAP, 0.0) > math.floor(min(east + OVERLAP, width - 1.0)) or count < 3:
                continue
            if mapped and inside == count:
                if covered_by(west, east, north, south, nearest, width, height, stride, tiles):
                    continue
            bx = (view[0] * n0 + view[3] * n1 + view[6] * n2) / (fx * d)
            by = (view[1] * n0 + view[4] * n1 + view[7] * n2) / (fy * d)
            a = (view[2] * n0 + view[5] * n1 + view[8] * n2) / d - bx * cx - by * cy
            spans(count, outline, first, last, width, left, right)
            covered = fill(first, last, left, right, stride, a, bx, by, slot, inverse, slots)
            if covered:
                drawn += covered
                planes[slot, 0], planes[slot, 1], planes[slot, 2] = a, bx, by
                work.facet_of[slot] = i
                outlines[slot, 0, 0] = count
                for j in range(count):
                    for m in range(4):
                        outlines[slot, j + 1, m] = outline[j, m + 2]
                slot += 1
    return slot
