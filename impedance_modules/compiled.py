# SPDX-License-Identifier: BSD-3-Clause
"""How functions of this package become machine code, and when kept code may be used again.

Numba keeps code on disk and discards it when the function's own file changes. But callers hold the code of what
they call, and the values of constants they import: kept code is used here only as long as neither any compiled
source of the package nor any module that one of them imports from has changed.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

PACKAGE = Path(__file__).parent
_IMPORT = re.compile(r"^from (impedance_modules[\w.]*) import", re.MULTILINE)


def _sources() -> Iterator[Path]:
    """Yields every compiled source, and every module of this package that one imports from."""
    for source in PACKAGE.rglob("compiled*.py"):
        yield source
        for name in _IMPORT.findall(source.read_text()):
            module = PACKAGE.parent.joinpath(*name.split(".")).with_suffix(".py")
            if module.is_file():
                yield module


def fingerprint() -> str:
    """Digests the sources on which machine code depends."""
    digest = hashlib.sha256()
    for source in sorted(set(_sources())):
        digest.update(source.read_bytes())
    return digest.hexdigest()


FINGERPRINT = fingerprint()


def compiled(function: Function) -> Function:
    """Compiles a function to machine code on its first call, and keeps the code on disk.

    Division by zero gives infinity or NaN, as in numpy; callers test what they hand on for being finite.
    """
    dispatcher: Any = numba.njit(cache=True, error_model="numpy")(function)
    kept = dispatcher._cache._cache_file
    kept._source_stamp = (kept._source_stamp, FINGERPRINT)
    return cast(Function, dispatcher)
