# SPDX-License-Identifier: BSD-3-Clause
"""The built-in plant and MuJoCo carry out the same tasks: hands, phases, energy, seeds and recordings agree."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.episode.data import Episode
from impedance_modules.episode.reader import read_episode
from impedance_modules.runs.execution import RunOptions, RunResult, carry_out
from impedance_modules.runs.run_backends import make_backend, mujoco_backend
from impedance_modules.runs.verify import verify
from tests.support.adversity import Books
from tests.support.commands import invoke, refusal
from tests.support.paths import TESTS

FREE, TOUCHING = 0.005, 0.010
"""By how much the hands of the two realities may differ, RMS [m]."""

TASKS = {
    "reach-and-return": (4.0, FREE),
    "mirrored-arms": (2.0, FREE),
    "wipe-table": (2.5, TOUCHING),
    "press-box": (2.0, TOUCHING),
    "box-hold": (3.5, TOUCHING),
    str(TESTS / "data" / "fr3-box.yaml"): (3.0, TOUCHING),
}
"""Task -> how much of it is run [s], and what may differ."""


@cache
def assembled(task: str) -> Assembly:
    return assemble(task, effects=None, rate=None, scale=1.0, arm=None)


def ran(task: str, backend: str, folder: Path, seed: int = 0, log: Path | None = None) -> RunResult:
    assembly = assembled(task)
    robot = make_backend(assembly, backend=backend, log=log, seed=seed)
    options = RunOptions(folder, seed, TASKS[task][0], live=False, read_only=False, backend=backend)
    return carry_out(assembly, robot, options, lambda *_: None)


@cache
def recorded(task: str, backend: str) -> tuple[Episode, dict[str, object], Path]:
    folder = Path(mkdtemp()) / "run"
    result = ran(task, backend, folder)
    return read_episode(folder), result.summary, folder


def bits(episode: Episode) -> list[bytes]:
    kinds = (episode.position, episode.velocity, episode.effort, episode.effort_command)
    return [values.tobytes() for kind in kinds for values in kind.values()]


@pytest.mark.parametrize("task", TASKS)
def test_hands_move_alike_and_phases_come_in_the_same_order(task: str) -> None:
    (plant, one, _), (mujoco, other, _) = recorded(task, "sim"), recorded(task, "mujoco")
    rows = min(len(plant), len(mujoco))
    assert rows > 0.9 * max(len(plant), len(mujoco))
    for hand in plant.pose:
        away = plant.pose[hand][:rows, :3] - mujoco.pose[hand][:rows, :3]
        assert np.sqrt(np.mean(np.sum(away**2, axis=1))) < TASKS[task][1], hand
        assert np.abs(away).max() > 0.0, "one reality was recorded twice"
    assert [phase["name"] for phase in one["phases"]] == [phase["name"] for phase in other["phases"]]


@pytest.mark.parametrize("task", TASKS)
def test_the_tank_is_never_overdrawn_and_no_effort_leaves_its_limit(task: str) -> None:
    _, summary, _ = recorded(task, "mujoco")
    assert summary["tank"]["lowest"] >= summary["tank"]["floor"]
    assert summary["tank"]["work"] <= summary["tank"]["work_bound"]
    assert max(summary["torque_peak_over_limit"].values()) <= 1.0


@pytest.mark.parametrize("noise", [True, False])
@pytest.mark.parametrize("task", ["wipe-table", "press-box"])
def test_work_at_mujocos_motors_stays_within_the_claim(task: str, noise: bool) -> None:
    """Integral of tau dtheta along MuJoCo's own rotors, never above what the tank grants."""
    assembly = assembled(task)
    backend = mujoco_backend(assembly, 3, noise=noise)
    books = Books(Supervisor(assembly), backend.plant)
    first = backend.start()
    books.supervisor.start(first)
    options = {"duration": 1.5, "paced": False, "read_only": False}
    run_loop(books.supervisor, backend, first.state, books.watch, Interrupt(), **options)
    assert books.least_margin >= -1e-9 and books.largest_error <= 1e-9
    assert abs(backend.plant.motor_work) > 0.05


def test_the_recording_names_its_reality_and_has_the_same_columns() -> None:
    (plant, _, _), (mujoco, summary, _) = recorded("box-hold", "sim"), recorded("box-hold", "mujoco")
    assert mujoco.metadata["backend"] == summary["backend"] == "mujoco"
    assert set(mujoco.extra) == set(plant.extra) and set(mujoco.pose) == set(plant.pose)
    assert "mujoco-core" in mujoco.metadata["versions"] and "mujoco-core" not in plant.metadata["versions"]


def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not(tmp_path: Path) -> None:
    again = [ran("wipe-table", "mujoco", tmp_path / str(seed), seed) for seed in (0, 1)]
    first, same, other = (
        bits(read_episode(folder))
        for folder in (recorded("wipe-table", "mujoco")[2], *(result.directory for result in again))
    )
    assert first == same and first != other


@pytest.mark.parametrize("task", ["wipe-table", "box-hold"])
def test_a_recording_is_recomputed_bit_for_bit_and_fed_back(tmp_path: Path, task: str) -> None:
    episode, _, folder = recorded(task, "mujoco")
    assert verify(episode, lambda _: None).samples == len(episode)
    ran(task, "replay", tmp_path / "fed", log=folder)
    fed = read_episode(tmp_path / "fed")
    rows = len(fed)
    assert rows >= len(episode) - 1
    for joint, effort in fed.effort_command.items():
        np.testing.assert_array_equal(effort, episode.effort_command[joint][:rows])


def test_the_command_runs_it_and_tells(tmp_path: Path) -> None:
    out = tmp_path / "run"
    done = invoke("run", "soft-hold", "--backend", "mujoco", "--duration", "0.2", "--out", str(out))
    assert done.return_value == 0
    assert "mujoco" in done.output and (out / "episode.parquet").exists()


def test_without_mujoco_the_command_names_its_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    said = refusal("run", "soft-hold", "--backend", "mujoco", "--out", tmp_path / "run")
    assert "not installed" in said and "impedance-modules[mujoco]" in said
