"""A vector of 16 float32 for numba kernels: values that live in registers.

Loops of 16 that decide millions of times have to become single instructions; left to itself LLVM unrolls them into
scalars. Here the lanes are a type of their own. LLVM splits it into what the machine has.
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
_FLOAT = ir.FloatType()
_FLOATS = ir.VectorType(_FLOAT, LANES)
_BITS = ir.VectorType(ir.IntType(32), LANES)
_FAST = ("fast",)


class VectorType(types.Type):
    """Numba's type of such a vector."""

    def __init__(self) -> None:
        super().__init__(name="galoc_float32x16")


VECTOR = VectorType()


@register_model(VectorType)
class _Model(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _FLOATS)


def _operator(function: Any, emit: Callable[[Any, Any, Any], Any]) -> None:
    """Gives two vectors this operator."""

    @type_callable(function)
    def typer(context: Any) -> Any:
        def typed(a: Any, b: Any) -> Any:
            return VECTOR if isinstance(a, VectorType) and isinstance(b, VectorType) else None

        return typed

    @lower_builtin(function, VectorType, VectorType)
    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return emit(builder, *arguments)


_operator(operator.add, lambda builder, a, b: builder.fadd(a, b, flags=_FAST))
_operator(operator.sub, lambda builder, a, b: builder.fsub(a, b, flags=_FAST))
_operator(operator.mul, lambda builder, a, b: builder.fmul(a, b, flags=_FAST))
_operator(operator.truediv, lambda builder, a, b: builder.fdiv(a, b, flags=_FAST))


def _call(builder: Any, name: str, arguments: list[Any], result: Any) -> Any:
    """Call of an LLVM intrinsic that may reorder sums."""
    kind = ir.FunctionType(result, [a.type for a in arguments])
    function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
    return builder.call(function, arguments, fastmath=_FAST)


def _constant(value: float) -> Any:
    return ir.Constant(_FLOATS, [value] * LANES)


def _address(context: Any, builder: Any, kind: Any, value: Any, indices: list[Any]) -> Any:
    """Address of an element of a C-ordered array."""
    array = context.make_array(kind)(context, builder, value)
    offset = indices[0]
    for k, index in enumerate(indices[1:], start=1):
        offset = builder.add(builder.mul(offset, builder.extract_value(array.shape, k)), index)
    return builder.gep(array.data, [offset])


@intrinsic
def load(typing_context, array, at):  # type: ignore[no-untyped-def]
    """The 16 values of a float32 array from index ``at`` on."""

    def codegen(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        first = _address(context, builder, signature.args[0], arguments[0], [arguments[1]])
        return builder.load(builder.bitcast(first, _FLOATS.as_pointer()), align=4)

    return VECTOR(array, types.intp), codegen


@intrinsic
def load_codes(typing_context, codes, cell, bound, phase, at):  # type: ignore[no-untyped-def]
    """The 16 numbers codes[cell, bound, phase, at : at + 16] of a uint16 array, as their bits (see :func:`decoded`)."""

    def codegen(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        first = _address(context, builder, signature.args[0], arguments[0], list(arguments[1:]))
        narrow = builder.load(builder.bitcast(first, ir.VectorType(ir.IntType(16), LANES).as_pointer()), align=2)
        return builder.bitcast(builder.zext(narrow, _BITS), _FLOATS)

    return VECTOR(codes, types.intp, types.intp, types.intp, types.intp), codegen


@intrinsic
def float_decoded(typing_context, codes, shift, base):  # type: ignore[no-untyped-def]
    """Numbers whose bits are (code << shift) + base."""

    def codegen(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        bits = builder.bitcast(arguments[0], _BITS)
        shift, base = (_spread(builder, builder.trunc(a, ir.IntType(32)), _BITS) for a in arguments[1:])
        return builder.bitcast(builder.add(builder.shl(bits, shift), base), _FLOATS)

    return VECTOR(VECTOR, types.intp, types.intp), codegen


@intrinsic
def whole_decoded(typing_context, codes):  # type: ignore[no-untyped-def]
    """Codes as numbers."""

    def codegen(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.uitofp(builder.bitcast(arguments[0], _BITS), _FLOATS)

    return VECTOR(VECTOR), codegen


def _spread(builder: Any, value: Any, kind: Any) -> Any:
    undefined = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(_BITS, [0] * LANES))


@intrinsic
def spread(typing_context, value):  # type: ignore[no-untyped-def]
    """A float32 in every lane."""
    return VECTOR(types.float32), lambda c, builder, s, arguments: _spread(builder, arguments[0], _FLOATS)


@intrinsic
def at_least_0(typing_context, a):  # type: ignore[no-untyped-def]
    """max(a, 0)."""

    def codegen(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return _call(builder, "llvm.maxnum.v16f32", [arguments[0], _constant(0.0)], _FLOATS)

    return VECTOR(VECTOR), codegen


@intrinsic
def larger(typing_context, a, b):  # type: ignore[no-untyped-def]
    """max(a, b) by lane."""

    def codegen(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return _call(builder, "llvm.maxnum.v16f32", list(arguments), _FLOATS)

    return VECTOR(VECTOR, VECTOR), codegen


@intrinsic
def total(typing_context, a):  # type: ignore[no-untyped-def]
    """Sum of the lanes, float32."""

    def codegen(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        zero = ir.Constant(_FLOAT, 0.0)
        return _call(builder, "llvm.vector.reduce.fadd.v16f32", [zero, arguments[0]], _FLOAT)

    return types.float32(VECTOR), codegen
