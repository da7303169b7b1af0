# SPDX-License-Identifier: BSD-3-Clause
"""Records: named numbers and arrays that laws change in place, as Python and as machine code alike.

A record owns a block of 8-byte words that machine code reads as it stands; a call converts nothing:

- word 0: the Python object;
- a number: itself;
- an array or a table: address of its first element, its Python object, its shape;
- another record: address of its block.

A table is a one-dimensional array whose rows have named fields: ``tank.cells[i].level``.
"""

from __future__ import annotations

import ctypes
from operator import attrgetter
from typing import (
    Annotated,
    Any,
    ClassVar,
    NamedTuple,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from numpy.typing import NDArray

Scalar = float
Integer = int
Flag = bool
Vector = Annotated[NDArray[np.float64], 1]
Matrix = Annotated[NDArray[np.float64], 2]
Array3 = Annotated[NDArray[np.float64], 3]
Array4 = Annotated[NDArray[np.float64], 4]
Indices = Annotated[NDArray[np.int64], 1]
IndexMatrix = Annotated[NDArray[np.int64], 2]
Row = Any
"""One row of a table: a record of numpy, or what numba takes for it."""
Table = np.recarray[Any, Any]
"""Declared as ``Annotated[Table, ROW]`` with ``ROW`` an aligned structured type, ``np.dtype([...], align=True)``."""

_KINDS: dict[Any, tuple[str, int]] = {float: ("float64", 0), int: ("int64", 0), bool: ("bool", 0)}
_KINDS |= {kind: ("float64", ndim) for ndim, kind in enumerate((Vector, Matrix, Array3, Array4), 1)}
_KINDS |= {Indices: ("int64", 1), IndexMatrix: ("int64", 2)}


class Field(NamedTuple):
    """What a field is and where.

    Attributes:
        name: In the record.
        place: Its first word in the block.
        dtype: "float64", "int64", "bool", "table", or "record".
        ndim: Of an array or a table; 0 for anything else.
        record: Layout of a record in this one.
        row: Type of a table's rows.
    """

    name: str
    place: int
    dtype: str
    ndim: int
    record: Layout | None = None
    row: np.dtype[np.void] | None = None


class Layout(NamedTuple):
    """What machine code depends on in a class of records: its full name, its fields, the length of the block."""

    name: str
    fields: tuple[Field, ...]
    words: int


class _NumbaType:
    """What numba takes a record for; made when it asks, then kept on the class."""

    def __get__(self, record: Record | None, owner: type[Record]) -> Any:
        from impedance_modules.machine_code import RecordType  # noqa: PLC0415 - only numba asks

        owner._numba_type_ = kept = RecordType(owner._layout)
        return kept


@dataclass_transform(kw_only_default=True, eq_default=False)
class Record:
    """Named numbers, arrays and other records; subclasses declare them as a dataclass does.

    Arrays and records are given once, by keyword, and shared; they cannot be replaced, only written in place.
    Numbers can be assigned and can have a default.
    """

    _layout: ClassVar[Layout]
    _defaults: ClassVar[dict[str, float]] = {}
    _numba_type_: ClassVar[Any]

    def __init_subclass__(cls) -> None:
        fields, place, defaults = [], 1, dict(cls._defaults)
        for name, hint in get_type_hints(cls, include_extras=True).items():
            if get_origin(hint) is ClassVar:
                continue
            if (field := _field(name, place, hint)) is None:
                raise TypeError(f"{cls.__qualname__}.{name}: a record cannot hold {hint}")
            if name in cls.__dict__:
                defaults[name] = cls.__dict__[name]
            setattr(cls, name, _access(field))
            fields.append(field)
            place += 2 + field.ndim if field.ndim else 1
        cls._layout = Layout(f"{cls.__module__}.{cls.__qualname__}", tuple(fields), place)
        cls._defaults, cls._numba_type_ = defaults, _NumbaType()

    def __init__(self, **values: Any) -> None:
        values = self._defaults | values
        wrong = values.keys() ^ {field.name for field in self._layout.fields}
        if wrong:
            raise TypeError(f"{type(self).__name__}: missing or unknown {sorted(wrong)}")
        words = np.zeros(self._layout.words, dtype=np.int64)
        words[0] = id(self)
        self._integers, self._floats = words.data, words.view(np.float64).data
        self._address: int = words.ctypes.data
        for field in self._layout.fields:
            value = values[field.name]
            if field.row is not None and isinstance(value, np.ndarray):
                value = value.view(np.recarray)
            if field.record is not None or field.ndim:
                setattr(self, f"_{field.name}", value)
                for place, word in enumerate(_description(field, value), field.place):
                    self._integers[place] = word
            else:
                setattr(self, field.name, value)

    @property
    def address(self) -> int:
        """Where its block begins; good as long as the record lives."""
        return self._address

    def snapshot(self) -> dict[str, Any]:
        """Copies all numbers, arrays and records in it."""
        found = {}
        for field in self._layout.fields:
            value = getattr(self, field.name)
            found[field.name] = (
                value.snapshot() if field.record is not None else value.copy() if field.ndim else value
            )
        return found

    def restore(self, kept: dict[str, Any]) -> None:
        """Puts back what ``snapshot`` copied."""
        for field in self._layout.fields:
            if field.record is not None:
                getattr(self, field.name).restore(kept[field.name])
            elif field.ndim:
                getattr(self, field.name)[:] = kept[field.name]
            else:
                setattr(self, field.name, kept[field.name])

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (type(self), {field.name: getattr(self, field.name) for field in self._layout.fields})


def _field(name: str, place: int, hint: Any) -> Field | None:
    """Reads what a field is from its annotation; None if a record cannot hold it."""
    if isinstance(hint, type) and issubclass(hint, Record):
        return Field(name, place, "record", 0, record=hint._layout)
    row = get_args(hint)[1] if get_origin(hint) is Annotated else None
    if isinstance(row, np.dtype) and row.isalignedstruct:
        # As Python, ``row.size`` would be numpy's own attribute.
        taken = any(hasattr(np.record, column) for column in row.names or ())
        return None if taken else Field(name, place, "table", 1, row=row)
    return Field(name, place, *_KINDS[hint]) if hint in _KINDS else None


def _description(field: Field, value: Any) -> tuple[int, ...]:
    """The words that tell machine code where an array or a record is."""
    if field.record is not None:
        if not isinstance(value, Record) or value._layout != field.record:
            raise TypeError(f"{field.name} is no {field.record.name}")
        return (value._address,)
    dtype = field.dtype if field.row is None else field.row
    known = isinstance(value, np.ndarray) and value.dtype == dtype and value.ndim == field.ndim
    if not (known and value.flags.carray):
        raise TypeError(f"{field.name}: not a writable C array of {field.dtype} in {field.ndim} dimensions")
    return (value.__array_interface__["data"][0], id(value), *value.shape)


def _access(field: Field) -> property:
    """Access to a field from Python."""
    place = field.place
    if field.record is not None or field.ndim:
        return property(attrgetter(f"_{field.name}"))
    if field.dtype == "float64":
        return property(
            lambda record: record._floats[place],
            lambda record, value: record._floats.__setitem__(place, value),
        )
    number = bool if field.dtype == "bool" else int
    return property(
        lambda record: number(record._integers[place]),
        lambda record, value: record._integers.__setitem__(place, bool(value) if number is bool else value),
    )


def record_at(address: int) -> Record:
    """Finds the living record whose block begins at an address: its first word is the Python object."""
    place = ctypes.c_size_t.from_address(int(address)).value
    record: Record = ctypes.cast(place, ctypes.py_object).value
    return record


def _again(cls: type[Record], values: dict[str, Any]) -> Record:
    return cls(**values)


def new_table(rows: int, row: np.dtype[np.void]) -> Table:
    """Makes a table of zeros."""
    return np.zeros(rows, row).view(np.recarray)
