"""Numba kernel: how well the views along a tree of poses would tell hypotheses apart."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

LOW, PER_UNIT, BINS = -2.0, 8.0, 64
"""Log ranges of the precision table: bin b covers LOW + b / PER_UNIT."""


@njit(cache=True, fastmath=True, error_model="numpy")
def expected_entropy(  # type: ignore[no-untyped-def]
    tree, parent, fresh, hypotheses, outer, prior, near, log_ranges, lowest, highest, index, origin, resolution, rays,
    measured, precision, limit_precision, weight, scale_precision, floor, bump_cost, dead,
):  # fmt: skip
    """Expected entropy of the hypotheses after each node of a tree of motions.

    Node 0 is where the body is. For a hypothesis i the body would stand at i + motion and see ranges r_i; hypothesis j
    explains them with the log-likelihood of :func:`galoc._likelihood_kernel.likelihood_volume` (rays every few degrees,
    the scale profiled out)::

        d      = log r_j - log r_i for rays whose wall line i would see in the image; r_j the nearest to r_i
                 between those within two degrees: an edge may pass on either side of a ray
        s      = sum(p * clip(d, -1, 1)) / (sum(p) + scale_precision)
        cost   = sum(robust(p * (d - s) ** 2)) + scale_precision * s ** 2
        cost  += sum(robust(q * max(log r_j - measured - s, 0) ** 2)) for the others: their wall is nearer than that
        L[i,j] = min(max(dead - weight * cost / 2, floor), 0)            robust(q) = q / (1 + q)

    Views add up along the way, each as far as it is news. Where a wall stops one of i and j and not the other, odometry
    tells: ``bump_cost``. A hypothesis that is stopped learns no more.

    Args:
        tree: (M, 3) motion from node 0 to each node in the body frame: m, m, rad.
        parent: (M,) node before, -1 for node 0; before its children.
        fresh: (M,) share of a view that is news, 0..1: see :func:`freshness`.
        hypotheses: (K, 3) x, y m, heading rad.
        outer: (K,) probability that i is the truth, for the expectation.
        prior: (K,) probability of each hypothesis in the belief.
        near: (K, K) bool: i and j are the same place.
        log_ranges: (P, 360) float32 log of the profiles.
        lowest: (P, 360) float32 least of them within two degrees.
        highest: (P, 360) float32 greatest of them within two degrees.
        index: (H, W) position of each grid cell, -1 for none.
        origin: (2,) m.
        resolution: m.
        rays: (R,) whole degrees beside the heading.
        measured: (R,) least log range at which a wall line is in the image; of a nearer wall no more is known.
        precision: (R, B) 1 / variance over the saturation, by log range: see ``galoc_agents.sight``.
        limit_precision: 1 / variance over the saturation.
        weight: of a ray's cost, saturation included.
        scale_precision: as ``precision``.
        floor: least log-likelihood of a view.
        dead: nats below which views of two hypotheses count as the same: cells of a grid are not exact poses.
        bump_cost: nats.

    Returns:
        (M,) expected entropy, nats; -log of the mass at the truth, averaged over ``outer``.
    """
    nodes, k, n = tree.shape[0], hypotheses.shape[0], rays.shape[0]
    entropy = np.empty(nodes)
    total = np.zeros((nodes, k, k), np.float32)
    stopped = np.zeros((nodes, k), np.bool_)
    seen = np.empty((3, k, n), np.float32)
    for node in range(nodes):
        before = parent[node]
        if before >= 0:
            total[node] = total[before]
            stopped[node] = stopped[before]
            _look(
                tree[node], hypotheses, log_ranges, lowest, highest, index, origin, resolution, rays, seen,
                stopped[node],
            )  # fmt: skip
            _compare(
                total[node], stopped[node], stopped[before], seen, measured, precision, limit_precision,
                weight, scale_precision, floor, bump_cost, dead, np.float32(fresh[node]),
            )  # fmt: skip
        entropy[node] = _entropy(total[node], outer, prior, near)
    return entropy


@njit(cache=True, fastmath=True, error_model="numpy")
def _look(motion, hypotheses, log_ranges, lowest, highest, index, origin, resolution, rays, seen, stopped):  # type: ignore[no-untyped-def]
    """Log ranges that each hypothesis would see after a motion; marks those that a wall stops."""
    for i in range(hypotheses.shape[0]):
        if stopped[i]:
            continue
        c, s = math.cos(hypotheses[i, 2]), math.sin(hypotheses[i, 2])
        x = hypotheses[i, 0] + c * motion[0] - s * motion[1]
        y = hypotheses[i, 1] + s * motion[0] + c * motion[1]
        row, col = math.floor((y - origin[1]) / resolution), math.floor((x - origin[0]) / resolution)
        if row < 0 or col < 0 or row >= index.shape[0] or col >= index.shape[1] or index[row, col] < 0:
            stopped[i] = True
            continue
        at = index[row, col]
        heading = int(round(math.degrees(hypotheses[i, 2] + motion[2])))
        for r in range(rays.shape[0]):
            bearing = (heading + rays[r]) % 360
            seen[0, i, r] = log_ranges[at, bearing]
            seen[1, i, r] = lowest[at, bearing]
            seen[2, i, r] = highest[at, bearing]


@njit(cache=True, fastmath=True, error_model="numpy")
def _compare(  # type: ignore[no-untyped-def]
    total, stopped, stopped_before, seen, measured, precision, limit_precision, weight, scale_precision, floor,
    bump_cost, dead, fresh,
):  # fmt: skip
    """Add the log-likelihoods of one view to (K, K) totals."""
    _, k, n = seen.shape
    p = np.empty(n, np.float32)
    d = np.empty(n, np.float32)
    bins = precision.shape[1]
    for i in range(k):
        if not stopped[i]:
            mass = np.float32(0.0)
            for r in range(n):
                at = min(max(int((seen[0, i, r] - LOW) * PER_UNIT), 0), bins - 1)
                p[r] = precision[r, at] if seen[0, i, r] >= measured[r] else np.float32(0.0)
                mass += p[r]
        for j in range(k):
            if j == i:
                continue
            if stopped[i] or stopped[j]:
                if stopped[i] != stopped[j] and not stopped_before[i] and not stopped_before[j]:
                    total[i, j] -= bump_cost
                continue
            shift = np.float32(0.0)
            for r in range(n):
                d[r] = max(seen[1, j, r] - seen[0, i, r], np.float32(0.0)) + min(
                    seen[2, j, r] - seen[0, i, r], np.float32(0.0)
                )
                shift += p[r] * min(max(d[r], np.float32(-1.0)), np.float32(1.0))
            shift /= mass + scale_precision
            cost = scale_precision * shift * shift
            for r in range(n):
                if p[r] > 0.0:
                    q = p[r] * (d[r] - shift) ** 2
                else:
                    beyond = max(seen[1, j, r] - measured[r] - shift, np.float32(0.0))
                    q = limit_precision * beyond * beyond
                cost += q / (np.float32(1.0) + q)
            total[i, j] += fresh * min(max(np.float32(-0.5) * weight * cost + dead, floor), np.float32(0.0))


@njit(cache=True, fastmath=True, error_model="numpy")
def _entropy(total, outer, prior, near):  # type: ignore[no-untyped-def]
    """Mean over ``outer`` of -log of the posterior mass at the truth."""
    k = total.shape[0]
    mean = 0.0
    for i in range(k):
        if outer[i] <= 0.0:
            continue
        here, everywhere = 0.0, 0.0
        for j in range(k):
            mass = prior[j] * math.exp(total[i, j])
            everywhere += mass
            if near[i, j]:
                here += mass
        mean -= outer[i] * math.log(here / everywhere)
    return mean


@njit(cache=True)
def shares_seen(hypotheses, views, log_ranges, index, origin, resolution, rays, measured):  # type: ignore[no-untyped-def]
    """Share of the rays whose wall line would be in the image.

    Args:
        hypotheses: (K, 3) x, y m, heading rad.
        views: (W, 3) motions from there in the body frame.
        log_ranges: (P, 360) float32 log of the profiles.
        index: (H, W) position of each grid cell, -1 for none.
        origin: (2,) m.
        resolution: m.
        rays: (R,) whole degrees beside the heading.
        measured: (R,) least log range at which a wall line is in the image.

    Returns:
        (K, W) 0..1; NaN where there is no free space.
    """
    out = np.empty((hypotheses.shape[0], views.shape[0]))
    for i in range(hypotheses.shape[0]):
        c, s = math.cos(hypotheses[i, 2]), math.sin(hypotheses[i, 2])
        for w in range(views.shape[0]):
            x = hypotheses[i, 0] + c * views[w, 0] - s * views[w, 1]
            y = hypotheses[i, 1] + s * views[w, 0] + c * views[w, 1]
            row, col = math.floor((y - origin[1]) / resolution), math.floor((x - origin[0]) / resolution)
            if row < 0 or col < 0 or row >= index.shape[0] or col >= index.shape[1] or index[row, col] < 0:
                out[i, w] = math.nan
                continue
            profile = log_ranges[index[row, col]]
            heading = int(round(math.degrees(hypotheses[i, 2] + views[w, 2])))
            count = 0
            for r in range(rays.shape[0]):
                if profile[(heading + rays[r]) % 360] >= measured[r]:
                    count += 1
            out[i, w] = count / rays.shape[0]
    return out


@njit(cache=True)
def freshness(tree, parent, views, reach_m, reach_rad):  # type: ignore[no-untyped-def]
    """How far the view at each node of a tree differs from all before it.

    Views of one wall from one side share its furniture, its flaws on the map and the detector's habits: seen again they
    tell nothing, though a filter would count them once more.

    Args:
        tree: (M, 3) motions in the body frame.
        parent: (M,) node before, -1 for node 0.
        views: (W, 3) earlier views in the same frame.
        reach_m: distance at which views share exp(-1) of what they tell, m.
        reach_rad: the same for directions, rad.

    Returns:
        (M,) 1 - the largest share.
    """
    out = np.empty(tree.shape[0])
    for node in range(tree.shape[0]):
        least = math.inf
        for w in range(views.shape[0]):
            least = min(least, _apart(tree[node], views[w], reach_m, reach_rad))
        at = parent[node]
        while at >= 0:
            least = min(least, _apart(tree[node], tree[at], reach_m, reach_rad))
            at = parent[at]
        out[node] = 1.0 - math.exp(-least)
    return out


@njit(cache=True)
def _apart(a, b, reach_m, reach_rad):  # type: ignore[no-untyped-def]
    turn = (a[2] - b[2] + math.pi) % (2.0 * math.pi) - math.pi
    return ((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2) / reach_m**2 + (turn / reach_rad) ** 2
