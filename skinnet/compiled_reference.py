"""References to named tuples of arrays, for compiled code.

Numba examines and unboxes every array of an argument at every call, about 0.4 µs each, and hands all of them
by value to every function that is not inlined. A contact problem has some hundred arrays: a call took longer
than its work. A reference is unboxed once, when it is made. Compiled code gets one pointer and loads the
arrays that it uses; it reads a reference as it reads the tuple, by the names of its attributes.
"""

from typing import Any, NoReturn, TypeVar, cast

import numba
import numpy as np
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)
from numpy.typing import NDArray

from skinnet.compilation import PACKAGES, compiled_for_this_process, compiled_without_nrt

__all__ = ["reference"]

T = TypeVar("T", bound=tuple[object, ...])


def reference(value: T) -> T:
    """Make a reference to `value`: a named tuple of arrays, numbers and such tuples.

    Its numbers are those of now, its arrays stay those of now. Python reads it as it reads `value`, by names.
    With `NUMBA_DISABLE_JIT` nothing is compiled, and `value` serves itself.
    """
    return value if numba.config.DISABLE_JIT else cast("T", _Reference(value))


class _Reference:
    """Named tuple, and its unboxed form at `address`."""

    def __init__(self, value: tuple[object, ...]) -> None:
        self._value = value  # owns the arrays
        self._numba_type_ = _ReferenceType(numba.typeof(value))
        store = _store if _is_ours(value) else _store_foreign
        self._unboxed = np.empty(store(np.empty(0, dtype=np.int64), value), dtype=np.int64)
        store(self._unboxed, value)
        self.address = self._unboxed.ctypes.data

    def __getattr__(self, name: str) -> object:
        return getattr(self._value, name)

    def __reduce__(self) -> NoReturn:
        raise TypeError("a reference holds an address and cannot be copied; make one of the copied tuple")


class _ReferenceType(types.Type):  # type: ignore[misc]
    """Numba's type of a reference; `target` is that of its tuple."""

    def __init__(self, target: Any) -> None:
        self.target = target
        super().__init__(name=f"reference({target})")


@typeof_impl.register(_Reference)  # type: ignore[untyped-decorator]
def _typeof(value: _Reference, _context: Any) -> _ReferenceType:
    return value._numba_type_


@register_model(_ReferenceType)
class _ReferenceModel(models.PrimitiveModel):  # type: ignore[misc]
    """A pointer to the unboxed tuple."""

    def __init__(self, manager: Any, kind: _ReferenceType) -> None:
        super().__init__(manager, kind, manager.lookup(kind.target).get_value_type().as_pointer())


@unbox(_ReferenceType)  # type: ignore[untyped-decorator]
def _unbox(kind: _ReferenceType, value: Any, context: Any) -> Any:
    address = context.pyapi.object_getattr_string(value, "address")
    number = context.pyapi.number_as_ssize_t(address)
    context.pyapi.decref(address)
    return NativeValue(context.builder.inttoptr(number, context.context.get_value_type(kind)))


@infer_getattr
class _Attributes(AttributeTemplate):  # type: ignore[misc]
    """Types of the attributes; a tuple within is a reference as well."""

    key = _ReferenceType

    def generic_resolve(self, kind: _ReferenceType, name: str) -> Any:
        if name not in kind.target.fields:
            return None
        field = kind.target.types[kind.target.fields.index(name)]
        return _ReferenceType(field) if isinstance(field, types.NamedTuple) else field


@lower_getattr_generic(_ReferenceType)  # type: ignore[untyped-decorator]
def _attribute(_context: Any, builder: Any, kind: _ReferenceType, pointer: Any, name: str) -> Any:
    index = kind.target.fields.index(name)
    place = _element(builder, pointer, index)
    return place if isinstance(kind.target.types[index], types.NamedTuple) else _load(builder, place)


def _load(builder: Any, place: Any) -> Any:
    """Load a value part by part, as a constant: LLVM drops the parts that are not used."""
    kind = place.type.pointee
    if not hasattr(kind, "elements"):
        value = builder.load(place)
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value
    value = kind(None)
    for index in range(len(kind)):
        value = builder.insert_value(value, _load(builder, _element(builder, place, index)), index)
    return value


def _element(builder: Any, pointer: Any, index: int) -> Any:
    """Pointer to part `index` of what `pointer` points to."""
    return cgutils.gep_inbounds(builder, pointer, 0, index)


@compiled_without_nrt
def _store(memory: NDArray[np.int64], value: tuple[object, ...]) -> int:
    """Store the unboxed form of `value` in `memory` if it is long enough; return the words that it takes."""
    n_words: int = _n_words(value)
    if len(memory) >= n_words:
        _write(memory, value)
    return n_words


_store_foreign = compiled_for_this_process(_store)
"""As `_store`. The cache on disk names the classes of all tuples: other programs could not load theirs."""


def _is_ours(value: tuple[object, ...]) -> bool:
    """True if the classes of a tuple, and of those within, can be imported by every program of ours."""
    within = all(_is_ours(part) for part in value if isinstance(part, tuple))
    return within and type(value).__module__.partition(".")[0] in PACKAGES


@intrinsic  # type: ignore[untyped-decorator]
def _n_words(_typing: Any, value: Any) -> Any:
    """Number of 8-byte words of the unboxed form of `value`."""

    def code(context: Any, _builder: Any, _signature: Any, arguments: Any) -> Any:
        return context.get_constant(types.intp, (context.get_abi_sizeof(arguments[0].type) + 7) // 8)

    return types.intp(value), code


@intrinsic  # type: ignore[untyped-decorator]
def _write(_typing: Any, memory: Any, value: Any) -> Any:
    """Write the unboxed form of `value` to the array `memory`."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        builder.store(arguments[1], builder.bitcast(data, arguments[1].type.as_pointer()))
        return context.get_dummy_value()

    return types.void(memory, value), code
