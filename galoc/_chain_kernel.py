"""Numba kernels of the maximum-likelihood layout: Gauss-Newton over a wall chain in pixels.

A chain has N nodes (wall ends). On the level plane node i stands at abscissa ``m = x / z`` with inverse depth
``s = 1 / z``, in the gauge where the geometric mean of the two heights is 1: the ceiling then lies at
``-exp(-k / 2) s`` and the floor at ``exp(k / 2) s`` with ``k = log(h_floor / h_ceiling)``. The parameter vector is
``(m_0, s_0, m_1, s_1, ..., k, roll, pitch, psi)``; psi is the direction of the walls' right-angled grid.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from galoc._linalg_kernel import cholesky, cholesky_solve

POINT, VERTICAL, LINE, TIE = 0, 1, 2, 3
"""Measurements: a junction; a pixel on a node's vertical; a pixel on a wall's ceiling or floor line; two nodes at one
azimuth."""
MAX_DIRECTION_VAR = math.radians(10.0) ** 2
"""Walls with a more uncertain direction do not take part in the wall-direction prior, rad^2."""
ROUNDS = 6
"""Gauss-Newton steps at most."""
S_MIN = 0.01
"""Least inverse depth: a wall at 100 times the mean height."""


@njit(cache=True, error_model="numpy")
def levelling_matrix(roll, pitch):  # type: ignore[no-untyped-def]
    """R_x(pitch) R_z(roll), as :func:`galoc.camera.levelling`."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = cr, -sr, 0.0
    out[1, 0], out[1, 1], out[1, 2] = cp * sr, cp * cr, -sp
    out[2, 0], out[2, 1], out[2, 2] = sp * sr, sp * cr, cp
    return out


@njit(cache=True, error_model="numpy")
def measurement_rows(t, kind, a, b, row, uv, theta, n, rot, intrinsics, res, jac, idx):  # type: ignore[no-untyped-def]
    """Residuals (observed minus predicted, px) and Jacobian of one measurement.

    Fills ``res`` (2,), ``jac`` (2, 7) and ``idx`` (7,); returns the numbers of residuals and of parameters.
    """
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    i = a[t]
    k = theta[2 * n]
    height = -math.exp(-0.5 * k) if row[t] == 0 else math.exp(0.5 * k)  # level-plane y per inverse depth
    dheight = 0.5 * abs(height)
    if kind[t] == POINT:
        m, s = theta[2 * i], theta[2 * i + 1]
        y = height * s
        c0 = rot[0, 0] * m + rot[1, 0] * y + rot[2, 0]
        c1 = rot[0, 1] * m + rot[1, 1] * y + rot[2, 1]
        c2 = max(rot[0, 2] * m + rot[1, 2] * y + rot[2, 2], 1e-3)
        res[0] = uv[t, 0] - (fx * c0 / c2 + cx)
        res[1] = uv[t, 1] - (fy * c1 / c2 + cy)
        # Turning the level frame by roll and pitch, see levelling_matrix.
        cp, sp = rot[2, 2], -rot[1, 2]
        w1, w2 = cp * y + sp, -sp * y + cp
        cr, sr = rot[0, 0], -rot[0, 1]
        for column in range(5):
            if column == 0:
                d0, d1, d2 = rot[0, 0], rot[0, 1], rot[0, 2]
                idx[column] = 2 * i
            elif column == 1:
                d0, d1, d2 = rot[1, 0] * height, rot[1, 1] * height, rot[1, 2] * height
                idx[column] = 2 * i + 1
            elif column == 2:
                d0, d1, d2 = rot[1, 0] * dheight * s, rot[1, 1] * dheight * s, rot[1, 2] * dheight * s
                idx[column] = 2 * n
            elif column == 3:
                d0, d1, d2 = c1, -c0, 0.0
                idx[column] = 2 * n + 1
            else:
                d0, d1, d2 = sr * w2, cr * w2, -w1
                idx[column] = 2 * n + 2
            jac[0, column] = fx * (d0 - c0 / c2 * d2) / c2
            jac[1, column] = fy * (d1 - c1 / c2 * d2) / c2
        return 2, 5
    if kind[t] == TIE:
        j = b[t]
        res[0] = theta[2 * j] - theta[2 * i]
        idx[0], idx[1] = 2 * i, 2 * j
        jac[0, 0], jac[0, 1] = 1.0, -1.0
        return 1, 2
    q0, q1 = (uv[t, 0] - cx) / fx, (uv[t, 1] - cy) / fy
    r0 = rot[0, 0] * q0 + rot[0, 1] * q1 + rot[0, 2]
    r1 = rot[1, 0] * q0 + rot[1, 1] * q1 + rot[1, 2]
    r2 = max(rot[2, 0] * q0 + rot[2, 1] * q1 + rot[2, 2], 1e-3)
    cr, sr = rot[0, 0], -rot[0, 1]
    cp, sp = rot[2, 2], -rot[1, 2]
    x_turned, y_turned = cr * q0 - sr * q1, sr * q0 + cr * q1
    roll0, roll1, roll2 = -y_turned, cp * x_turned, sp * x_turned
    if kind[t] == VERTICAL:
        m = theta[2 * i]
        gradient = max(abs(rot[0, 0] - m * rot[2, 0]) / fx, 1e-9)  # such pixels move along u
        res[0] = -(r0 - m * r2) / gradient
        jac[0, 0] = -r2 / gradient
        jac[0, 1] = (roll0 - m * roll2) / gradient
        jac[0, 2] = -m * r1 / gradient
        idx[0], idx[1], idx[2] = 2 * i, 2 * n + 1, 2 * n + 2
        return 1, 3
    j = b[t]
    ma, sa, mb, sb = theta[2 * i], theta[2 * i + 1], theta[2 * j], theta[2 * j + 1]
    width = mb - ma
    if abs(width) < 1e-4:
        width = 1e-4
    mu = r0 / r2
    share = (mu - ma) / width
    slope = (sb - sa) / width
    e = r1 / r2 - height * (sa + slope * (mu - ma))
    d0, d1, d2 = -height * slope / r2, 1.0 / r2, (height * slope * r0 - r1) / (r2 * r2)
    # The pixel lies on the image border and moves along it: u on the upper and lower one, v on the others.
    if uv[t, 2] == 0.0:
        gradient = abs(d0 * rot[0, 0] + d1 * rot[1, 0] + d2 * rot[2, 0]) / fx
    else:
        gradient = abs(d0 * rot[0, 1] + d1 * rot[1, 1] + d2 * rot[2, 1]) / fy
    gradient = max(gradient, 1e-5)
    res[0] = -e / gradient
    jac[0, 0] = height * slope * (1.0 - share) / gradient
    jac[0, 1] = -height * (1.0 - share) / gradient
    jac[0, 2] = height * slope * share / gradient
    jac[0, 3] = -height * share / gradient
    jac[0, 4] = -dheight * (sa + slope * (mu - ma)) / gradient
    jac[0, 5] = (d0 * roll0 + d1 * roll1 + d2 * roll2) / gradient
    jac[0, 6] = (-d1 * r2 + d2 * r1) / gradient
    idx[0], idx[1], idx[2], idx[3] = 2 * i, 2 * i + 1, 2 * j, 2 * j + 1
    idx[4], idx[5], idx[6] = 2 * n, 2 * n + 1, 2 * n + 2
    return 1, 7


@njit(cache=True, error_model="numpy")
def normal_equations(  # type: ignore[no-untyped-def]
    theta, n, kind, a, b, row, uv, sd, use, intrinsics, prior, prior_sd, walls, wall_weight, wall_sd, hess, grad
):
    """Fill the information matrix and the gradient at ``theta``; returns the cost, a sum of whitened squares."""
    size = 2 * n + 4
    cost = 0.0
    for p in range(size):
        for q in range(size):
            hess[p, q] = 0.0
        weight = 1.0 / (prior_sd[p] * prior_sd[p])
        hess[p, p] = weight
        grad[p] = weight * (prior[p] - theta[p])
        cost += weight * (prior[p] - theta[p]) ** 2
    rot = levelling_matrix(theta[2 * n + 1], theta[2 * n + 2])
    res = np.empty(2)
    jac = np.empty((2, 7))
    idx = np.empty(7, np.int64)
    for t in range(kind.shape[0]):
        if not use[t]:
            continue
        rows, count = measurement_rows(t, kind, a, b, row, uv, theta, n, rot, intrinsics, res, jac, idx)
        weight = 1.0 / (sd[t] * sd[t])
        for r in range(rows):
            cost += weight * res[r] * res[r]
            for p in range(count):
                v = weight * jac[r, p]
                grad[idx[p]] += v * res[r]
                for q in range(count):
                    hess[idx[p], idx[q]] += v * jac[r, q]
    d = np.empty(5)
    at = np.empty(5, np.int64)
    for w in range(walls.shape[0]):
        if wall_weight[w] <= 0.0:
            continue
        e, d0, d1, d2, d3 = wall_direction(theta, walls[w, 0], walls[w, 1])
        e = turn_mod_right_angle(e - theta[size - 1])
        d[0], d[1], d[2], d[3], d[4] = d0, d1, d2, d3, -1.0
        at[0], at[1], at[2], at[3] = 2 * walls[w, 0], 2 * walls[w, 0] + 1, 2 * walls[w, 1], 2 * walls[w, 1] + 1
        at[4] = size - 1
        weight = wall_weight[w] / (wall_sd * wall_sd)
        cost += weight * e * e
        for p in range(5):
            grad[at[p]] -= weight * d[p] * e
            for q in range(5):
                hess[at[p], at[q]] += weight * d[p] * d[q]
    return cost


@njit(cache=True, error_model="numpy")
def turn_mod_right_angle(angle):  # type: ignore[no-untyped-def]
    """Angle wrapped to [-pi/4, pi/4): the difference of two directions on one right-angled grid."""
    return (angle + math.pi / 4.0) % (math.pi / 2.0) - math.pi / 4.0


@njit(cache=True, error_model="numpy")
def wall_direction(theta, i, j):  # type: ignore[no-untyped-def]
    """Direction of the wall between nodes i and j seen from above, and its derivatives by (m_i, s_i, m_j, s_j)."""
    mi, si, mj, sj = theta[2 * i], theta[2 * i + 1], theta[2 * j], theta[2 * j + 1]
    dx, dz = mj / sj - mi / si, 1.0 / sj - 1.0 / si
    square = max(dx * dx + dz * dz, 1e-12)
    gx, gz = -dz / square, dx / square
    return (
        math.atan2(dz, dx), -gx / si, (gx * mi + gz) / (si * si), gx / sj, -(gx * mj + gz) / (sj * sj),
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def iterate(  # type: ignore[no-untyped-def]
    theta, n, kind, a, b, row, uv, sd, use, intrinsics, prior, prior_sd, walls, wall_weight, wall_sd, hess, grad
):
    """Gauss-Newton from ``theta`` (in place). Leaves the last Cholesky factor in ``hess``; returns success."""
    size = 2 * n + 4
    for _ in range(ROUNDS):
        normal_equations(
            theta, n, kind, a, b, row, uv, sd, use, intrinsics, prior, prior_sd, walls, wall_weight, wall_sd, hess, grad
        )
        if not cholesky(hess, size):
            return False
        cholesky_solve(hess, grad, size)
        step = 1.0
        for i in range(n):  # an inverse depth shrinks to no less than 0.3 of itself in one step
            s, d = theta[2 * i + 1], grad[2 * i + 1]
            if d < -0.7 * s:
                step = min(step, max(0.1, -0.7 * s / d))
        largest = 0.0
        for p in range(size):
            theta[p] += step * grad[p]
            largest = max(largest, abs(step * grad[p]))
        for i in range(n):
            theta[2 * i + 1] = max(theta[2 * i + 1], S_MIN)
        theta[2 * n] = min(max(theta[2 * n], -2.0), 2.0)
        if largest < 1e-6:
            break
    return True


@njit(cache=True, error_model="numpy")
def worst_group(theta, n, kind, a, b, row, uv, sd, use, group, intrinsics, cov):  # type: ignore[no-untyped-def]
    """The group of measurements that fits worst: its index (-1: none), its test value, typical chi2 and redundancy.

    A group's residuals are tested against their own covariance ``S - J C J^T``: the squared whitened residuals divided
    by the group's mean redundancy, which is chi-square with ``dof`` freedoms in a sound frame. The value returned is
    that statistic divided by its 99.9 % quantile. The typical chi2 per freedom is the median over the groups, which one
    gross error does not move.
    """
    groups = 0
    for t in range(group.shape[0]):
        groups = max(groups, group[t] + 1)
    square = np.zeros(groups)
    redundancy = np.zeros(groups)
    rows_in = np.zeros(groups)
    rot = levelling_matrix(theta[2 * n + 1], theta[2 * n + 2])
    res = np.empty(2)
    jac = np.empty((2, 7))
    idx = np.empty(7, np.int64)
    free, tested = 0.0, 0
    ratio = np.empty(groups)
    for t in range(kind.shape[0]):
        if not use[t] or kind[t] == TIE:
            continue
        rows, count = measurement_rows(t, kind, a, b, row, uv, theta, n, rot, intrinsics, res, jac, idx)
        for r in range(rows):
            v = 0.0
            for p in range(count):
                for q in range(count):
                    v += jac[r, p] * cov[idx[p], idx[q]] * jac[r, q]
            square[group[t]] += res[r] * res[r] / (sd[t] * sd[t])
            redundancy[group[t]] += max(0.0, 1.0 - v / (sd[t] * sd[t]))
            rows_in[group[t]] += 1.0
    worst, value = -1, 0.0
    for g in range(groups):
        free += redundancy[g]
        if rows_in[g] == 0.0 or redundancy[g] < 0.1:
            continue  # nothing speaks against it but itself
        ratio[tested] = square[g] / redundancy[g]
        tested += 1
        dof = max(1.0, math.floor(redundancy[g] + 0.5))
        quantile = 10.83 if dof == 1.0 else 13.82 if dof == 2.0 else 16.27 if dof == 3.0 else 18.47
        test = square[g] * min(dof, 4.0) / redundancy[g] / quantile
        if test > value:
            worst, value = g, test
    # The median of chi-square per freedom is 0.69 for the two freedoms of a pair.
    typical = median(ratio[:tested]) / 0.693 if tested > 0 else 1.0
    return worst, value, typical, free


@njit(cache=True, error_model="numpy")
def median(values):  # type: ignore[no-untyped-def]
    """Median of at least one value; sorts them in place. That of numpy costs a second to compile."""
    count = values.shape[0]
    for i in range(1, count):
        value, j = values[i], i
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
    return 0.5 * (values[(count - 1) // 2] + values[count // 2])


@njit(cache=True, error_model="numpy")
def grid_weights(theta, n, walls, cov, wall_sd, share):  # type: ignore[no-untyped-def]
    """Probability of each wall to lie on the best right-angled grid, and that grid's direction (mixture, E step).

    Every wall proposes its own direction; predicted direction variances decide who agrees. All zero where fewer than
    two walls do.
    """
    count = walls.shape[0]
    angle = np.empty(count)
    variance = np.empty(count)
    d = np.empty(4)
    at = np.empty(4, np.int64)
    for w in range(count):
        i, j = walls[w, 0], walls[w, 1]
        angle[w], d[0], d[1], d[2], d[3] = wall_direction(theta, i, j)
        at[0], at[1], at[2], at[3] = 2 * i, 2 * i + 1, 2 * j, 2 * j + 1
        v = wall_sd * wall_sd
        for p in range(4):
            for q in range(4):
                v += d[p] * cov[at[p], at[q]] * d[q]
        variance[w] = v
    uniform = (1.0 - share) / (math.pi / 2.0)
    best, direction = -1e18, 0.0
    weight = np.zeros(count)
    trial = np.empty(count)
    for h in range(count):
        psi = angle[h]
        value = 0.0
        for step in range(3):
            value, total, pull = 0.0, 0.0, 0.0
            for w in range(count):
                e = turn_mod_right_angle(angle[w] - psi)
                g = share * math.exp(-0.5 * e * e / variance[w]) / math.sqrt(2.0 * math.pi * variance[w])
                value += math.log(g + uniform)
                trial[w] = g / (g + uniform)
                total += trial[w] / variance[w]
                pull += trial[w] * e / variance[w]
            if step < 2 and total > 0.0:
                psi += pull / total
        if value > best:
            best, direction = value, psi
            for w in range(count):
                weight[w] = trial[w]
    agree = 0.0
    for w in range(count):
        # A wall whose direction is hardly known may snap to the wrong axis.
        if weight[w] < 0.3 or variance[w] > MAX_DIRECTION_VAR:
            weight[w] = 0.0
        agree += weight[w]
    if agree < 1.5:
        return np.zeros(count), direction
    return weight, direction
