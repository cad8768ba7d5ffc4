"""Surfaces: facets that continue each other in one plane, and the points at which their soft light is found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from galoc_env.render._surface_kernel import join, link, settle, weigh
from galoc_env.render.facet_build import dot
from galoc_env.render.facet_layout import BIG, SMALL, extent, padded
from galoc_env.render.facets import Facets
from galoc_env.render.light_world import World

Array = NDArray[np.float64]

SPACING, FINE = 0.5, 0.3
"""Between the points of a lattice, and of a floor's, where furniture casts soft shadows, m."""
STRIP = 0.15
"""What is narrower has one row of points, m."""
MOST_POINTS = 400
"""Along a side of a lattice."""
MOST = 800_000
"""Points of a scene: where there would be more they lie farther apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """A lattice of points for every surface."""

    size: NDArray[np.int32]
    """(S, 2) columns and rows of each lattice."""
    first: NDArray[np.int64]
    """(S + 1,) first point of each."""
    points: Array
    """(M, 3) m, just off the surface."""
    facet: NDArray[np.int64]
    """(M,) on which each point lies; -1: on none."""
    fan: NDArray[np.int64]
    """(M,) 0 to 8, different for all neighbours."""
    odd: NDArray[np.int64]
    """(M,) 0 and 1 as on a chessboard."""
    few: NDArray[np.bool_]
    """(M,) whether its surface has but one row of points: it is small or narrow, and half the rays will do."""
    links: NDArray[np.bool_]
    """(M, 2) whether each point and the next in its row, and in its column, see each other."""
    index: NDArray[np.int32]
    """(T, 4) points around each texel ..."""
    weight: NDArray[np.float32]
    """(T, 4) ... and their weights."""


def make_surfaces(facets: Facets, world: World, lit: NDArray[np.bool_]) -> Surfaces:
    """Surfaces of all facets that are lit."""
    label = join(world.rays, lit)
    members = np.flatnonzero(lit)
    members = members[np.argsort(label[members], kind="stable")]
    starts = np.flatnonzero(np.diff(label[members], prepend=-1))
    member_first = np.append(starts, len(members))
    surface = np.full(len(lit), -1, np.int64)
    surface[members] = np.repeat(np.arange(len(starts)), np.diff(member_first))
    frames, size, stretch = _lattices(facets, world, members, starts, surface)
    first = np.concatenate([[0], np.cumsum(size.astype(np.int64).prod(axis=1))])
    points, facet = settle(world.rays, frames, size, first, members, member_first, 1.5 * SPACING * stretch)
    level = np.abs(facets.plane[members[starts], 2]) > 0.9
    check = level & ((size - 1) * FINE > BIG).any(axis=1)
    number = np.arange(first[-1]) - np.repeat(first[:-1], np.diff(first))
    column = number % np.repeat(size[:, 0], np.diff(first))
    row = number // np.repeat(size[:, 0], np.diff(first))
    links = link(world.rays, points, facet, size, first, check)
    index, weight = weigh(
        world.rays, points, facet, links, frames, size, first, surface, world.step, world.size, world.first, lit
    )
    fan, odd, few = column % 3 * 3 + row % 3, (column + row) % 2, np.repeat((size == 1).any(axis=1), np.diff(first))
    return Surfaces(size, first, points, facet, fan, odd, few, links, index, weight)


def _lattices(
    facets: Facets, world: World, members: NDArray[np.intp], starts: NDArray[np.intp], surface: NDArray[np.int64]
) -> tuple[Array, NDArray[np.int32], float]:
    """(S, 3, 3) corner and steps of each lattice, along the axes of its largest facet, and (S, 2) columns and rows.

    Also how much farther apart points are than they should be.
    """
    if not len(starts):
        return np.zeros((0, 3, 3)), np.zeros((0, 2), np.int32), 1.0
    sheets = world.rays[0]
    area = (sheets[:, 12] * sheets[:, 13])[members]
    largest = members[np.lexsort((-area, surface[members]))[starts]]
    axes = np.stack([sheets[largest, 4:7], sheets[largest, 8:11]], axis=1)
    shape = padded(facets.vertices.astype(np.float64), facets.first.astype(np.int64))[members]
    own = axes[surface[members]]
    place = np.stack([dot(shape, own[:, None, k]) for k in range(2)], axis=1)
    low, high = extent(place, 2)
    low = np.minimum.reduceat(low, starts, axis=0)
    span = np.maximum.reduceat(high, starts, axis=0) - low
    floor = (facets.plane[largest, 2] > 0.9) & (span.max(axis=1) > BIG)
    size, stretch = _sizes(span, np.where(floor, FINE, SPACING)[:, None])
    step = span / np.maximum(size - 1, 1)
    low += np.where(size == 1, span / 2, 0.0)
    plane = sheets[largest, :4]
    corner = low[:, :1] * axes[:, 0] + low[:, 1:] * axes[:, 1] + plane[:, 3:] * plane[:, :3]
    return np.concatenate([corner[:, None], axes * step[..., None]], axis=1), size, stretch


def _sizes(span: Array, spacing: Array) -> tuple[NDArray[np.int32], float]:
    """Columns and rows of lattices with these spans (S, 2) m and spacings (S, 1) m, and the stretch of these."""
    most, stretch = max(MOST, 5 * len(span)), 1.0  # none has more than four at last
    while True:
        size = np.clip(np.rint(span / (stretch * spacing)) + 1, 2, MOST_POINTS).astype(np.int32)
        size[(span < STRIP) | (span.max(axis=1) < SMALL)[:, None]] = 1
        if size.astype(np.int64).prod(axis=1).sum() <= most:
            return size, stretch
        stretch *= 1.25
