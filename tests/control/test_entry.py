# SPDX-License-Identifier: BSD-3-Clause
"""How a run begins on a robot that stands beside the start: no jump of torque, no push, no energy from nowhere."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.backends.protocol import FirstState
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.controller import Controller
from impedance_modules.control.set_points import BLENDING
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.task_plant import sim_backend
from tests.support.paths import TESTS

RATE = 500.0

TASK = """
format: 1
name: entry
robot: baxter
arms:
  right:
    posture: {s0: 0.2706, s1: -0.4171, e0: 0.8304, e1: 1.4871, w0: -0.9774, w1: 0.9511, w2: -2.5284}
    joint_bias: {stiffness: {s0: 20, s1: 20, e0: 10, e1: 10, w0: 5, w1: 5, w2: 2}, damping_ratio: 0.7}
    springs:
      - name: hand
        frame: right_hand
        expressed_in: world
        stiffness: {x: 200, y: 200, z: 0, rx: 10, ry: 10, rz: 10}
        damping_ratio: 0.7
        axes: {z: {force: -10, speed_limit: 0.2}}
safety: {tank: {initial: 4, max: 8, floor: 0.3}}
phases:
  - {name: short, duration: 0.1}
  - {name: rest, duration: 4}
"""


@pytest.fixture(scope="module")
def assembly(tmp_path_factory: pytest.TempPathFactory) -> Assembly:
    path: Path = tmp_path_factory.mktemp("entry") / "entry.yaml"
    path.write_text(TASK)
    return assemble(str(path), effects=None, rate=RATE, scale=1.0, arm=None)


def run(assembly: Assembly, away: float, cycles: int) -> tuple[Supervisor, list[np.ndarray], list[float]]:
    """Torques and the force axis's force, cycle by cycle, of a run that starts so far from its posture [rad]."""
    supervisor = Supervisor(assembly)
    start = assembly.modules.posture.copy()
    start[assembly.modules.arms[0].limb.joints] += away * np.array([1, -1, 1, -1, 1, -1, 1])
    displaced = replace(assembly, modules=replace(assembly.modules, posture=start))
    robot = sim_backend(displaced, 0, noise=False)
    first = robot.start()
    supervisor.start(first)
    state, efforts, forces = first.state, [], []
    for _ in range(cycles):
        efforts.append(supervisor.step(state, late=False, stop_request=None).copy())
        forces.append(float(supervisor.controller.cycle.modules.springs.force[0, 2]))
        robot.write(efforts[-1])
        state = robot.read()
    return supervisor, efforts, forces


def test_springs_begin_relaxed_where_the_robot_stands_elsewhere(assembly: Assembly) -> None:
    supervisor, efforts, forces = run(assembly, 0.08, round(2.5 * RATE))
    # At full springs it would be 19 N.m by then.
    assert np.abs(efforts[:10]).max() < 1.0
    tank = supervisor.controller.tank
    assert tank.spring_scale == 1.0
    # What the springs held at the start was never counted as given.
    assert tank.initial_energy == assembly.tank.initial
    # The force axis comes in by minimum jerk over half a second although the first phase is over after a tenth.
    s = np.clip(np.arange(len(forces)) / RATE / BLENDING, 0.0, 1.0)
    expected = -10.0 * (10 * s**3 - 15 * s**4 + 6 * s**5)
    assert abs(forces[0]) < 0.1
    assert forces[-1] == pytest.approx(-10.0)
    assert np.abs(np.diff(forces)).max() < 2.5 * np.abs(np.diff(expected)).max()


def test_springs_are_tight_at_once_where_the_task_begins(assembly: Assembly) -> None:
    supervisor, _, _ = run(assembly, 0.0, 3)
    assert supervisor.controller.tank.spring_scale == 1.0


def gripped(acting: float, cycles: int) -> list[np.ndarray]:
    """Torques of squeeze and carried weight, cycle by cycle, with this much acting on every joint before [N.m]."""
    task = str(TESTS / "data" / "pair-box.yaml")
    assembly = assemble(task, effects=None, rate=RATE, scale=1.0, arm=None)
    n = assembly.model.n
    controller = Controller(assembly)
    parts = assembly.modules.posture.copy(), np.zeros(n), np.zeros(n)
    controller.start(FirstState(RobotState(0.0, *parts), np.full(n, acting)), assembly.task.phases[0])
    found = []
    for k in range(cycles):
        if k == cycles // 3:
            controller.next_phase(assembly.task.phases[1])
        controller.tick(RobotState((k + 1) / RATE, *parts))
        found.append(controller.cycle.modules.efforts[-2:].copy())
    return found


def test_an_object_is_squeezed_and_carried_gently_by_hands_that_do_not_hold_it_yet() -> None:
    cycles = round((2.0 * BLENDING + 0.1) * RATE)
    gently, at_once = gripped(0.0, cycles), gripped(0.01, cycles)
    full = at_once[0]
    assert np.abs(full).max(axis=1).min() > 0.5
    share = np.array([now[0] @ full[0] / (full[0] @ full[0]) for now in gently])
    for now, part in zip(gently, share, strict=True):
        np.testing.assert_allclose(now, part * full, atol=1e-9)
    assert share[0] < 1e-3 and share[-1] == pytest.approx(1.0, abs=1e-12)
    # Never back and nowhere suddenly, also where the first phase is over before the hands press in full.
    assert (np.diff(share) >= -1e-12).all() and np.diff(share).max() < 2.0 / (BLENDING * RATE)
    for now in at_once:
        np.testing.assert_allclose(now, full, atol=1e-12)
