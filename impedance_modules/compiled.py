# SPDX-License-Identifier: BSD-3-Clause
"""One text of a law, run as plain Python or, when a run asks for it, as machine code.

``compiled`` marks a function of numbers, arrays and ``records.Record``. It runs as Python until
``use_machine_code`` is called; from then on numba runs it. Numba is not imported before that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property, update_wrapper
from typing import Any, ClassVar, Generic, ParamSpec, TypeVar

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
