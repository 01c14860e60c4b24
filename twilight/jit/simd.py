"""Eight wavelengths as one value in kernels: `Lanes`, a vector register of float32.

A loop over eight numbers of arrays costs more than its arithmetic: arrays may overlap, so that every term of a sum is
stored and read again, and every row is an array of its own that is counted in and out.  `Lanes` are read where they
lie, added and multiplied with each other or with one float32, and written once.  Products and sums may be fused.

Where numba compiles nothing (NUMBA_DISABLE_JIT=1) `Lanes` are arrays (LANES,) of float32.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

from twilight.jit.kernels import COMPILED

LANES = 8
"""Wavelengths that the inner loops take at once."""

_FLOAT, _INT = ir.FloatType(), ir.IntType(32)
_VECTOR, _INTS = ir.VectorType(_FLOAT, LANES), ir.VectorType(_INT, LANES)
_FUSED = ("contract", "nsz")
_LOWEST = -87.0
"""Exponents below give 0: e^-87.3 is the smallest normal float32."""
_HIGHEST = 88.0
"""Exponents above count as this: e^88.7 is the largest float32."""
_LN2_HIGH = 0.693359375
"""ln 2 to nine bits, whose product with an exponent is exact (Cephes' `expf`)."""
_LN2_LOW = -2.12194440e-4
"""ln 2 less _LN2_HIGH (Cephes' `expf`)."""
_SERIES = (1.9875691500e-4, 1.3981999507e-3, 8.3334519073e-3, 4.1665795894e-2, 1.6666665459e-1, 5.0000001201e-1)
"""(exp(r) - 1 - r) / r^2 for |r| < ln(2) / 2, highest power first: Cephes' minimax polynomial of `expf`."""


class LanesType(types.Type):
    """The type of `Lanes` in numba."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes{LANES}")


_TYPE = LanesType()


@register_model(LanesType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, type_: Any) -> None:
        super().__init__(manager, type_, _VECTOR)


def _all(builder: Any, number: Any) -> Any:
    """The same number in all lanes."""
    nothing = ir.Constant(_VECTOR, ir.Undefined)
    one = builder.insert_element(nothing, number, ir.Constant(_INT, 0))
    return builder.shuffle_vector(one, nothing, ir.Constant(_INTS, [0] * LANES))


def _constant(value: float) -> Any:
    return ir.Constant(_VECTOR, [value] * LANES)


def _typed(context: Any) -> Any:
    def typer(a: Any, b: Any) -> Any:
        kinds = {a, b}
        return _TYPE if _TYPE in kinds and kinds <= {_TYPE, types.float32} else None

    return typer


def _operation(operation: Any, instruction: str) -> None:
    """Teach numba an operation of two `Lanes`, or of one and a float32."""
    type_callable(operation)(_typed)

    def lower(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        both = [
            value if kind == _TYPE else _all(builder, value)
            for kind, value in zip(signature.args, arguments, strict=True)
        ]
        return getattr(builder, instruction)(*both, flags=_FUSED)

    for kinds in ((_TYPE, _TYPE), (_TYPE, types.float32), (types.float32, _TYPE)):
        lower_builtin(operation, *kinds)(lower)


_operation(operator.add, "fadd")
_operation(operator.iadd, "fadd")
_operation(operator.sub, "fsub")
_operation(operator.mul, "fmul")


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, index_type: Any, index: Any) -> Any:
    """Where the lanes of an array (..., LANES) in C order lie; index: a number, or a tuple of all but the last."""
    one = isinstance(index_type, types.Integer)
    kinds = [index_type] if one else list(index_type)
    numbers = [index] if one else cgutils.unpack_tuple(builder, index)
    places = [context.cast(builder, n, k, types.intp) for n, k in zip(numbers, kinds, strict=True)]
    made = context.make_array(array_type)(context, builder, array)
    places.append(context.get_constant(types.intp, 0))
    first = cgutils.get_item_pointer(context, builder, array_type, made, places, wraparound=False)
    return builder.bitcast(first, _VECTOR.as_pointer())


def _fits(array_type: Any, index_type: Any) -> bool:
    size = 1 if isinstance(index_type, types.Integer) else len(index_type)
    return array_type.dtype == types.float32 and array_type.layout == "C" and array_type.ndim == size + 1


def _vector_operation(in_python: Callable[..., Any]) -> Callable[[Callable[..., Any]], Any]:
    """An operation of kernels: numba's intrinsic from the function that makes its machine code, `in_python` where
    nothing is compiled."""

    def made(generator: Callable[..., Any]) -> Any:
        if not COMPILED:
            return in_python
        # numba's own types tell a checker that kernels hand over the typing context too
        return intrinsic(generator)  # type: ignore[call-overload]

    return made


def _load_array(array: np.ndarray, index: Any) -> np.ndarray:
    return array[index].copy()


def _store_array(array: np.ndarray, index: Any, lanes: np.ndarray) -> None:
    array[index] = lanes


def _broadcast_array(number: Any) -> np.ndarray:
    return np.full(LANES, number, np.float32)


def _array_maximum(lanes: np.ndarray, least: Any) -> np.ndarray:
    return np.where(lanes < least, least, lanes)


def _exp_of_array(lanes: np.ndarray) -> np.ndarray:
    exact = np.exp(np.clip(lanes.astype(float), _LOWEST, _HIGHEST)).astype(np.float32)
    return np.where(lanes < _LOWEST, np.float32(0.0), exact)


@_vector_operation(_load_array)
def load(typing_context, array, index):
    """The lanes array[index] of an array (..., LANES), float32 in C order; index: a number or a tuple, none below 0."""
    if not _fits(array, index):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        at = _pointer(context, builder, signature.args[0], arguments[0], signature.args[1], arguments[1])
        lanes = builder.load(at)
        lanes.align = 4
        return lanes

    return _TYPE(array, index), generate


@_vector_operation(_store_array)
def store(typing_context, array, index, lanes):
    """Set array[index] to lanes; array and index as in `load`."""
    if not _fits(array, index) or lanes != _TYPE:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        at = _pointer(context, builder, signature.args[0], arguments[0], signature.args[1], arguments[1])
        builder.store(arguments[2], at).align = 4
        return context.get_dummy_value()

    return types.void(array, index, lanes), generate


@_vector_operation(_broadcast_array)
def broadcast(typing_context, number):
    """Lanes that are all one float32."""
    if number != types.float32:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _all(builder, arguments[0])

    return _TYPE(number), generate


@_vector_operation(_array_maximum)
def maximum(typing_context, lanes, least):
    """The lanes, and the float32 `least` where they are less."""
    if lanes != _TYPE or least != types.float32:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        bound = _all(builder, arguments[1])
        return builder.select(builder.fcmp_ordered("<", arguments[0], bound), bound, arguments[0])

    return _TYPE(lanes, least), generate


@_vector_operation(_exp_of_array)
def exp(typing_context, lanes):
    """Exponentials, right within 1e-7; 0 for less than -87."""
    if lanes != _TYPE:
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        def bounded(x: Any, sign: str, bound: float) -> Any:
            return builder.select(builder.fcmp_ordered(sign, x, _constant(bound)), _constant(bound), x)

        def plus(a: Any, b: Any) -> Any:
            return builder.fadd(a, b, flags=_FUSED)

        def times(a: Any, b: Any) -> Any:
            return builder.fmul(a, b, flags=_FUSED)

        x = arguments[0]
        dark = builder.fcmp_ordered("<", x, _constant(_LOWEST))
        x = bounded(bounded(x, "<", _LOWEST), ">", _HIGHEST)
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        floor = cgutils.get_or_insert_function(builder.module, kind, f"llvm.floor.v{LANES}f32")
        # x = n ln 2 + r
        n = builder.call(floor, [plus(times(x, _constant(1.0 / math.log(2.0))), _constant(0.5))])
        r = plus(x, times(n, _constant(-_LN2_HIGH)))
        r = plus(r, times(n, _constant(-_LN2_LOW)))
        series = _constant(_SERIES[0])
        for factor in _SERIES[1:]:
            series = plus(times(series, r), _constant(factor))
        value = plus(plus(times(series, times(r, r)), r), _constant(1.0))
        # 2^n has the exponent bits n + 127
        bits = builder.add(builder.fptosi(n, _INTS), ir.Constant(_INTS, [127] * LANES))
        power = builder.bitcast(builder.shl(bits, ir.Constant(_INTS, [23] * LANES)), _VECTOR)
        return builder.select(dark, _constant(0.0), builder.fmul(value, power))

    return _TYPE(lanes), generate
