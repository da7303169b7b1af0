# SPDX-License-Identifier: BSD-3-Clause
"""The same seed gives the same bits on one machine: whatever the number of threads, locale, time zone, folder or hash
seed. Each variation is a process of its own.
"""

import json
import locale
import os
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from impedance_modules.control.assembly import assemble
from impedance_modules.episode.reader import read_episode
from impedance_modules.runs.verify import verify
from tests.diagnosis.test_diagnosis import URDF, record
from tests.support.baxter_lockstep import run_in_lockstep
from tests.support.commands import python
from tests.support.paths import CHECKOUT
from tests.support.shipped_runs import SHIPPED, shipped

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
FIRST = {**dict.fromkeys(THREADS, "1"), "LC_ALL": "C", "TZ": "UTC", "PYTHONHASHSEED": "0"}

COMMAS_AND_DOTLESS = ("de_DE.UTF-8", "tr_TR.UTF-8", "C.UTF-8")
"""Locales with a decimal comma and with another upper case of i, where they are installed; the last always is."""


def installed(name: str) -> bool:
    before = locale.setlocale(locale.LC_ALL)
    try:
        locale.setlocale(locale.LC_ALL, name)
    except locale.Error:
        return False
    finally:
        locale.setlocale(locale.LC_ALL, before)
    return True


SURROUNDINGS = {"TZ": "Asia/Kathmandu", "PYTHONHASHSEED": "4711"}
VARIATIONS = {
    "two threads": dict.fromkeys(THREADS, "2"),
    **{
        f"elsewhere, {name}": {"LC_ALL": name, **SURROUNDINGS}
        for name in COMMAS_AND_DOTLESS
        if installed(name)
    },
}
"""What differs from the first process; elsewhere: another folder, time zone, hash seed and locale."""

FOLDER = "another folder/\N{LATIN CAPITAL LETTER O WITH DIAERESIS}l"
EACH = pytest.mark.parametrize("variation", VARIATIONS)


def impedance(cwd: Path, environment: dict[str, str], *words: object) -> int:
    cwd.mkdir(parents=True, exist_ok=True)
    arguments = [str(word) for word in words]
    done = python("-m", "impedance_modules", *arguments, cwd=cwd, PYTHONPATH=str(CHECKOUT), **environment)
    assert done.returncode in (0, 5, 6), done.stdout + done.stderr
    return done.returncode


def ran(folder: Path, environment: dict[str, str]) -> Path:
    """Both arms hold a box and lower it, on a plant with noise."""
    task = shipped("press-and-slide")
    impedance(folder, environment, "run", task, "--duration", 0.6, "--seed", 3, "--out", folder / "out")
    return folder / "out"


@pytest.fixture(scope="module")
def first_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ran(tmp_path_factory.mktemp("first"), FIRST)


def contents(run: Path) -> tuple[dict[str, bytes], dict[str, object], dict[str, object]]:
    """Columns as bytes, metadata and summary: no time of day and no folder stands in any of them."""
    table = pq.read_table(run / "episode.parquet")
    columns = {name: _bytes(table[name]) for name in table.column_names}
    metadata = json.loads(table.schema.metadata[b"impedance_modules"])
    summary = json.loads((run / "summary.json").read_text())
    return columns, metadata, summary


def _bytes(column: object) -> bytes:
    values = column.to_numpy(zero_copy_only=False)
    return values.tobytes() if values.dtype == np.float64 else "\n".join(map(str, values)).encode()


@EACH
def test_a_run_is_the_same_to_the_last_bit(variation: str, first_run: Path, tmp_path: Path) -> None:
    environment = {**FIRST, **VARIATIONS[variation]}
    columns, metadata, summary = contents(first_run)
    again = contents(ran(tmp_path / FOLDER, environment))
    assert list(again[0]) == list(columns)
    assert [name for name in columns if again[0][name] != columns[name]] == []
    assert again[1:] == (metadata, summary)


def diagnosed(
    folder: Path, environment: dict[str, str], recordings: list[Path]
) -> tuple[int, dict[str, object]]:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(URDF)
    files = ("--json", folder / "answer.json")
    code = impedance(folder, environment, "diagnose", *recordings, "--urdf", folder / "robot.urdf", *files)
    found = json.loads((folder / "answer.json").read_text())
    found["patch"]["provenance"].pop("date")  # the day, where the user is
    return code, found


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return record(tmp_path_factory.mktemp("recordings"), "viscous_friction", seconds=12.0)


@pytest.fixture(scope="module")
def first_diagnosis(tmp_path_factory, recordings) -> tuple[int, dict[str, object]]:
    return diagnosed(tmp_path_factory.mktemp("first"), FIRST, recordings)


@EACH
def test_a_diagnosis_is_the_same_to_the_last_digit(variation, first_diagnosis, recordings, tmp_path) -> None:
    environment = {**FIRST, **VARIATIONS[variation]}
    assert first_diagnosis[1]["causes"]
    assert diagnosed(tmp_path / FOLDER, environment, recordings) == first_diagnosis


def test_another_seed_gives_other_bits(first_run: Path, tmp_path: Path) -> None:
    """What the tests above compare can differ."""
    task = shipped("press-and-slide")
    impedance(tmp_path, FIRST, "run", task, "--duration", 0.6, "--seed", 4, "--out", tmp_path / "out")
    assert contents(tmp_path / "out")[0] != contents(first_run)[0]


@pytest.mark.long
@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_task_is_recomputed_bit_by_bit(name: str, tmp_path: Path) -> None:
    """The whole task, as users run it, and then every torque of it once more from what was recorded."""
    impedance(tmp_path, dict(os.environ), "run", name, "--out", tmp_path / "out")
    done = python("-m", "impedance_modules", "replay", str(tmp_path / "out"), "--verify", cwd=tmp_path)
    assert done.returncode == 0 and "bit-equal" in done.stdout, done.stdout + done.stderr


@pytest.mark.long
@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_task_is_recomputed_from_a_simulated_baxter(name: str, tmp_path: Path) -> None:
    """Its messages come in another order and at another rate than the plant's states; a stop is recomputed too."""
    assembly = assemble(name, effects=None, rate=200.0, scale=1.0, arm=None)
    run_in_lockstep(assembly, tmp_path / "out")
    episode = read_episode(tmp_path / "out")
    assert verify(episode, lambda part: None).samples == len(episode) > 0
