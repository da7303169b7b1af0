# SPDX-License-Identifier: BSD-3-Clause
"""Runs on the simulated Baxter: the same motion and phases as on the plant alone, and withheld effects diagnosed.

The comparison runs the same YAML on the plant and, over ROS, on the simulated Baxter. Three tasks here;
``EVERY_TASK=1 pytest -s`` on this file compares and prints all that need nothing but the robot.
The tanks are made ample: what lost samples cost is tested in tests/control.
"""

import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from impedance_modules.backends.baxter.simulator.parameters import SPRINGS
from impedance_modules.control.assembly import assemble
from impedance_modules.episode.data import Episode
from impedance_modules.episode.reader import read_episode
from impedance_modules.spec.locate import find_task, list_tasks
from impedance_modules.spec.task_reader import read_task
from tests.support.baxter_lockstep import run_in_lockstep
from tests.support.baxter_process import ATTEMPTS, BUSY, impedance, simulator
from tests.support.paths import TESTS

pytestmark = pytest.mark.ros

RATE = 200

THREE = ["elbow-swing", "joint-springs", "reach-and-return"]


def without_surroundings() -> list[str]:
    """Tasks that need nothing but the robot."""
    tasks = {name: read_task(name)[0] for name in list_tasks()}
    return [name for name, task in tasks.items() if not task.environment and task.object is None]


def phases(folder: Path) -> list[str]:
    summary = json.loads((folder / "summary.json").read_text())
    return [phase["name"] for phase in summary["phases"]]


def progress(episode: Episode) -> np.ndarray:
    """How far the task is, phase by phase: a phase's clock stands still while a state is missing."""
    names = phases_of(episode)
    place = np.array([names.index(str(name)) for name in episode.phase])
    return place + np.minimum(episode.extra["phase_clock"] / 100.0, 0.999)


def phases_of(episode: Episode) -> list[str]:
    return list(dict.fromkeys(str(name) for name in episode.phase))


def apart(one: Episode, other: Episode) -> tuple[dict[str, float], dict[str, float]]:
    """RMS distance of joints [rad] and of hands [m] at the same points of two runs of a task."""
    here, there = progress(one), progress(other)
    # Phases end where each run reached their end; what only one of them has is left out.
    last = {k: min(here[here // 1 == k].max(), there[there // 1 == k].max()) for k in np.unique(here // 1)}
    both = np.array([point <= last[point // 1] for point in here])
    at = here[both]
    joints = {
        joint: rms(one.position[joint][both], np.interp(at, there, other.position[joint]))
        for limb in one.metadata["limbs"].values()
        for joint in limb
    }
    hands = {
        frame: rms(
            one.pose[frame][both, :3].T,
            np.stack([np.interp(at, there, other.pose[frame][:, i]) for i in range(3)]),
        )
        for frame in one.pose
    }
    return joints, hands


def rms(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(np.atleast_2d(one - other) ** 2, axis=0))))


def with_an_ample_tank(task: str, folder: Path) -> str:
    text = find_task(task).read_text()
    path = folder / f"{task}.yaml"
    path.write_text(re.sub(r"tank: \{initial: [\d.]+, max: [\d.]+,", "tank: {initial: 40, max: 80,", text))
    assert path.read_text() != text
    return str(path)


@pytest.mark.long
@pytest.mark.parametrize("task", without_surroundings() if os.environ.get("EVERY_TASK") else THREE)
def test_a_task_moves_the_simulated_baxter_as_it_moves_the_plant(task, master, tmp_path) -> None:
    simulated, file = tmp_path / "sim", with_an_ample_tank(task, tmp_path)
    run = impedance("run", file, "--rate", str(RATE), "--out", str(simulated))
    assert run.returncode == 0, run.stdout + run.stderr
    for attempt in range(ATTEMPTS):
        real = tmp_path / f"real-{attempt}"
        real.mkdir()
        with simulator(real, master, "--posture", file, "--enabled") as robot:
            run = impedance(
                "run", file, "--rate", str(RATE), "--backend", "baxter", "--out", str(real / "run")
            )
        if run.returncode == 0 or not BUSY.search(re.sub(r"\s+", " ", run.stdout + run.stderr)):
            break
    assert run.returncode == 0, f"{run.stdout}{run.stderr}{robot.said}"
    real = real / "run"
    assert phases(real) == phases(simulated)
    one, other = read_episode(simulated), read_episode(real)
    joints, hands = apart(one, other)
    print(f"{task}: joints {1e3 * max(joints.values()):.2f} mrad, hands {1e3 * max(hands.values()):.2f} mm")
    assert max(joints.values()) < 0.02, joints
    assert max(hands.values()) < 0.005, hands


MOTIONS = [str(TESTS / "data" / f"swing-{name}.yaml") for name in ("one", "one", "two")]
"""The right arm only, every joint at once; the first twice, which tells the noise, the last held out."""


WITHHELD = 2.0
"""Viscous friction in the elbow's drive [N.m.s/rad]; the model has none."""

PATCH = f"""
format: 1
robot: baxter
provenance: {{origin: hand, date: "2026-11-21", note: Withheld from task and diagnosis.}}
effects:
  - effect: viscous_friction
    joints: [right_e1]
    port: actuator
    parameters: {{right_e1: {{fv: {{value: {WITHHELD}, unit: N.m.s/rad}}}}}}
"""


@pytest.fixture
def patch(tmp_path: Path) -> Path:
    path = tmp_path / "withheld.yaml"
    path.write_text(PATCH)
    return path


def diagnosed(recordings: list[str], folder: Path) -> tuple[list[dict[str, Any]], str]:
    """Causes that are named, and what the terminal said."""
    one, again, held_out = recordings
    answer = folder / "answer.json"
    options = ("--robot", "baxter", "--json", str(answer))
    run = impedance("diagnose", one, again, "--holdout", held_out, *options, seconds=900.0)
    assert run.returncode in (0, 5, 6), run.stdout + run.stderr
    return json.loads(answer.read_text())["causes"], run.stdout


def check_the_answer(recordings: list[str], folder: Path) -> None:
    causes, said = diagnosed(recordings, folder)
    assert causes, said
    first = causes[0]
    assert (first["effect"], first["port"]) == ("viscous_friction", "actuator"), said
    assert "right_e1" in first["joints"]
    assert first["weight"] > 0.8
    assert first["parameters"]["right_e1"]["fv"]["value"] == pytest.approx(WITHHELD, rel=0.1)


@pytest.mark.long
def test_withheld_friction_and_springs_are_named_from_recordings_of_the_simulated_baxter(
    tmp_path: Path, patch: Path
) -> None:
    """The robot carries the springs beside s1 itself; nobody told the model of them."""
    recordings = []
    for k, motion in enumerate(MOTIONS):
        assembly = assemble(motion, effects=None, rate=RATE, scale=1.0, arm=None)
        out = tmp_path / f"recording-{k}"
        run_in_lockstep(assembly, out, effects=patch, seed=k, springs=SPRINGS)
        recordings.append(str(out))
    causes, said = diagnosed(recordings, tmp_path)
    named = {(cause["effect"], joint): cause for cause in causes for joint in cause["joints"]}
    friction = named["viscous_friction", "right_e1"]["parameters"]["right_e1"]
    assert friction["fv"]["value"] == pytest.approx(WITHHELD, rel=0.1), said
    stiffness, preload = SPRINGS["s1"]
    spring = named["parallel_spring", "right_s1"]["parameters"]["right_s1"]
    assert spring["k"]["value"] == pytest.approx(stiffness, rel=0.1), said
    assert spring["preload"]["value"] == pytest.approx(preload, rel=0.1), said


def record(motion: str, out: Path) -> str:
    """Runs a motion on the simulator; again where a busy machine has made it give up."""
    for attempt in range(ATTEMPTS):
        out = out.with_name(f"{out.name}-try-{attempt}") if attempt else out
        options = ("--backend", "baxter", "--rate", str(RATE), "--approach", "--out", str(out))
        run = impedance("run", motion, *options)
        said = re.sub(r"\s+", " ", run.stdout + run.stderr)
        if run.returncode == 0:
            return str(out)
        assert BUSY.search(said), said
    raise AssertionError(said)


@pytest.mark.long
@pytest.mark.ros
def test_the_same_over_ros(master: str, tmp_path: Path, patch: Path) -> None:
    stands = ("--posture", MOTIONS[0], "--enabled", "--no-spring", "--effects", str(patch))
    with simulator(tmp_path, master, *stands):
        recordings = [record(motion, tmp_path / f"recording-{k}") for k, motion in enumerate(MOTIONS)]
    check_the_answer(recordings, tmp_path)
