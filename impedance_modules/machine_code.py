# SPDX-License-Identifier: BSD-3-Clause
"""How laws and records become machine code, and when kept code may be used again. Importing this wakes numba.

A record is handed to machine code as the address of its block. What the block says about arrays never changes, so
the compiler may read it once per loop (``invariant.load``).

Numba keeps code on disk until the function's own file changes. But callers hold the code of the laws that they
call, and the values of globals: here kept code is used again only if none of these has changed.
"""

# mypy: allow-untyped-calls

from __future__ import annotations

import contextlib
import grp
import hashlib
import operator
import os
import pickle
import pwd
import stat
import sys
import warnings
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
from numba.core import cgutils, types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.errors import NumbaTypeError
from numba.core.extending import (
    NativeValue,
    box,
    infer_getattr,
    lower_builtin,
    lower_getattr_generic,
    lower_setattr_generic,
    models,
    register_model,
    type_callable,
    unbox,
)
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_global, signature
from numba.np.arrayobj import make_array, populate_array

from impedance_modules.compiled import Law, call, state_at
from impedance_modules.records import Field, Layout

_WORD = cgutils.intp_t


class RecordType(types.Type):
    """Numba's type of the instances of a class of records: two are the same if their layouts are."""

    def __init__(self, layout: Layout) -> None:
        self.fields = {field.name: field for field in layout.fields}
        digest = hashlib.sha256(repr(layout).encode()).hexdigest()[:16]
        super().__init__(name=f"{layout.name}#{digest}")


register_model(RecordType)(models.OpaqueModel)


def _type_of(field: Field) -> Any:
    if field.record is not None:
        return RecordType(field.record)
    if field.row is not None:
        return types.Array(numba.from_dtype(field.row), 1, "C")
    number = {"float64": types.float64, "int64": types.int64, "bool": types.boolean}[field.dtype]
    return types.Array(number, field.ndim, "C") if field.ndim else number


@infer_getattr
class _Fields(AttributeTemplate):
    key = RecordType

    def generic_resolve(self, record: RecordType, name: str) -> Any:  # type: ignore[override]
        """Tells numba the type of a field."""
        return _type_of(record.fields[name]) if name in record.fields else None


def _pointer(builder: Any, record: Any, place: int, to: Any) -> Any:
    """Points at a word of the block."""
    words = builder.bitcast(record, _WORD.as_pointer())
    return builder.bitcast(builder.gep(words, [_WORD(place)]), to.as_pointer())


def _fixed(builder: Any, record: Any, place: int, kind: Any) -> Any:
    """Reads a word that never changes."""
    word = builder.load(_pointer(builder, record, place, kind))
    word.set_metadata("invariant.load", builder.module.add_metadata([]))
    return word


@lower_getattr_generic(RecordType)  # type: ignore[untyped-decorator]
def _get(context: Any, builder: Any, record: RecordType, value: Any, name: str) -> Any:
    field = record.fields[name]
    if field.record is not None:
        return _fixed(builder, value, field.place, cgutils.voidptr_t)
    if field.dtype == "bool":
        return builder.icmp_unsigned(
            "!=", builder.load(_pointer(builder, value, field.place, _WORD)), _WORD(0)
        )
    kind = _type_of(field)
    if field.ndim == 0:
        return builder.load(_pointer(builder, value, field.place, context.get_value_type(kind)))
    data = _fixed(builder, value, field.place, context.get_data_type(kind.dtype).as_pointer())
    parent = _fixed(builder, value, field.place + 1, cgutils.voidptr_t)
    shape = [_fixed(builder, value, field.place + 2 + axis, _WORD) for axis in range(field.ndim)]
    size = 8 if field.row is None else field.row.itemsize
    strides = [_WORD(size)]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    array = make_array(kind)(context, builder)
    populate_array(array, data, shape, strides, size, meminfo=None, parent=parent)
    return array._getvalue()


@lower_setattr_generic(RecordType)  # type: ignore[untyped-decorator]
def _set(context: Any, builder: Any, signature: Any, values: tuple[Any, Any], name: str) -> None:
    record, given = signature.args
    field = record.fields[name]
    if field.record is not None or field.ndim:
        raise NumbaTypeError(f"{name} cannot be replaced, only written in place")
    number = context.cast(builder, values[1], given, _type_of(field))
    if field.dtype == "bool":
        number = builder.zext(number, _WORD)
    builder.store(number, _pointer(builder, values[0], field.place, number.type))


@lower_builtin(operator.is_, RecordType, RecordType)  # type: ignore[untyped-decorator]
def _is(_: Any, builder: Any, __: Any, values: tuple[Any, Any]) -> Any:
    return builder.icmp_unsigned("==", *values)


@unbox(RecordType)  # type: ignore[untyped-decorator]
def _hand_in(_: RecordType, record: Any, c: Any) -> NativeValue:
    address = c.pyapi.object_getattr_string(record, "_address")
    pointer = c.pyapi.long_as_voidptr(address)
    c.pyapi.decref(address)
    return NativeValue(pointer, is_error=cgutils.is_not_null(c.builder, c.pyapi.err_occurred()))


@box(RecordType)  # type: ignore[untyped-decorator]
def _hand_out(_: RecordType, pointer: Any, c: Any) -> Any:
    record = _fixed(c.builder, pointer, 0, c.pyapi.pyobj)
    c.pyapi.incref(record)
    return record


@type_callable(state_at)
def _type_of_state(_: Any) -> Any:
    """Tells numba that the record at an address is a pointer; whose law it is knows of what type."""
    return lambda block: types.voidptr if isinstance(block, types.Integer) else None


@lower_builtin(state_at, types.Integer)  # type: ignore[untyped-decorator]
def _state_at(_: Any, builder: Any, __: Any, values: tuple[Any]) -> Any:
    return builder.inttoptr(values[0], cgutils.voidptr_t)


@infer_global(call)
class _TypeOfCall(AbstractTemplate):
    def generic(self, given: tuple[Any, ...], _: Any) -> Any:
        """Tells numba that a law called by its address returns nothing."""
        return signature(types.none, *given) if isinstance(given[0], types.Integer) else None


@lower_builtin(call, types.Integer, types.VarArg(types.Any))  # type: ignore[untyped-decorator]
def _call(context: Any, builder: Any, types_of: Any, values: tuple[Any, ...]) -> Any:
    kinds, convention = types_of.args[1:], context.call_conv
    kind = convention.get_function_type(types.none, kinds)
    law = builder.inttoptr(values[0], kind.as_pointer())
    status, _ = convention.call_function(builder, law, types.none, kinds, values[1:])
    with cgutils.if_unlikely(builder, status.is_error):
        convention.return_status_propagate(builder, status)
    return context.get_dummy_value()


def entry(law: Law[..., Any], values: tuple[Any, ...]) -> int:
    """Gives the address of a law's machine code for values of these types; compiles or loads it where needed."""
    made, kinds = law.machine_code, tuple(numba.typeof(value) for value in values)
    made.compile(kinds)
    code = made.overloads[kinds]
    return int(code.library.get_pointer_to_function(code.fndesc.llvm_func_name))


_UNREADABLE = (
    pickle.UnpicklingError,
    AttributeError,
    ImportError,
    EOFError,
    OSError,
    TypeError,
    ValueError,
    KeyError,
    IndexError,
)


class _Index(IndexDataCacheFile):
    """What is kept of one law; what cannot be read, cut off or from an older text of this file, is not there.

    Nor is what somebody else may have written: numba unpickles these files, and what they hold is executed.
    """

    def load(self, key: Any) -> Any:
        """Returns what is kept under a key, None where there is nothing."""
        with contextlib.suppress(*_UNREADABLE):
            return super().load(key)
        return None

    def _load_data(self, name: str) -> Any:
        _refuse_foreign(Path(self._data_path(name)))
        return super()._load_data(name)

    def _load_index(self) -> dict[Any, str]:
        with contextlib.suppress(*_UNREADABLE):
            _refuse_foreign(Path(self._index_path))
            return dict(super()._load_index())
        return {}


class _Kept(FunctionCache):
    """Numba's cache of one law, stamped with all that its code depends on."""

    def __init__(self, law: Law[..., Any]) -> None:
        super().__init__(law.python)
        if not is_ours_alone(Path(self._cache_path)):
            _warn_of(self._cache_path)
            raise RuntimeError(f"others may write into {self._cache_path}")
        self._cache_file = _Index(self._cache_path, self._impl.filename_base, stamp(law))

    def save_overload(self, signature: Any, data: Any) -> None:
        """Keeps code if it can be kept: a full disk stops nothing."""
        with contextlib.suppress(OSError):
            super().save_overload(signature, data)


def _refuse_foreign(place: Path) -> None:
    if not is_ours_alone(place):
        raise PermissionError(f"others may write {place}")


def is_ours_alone(place: Path) -> bool:
    """Says whether a file or folder belongs to this user, or to root, and nobody else may write into it.

    Members of a group may where that group is the user's own (umask 002 on many systems).
    """
    status = place.stat()
    if status.st_uid not in (os.geteuid(), 0) or status.st_mode & stat.S_IWOTH:
        return False
    return not status.st_mode & stat.S_IWGRP or _own_group(status.st_gid)


@cache
def _own_group(group: int) -> bool:
    """Says whether a group has this user's name and no other member."""
    try:
        found, user = grp.getgrgid(group), pwd.getpwuid(os.geteuid()).pw_name
    except KeyError:
        return False
    return found.gr_name == user and set(found.gr_mem) <= {user}


@cache
def _warn_of(folder: str) -> None:
    warnings.warn(
        f"{folder}: kept machine code is not used, others may write there; every run compiles anew"
        f" (valid: a folder of your own: chmod go-w {folder}, or set NUMBA_CACHE_DIR)",
        stacklevel=2,
    )


def dispatcher(law: Law[..., Any]) -> Any:
    """Makes numba's side of a law."""
    made: Any = numba.njit(error_model="numpy")(law.python)
    with contextlib.suppress(RuntimeError):  # no directory to keep code in: compile without keeping
        made._cache = _Kept(law)
    return made


_OUTSIDE = sys.stdlib_module_names | {"numpy", "numba"}
"""Packages into which ``stamp`` does not follow a law: their versions stand for them, where they matter."""


def stamp(law: Law[..., Any]) -> str:
    """Digests all that the code of a law depends on, except the types of its arguments.

    That is: the bytecode of the law and of every law it reaches, the values of the globals they name, and the
    tools. Not the files: those may have changed since they were imported.
    """
    reached: dict[Law[..., Any], str] = {}
    waiting = [law]
    while waiting:
        one = waiting.pop()
        if one not in reached:
            reached[one], called = _own(one)
            waiting += called
    return hashlib.sha256("\n".join([_tools(), reached[law], *sorted(reached.values())]).encode()).hexdigest()


@cache
def _own(law: Law[..., Any]) -> tuple[str, list[Law[..., Any]]]:
    """Writes down what a law itself depends on, and lists the laws that it names."""
    function = law.python
    if not isinstance(function, FunctionType):
        raise TypeError(f"{function} is no Python function")
    codes = list(_codes(function.__code__))
    names = sorted({name for code in codes for name in code.co_names})
    written, called = [f"{function.__module__}.{function.__qualname__}"], []
    for code in codes:
        constants = [constant for constant in code.co_consts if not isinstance(constant, CodeType)]
        written.append(repr((code.co_code, code.co_names, code.co_varnames, code.co_freevars, constants)))
    found = [(name, function.__globals__[name]) for name in names if name in function.__globals__]
    found += [("closure", cell.cell_contents) for cell in function.__closure__ or ()]
    found.append(("defaults", (function.__defaults__, function.__kwdefaults__)))
    entered: set[str] = set()
    while found:
        name, value = found.pop()
        if isinstance(value, Law):
            called.append(value)
            written.append(f"{name} = {value.__module__}.{value.python.__qualname__}")
        elif isinstance(value, ModuleType):
            if value.__name__ not in entered and not _outside(value.__name__):
                entered.add(value.__name__)
                found += [(f"{name}.{more}", getattr(value, more)) for more in names if hasattr(value, more)]
        elif isinstance(value, tuple):
            found += [(f"{name}[{at}]", item) for at, item in enumerate(value)]
        else:
            written.append(f"{name} = {_constant(value)}")
    return "\n".join(written), called


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _constant(value: Any) -> str:
    """Writes down a value; of a class or a function of the project, the file it is in."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype.str} {value.shape} {value.tobytes().hex()}"
    if not callable(value):
        return repr(value)
    module = str(getattr(value, "__module__", "builtins"))
    return f"{module}.{getattr(value, '__qualname__', value)}" if _outside(module) else _file(module)


def _outside(module: str) -> bool:
    return module.partition(".")[0] in _OUTSIDE


@cache
def _file(module: str) -> str:
    """Digests the file of a module."""
    path = getattr(sys.modules.get(module), "__file__", None)
    return hashlib.sha256(Path(path).read_bytes()).hexdigest() if path else module


@cache
def _tools() -> str:
    """Writes down the versions of what makes the code; numba checks its own."""
    return f"{version('llvmlite')} {np.__version__} {_file(Layout.__module__)} {_file(__name__)}"
