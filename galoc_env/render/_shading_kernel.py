"""What each pixel looks like: texture times baked light, for runs of pixels that see the same facet, 16 at a time."""

import math

import numpy as np
from numba import njit

from galoc_env.render._lanes import (
    LANES,
    blend,
    blend_again,
    differ,
    first_bit,
    gather,
    lit,
    load,
    ramp,
    spread,
    spread_int,
    store,
    store_bytes,
    store_rgb,
    whole,
)

f4, i4, u4, i8, u8 = np.float32, np.int32, np.uint32, np.int64, np.uint64
LEVELS = 7
"""Mip levels of a texture: 256 to 4 texels wide."""
SIZE, SIZE_BITS = 256, 8
WEIGHT_BITS = 7
"""Positions in a texture are counted in 1/128 texel."""
RED_BLUE = i4(0x00FF00FF)
LIGHT_MASK = u8(0xFFF | 0xFFF << 20 | 0xFFF << 40)
"""A light texel holds three numbers of 12 bits, 20 bits apart."""
VOID = 255
"""Colour of a pixel that sees nothing."""

# Columns of the coefficients of a facet in a view. Where depth is z, texture u at pixel (x, y) is
# c[U + 3] + z * (c[U] + c[U + 1] * x + c[U + 2] * y), and so on. Texture in texture widths, without the constant's
# whole part; column and row of light in 1/256 texel.
U, V, COLUMN, ROW = 0, 4, 8, 12
AREA, GRAZING, LAST_COLUMN, LAST_ROW = 16, 17, 18, 19
"""Texels per pixel (mip level 0) are c[AREA] * z^3; z * c[GRAZING] tells how oblique; largest column and row."""
COEFFICIENTS = 20


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def prepare(view, slot, table, numbers, work):  # type: ignore[no-untyped-def]
    """Fill in the coefficients of the facet in a slot."""
    planes, facet, c = work.planes, work.facet_of[slot], work.coefficients
    fx, fy, cx, cy = view[12], view[13], view[14], view[15]
    for k in range(4):
        p, q, r = table[facet, 4 + 4 * k], table[facet, 5 + 4 * k], table[facet, 6 + 4 * k]
        constant = table[facet, 7 + 4 * k] + p * view[9] + q * view[10] + r * view[11]
        bx = (view[0] * p + view[3] * q + view[6] * r) / fx
        by = (view[1] * p + view[4] * q + view[7] * r) / fy
        a = view[2] * p + view[5] * q + view[8] * r - bx * cx - by * cy
        if k < 2:
            constant -= math.floor(constant)
        scale = 1.0 if k < 2 else 256.0
        c[slot, 4 * k], c[slot, 4 * k + 1], c[slot, 4 * k + 2] = scale * a, scale * bx, scale * by
        c[slot, 4 * k + 3] = scale * constant
    # The map from pixels to the texture is projective, so that its Jacobian is a constant times z^3.
    a, bx, by = planes[slot, 0], planes[slot, 1], planes[slot, 2]
    minor_a = c[slot, U + 1] * c[slot, V + 2] - c[slot, U + 2] * c[slot, V + 1]
    minor_b = c[slot, U + 2] * c[slot, V] - c[slot, U] * c[slot, V + 2]
    minor_c = c[slot, U] * c[slot, V + 1] - c[slot, U + 1] * c[slot, V]
    c[slot, AREA] = float(SIZE * SIZE) * abs(a * minor_a + bx * minor_b + by * minor_c)
    off = table[facet, 3] - table[facet, 0] * view[9] - table[facet, 1] * view[10] - table[facet, 2] * view[11]
    c[slot, GRAZING] = 0.25 / max(-off, 1e-3)
    c[slot, LAST_COLUMN] = 256.0 * numbers[facet, 4] - 257.0
    c[slot, LAST_ROW] = 256.0 * numbers[facet, 5] - 257.0


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def light_at(column, row, last_column, last_row, first, columns, light):  # type: ignore[no-untyped-def]
    """Packed light at a place counted in 1/256 texel, bilinear between light texels."""
    u, v = u8(i8(min(max(column, 0.0), last_column))), u8(i8(min(max(row, 0.0), last_row)))
    wu, wv, one = u & u8(255), v & u8(255), u8(256)
    at = first + (v >> u8(8)) * columns + (u >> u8(8))
    below = at + columns
    top = ((light[at] * (one - wu) + light[at + u8(1)] * wu) >> u8(8)) & LIGHT_MASK
    bottom = ((light[below] * (one - wu) + light[below + u8(1)] * wu) >> u8(8)) & LIGHT_MASK
    return ((top * (one - wv) + bottom * wv) >> u8(8)) & LIGHT_MASK


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def mip_level(z, area, grazing, finest):  # type: ignore[no-untyped-def]
    """Mip level of about one texel per pixel; at grazing angles less blur than would be needed along the view."""
    texels = area * z * z * z * max(1.0, z * grazing)
    level = 0
    while texels > 2.0 and level < LEVELS - 1:
        texels *= 0.25
        level += 1
    return max(level, finest)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def level_start(level):  # type: ignore[no-untyped-def]
    """Texels before a mip level of a texture."""
    # 4^8 + 4^7 + ... as a closed form.
    return ((1 << (2 * SIZE_BITS + 2)) - (1 << (2 * (SIZE_BITS - level) + 2))) // 3


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def texture_lanes(z, u, ux, u_constant, v, vx, v_constant, level, base, texels, plain):  # type: ignore[no-untyped-def]
    """Texture of 16 pixels: red and blue, and green, each as a result of ``blend``.

    Args:
        z: depth of the pixels.
        u: what z is multiplied with at the first pixel to get the texture coordinate less its constant.
        ux: its change from pixel to pixel.
        u_constant: texture coordinate where z = 0, in texture widths, from 0 to 1.
        v: as ``u``.
        vx: as ``ux``.
        v_constant: as ``u_constant``.
        level: mip level.
        base: first texel of the texture.
        texels: packed textures.
        plain: None to blend rows of texels, else take the nearest (compiled for both: a branch would cost much).
    """
    bits = SIZE_BITS - level
    unit = float(1 << (bits + WEIGHT_BITS))
    mask, lane = spread_int(i4((1 << bits) - 1)), ramp()
    weight, three = spread_int(i4(127)), spread_int(i4(3))
    seven, sixteen = spread_int(i4(WEIGHT_BITS)), spread_int(i4(16))
    two, four = spread_int(i4(2)), spread_int(i4(4))
    iu = whole(z * (spread(f4(unit * u)) + spread(f4(unit * ux)) * lane)) + spread_int(i4(unit * u_constant - 64.0))
    iv = whole(z * (spread(f4(unit * v)) + spread(f4(unit * vx)) * lane)) + spread_int(i4(unit * v_constant - 64.0))
    wu, wv = iu & weight, iv & weight
    wu, wv = wu | (wu << sixteen), wv | (wv << sixteen)
    column, row = (iu >> seven) & mask, ((iv + spread_int(i4(0 if plain is None else 64))) >> seven) & mask
    right = (column + spread_int(i4(1))) & mask
    # Texels lie in tiles of 4 x 4.
    shift, start = spread_int(i4(bits + 2)), spread_int(i4(base + level_start(level)))
    west = (((column >> two) << four) | (column & three)) + start
    east = (((right >> two) << four) | (right & three)) + start
    at = ((row >> two) << shift) | ((row & three) << two)
    p, q = gather(texels, west + at), gather(texels, east + at)
    pair, byte, eight = spread_int(RED_BLUE), spread_int(i4(255)), spread_int(i4(8))
    low = blend(p & pair, q & pair, wu), blend((p >> eight) & byte, (q >> eight) & byte, wu)
    high = low
    if plain is None:
        row = (row + spread_int(i4(1))) & mask
        at = ((row >> two) << shift) | ((row & three) << two)
        p, q = gather(texels, west + at), gather(texels, east + at)
        high = blend(p & pair, q & pair, wu), blend((p >> eight) & byte, (q >> eight) & byte, wu)
    return blend_again(low[0], high[0], wv), blend_again(low[1], high[1], wv)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def light_lanes(start, end, share, shift):  # type: ignore[no-untyped-def]
    """Light of pixels between its packed values at the first one and 1 / ``share`` pixels later."""
    a = f4(i4((start >> u8(shift)) & u8(4095)) << i4(4))
    b = f4(i4((end >> u8(shift)) & u8(4095)) << i4(4))
    return whole(spread(a) + spread((b - a) * share) * ramp())


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def finish(to, count, facet, numbers, work, rgb, depth, instance, semantic):  # type: ignore[no-untyped-def]
    """Copy the last pixels of a picture from where ``shade`` has put them."""
    for i in range(count):
        for k in range(3):
            rgb[3 * (to + i) + k] = work.last_rgb[3 * i + k]
        if len(depth):
            depth[to + i] = work.last_depth[i]
        if len(instance):
            instance[to + i] = numbers[facet, 6]
        if len(semantic):
            semantic[to + i] = numbers[facet, 7]


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def blank(to, count, rgb, depth, instance, semantic):  # type: ignore[no-untyped-def]
    """Pixels that see nothing."""
    for i in range(to, to + count):
        rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2] = VOID, VOID, VOID
        if len(depth):
            depth[i] = np.inf
        if len(instance):
            instance[i] = 0
        if len(semantic):
            semantic[i] = 0


@njit(cache=True, nogil=True, error_model="numpy")
def shade(  # type: ignore[no-untyped-def]
    view,
    width,
    height,
    stride,
    finest,
    plain,
    scene,
    work,
    rgb,
    depth,
    instance,
    semantic,
):
    """Write the picture from filled buffers.

    Args:
        view: as for ``visible``.
        width: px.
        height: px.
        stride: as for ``visible``.
        finest: largest mip level that textures have.
        plain: as for ``texture_lanes``.
        scene: as for ``visible``.
        work: as for ``visible``.
        rgb: (H * W * 3,) uint8, written.
        depth: (H * W,) float32 m, written; may be empty.
        instance: (H * W,) int32, written; may be empty.
        semantic: (H * W,) uint8, written; may be empty.
    """
    table, numbers, texels, light = scene.table, scene.numbers, scene.texels, scene.light
    slots, planes, facet_of = work.slots, work.planes, work.facet_of
    c, ready = work.coefficients, work.ready
    total = width * height
    eight, sixteen, one = spread_int(i4(8)), spread_int(i4(16)), spread(f4(1.0))
    for y in range(height):
        x, current, fresh = 0, -2, True
        inverse = step = u = ux = v = vx = column = columnx = row = rowx = z_start = 0.0
        facet = base = 0
        first = columns = start = u8(0)
        while x < width:
            at, to = y * stride + x, y * width + x
            slot = slots[at]
            count = min(first_bit(differ(load(slots, at), spread_int(slot))), LANES, width - x)
            if slot < 0:
                blank(to, count, rgb, depth, instance, semantic)
                x, current = x + count, slot
                continue
            if slot != current:
                if not ready[slot]:
                    prepare(view, slot, table, numbers, work)
                    ready[slot] = True
                facet, current, fresh = facet_of[slot], slot, True
                step = planes[slot, 1]
                inverse = planes[slot, 0] + planes[slot, 2] * y + step * x
                ux, vx, columnx, rowx = c[slot, U + 1], c[slot, V + 1], c[slot, COLUMN + 1], c[slot, ROW + 1]
                u = c[slot, U] + c[slot, U + 2] * y + ux * x
                v = c[slot, V] + c[slot, V + 2] * y + vx * x
                column = c[slot, COLUMN] + c[slot, COLUMN + 2] * y + columnx * x
                row = c[slot, ROW] + c[slot, ROW + 2] * y + rowx * x
                base, first, columns = numbers[facet, 2], u8(numbers[facet, 3]), u8(numbers[facet, 4])
            last_column, last_row = c[slot, LAST_COLUMN], c[slot, LAST_ROW]
            if fresh:
                z_start = 1.0 / inverse
                start = light_at(
                    c[slot, COLUMN + 3] + z_start * column, c[slot, ROW + 3] + z_start * row,
                    last_column, last_row, first, columns, light,
                )  # fmt: skip
                fresh = False
            here, inverse = inverse, inverse + step * count
            column, row = column + columnx * count, row + rowx * count
            z_end = 1.0 / inverse if inverse > 1e-3 else z_start  # beyond a facet's end its plane may vanish
            end = light_at(
                c[slot, COLUMN + 3] + z_end * column, c[slot, ROW + 3] + z_end * row,
                last_column, last_row, first, columns, light,
            )  # fmt: skip
            level = mip_level(0.5 * (z_start + z_end), c[slot, AREA], c[slot, GRAZING], finest)
            z = one / (spread(f4(here)) + spread(f4(step)) * ramp())
            red_blue, green = texture_lanes(z, u, ux, c[slot, U + 3], v, vx, c[slot, V + 3], level, base, texels, plain)
            share = f4(1.0) / f4(count)
            light_rb = light_lanes(start, end, share, 0) | (light_lanes(start, end, share, 40) << sixteen)
            colour = lit(red_blue, light_rb) | (lit(green, light_lanes(start, end, share, 20)) << eight)
            if to + LANES <= total:  # what is written beyond the run is written over by the next
                store_rgb(rgb, 3 * to, colour)
                if len(depth):
                    store(depth, to, z)
                if len(instance):
                    store(instance, to, spread_int(numbers[facet, 6]))
                if len(semantic):
                    store_bytes(semantic, to, spread_int(numbers[facet, 7]))
            else:
                store_rgb(work.last_rgb, 0, colour)
                store(work.last_depth, 0, z)
                finish(to, count, facet, numbers, work, rgb, depth, instance, semantic)
            u, v, start, z_start = u + ux * count, v + vx * count, end, z_end
            x += count
