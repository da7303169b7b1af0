# SPDX-License-Identifier: BSD-3-Clause
"""One text of a law, run as plain Python or, when a run asks for it, as machine code.

``compiled`` marks a function of numbers, arrays and ``records.Record``. It runs as Python until
``use_machine_code`` is called; from then on numba runs it. Numba is not imported before that.

A law calls another one by its name, or by a number that a record holds (``call``): then the caller's code does not
depend on which law it is, and is compiled once for all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property, update_wrapper
from typing import Any, ClassVar, Generic, ParamSpec, TypeVar

from impedance_modules.records import Record, record_at

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class Law(Generic[Arguments, Result]):
    """A function of a module that can run in two ways.

    Attributes:
        python: The function itself. Laws that it calls run as ``use_machine_code`` says.
        machine_code: The same function as numba compiles it, whatever ``use_machine_code`` says. A hot loop may
            take it once: a call of it costs 0.1 us less than one of the law.
    """

    in_machine_code: ClassVar[bool | None] = None

    def __init__(self, python: Callable[Arguments, Result]) -> None:
        self.python = python
        update_wrapper(self, python)

    def __call__(self, *values: Arguments.args, **named: Arguments.kwargs) -> Result:
        """Runs the law."""
        if Law.in_machine_code:
            result: Result = self.machine_code(*values, **named)
            return result
        return self.python(*values, **named)

    @cached_property
    def machine_code(self) -> Any:
        """The numba dispatcher: compiles for the types of a call on the first such call, or loads kept code."""
        from impedance_modules.machine_code import dispatcher  # noqa: PLC0415 - numba is imported only where it is asked for

        return dispatcher(self)

    def address(self, *values: Any) -> int:
        """Gives the number by which ``call`` finds the law, for values of these types.

        It holds in this process, and for the way in which laws run now: ask again after ``use_machine_code``.
        """
        found = id(self)
        if Law.in_machine_code:
            from impedance_modules.machine_code import entry  # noqa: PLC0415 - numba is imported only where it is asked for

            found = entry(self, values)
        _LAW_AT[found] = self
        return found

    @property
    def _numba_type_(self) -> Any:
        """What numba takes this object for when it meets it in a law."""
        return self.machine_code._numba_type_

    def __reduce__(self) -> str:
        return self.python.__qualname__


def compiled(function: Callable[Arguments, Result]) -> Law[Arguments, Result]:
    """Makes a function of a module a law.

    Division by zero gives infinity or NaN in machine code; callers test what they hand on for being finite.
    """
    return Law(function)


_LAW_AT: dict[int, Law[..., Any]] = {}
"""The laws whose addresses were asked for, which stay."""


def call(law: int, *values: Any) -> None:
    """Calls the law at an address (``Law.address``) from within a law; it returns nothing.

    The values must have the types for which the address was asked; machine code does not look. A record may be given
    by ``state_at``.
    """
    _LAW_AT[law](*values)


def state_at(block: int) -> Record:
    """Gives the record whose block is at an address (``Record.address``), to hand it to a law by ``call``."""
    return record_at(block)


def use_machine_code(on: bool = True) -> None:
    """Lets all laws of this process run as machine code from now on, or as Python again."""
    if on:
        import impedance_modules.machine_code  # noqa: F401, PLC0415 - only where it is asked for
    Law.in_machine_code = on


def want_machine_code() -> None:
    """Asks for machine code on behalf of a run; where ``use_machine_code`` was called before, that stays."""
    if Law.in_machine_code is None:
        use_machine_code()


@contextmanager
def as_python() -> Iterator[None]:
    """Lets all laws run as Python within the block, also those that would ask for machine code."""
    before = Law.in_machine_code
    Law.in_machine_code = False
    try:
        yield
    finally:
        Law.in_machine_code = before
