# SPDX-License-Identifier: BSD-3-Clause
"""Machine code is kept where that is possible; where it is not, or where it was damaged, laws are compiled anew."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.support.paths import CHECKOUT

PROGRAM = """
import sys
from impedance_modules.compiled import use_machine_code
from tests.support import example_laws as laws
use_machine_code()
print(laws.fill_all(laws.new().tank, 0.25), laws.__file__, len(laws.fill_all.machine_code.stats.cache_hits))
"""

PACKAGES = ("impedance_modules", "tests/support", "tasks", "robots", "schemas")


@pytest.fixture
def installed(tmp_path):
    """A copy of the package in a folder that nobody may write, and a home likewise."""
    folder = tmp_path / "lib"
    for package in PACKAGES:
        shutil.copytree(CHECKOUT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    home = tmp_path / "home"
    home.mkdir()
    places = [home, *(path for path in (folder, *folder.rglob("*")) if path.is_dir())]
    for place in places:
        place.chmod(0o555)
    yield folder, home
    for place in places:
        place.chmod(0o755)


def as_a_user() -> list[str]:
    """Words before a command that take root's right to write everywhere from it."""
    if os.geteuid() != 0:
        return []
    if shutil.which("setpriv") is None:
        pytest.skip("root may write everywhere, and there is no command 'setpriv'")
    return ["setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-all"]


def run(
    folder: Path, *before: str, words: tuple[str, ...] = ("-c", PROGRAM), **environment: str
) -> subprocess.CompletedProcess[str]:
    kept = {
        name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "NUMBA_", "HOME"))
    }
    return subprocess.run(
        [*before, sys.executable, *words],
        cwd=folder,
        env={**kept, "PYTHONPATH": str(folder), **environment},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("home", [True, False])
def test_without_any_place_to_keep_code_laws_are_compiled_and_not_kept(installed, home):
    folder, place = installed
    environment = {"HOME": str(place)} if home else {"HOME": "/proc/nowhere"}
    ended = run(folder, *as_a_user(), **environment)
    assert ended.returncode == 0, ended.stderr
    number, where, hits = ended.stdout.split()
    assert where.startswith(str(folder)) and hits == "0" and np.isfinite(float(number))
    assert list(place.iterdir()) == [] and not list(folder.rglob("*.nbi"))


@pytest.mark.long
def test_a_run_without_any_place_to_keep_code_is_a_run(installed, tmp_path):
    folder, place = installed
    words = (
        "-m",
        "impedance_modules",
        "run",
        "soft-hold",
        "--duration",
        "0.3",
        "--out",
        str(tmp_path / "run"),
    )
    ended = run(folder, *as_a_user(), words=words, HOME=str(place))
    assert ended.returncode == 0, ended.stderr
    names = {"episode.parquet", "picture.png", "recording.rrd", "summary.json"}
    assert {path.name for path in (tmp_path / "run").iterdir()} == names
    assert list(place.iterdir()) == [] and not list(folder.rglob("*.nbi"))


def spoil_nothing(path: Path) -> None:
    """As it is."""


def cut_off(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def empty(path: Path) -> None:
    path.write_bytes(b"")


def become_a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def let_others_write(path: Path) -> None:
    path.chmod(0o666)


def belong_to_somebody(path: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root can give files away")
    os.chown(path, 12345, -1)


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A folder of kept code, and what the program printed that made it."""
    folder = tmp_path_factory.mktemp("kept")
    ended = run(CHECKOUT, NUMBA_CACHE_DIR=str(folder))
    assert ended.returncode == 0, ended.stderr
    return folder, ended.stdout.split()


@pytest.mark.parametrize(
    ("kind", "spoil"),
    [
        ("nbi", spoil_nothing),
        ("nbi", cut_off),
        ("nbi", become_a_folder),
        ("nbc", cut_off),
        ("nbc", empty),
        ("nbc", become_a_folder),
        ("nbi", let_others_write),
        ("nbc", let_others_write),
        ("nbi", belong_to_somebody),
        ("nbc", belong_to_somebody),
    ],
)
def test_kept_code_that_cannot_be_read_is_compiled_anew(kept, tmp_path, kind, spoil):
    folder, printed = kept
    shutil.copytree(folder, tmp_path / "kept")
    files = list((tmp_path / "kept").rglob(f"*.{kind}"))
    assert files
    for path in files:
        spoil(path)
    again = run(CHECKOUT, NUMBA_CACHE_DIR=str(tmp_path / "kept"))
    assert again.returncode == 0, again.stderr
    number, _, hits = again.stdout.split()
    assert number == printed[0]
    assert (hits != "0") == (spoil is spoil_nothing)


def test_code_in_a_folder_where_others_may_write_is_neither_run_nor_kept(kept, tmp_path):
    """Numba unpickles what it keeps: whoever can write there could have anything executed."""
    folder, printed = kept
    shutil.copytree(folder, tmp_path / "kept")
    for place in (tmp_path / "kept").iterdir():
        place.chmod(0o777)
    again = run(CHECKOUT, NUMBA_CACHE_DIR=str(tmp_path / "kept"))
    number, _, hits = again.stdout.split()
    assert (number, hits) == (printed[0], "0")
    assert "kept machine code is not used, others may write there" in again.stderr
