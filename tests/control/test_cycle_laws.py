# SPDX-License-Identifier: BSD-3-Clause
"""Laws of a control cycle: energy booked in full, dampers on the motors, the filter's optimum, the recorded row."""

import math
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.backends.protocol import FirstState
from impedance_modules.control.controller import Controller
from impedance_modules.control.cycle import all_finite
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.modules.spring import displacement_of, turn_moment
from impedance_modules.modules.sum import potential_energy
from impedance_modules.robot.pose import Pose
from impedance_modules.runs.recorder import Recorder
from tests.control.test_cycle import Motion, pair_assembly, started
from tests.reference import filter_reference


@pytest.fixture(scope="module")
def assembly(tmp_path_factory: pytest.TempPathFactory):
    return pair_assembly(tmp_path_factory.mktemp("tasks"), 6.0)


def states(motion: Motion, count: int):
    """States after the start; a ``Motion`` draws its noise in order."""
    return [motion.state(k) for k in range(1, count)]


def run(controller: Controller, motion: Motion, count: int):
    """Cycle by cycle the state and whatever the test then looks at, after the controller has answered it."""
    for state in states(motion, count):
        assert controller.tick(state) == 0
        yield state


def test_tank_and_springs_lose_what_the_motors_did_and_nothing_else(assembly) -> None:
    """T + r U + work + charged + spilled stays T_0, through set-points that move and springs that are rescaled."""
    controller, motion = started(assembly, 1, 0.03)
    tank, moved = controller.tank, 0.0
    for state in states(motion, 120):
        before = tank.motor_position.copy()
        acting = tank.pending[0].copy()
        work = tank.work
        assert controller.tick(state) == 0
        travel = state.position + state.effort * assembly.tank.compliance - before
        assert tank.work - work == pytest.approx(float(acting @ travel), abs=1e-12)
        balance = tank.level + tank.spring_scale * tank.potential + tank.work + tank.charged + tank.spilled
        assert balance == pytest.approx(tank.initial_energy, abs=1e-9)
        expected = potential_energy(controller.cycle.modules, controller.cycle.arms, state.position)
        assert tank.potential == pytest.approx(expected, rel=1e-12, abs=1e-15)
        moved += controller.cycle.admitted
        assert controller.clock == pytest.approx(moved * assembly.period)


def test_dampers_act_on_the_motors_and_the_tank_relaxes_springs_alone(assembly) -> None:
    """Torque of every module from numpy's recursion of the motors' velocity and the ledger's spring scale."""
    controller, motion = started(assembly, 2, 0.15)
    compliance, period = assembly.tank.compliance, assembly.period
    lag = assembly.robot.sensors.velocity_filter
    share = 1.0 - math.exp(-period / lag) if lag > 0.0 else 1.0
    # The first state of the run has been asked for by ``started``.
    deflection, rate = controller.cycle.motor.deflection.copy(), np.zeros(controller.layout.n)
    for k, state in enumerate(states(motion, 90)):
        assert controller.tick(state) == 0
        rate += share * ((state.effort * compliance - deflection) / period - rate)
        deflection = state.effort * compliance
        springs, bias = controller.cycle.modules.springs, controller.cycle.modules.bias
        if k == 58:
            controller.tank.spring_scale = 0.3
        if k not in (29, 59, 89):
            continue
        assert k != 59 or controller.tank.spring_scale < 0.9
        expected = np.zeros(controller.layout.n)
        r = controller.tank.spring_scale
        for s in range(len(springs.wrench)):
            J = controller.kinematics.jacobian[springs.frame[s]]
            damped = springs.damping[s] @ J @ (state.velocity + rate)
            elastic = springs.wrench[s] - springs.force[s] + damped
            # What is left of the wrench without forces and dampers grows with the scale alone.
            scale = r if r > 0.0 else 1.0
            full = _full_wrench(controller, s)
            np.testing.assert_allclose(elastic / scale, full, rtol=1e-6, atol=1e-7)
            expected += J.T @ springs.wrench[s]
        expected -= r * bias.stiffness * (state.position - bias.rest)
        expected -= bias.damping @ (state.velocity + rate)
        expected += controller.cycle.modules.efforts[-2:].sum(axis=0)
        np.testing.assert_allclose(controller.cycle.modules.desired, expected, rtol=1e-8, atol=1e-8)


def _full_wrench(controller: Controller, s: int) -> np.ndarray:
    """The wrench of one spring, not relaxed, at the last state."""
    spring = [spring for arm in controller.modules.arms for spring in arm.springs][s]
    now = controller.cycle.modules.springs
    target = Pose(now.target_rotation[s], now.target_translation[s])
    offset = displacement_of(controller.kinematics.pose(spring.frame), target)
    gradient = now.stiffness[s] @ offset
    turn_moment(offset, gradient)
    return -gradient


def test_what_leaves_is_the_filters_optimum_within_the_budget(assembly) -> None:
    controller, motion = started(assembly, 3, 0.25)
    cycle, limits, limited = controller.cycle, assembly.limits, 0
    horizon, previous = limits.period + limits.delay, cycle.previous.copy()
    for k, state in enumerate(states(motion, 60)):
        if k >= 40:
            controller.tank.level = assembly.tank.floor + 0.02
        assert controller.tick(state) == 0 and controller.solved
        inverse = controller.kinematics.inverse_inertia
        weights = np.linalg.eigvals(np.linalg.solve(inverse, cycle.problem.metric)).real
        assert weights.min() >= 0.1 - 1e-9 and weights.max() <= 1.1 + 1e-9
        lowest = (
            np.clip(previous, -limits.effort_max, limits.effort_max)
            - limits.effort_rate_max * assembly.period
        )
        np.testing.assert_allclose(cycle.problem.lower[controller.layout.rate], lowest, atol=1e-9)
        available = max(0.0, controller.tank.level - assembly.tank.floor)
        speed = float(np.linalg.norm(cycle.motor.velocity))
        if speed > 0.0:
            assert cycle.problem.upper[0] * speed * horizon == pytest.approx(available, rel=1e-9, abs=1e-12)
        if controller.changed and limited < 12:
            expected = filter_reference.solve(cycle.problem)
            np.testing.assert_allclose(controller.solution.effort, expected, rtol=1e-6, atol=1e-6)
            limited += 1
        scaled = cycle.effort_scale * controller.solution.effort
        np.testing.assert_allclose(controller.effort, scaled, rtol=1e-12, atol=1e-12)
        needed = float(np.abs(controller.effort) @ assembly.tank.speed_bound) * horizon
        assert needed <= available + 1e-9
        previous = controller.effort.copy()
        np.testing.assert_array_equal(cycle.previous, previous)
    assert limited > 2


def test_a_gap_that_was_no_gap_costs_nothing(assembly) -> None:
    """What was booked for cycles without a state is taken back when the state shows that none was missed."""
    controller, motion = started(assembly, 4, 0.02)
    first, second = states(motion, 3)
    controller.tick(first)
    level, pending = controller.tank.level, controller.tank.pending.copy()
    controller.miss()
    controller.miss()
    assert controller.tank.level < level or not pending.any()
    controller.reckon(1, anew=True)
    assert controller.tank.level == level
    np.testing.assert_array_equal(controller.tank.pending, pending)
    assert controller.tick(second) == 0


def test_a_recorded_row_says_what_the_cycle_was(assembly, tmp_path: Path) -> None:
    supervisor = Supervisor(assembly)
    motion = Motion(assembly, 5, 0.05)
    still = np.zeros(assembly.model.n)
    supervisor.start(FirstState(motion.state(0), still))
    recorder = Recorder(tmp_path / "run", supervisor, still, 0, "sim", simulated=True)
    for state in states(motion, 30):
        effort = supervisor.step(state, late=False, stop_request=None)
        assert effort is not None
        supervisor.look()
    command = effort + 0.25
    supervisor.controller.cycle.admitted, supervisor.controller.cycle.effort_scale = 0.25, 0.75
    recorder.add(state, command, late=True, interrupted=False)
    row = dict(zip(recorder.columns, recorder.row, strict=False))
    recorder.abandon()
    controller, cycle = supervisor.controller, supervisor.controller.cycle
    for i, joint in enumerate(assembly.model.joint_names):
        told = [row[f"{kind}.{joint}"] for kind in ("position", "velocity", "effort_command", "effort")]
        assert told == [state.position[i], state.velocity[i], command[i], state.effort[i]]
    assert (row["time"], row["late"], row["interrupt"]) == (state.time, 1.0, 0.0)
    assert (row["tank"], row["spring_scale"]) == (controller.tank.level, controller.tank.spring_scale)
    told = row["granted"], row["paid"], row["phase_clock"]
    assert told == (cycle.admitted, cycle.effort_scale, controller.clock)
    assert row["active_rows"] == controller.active_rows
    for name, efforts in zip(controller.module_names, cycle.modules.efforts, strict=True):
        for i, joint in enumerate(assembly.model.joint_names):
            assert row.get(f"module.{name}.{joint}", 0.0) == efforts[i]
    hand = assembly.modules.arms[0].limb.hand
    pose = controller.kinematics.pose(hand)
    assert [row[f"pose.{hand}.{axis}"] for axis in "xyz"] == pose.translation.tolist()
    wrench = [row[f"wrench.{hand}.{part}"] for part in ("fx", "fy", "fz", "tx", "ty", "tz")]
    assert wrench == supervisor.hand_wrenches.wrench[0].tolist()


def test_forces_and_grip_come_in_by_minimum_jerk(assembly) -> None:
    controller, motion = started(assembly, 6, 0.0)
    springs, loads = controller.cycle.modules.springs, controller.cycle.modules.loads
    found = [(springs.force[0, 2], loads.grip) for _ in run(controller, motion, 260)]
    x = np.minimum(np.arange(1, 260) * assembly.period * 1.0, 0.5) / 0.5
    expected = 10 * x**3 - 15 * x**4 + 6 * x**5
    assert controller.clock == pytest.approx(259 * assembly.period)
    np.testing.assert_allclose(found, np.outer(expected, [-6.0, 1.0]), atol=1e-9)


def test_one_entry_that_is_not_finite_is_enough(ways) -> None:
    for bad in (np.nan, np.inf, -np.inf):
        assert not any(all_finite(np.where(np.arange(3) == place, bad, 1.0)) for place in range(3))
    assert all_finite(np.ones(3))


def test_a_grip_that_was_there_stays(assembly) -> None:
    controller, motion = started(assembly, 7, 0.0, acting=0.3)
    assert all(controller.cycle.modules.loads.grip == 1.0 for _ in run(controller, motion, 40))


def test_an_empty_tank_admits_no_motion_that_costs(assembly) -> None:
    """What is admitted is paid: the level never falls below its floor by it, and U is that of what is in force."""
    controller, motion = started(assembly, 8, 0.1)
    cycle, tank, parts = controller.cycle, controller.tank, []
    for state in run(controller, motion, 100):
        parts.append(cycle.admitted)
        expected = potential_energy(cycle.modules, cycle.arms, state.position)
        assert tank.potential == pytest.approx(expected, rel=1e-12, abs=1e-15)
        tank.level, tank.spring_scale, tank.need = tank.floor, 1.0, 0.0
    assert min(parts) < 1.0
