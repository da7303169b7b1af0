# SPDX-License-Identifier: BSD-3-Clause
"""Without the extras: every verb can be asked, `check`, `run` and `diagnose` work, what needs an extra names it."""

from __future__ import annotations

import json
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.cli.main import VERBS
from impedance_modules.extras import EXTRAS
from tests.diagnosis.test_diagnosis import ADDED, JOINTS, URDF, motion, torque
from tests.support.commands import invoke, python
from tests.support.paths import CHECKOUT, TESTS

PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]

BLOCKED = """
import importlib.abc, sys
class Blocked(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {names!r}:
            raise ModuleNotFoundError("No module named " + repr(name), name=name)
sys.meta_path.insert(0, Blocked())
from impedance_modules.cli.main import main
for words in {commands!r}:
    sys.argv = ["impedance", *words]
    try:
        main()
    except SystemExit as end:
        print("exit", end.code, *words[:1], flush=True)
"""
NAMES = {
    *(
        "matplotlib",
        "rosbags",
        "lz4",
        "apsw",
        "backports",
        "mujoco",
        "zmq",
        "pylibfranka",
        "distributed",
        "dask",
    ),
    *("xacrodoc", "rclpy", "rospy"),
}
"""Packages that the extras bring, as they are imported."""


def light(*commands: tuple[object, ...]) -> subprocess.CompletedProcess[str]:
    """Runs commands in a process that can import none of the extras."""
    words = [[str(word) for word in command] for command in commands]
    return python("-c", BLOCKED.format(names=NAMES, commands=words))


def endings(done: subprocess.CompletedProcess[str]) -> list[str]:
    assert "Traceback" not in done.stderr, done.stderr
    return [line for line in done.stdout.splitlines() if line.startswith("exit ")]


def table(path: Path) -> Path:
    """A pendulum whose elbow has friction, as a table of time, positions and efforts."""
    t, q, v, a = motion(1, 20.0)
    effort = torque(q, v, a, mass=1.02)
    joint, law = ADDED["viscous_friction"]
    effort[:, joint] += law(t, q, v, 1)
    random = np.random.default_rng(0)
    effort += random.normal(scale=0.05, size=effort.shape)
    q = q + random.normal(scale=1e-5, size=q.shape)
    names = ["time", *(f"position.{name}" for name in JOINTS), *(f"effort.{name}" for name in JOINTS)]
    np.savetxt(path, np.column_stack([t, q, effort]), delimiter=",", header=",".join(names), comments="")
    return path


def test_every_verb_can_be_asked() -> None:
    done = light(*((verb, "--help") for verb in VERBS))
    assert endings(done) == [f"exit 0 {verb}" for verb in VERBS]


def test_a_table_is_diagnosed_and_what_needs_an_extra_names_it(tmp_path: Path) -> None:
    log, urdf, answer = table(tmp_path / "log.csv"), tmp_path / "robot.urdf", tmp_path / "answer.json"
    urdf.write_text(URDF)
    bag = tmp_path / "run.bag"
    bag.write_bytes(b"#ROSBAG V2.0\n" + b"\0" * 64)
    done = light(
        ("diagnose", log, "--urdf", urdf, "--json", answer),
        ("diagnose", log, "--urdf", urdf, "--report", tmp_path / "report.html"),
        ("import", bag, "--out", tmp_path / "out"),
        ("reproduce", "--list"),
    )
    codes = ["exit 0 diagnose", "exit 2 diagnose", "exit 2 import", "exit 2 reproduce"]
    assert endings(done) == codes
    found = json.loads(answer.read_text())
    assert found["verdict"] == "explained" and "viscous_friction" in str(found["causes"])
    assert "'joint_sensor' is taken (--effort-source states it)" in done.stderr
    for what, extra in (("--report", "plots"), (f"{bag}: a ROS recording", "bags"), ("reproduce", "plots")):
        line = next(
            line for line in done.stderr.splitlines() if what in line and "which is not installed" in line
        )
        assert f"pip install 'impedance-modules[{extra}]'" in line


def test_a_run_without_plots_says_how_to_get_the_picture(tmp_path: Path) -> None:
    hold = TESTS / "data" / "pair-hold.yaml"
    robots = tmp_path / "robots"
    robots.symlink_to(TESTS / "robots")
    task = tmp_path / "hold.yaml"
    task.write_text(hold.read_text())
    done = light(("check", task), ("run", task, "--duration", 0.1, "--out", tmp_path / "out"))
    assert endings(done)[0] == "exit 0 check"
    assert "no picture.png: it needs matplotlib" in " ".join(done.stdout.split())
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "episode.parquet", "recording.rrd", "summary.json",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "stated", [(), ("--effort-source", "motor", "--gravity-compensation", "robot")], ids=str
)
def test_what_a_table_does_not_say_is_stated_or_told(stated: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text(URDF)
    log = table(tmp_path / "log.csv")
    done = invoke("diagnose", log, "--urdf", tmp_path / "robot.urdf", *stated)
    assert ("is taken" in done.output) != bool(stated)


def test_extras_hold_what_they_are_asked_for() -> None:
    for package, extra in EXTRAS.items():
        wanted = " ".join(PROJECT["optional-dependencies"][extra])
        assert package in wanted and package not in " ".join(PROJECT["dependencies"])


def test_importing_the_package_imports_nothing_else() -> None:
    """A cold `import impedance_modules` costs next to nothing: no other package comes with it."""
    code = (
        "import sys; before = set(sys.modules); import impedance_modules\n"
        "new = {name.split('.')[0] for name in set(sys.modules) - before}\n"
        "print(sorted(new - set(sys.stdlib_module_names)))"
    )
    assert python("-c", code).stdout.strip() == "['impedance_modules']"
