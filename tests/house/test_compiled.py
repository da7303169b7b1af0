# SPDX-License-Identifier: BSD-3-Clause
"""Laws and records run as Python and as machine code alike; kept machine code is never older than its sources."""

import copy
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest

from impedance_modules.compiled import Law, use_machine_code
from impedance_modules.records import Record, Scalar, Table, Vector
from tests.support import example_laws as laws
from tests.support.commands import python
from tests.support.paths import CHECKOUT


@pytest.fixture(autouse=True)
def as_python_at_first() -> Iterator[None]:
    before = Law.in_machine_code
    use_machine_code(False)
    yield
    Law.in_machine_code = before


def contents(record: Record) -> list[bytes]:
    found: list[bytes] = []
    for field in record._layout.fields:
        value = getattr(record, field.name)
        found += contents(value) if isinstance(value, Record) else [np.ascontiguousarray(value).tobytes()]
    return found


def test_one_text_gives_the_same_bits_both_ways() -> None:
    q = np.random.default_rng(3).uniform(0.1, 2.0, 4)
    python, machine = laws.new(), laws.new()
    for _ in range(50):
        use_machine_code(False)
        first = laws.cycle(python, q)
        use_machine_code()
        assert laws.cycle(machine, q) == first
        assert contents(python) == contents(machine)
    assert python.tank.short and python.tank.missed == 50


def test_memory_is_shared() -> None:
    memory, q = laws.new(), np.ones(4)
    memory.tank.level, memory.tank.pending[0, :] = 10.0, 2.0
    laws.book.machine_code(memory.tank, q, 4.0)
    assert memory.tank.level == 2.0
    assert memory.tank.applied.tolist() == [2.0] * 4
    assert type(memory.tank.level) is float and type(memory.tank.missed) is int


def test_records_and_arrays_come_back_as_themselves() -> None:
    use_machine_code()
    memory = laws.new()
    assert laws.same_tank(memory) is memory.tank
    assert laws.rest_of(memory) is memory.rest
    count = sys.getrefcount(memory.tank)
    for _ in range(100):
        laws.same_tank(memory)
    after = sys.getrefcount(memory.tank)
    assert after == count


def test_arrays_cannot_be_replaced() -> None:
    memory, q = laws.new(), np.ones(4)
    with pytest.raises(AttributeError):
        laws.rebind(memory, q)
    with pytest.raises(Exception, match="only written in place"):
        laws.rebind.machine_code(memory, q)


def test_default_and_named_arguments() -> None:
    for on in (False, True):
        use_machine_code(on)
        assert laws.with_default(2.0) == 6.0
        assert laws.with_default(2.0, shift=1.0) == 7.0
        assert laws.with_default(2.0, factor=2.0) == 4.0


@pytest.mark.parametrize(
    "wrong",
    [np.zeros((2, 2)), np.zeros(3, dtype=np.float32), np.zeros(6)[::2], [0.0], None, np.frombuffer(bytes(8))],
)
def test_a_record_refuses_what_machine_code_would_misread(wrong: Any) -> None:
    class One(Record):
        vector: Vector

    with pytest.raises(TypeError, match="vector"):
        One(vector=wrong)


def test_a_table_is_shared_and_its_rows_have_names() -> None:
    memory = laws.new()
    tank, total = memory.tank, laws.fill_all(memory.tank, 0.25)
    assert tank.cells[1].level == 0.375 and tank.cells["axis"][1, 1] == 0.375
    assert laws.fill_all.machine_code(laws.new().tank, 0.25) == total
    assert laws.fill.machine_code(tank.cells[1], 1.0) == -1.375 and tank.cells[1].level == 1.375
    laws.fill_all.machine_code(tank, 0.25)
    assert tank.cells[2].level == 0.75 and tank.cells[2].kind == 0


PACKED = np.dtype([("a", np.int8), ("b", np.float64)])
HIDDEN = np.dtype([("flat", np.float64)], align=True)
ALIGNED = np.dtype([("c", np.float64)], align=True)


def test_a_table_must_have_the_declared_rows() -> None:
    class Cells(Record):
        cells: Annotated[Table, ALIGNED]

    for wrong in (np.zeros(2, laws.CELL), np.zeros(4, ALIGNED)[::2], np.zeros(2)):
        with pytest.raises(TypeError, match="cells"):
            Cells(cells=wrong)
    for rows in (PACKED, HIDDEN):
        with pytest.raises(TypeError, match="cannot hold"):
            type("Wrong", (Record,), {"__annotations__": {"cells": Annotated[Table, rows]}})


def test_a_record_refuses_missing_and_unknown_fields() -> None:
    with pytest.raises(TypeError, match="pending"):
        laws.Tank(level=1.0, applied=np.zeros(2), cells=np.zeros(1, laws.CELL))  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="tank is no"):
        laws.Cycle(**{**laws.new().__reduce__()[1][1], "tank": laws.new()})
    with pytest.raises(TypeError, match="cannot hold"):
        type("Bad", (Record,), {"__annotations__": {"name": str}})


def test_a_subclass_has_its_own_type() -> None:
    use_machine_code()

    class Bigger(laws.Tank):
        more: Scalar = 0.0

    bigger = Bigger(level=1.0, applied=np.zeros(2), pending=np.ones((1, 2)), cells=np.zeros(1, laws.CELL))
    laws.book(laws.new().tank, np.ones(4), 1.0)
    assert laws.book(bigger, np.ones(2), 1.0) == 2.0
    assert bigger.level == -1.0


def test_copies_have_their_own_memory() -> None:
    memory = laws.new()
    for other in (copy.deepcopy(memory), pickle.loads(pickle.dumps(memory))):
        other.tank.level, other.rest[0] = 99.0, 99.0
        assert memory.tank.level != 99.0 and memory.rest[0] != 99.0
        laws.book.machine_code(other.tank, np.ones(4), 1.0)
        assert contents(memory) == contents(laws.new())
    shallow = copy.copy(memory)
    shallow.clock = 7.0
    assert shallow.tank is memory.tank and memory.clock == 0.0
    assert pickle.loads(pickle.dumps(laws.cycle)) is laws.cycle


def test_numba_is_not_imported_until_asked() -> None:
    text = "import sys, numpy, tests.support.example_laws as l\n"
    text += "l.cycle(l.new(), numpy.ones(4)); print('numba' in sys.modules)"
    assert run(text, CHECKOUT) == ["False"]


# Kept code

PACKAGE = {
    "__init__": "",
    "a": """
from __future__ import annotations
from impedance_modules.compiled import compiled
from pkg import b
from pkg.b import scaled
from pkg.r import R

@compiled
def top(r: R, x: float) -> float:
    return b.measure(x) + scaled(x) + r.level + r.rows[0].height

@compiled
def alone(x: float) -> float:
    return x
""",
    "b": """
from __future__ import annotations
from impedance_modules.compiled import compiled
from pkg.c import DERIVED, LIMIT

@compiled
def measure(x: float) -> float:
    return x * 2.0

@compiled
def scaled(x: float) -> float:
    return x * LIMIT + DERIVED
""",
    "c": "from pkg.d import BASE\nLIMIT = 3.0\nDERIVED = BASE * 10.0\n",
    "d": "BASE = 0.0\n",
    "r": """
from __future__ import annotations
from typing import Annotated
import numpy as np
from impedance_modules.records import Record, Scalar, Table

ROW = np.dtype([("height", np.float64), ("width", np.float64)], align=True)

class R(Record):
    level: Scalar
    other: Scalar
    rows: Annotated[Table, ROW]
""",
}
PROGRAM = """
import numpy as np
from impedance_modules.compiled import use_machine_code
from pkg import a, r
use_machine_code()
print(a.top(r.R(level=100.0, other=1000.0, rows=np.ones(1, r.ROW)), 1.0), a.alone(1.0))
for law in (a.top, a.alone):
    print(sum(law.machine_code.stats.cache_hits.values()))
"""


def run(program: str, path: Path, **environment: str) -> list[str]:
    found = {"PYTHONPATH": f"{path}:{CHECKOUT}", "PYTHONDONTWRITEBYTECODE": "1", **environment}
    done = python("-c", program, cwd=path, **found)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.fixture
def package(tmp_path: Path) -> Path:
    (tmp_path / "pkg").mkdir()
    for name, text in PACKAGE.items():
        (tmp_path / "pkg" / f"{name}.py").write_text(text)
    return tmp_path


def edit(package: Path, name: str, old: str, new: str) -> None:
    file = package / "pkg" / f"{name}.py"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))


def test_kept_code_is_used_again_only_while_all_it_depends_on_is_unchanged(package: Path) -> None:
    first = "    level: Scalar\n", "    other: Scalar\n"
    height, width = '("height", np.float64)', '("width", np.float64)'
    for edited, expected in (
        (None, "106.0 1.0 0 0"),
        (None, "106.0 1.0 1 1"),
        (("b", "x * 2.0", "x * 4.0"), "108.0 1.0 0 1"),
        (("c", "LIMIT = 3.0", "LIMIT = 5.0"), "110.0 1.0 0 1"),
        (("d", "BASE = 0.0", "BASE = 1.0"), "120.0 1.0 0 1"),
        (None, "120.0 1.0 1 1"),
        (("r", "".join(first), "".join(reversed(first))), "120.0 1.0 0 1"),
        (("r", f"{height}, {width}", f"{width}, {height}"), "120.0 1.0 0 1"),
        (("b", "from pkg.c import", "# a comment\nfrom pkg.c import"), "120.0 1.0 1 1"),
    ):
        if edited is not None:
            edit(package, *edited)
        assert run(PROGRAM, package, NUMBA_CACHE_DIR=str(package / "cache")) == expected.split(), edited


def test_unreadable_kept_code_is_ignored(package: Path) -> None:
    cache = package / "cache"
    run(PROGRAM, package, NUMBA_CACHE_DIR=str(cache))
    for index in cache.rglob("*.nbi"):
        index.write_bytes(index.read_bytes()[:-9])
    assert run(PROGRAM, package, NUMBA_CACHE_DIR=str(cache)) == ["106.0", "1.0", "0", "0"]


def test_without_a_place_to_keep_code(package: Path) -> None:
    nowhere = dict.fromkeys(("HOME", "NUMBA_CACHE_DIR"), "/proc/nowhere")
    nowhere["NUMBA_CACHE_LOCATOR_CLASSES"] = "UserProvidedCacheLocator"
    for _ in range(2):
        assert run(PROGRAM, package, **nowhere) == ["106.0", "1.0", "0", "0"]


def test_no_multiplication_is_fused_with_an_addition() -> None:
    import numba

    for law, values in (
        (laws.book, (laws.new().tank, np.ones(4), 1.0)),
        (laws.cycle, (laws.new(), np.ones(4))),
    ):
        fresh: Any = numba.njit(error_model="numpy")(law.python)
        fresh(*values)
        for text in fresh.inspect_asm().values():
            assert "mulsd" in text and "fmadd" not in text
