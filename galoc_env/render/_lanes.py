"""Sixteen pixels side by side, for numba kernels: vectors of float32, int32 and of packed pairs of colours.

A rasteriser's inner loop is the same arithmetic for neighbouring pixels. Written as a loop over 16 it is at LLVM's
mercy; here the 16 are one value, that LLVM splits into what the machine has. No operation may be reordered or fused
("fast" flags), so that the bytes of a picture do not depend on the machine.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import extending, types
from numba.core.datamodel import models
from numba.extending import lower_builtin, register_model, type_callable

intrinsic: Any = extending.intrinsic  # for type checkers: what it returns is called without the typing context

LANES = 16
_BIT, _BYTE, _SHORT, _INT, _LONG = (ir.IntType(n) for n in (1, 8, 16, 32, 64))
_FLOAT = ir.FloatType()
_FLOATS, _INTS = (ir.VectorType(t, LANES) for t in (_FLOAT, _INT))
_SHORTS = ir.VectorType(_SHORT, 2 * LANES)


class LaneType(types.Type):
    """Numba's type of 16 values."""

    def __init__(self, name: str, kind: Any) -> None:
        self.kind = kind
        super().__init__(name=f"galoc_{name}x{LANES}")


@register_model(LaneType)
class _Model(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, fe_type.kind)


FLOATS = LaneType("float32", _FLOATS)
INTS = LaneType("int32", _INTS)
MASK = LaneType("bool", ir.VectorType(_BIT, LANES))


def _operator(function: Any, lanes: LaneType, emit: Callable[[Any, Any, Any], Any]) -> None:
    """Gives two values of one lane type this operator."""

    @type_callable(function)
    def typer(context: Any) -> Any:
        return lambda a, b: lanes if a is lanes and b is lanes else None

    @lower_builtin(function, lanes, lanes)
    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return emit(builder, *arguments)


def _instruction(name: str) -> Callable[[Any, Any, Any], Any]:
    """Emitter of one instruction with two operands."""
    return lambda builder, a, b: getattr(builder, name)(a, b)


_ARITHMETIC = {"add": operator.add, "sub": operator.sub, "mul": operator.mul}
for _name, _function in _ARITHMETIC.items():
    _operator(_function, FLOATS, _instruction("f" + _name))
    _operator(_function, INTS, _instruction(_name))
_operator(operator.truediv, FLOATS, _instruction("fdiv"))
_operator(operator.lshift, INTS, _instruction("shl"))
_operator(operator.rshift, INTS, _instruction("ashr"))
for _lanes in (INTS, MASK):
    _operator(operator.and_, _lanes, _instruction("and_"))
    _operator(operator.or_, _lanes, _instruction("or_"))


def _spread(builder: Any, value: Any, kind: Any) -> Any:
    undefined = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(_INT, 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(_INTS, [0] * LANES))


def _address(context: Any, builder: Any, kind: Any, array: Any, at: Any, vector: Any) -> Any:
    """Address of element ``at`` of a one-dimensional array, as that of a vector."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), vector.as_pointer())


def _item(array: Any) -> int:
    return int(array.dtype.bitwidth) // 8


def _make(result: Any, arguments: tuple[Any, ...], emit: Callable[..., Any]) -> Any:
    """An intrinsic's pair: its signature, and the code that ``emit(builder, *values)`` writes."""
    return result(*arguments), lambda context, builder, signature, values: emit(builder, *values)


@intrinsic
def spread(typing_context, value):  # type: ignore[no-untyped-def]
    """A float32 in every lane."""
    return _make(FLOATS, (types.float32,), lambda builder, v: _spread(builder, v, _FLOATS))


@intrinsic
def spread_int(typing_context, value):  # type: ignore[no-untyped-def]
    """An int32 in every lane."""
    return _make(INTS, (types.int32,), lambda builder, v: _spread(builder, v, _INTS))


@intrinsic
def ramp(typing_context):  # type: ignore[no-untyped-def]
    """0, 1, ..., 15 as float32."""
    return _make(FLOATS, (), lambda builder: ir.Constant(_FLOATS, [float(i) for i in range(LANES)]))


@intrinsic
def ramp_int(typing_context):  # type: ignore[no-untyped-def]
    """0, 1, ..., 15."""
    return _make(INTS, (), lambda builder: ir.Constant(_INTS, list(range(LANES))))


@intrinsic
def whole(typing_context, a):  # type: ignore[no-untyped-def]
    """Float lanes cut to whole numbers; they must fit int32."""
    return _make(INTS, (FLOATS,), lambda builder, v: builder.fptosi(v, _INTS))


@intrinsic
def real(typing_context, a):  # type: ignore[no-untyped-def]
    """Int lanes as floats."""
    return _make(FLOATS, (INTS,), lambda builder, v: builder.sitofp(v, _FLOATS))


@intrinsic
def load(typing_context, array, at):  # type: ignore[no-untyped-def]
    """Sixteen values of a float32 or int32 array from index ``at`` on."""
    lanes = FLOATS if array.dtype == types.float32 else INTS

    def codegen(context, builder, signature, values):  # type: ignore[no-untyped-def]
        return builder.load(_address(context, builder, array, values[0], values[1], lanes.kind), align=4)

    return lanes(array, types.intp), codegen


@intrinsic
def store(typing_context, array, at, a):  # type: ignore[no-untyped-def]
    """Sixteen values into a float32 or int32 array from index ``at`` on."""

    def codegen(context, builder, signature, values):  # type: ignore[no-untyped-def]
        builder.store(values[2], _address(context, builder, array, values[0], values[1], a.kind), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, a), codegen


@intrinsic
def store_bytes(typing_context, array, at, a):  # type: ignore[no-untyped-def]
    """The lanes' lowest bytes into a byte array from index ``at`` on."""

    def codegen(context, builder, signature, values):  # type: ignore[no-untyped-def]
        narrow = ir.VectorType(_BYTE, LANES)
        builder.store(
            builder.trunc(values[2], narrow), _address(context, builder, array, values[0], values[1], narrow), align=1
        )
        return context.get_dummy_value()

    return types.void(array, types.intp, INTS), codegen


@intrinsic
def store_rgb(typing_context, array, at, a):  # type: ignore[no-untyped-def]
    """Pixels 0xBBGGRR as 48 bytes R, G, B into a byte array from index ``at`` on."""
    packed = ir.VectorType(_BYTE, 3 * LANES)
    order = [4 * (i // 3) + i % 3 for i in range(3 * LANES)]

    def codegen(context, builder, signature, values):  # type: ignore[no-untyped-def]
        split = builder.bitcast(values[2], ir.VectorType(_BYTE, 4 * LANES))
        mask = ir.Constant(ir.VectorType(_INT, 3 * LANES), order)
        pixels = builder.shuffle_vector(split, ir.Constant(split.type, ir.Undefined), mask)
        builder.store(pixels, _address(context, builder, array, values[0], values[1], packed), align=1)
        return context.get_dummy_value()

    return types.void(array, types.intp, INTS), codegen


@intrinsic
def gather(typing_context, array, index):  # type: ignore[no-untyped-def]
    """Values of an int32 array at the lanes' indices."""

    def codegen(context, builder, signature, values):  # type: ignore[no-untyped-def]
        data = context.make_array(array)(context, builder, values[0]).data
        out: Any = ir.Constant(_INTS, ir.Undefined)
        for lane in range(LANES):
            where = builder.zext(builder.extract_element(values[1], ir.Constant(_INT, lane)), _LONG)
            item = builder.load(builder.gep(data, [where]), align=4)
            out = builder.insert_element(out, item, ir.Constant(_INT, lane))
        return out

    return INTS(array, INTS), codegen


@intrinsic
def greater(typing_context, a, b):  # type: ignore[no-untyped-def]
    """Where a > b, both floats."""
    return _make(MASK, (FLOATS, FLOATS), lambda builder, x, y: builder.fcmp_ordered(">", x, y))


@intrinsic
def between(typing_context, a, low, high):  # type: ignore[no-untyped-def]
    """Where low <= a <= high, all ints."""

    def emit(builder: Any, x: Any, y: Any, z: Any) -> Any:
        return builder.and_(builder.icmp_signed(">=", x, y), builder.icmp_signed("<=", x, z))

    return _make(MASK, (INTS, INTS, INTS), emit)


@intrinsic
def choose(typing_context, mask, a, b):  # type: ignore[no-untyped-def]
    """By lane, a where the mask holds and b elsewhere."""
    return _make(a, (MASK, a, a), lambda builder, m, x, y: builder.select(m, x, y))


@intrinsic
def differ(typing_context, a, b):  # type: ignore[no-untyped-def]
    """One bit for each lane, the first lowest: whether int lanes a and b differ."""

    def emit(builder: Any, x: Any, y: Any) -> Any:
        bits = builder.bitcast(builder.icmp_signed("!=", x, y), ir.IntType(LANES))
        return builder.zext(bits, _INT)

    return _make(types.uint32, (INTS, INTS), emit)


@intrinsic
def first_bit(typing_context, bits):  # type: ignore[no-untyped-def]
    """Index of the lowest bit set, 32 for none."""

    def emit(builder: Any, value: Any) -> Any:
        return builder.zext(builder.cttz(value, ir.Constant(_BIT, 0)), _LONG)

    return _make(types.intp, (types.uint32,), emit)


@intrinsic
def least(typing_context, a):  # type: ignore[no-untyped-def]
    """Smallest of non-negative float lanes."""
    name = "llvm.vector.reduce.smin.v16i32"  # floats from 0 order as their bits do

    def emit(builder: Any, value: Any) -> Any:
        kind = ir.FunctionType(_INT, [_INTS])
        function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
        return builder.bitcast(builder.call(function, [builder.bitcast(value, _INTS)]), _FLOAT)

    return _make(types.float32, (FLOATS,), emit)


# Colours: two numbers of 16 bits in each int lane (red and blue; green alone), so that one instruction handles 32.


def _halves(builder: Any, *lanes: Any) -> list[Any]:
    return [builder.bitcast(a, _SHORTS) for a in lanes]


def _constant(value: int) -> Any:
    return ir.Constant(_SHORTS, [value] * (2 * LANES))


def _high_product(builder: Any, a: Any, b: Any) -> Any:
    """Upper 16 bits of the products of 16-bit numbers; LLVM knows the pattern."""
    wide = ir.VectorType(_INT, 2 * LANES)
    product = builder.mul(builder.zext(a, wide), builder.zext(b, wide))
    return builder.trunc(builder.lshr(product, ir.Constant(wide, [16] * (2 * LANES))), _SHORTS)


@intrinsic
def blend(typing_context, a, b, weight):  # type: ignore[no-untyped-def]
    """128 times the mean of bytes a and b, b weighing weight / 128 (weights from 0 to 127, in both halves)."""

    def emit(builder: Any, *lanes: Any) -> Any:
        x, y, w = _halves(builder, *lanes)
        rest = builder.sub(_constant(128), w)
        return builder.bitcast(builder.add(builder.mul(x, rest), builder.mul(y, w)), _INTS)

    return _make(INTS, (INTS, INTS, INTS), emit)


@intrinsic
def blend_again(typing_context, a, b, weight):  # type: ignore[no-untyped-def]
    """Mean of two results of :func:`blend`, b weighing weight / 127; 127 / 128 of it, as the sum must fit 16 bits."""

    def emit(builder: Any, *lanes: Any) -> Any:
        x, y, w = _halves(builder, *lanes)
        w = builder.shl(w, _constant(9))
        rest = builder.sub(_constant(127 << 9), w)
        return builder.bitcast(builder.add(_high_product(builder, x, rest), _high_product(builder, y, w)), _INTS)

    return _make(INTS, (INTS, INTS, INTS), emit)


@intrinsic
def lit(typing_context, colour, light):  # type: ignore[no-untyped-def]
    """Bytes: a result of :func:`blend_again` times light / 33040 (129.06 steps of 256), at most 255."""

    def emit(builder: Any, *lanes: Any) -> Any:
        x, light = _halves(builder, *lanes)
        product = builder.add(_high_product(builder, builder.shl(x, _constant(1)), light), _constant(64))
        top = _constant(32767)
        clipped = builder.select(builder.icmp_unsigned("<", product, top), product, top)
        return builder.bitcast(builder.lshr(clipped, _constant(7)), _INTS)

    return _make(INTS, (INTS, INTS), emit)
