"""A correlation in vector registers: the inner loop of the dense cosine, written as vector IR for numba.

The similarity of one position at every heading is a correlation of the profile with the observation. Loop by loop it
is bound by loads: each product needs a profile value at another alignment. But the profile, read at lane offset r,
serves all pairs of heading block b and tap block j with the same b + j, so that one load feeds many products and the
sums never leave their registers. LLVM does not find this by itself; numba lets us hand it the instructions.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
import numba
from llvmlite import ir
from numba import extending, njit, types

intrinsic: Any = extending.intrinsic  # for type checkers: what it returns is called without the typing context


def _wide() -> bool:
    """Whether numba compiles for 512-bit registers."""
    config: Any = numba.config
    features = config.CPU_FEATURES
    if features is not None:
        return "+avx512f" in features
    if config.CPU_NAME not in (None, "", llvm.get_host_cpu_name()):
        return False
    return bool(llvm.get_host_cpu_features().get("avx512f", False))


# 32 registers of 16 lanes hold 23 blocks of headings and 7 taps; 16 registers of 8 lanes hold 9 and 4.
LANES, BLOCKS, MOST = (16, 23, 7) if _wide() else (8, 9, 4)
"""Lanes of a vector; heading blocks of one call; most tap blocks of one call."""
SPAN = LANES * BLOCKS
"""Headings of one call."""
GROUPS = -(-360 // SPAN)
"""Calls that cover 360 headings."""


def _emit(builder: Any, pointers: tuple[Any, Any, Any], taps: int) -> None:
    """Sums of BLOCKS heading blocks, taps r, r + LANES, ... of the observation added."""
    out, profile, weights = pointers
    scalar = ir.FloatType()
    vector = ir.VectorType(scalar, LANES)

    def at(base: Any, index: int, kind: Any) -> Any:
        element = builder.gep(base, [ir.Constant(ir.IntType(64), index)])
        return builder.bitcast(element, kind.as_pointer())

    def spread(value: Any) -> Any:
        first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
        zero = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), zero)

    weight = [spread(builder.load(at(weights, j * LANES, scalar))) for j in range(taps)]
    sums = [builder.load(at(out, b * LANES, vector), align=4) for b in range(BLOCKS)]
    for m in range(BLOCKS + taps - 1):
        window = builder.load(at(profile, m * LANES, vector), align=4)
        for j in range(taps):
            b = m - j
            if 0 <= b < BLOCKS:
                product = builder.fmul(weight[j], window, flags=("contract",))
                sums[b] = builder.fadd(sums[b], product, flags=("contract",))
    for b in range(BLOCKS):
        builder.store(sums[b], at(out, b * LANES, vector), align=4)


def _accumulator(taps: int) -> Any:
    @intrinsic
    def accumulate(typing_context, out, out_at, profile, profile_at, weights, weights_at):  # type: ignore[no-untyped-def]
        """Add ``taps`` tap blocks to SPAN sums; see :func:`_emit`. Arrays (float32, C order) with their offsets."""
        signature = types.void(out, types.intp, profile, types.intp, weights, types.intp)

        def codegen(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            pointers = []
            for k in (0, 2, 4):
                array = context.make_array(signature.args[k])(context, builder, arguments[k])
                pointers.append(builder.gep(array.data, [arguments[k + 1]]))
            _emit(builder, (pointers[0], pointers[1], pointers[2]), taps)
            return context.get_dummy_value()

        return signature, codegen

    return accumulate


accumulate_most, accumulate_4, accumulate_2, accumulate_1 = (_accumulator(taps) for taps in (MOST, 4, 2, 1))


@njit(cache=True, inline="always")
def correlate(out, out_at, profile, profile_at, weights):  # type: ignore[no-untyped-def]
    """Add the correlation of a profile with an observation to SPAN sums: out[v] += sum_i weights[i] profile[v + i].

    Args:
        out: float32 sums; those from ``out_at`` on are added to.
        out_at: index of the first sum.
        profile: float32, SPAN + n - 1 values from ``profile_at`` on.
        profile_at: index of the first value.
        weights: (n,) float32, n a multiple of LANES.
    """
    block, blocks = 0, weights.shape[0] // LANES
    while block < blocks:
        left = blocks - block
        taps = MOST if left >= MOST else 4 if left >= 4 else 2 if left >= 2 else 1
        for r in range(block * LANES, block * LANES + LANES):
            if taps == MOST:
                accumulate_most(out, out_at, profile, profile_at + r, weights, r)
            elif taps == 4:
                accumulate_4(out, out_at, profile, profile_at + r, weights, r)
            elif taps == 2:
                accumulate_2(out, out_at, profile, profile_at + r, weights, r)
            else:
                accumulate_1(out, out_at, profile, profile_at + r, weights, r)
        block += taps
