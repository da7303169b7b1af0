# SPDX-License-Identifier: BSD-3-Clause
"""Runs on a robot in real time: lost states, calibrated mounts, extra columns; replayed bit for bit."""

import dataclasses

import numpy as np
import pytest

from impedance_modules.backends.protocol import FirstState
from impedance_modules.backends.sim_backend import SimBackend
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import ReplayMismatch
from impedance_modules.runs.execution import RunOptions, RunResult, carry_out
from impedance_modules.runs.task_plant import sim_backend
from impedance_modules.runs.verify import verify
from impedance_modules.safety.stop_levels import StopLevel
from impedance_modules.spec.robot_spec import JointOrigin, RobotSpec

GAP = (1750, 1766)
"""Reads without a state while the arms move: 32 ms at 500 Hz, after which they brake."""

MOUNT = JointOrigin((0.0251329, -0.2197093, 0.1090394), (-0.00194, 0.00346, -0.78595))


def calibrated(spec: RobotSpec) -> RobotSpec:
    return dataclasses.replace(spec, joint_origins={"right_arm_mount_fixed": MOUNT})


class LossyRobot:
    """The plant, but some states are lost; reports two extra columns."""

    def __init__(self, robot: SimBackend) -> None:
        self._robot, self.start, self.write = robot, robot.start, robot.write
        self._random = np.random.default_rng(1)
        self.extra_reads = self._reads = 0
        self.finished: list[str] = []

    def warm_up_with(self, cycle) -> None:
        self.warm_up = cycle

    def newest(self) -> FirstState:
        return FirstState(self._robot.plant.sense(), self._robot.plant.start_command.copy())

    def read(self):
        state = self._robot.read()
        self._reads += 1
        self.warm_up()
        lost = self._random.random() < 0.05 or GAP[0] <= self._reads < GAP[1]
        return None if lost else state

    def finish(self, how) -> None:
        self.finished.append(how)
        self._robot.finish(how)

    def extra_columns(self) -> tuple[str, ...]:
        return ("gravity.one", "gravity.other")

    def extra_values(self):
        self.extra_reads += 1
        return np.array([self.extra_reads, np.nan])


@pytest.fixture(scope="module")
def assembly() -> Assembly:
    return assemble("joint-springs", effects=None, rate=500.0, scale=1.0, arm=None, calibrate=calibrated)


def test_the_model_has_the_mount_that_was_found(assembly: Assembly) -> None:
    nominal = assemble("joint-springs", effects=None, rate=500.0, scale=1.0, arm=None)
    q = assembly.modules.posture
    moved = assembly.model.pose(q, "right_hand").translation - nominal.model.pose(q, "right_hand").translation
    assert 0.005 < np.linalg.norm(moved) < 0.02
    left = [a.model.pose(q, "left_hand").translation for a in (assembly, nominal)]
    assert np.array_equal(*left)


def run(assembly, robot, folder) -> RunResult:
    out = folder / "run"
    options = RunOptions(out=out, seed=0, duration=4.0, live=False, read_only=False, backend="sim")
    return carry_out(assembly, robot, options, lambda time, phase: None)


def test_a_run_with_gaps_is_replayed_bit_for_bit_on_the_mounts_it_had(assembly, tmp_path) -> None:
    robot = LossyRobot(sim_backend(assembly, 0))
    result = run(assembly, robot, tmp_path)
    assert robot.finished[0] == "hold"
    assert "stale state" in result.reason
    episode = read_episode(tmp_path / "run")
    missed = np.asarray(episode.extra["missed"])
    gap = int(np.argmax(missed))
    assert 16 <= missed[gap] <= 19
    assert episode.extra["rung"][gap] == StopLevel.DAMP
    assert 60 <= missed.sum() <= 150
    assert missed[: gap + 1].sum() + gap == GAP[1]
    assert np.array_equal(episode.extra["gravity.one"], 1.0 + np.arange(len(missed)))
    assert np.isnan(episode.extra["gravity.other"]).all()
    assert verify(episode, lambda part: None).samples == len(missed)
    for change in ({"joint_origins": {}}, {}):
        extra = dict(episode.extra) if change else {**episode.extra, "missed": np.zeros(len(missed))}
        other = dataclasses.replace(episode, metadata={**episode.metadata, **change}, extra=extra)
        with pytest.raises(ReplayMismatch):
            verify(other, lambda part: None)


def test_a_robot_that_cannot_be_started_leaves_no_episode_and_is_released(assembly, tmp_path) -> None:
    robot = LossyRobot(sim_backend(assembly, 0))

    def broken() -> FirstState:
        nothing = np.full(assembly.model.n, np.nan)
        state = dataclasses.replace(robot._robot.plant.sense(), position=nothing)
        return FirstState(state, np.zeros(assembly.model.n))

    robot.newest = broken
    with pytest.raises(Exception, match="not finite"):
        run(assembly, robot, tmp_path)
    assert robot.finished == ["hold"]
    assert not list((tmp_path / "run").glob("*.parquet"))
