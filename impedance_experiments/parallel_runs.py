# SPDX-License-Identifier: BSD-3-Clause
"""Many runs on several processors, each result kept in a folder: what the same program has done is not done again."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import impedance_modules
from impedance_experiments.kept_results import read_result, write_result
from impedance_modules.spec.locate import data_folder

Job = TypeVar("Job")
Result = TypeVar("Result")

FEW = 4
"""So many runs are not worth starting processes for."""
MOST_PROCESSES = 4


def carry_out_all(
    run: Callable[[Job], Result], jobs: Sequence[Job], folder: Path, on_done: Callable[[int], None]
) -> list[Result]:
    """Carries runs out on as many processes as there are processors (at most four); results in order.

    Args:
        run: Of a module, not a closure; a dataclass that it returns is its stated return type, of plain data.
        jobs: Plain data: dataclasses, arrays, numbers, texts, paths.
        folder: Results are written there as they come, and read again by a later call of the same program.
        on_done: Called with how many are done.
    """
    places = [folder / f"{run.__name__}-{_digest((program(), job))}.npz" for job in jobs]
    missing = [index for index, place in enumerate(places) if not place.is_file()]
    done = len(jobs) - len(missing)
    count = min(MOST_PROCESSES, os.cpu_count() or 1)

    work = [(run, jobs[index], places[index]) for index in missing]
    if count == 1 or len(missing) <= FEW:
        for number, each in enumerate(work):
            _carry_out(each)
            on_done(done + number + 1)
    else:
        with ProcessPoolExecutor(count, mp_context=multiprocessing.get_context("spawn")) as pool:
            for number, _ in enumerate(pool.map(_carry_out, work)):
                on_done(done + number + 1)
    return [read_result(run, place) for place in places]


def _carry_out(work: tuple[Callable[[Any], object], Any, Path]) -> None:
    """Does one job and writes its result, whole or not at all."""
    run, job, place = work
    write_result(run(job), place)


@cache
def program() -> str:
    """Identifies the program: a digest of its sources, tasks and robots."""
    found = hashlib.sha256()
    sources = (Path(__file__).parent, Path(impedance_modules.__file__).parent)
    roots = (*sources, data_folder("tasks"), data_folder("robots"))
    for root in roots:
        for path in sorted(root.rglob("*")):
            if path.suffix in (".py", ".yaml", ".urdf"):
                found.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return found.hexdigest()


def _digest(value: Any) -> str:
    found = hashlib.sha256()
    _feed(found, value)
    return found.hexdigest()[:24]


def _feed(found: hashlib._Hash, value: Any) -> None:
    """Feeds plain data to a digest, kind by kind."""
    found.update(type(value).__name__.encode())
    if isinstance(value, np.ndarray):
        found.update(str((value.shape, value.dtype)).encode() + np.ascontiguousarray(value).tobytes())
    elif is_dataclass(value):
        for field in fields(value):
            _feed(found, (field.name, getattr(value, field.name)))
    elif isinstance(value, Mapping):
        for key in sorted(value):
            _feed(found, (key, value[key]))
    elif isinstance(value, (list, tuple)):
        for item in value:
            _feed(found, item)
        found.update(b"end")
    elif value is None or isinstance(value, (str, float, int, Path, Enum)):
        found.update(f"{value!r}".encode())
    else:
        raise TypeError(f"a {type(value).__name__} is not plain data")
