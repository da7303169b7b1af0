# SPDX-License-Identifier: BSD-3-Clause
"""An installed wheel, outside the checkout, knows its tasks, robots and schemas."""

import zipfile
from pathlib import Path

import pytest

from tests.support import commands
from tests.support.paths import CHECKOUT


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the unpacked wheel and nothing of the checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    built = commands.python("-m", "hatchling", "build", "-t", "wheel", "-d", str(folder))
    assert built.returncode == 0, built.stderr
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def python(installed: Path, *arguments: str) -> str:
    """What a program prints that finds the package in the wheel alone."""
    found = commands.python(*arguments, cwd=installed.parent, PYTHONPATH=str(installed))
    assert found.returncode == 0, found.stderr
    return found.stdout


def test_the_wheel_is_what_runs(installed: Path) -> None:
    found = python(installed, "-c", "import impedance_modules; print(impedance_modules.__file__)")
    assert Path(found.strip()).is_relative_to(installed)


def test_a_shipped_task_is_checked_by_name(installed: Path) -> None:
    assert python(installed, "-m", "impedance_modules", "check", "soft-hold")


def test_every_task_robot_and_schema_is_in_the_wheel(installed: Path) -> None:
    for kind, pattern in (("tasks", "*.yaml"), ("robots", "*"), ("schemas", "*.json")):
        here = {path.name for path in (CHECKOUT / kind).glob(pattern)}
        there = {path.name for path in (installed / "impedance_modules" / "data" / kind).glob(pattern)}
        assert here == there != set()


def test_the_experiments_of_the_thesis_are_in_the_wheel(installed: Path) -> None:
    found = python(installed, "-m", "impedance_modules", "reproduce", "--list")
    listed = [line.split()[0] for line in found.splitlines()]
    assert {"planar-arms", "sanding", "under-water"} <= set(listed)
    modules = {path.stem for path in (CHECKOUT / "impedance_experiments").glob("*.py")}
    assert modules == {path.stem for path in (installed / "impedance_experiments").glob("*.py")}


def test_an_experiment_runs_from_the_wheel(installed: Path, tmp_path: Path) -> None:
    python(installed, "-m", "impedance_modules", "reproduce", "planar-arms", "--out", str(tmp_path))
    assert (tmp_path / "planar-arms.md").is_file()


def test_the_wheel_has_the_packages_alone_and_says_that_their_types_can_be_checked(installed: Path) -> None:
    tops = {path.name for path in installed.iterdir() if not path.name.endswith(".dist-info")}
    assert tops == {"impedance_modules", "impedance_experiments"}
    assert all((installed / top / "py.typed").is_file() for top in tops)
