# SPDX-License-Identifier: BSD-3-Clause
"""Submovements add: closed form, velocity, arrival, any order; a run pays for them, verifies, and is predicted."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Ending, Supervisor
from impedance_modules.modules.equilibrium import phase_motion, start_equilibrium
from impedance_modules.modules.pose_motion import PoseMotion, pose_motion
from impedance_modules.modules.spring import displacement_of
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.prediction.quasi_static import (
    FINEST_STEP,
    SHORTEST_STEP,
    plan_steps,
    predict_motion,
)
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3, exponential_jacobian, log3, log_jacobian
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.task_plant import sim_backend
from impedance_modules.spec.submovement_spec import Submovement, build_submovements
from impedance_modules.spec.task import AXES, PhaseSpec
from tests.support.adversity import Books, Pushes
from tests.support.arm_samples import Array, random_pose
from tests.support.both_ways import ways  # noqa: F401 - a fixture
from tests.support.commands import invoke, refusal
from tests.support.led_arms import started

SEEDS = st.integers(0, 2**32 - 1)
PHASE = 4.0

TASK = """
format: 1
name: two-steps
robot: baxter
arms:
  right:
    posture: {s0: 0.5462, s1: -0.6994, e0: 0.3534, e1: 1.7099, w0: -0.4574, w1: 0.6431, w2: 0.3692}
    joint_bias: {stiffness: {s0: 2, s1: 2, e0: 2, e1: 2, w0: 1, w1: 1, w2: 1}, damping_ratio: 0.7}
    springs:
      - name: hand
        frame: right_hand
        expressed_in: EXPRESSED
        stiffness: {x: 300, y: 200, z: 300, rx: 5, ry: 5, rz: 5}
        damping_ratio: 0.7
        damping_against: AGAINST
safety: {tank: {initial: TANK, max: 8, floor: 0.1}}
phases:
  - name: reach
    equilibrium:
      right.hand:
        submovements:
          - {start: 0, duration: 0.8, by: {x: 0.05, rz: 0.1}}
          - {start: 0.4, duration: 0.8, by: {y: DISTANCE, ry: 0.1}}
    duration: 2.0
  - name: return
    equilibrium: {right.hand: {submovements: [{start: 0.1, duration: 0.8, by: {x: -0.05}}]}}
    duration: 1.2
"""


def task_file(folder: Path, **words: object) -> Path:
    path, text = folder / "two-steps.yaml", TASK
    stated = {"EXPRESSED": "right_hand", "AGAINST": "equilibrium", "TANK": 4.0, "DISTANCE": 0.06, **words}
    for word, value in stated.items():
        text = text.replace(word, str(value))
    path.write_text(text, encoding="utf-8")
    return path


def assembly(folder: Path, **words: object) -> Assembly:
    return assemble(str(task_file(folder, **words)), effects=None, rate=None, scale=1.0, arm=None)


def random_submovements(random: np.random.Generator, *, turning: bool) -> tuple[Submovement, ...]:
    """A few, overlapping or not, within the phase."""

    def one() -> dict[str, object]:
        start, axes = 2.0 * random.random(), AXES if turning else AXES[:3]
        chosen = random.choice(axes, int(random.integers(1, len(axes) + 1)), replace=False)
        by = {str(axis): float(random.normal(scale=0.5)) for axis in chosen}
        return {"start": float(start), "duration": float(random.uniform(0.1, PHASE - start)), "by": by}

    return build_submovements([one() for _ in range(random.integers(1, 5))])


def random_motion(random: np.random.Generator, *, turning: bool) -> tuple[PoseMotion, Pose, Pose]:
    reference, current = random_pose(random), random_pose(random)
    movements = random_submovements(random, turning=turning)
    return pose_motion(reference, current, {}, PHASE, movements), reference, current


def closed_form(movements: tuple[Submovement, ...], clock: float) -> Array:
    """The sum by polynomials of numpy, term by term."""
    total = np.zeros(6)
    for movement in movements:
        x = np.clip((clock - movement.start) / movement.duration, 0.0, 1.0)
        total += np.polyval([6.0, -15.0, 10.0, 0.0, 0.0, 0.0], x) * np.array(movement.by)
    return total


@pytest.mark.usefixtures("ways")
@pytest.mark.parametrize("seed", range(12))
def test_the_pose_is_the_sum_of_all_minimum_jerks(seed: int) -> None:
    """In the axes of ``expressed_in``, turns before what the target was turned by at the start."""
    random = np.random.default_rng(seed)
    motion, reference, current = random_motion(random, turning=True)
    before = reference.inverse() @ current
    for clock in np.linspace(-0.1, PHASE + 0.5, 24):
        added = closed_form(motion.submovements, clock)
        inside = reference.inverse() @ motion.pose(clock)
        np.testing.assert_allclose(inside.translation, before.translation + added[:3], atol=1e-12)
        np.testing.assert_allclose(inside.rotation, exp3(added[3:]) @ before.rotation, atol=1e-12)


@given(seed=SEEDS)
@settings(max_examples=60, deadline=None)
def test_velocity_is_the_derivative_of_the_pose(seed: int) -> None:
    random = np.random.default_rng(seed)
    motion, *_ = random_motion(random, turning=True)
    for clock in random.uniform(0.0, PHASE, 8):
        slope = displacement_of(motion.pose(clock + 1e-6), motion.pose(clock - 1e-6)) / 2e-6
        np.testing.assert_allclose(motion.velocity(clock), slope, atol=2e-6)


@given(seed=SEEDS)
@settings(max_examples=40, deadline=None)
def test_beside_coordinates_and_sines_both_go_on(seed: int) -> None:
    """What coordinates do alone, plus the sum; and the derivative of both."""
    random = np.random.default_rng(seed)
    reference, current = random_pose(random), random_pose(random)
    movements = random_submovements(random, turning=False)
    coordinates = {"rz": 0.3} if seed % 2 else {"y": 0.2, "rx": -0.2}
    alone = pose_motion(reference, current, coordinates, PHASE)
    both = pose_motion(reference, current, coordinates, PHASE, movements)
    for clock in random.uniform(0.0, PHASE, 6):
        added = reference.rotation @ closed_form(movements, clock)[:3]
        np.testing.assert_allclose(
            both.pose(clock).translation, alone.pose(clock).translation + added, atol=1e-12
        )
        np.testing.assert_array_equal(both.pose(clock).rotation, alone.pose(clock).rotation)
        slope = displacement_of(both.pose(clock + 1e-6), both.pose(clock - 1e-6)) / 2e-6
        np.testing.assert_allclose(both.velocity(clock), slope, atol=2e-6)


def test_it_arrives_at_the_sum_and_stays() -> None:
    random = np.random.default_rng(3)
    motion, reference, current = random_motion(random, turning=False)
    arrived = (reference.inverse() @ motion.pose(PHASE)).translation
    gone = np.sum([movement.by for movement in motion.submovements], axis=0)[:3]
    np.testing.assert_allclose(
        arrived, (reference.inverse() @ current).translation + gone, rtol=0.0, atol=1e-14
    )
    np.testing.assert_array_equal(motion.velocity(PHASE), 0.0)


def test_the_order_in_the_file_means_nothing() -> None:
    raw = [
        {"start": 0.0, "duration": 1.0, "by": {"x": 0.1, "rz": 0.3}},
        {"start": 0.6, "duration": 0.7, "by": {"y": 0.07, "rx": 0.2}},
        {"start": 0.6, "duration": 0.9, "by": {"z": -0.03}},
    ]
    current = random_pose(np.random.default_rng(0))
    motions = [
        pose_motion(current, current, {}, PHASE, build_submovements(order)) for order in permutations(raw)
    ]
    for clock in (0.3, 0.9, 1.2):
        poses = [motion.pose(clock) for motion in motions]
        assert all(np.array_equal(pose.rotation, poses[0].rotation) for pose in poses)
        assert all(np.array_equal(pose.translation, poses[0].translation) for pose in poses)


def test_a_submovement_that_adds_in_the_middle_leaves_no_trace_of_the_first_one_alone() -> None:
    """Double step: until the second begins the way is that of the first alone; then the difference is the second."""
    first, second = Submovement(0.0, 1.0, (0.1, 0, 0, 0, 0, 0)), Submovement(0.6, 1.0, (0, 0.1, 0, 0, 0, 0))
    at = Pose.identity()
    alone, both = (pose_motion(at, at, {}, 2.0, which) for which in ((first,), (first, second)))
    for clock in np.linspace(0.0, 0.6, 7):
        np.testing.assert_array_equal(both.pose(clock).translation, alone.pose(clock).translation)
    for clock in np.linspace(0.61, 2.0, 7):
        difference = both.pose(clock).translation - alone.pose(clock).translation
        assert difference[1] > 0.0 and difference[0] == difference[2] == 0.0
    assert alone.velocity(0.8)[0] > 0.0 and both.velocity(0.8)[1] > 0.0, "both are under way at once"


@given(seed=SEEDS)
@settings(max_examples=60, deadline=None)
def test_the_exponentials_jacobian_is_its_derivative_at_any_angle(seed: int) -> None:
    random = np.random.default_rng(seed)
    vector = random.normal(size=3) * random.choice([1e-6, 0.5, 2.0])
    change = random.normal(size=3)
    turned = log3(exp3(vector + 1e-6 * change) @ exp3(vector - 1e-6 * change).T) / 2e-6
    np.testing.assert_allclose(exponential_jacobian(vector) @ change, turned, atol=1e-6)
    if np.linalg.norm(vector) < np.pi:
        np.testing.assert_allclose(exponential_jacobian(vector) @ log_jacobian(vector), np.eye(3), atol=1e-9)


def run(task: Assembly, push: float = 0.0) -> Books:
    """Runs it on the plant and keeps the books at the motors."""
    backend, supervisor = sim_backend(task, 0), Supervisor(task)
    if push:
        backend.plant.torques.append(Pushes(np.random.default_rng(0), task.model.n, push, 1.0))
    books = Books(supervisor, backend.plant)
    first = backend.start()
    supervisor.start(first)
    run_loop(
        supervisor,
        backend,
        first.state,
        books.watch,
        Interrupt(),
        duration=None,
        paced=False,
        read_only=False,
    )
    return books


def test_dampers_against_the_equilibrium_know_its_speed(tmp_path: Path) -> None:
    task = assembly(tmp_path)
    controller, n = started(task), task.model.n
    for k in range(1, 1500):
        controller.tick(RobotState(k * task.period, task.modules.posture, np.zeros(n), np.zeros(n)))
        if k % 75 == 0 and controller.cycle.admitted == 1.0:
            twist = controller.motion.velocities(controller.clock - 0.5 * task.period)["right.hand"]
            assert np.linalg.norm(twist) > 0.0 or controller.clock > 1.2
            np.testing.assert_allclose(controller.cycle.modules.springs.target_twist[0], twist, atol=1e-6)


def test_the_tank_pays_and_the_claim_holds(tmp_path: Path) -> None:
    """With enough nothing is slowed; with little the clock of the phase is, and pushed the claim holds as well."""
    rich = run(assembly(tmp_path))
    assert rich.supervisor.ending is Ending.DONE
    assert rich.least_margin > -1e-6 and rich.largest_error < 1e-6
    poor = run(assembly(tmp_path, TANK=0.33), push=4.0)
    assert poor.least_margin > -1e-6
    assert poor.supervisor.controller.tank.level >= 0.1


def test_the_predicted_need_covers_the_run(tmp_path: Path) -> None:
    task = assembly(tmp_path, AGAINST="world")
    prediction = refuse_infeasible(task)
    backend, supervisor = sim_backend(task, 0), Supervisor(task)
    first, needed = backend.start(), [0.0]
    supervisor.start(first)

    def watch(_state: RobotState, _effort: Array, _late: bool, asked: bool) -> None:
        tank = supervisor.controller.tank
        if not asked:
            needed.append(task.tank.initial - (tank.level - task.tank.floor - tank.need))

    run_loop(
        supervisor, backend, first.state, watch, Interrupt(), duration=None, paced=False, read_only=False
    )
    assert max(needed) == pytest.approx(prediction.tank.need, rel=0.25)
    still = assembly(tmp_path, DISTANCE=0.0)
    assert refuse_infeasible(still).tank.need < prediction.tank.need


def test_a_phase_whose_submovements_go_nowhere_is_predicted_like_one_that_rests(tmp_path: Path) -> None:
    """No finer step, and no whole phase to integrate, where nothing moves."""
    task = assembly(tmp_path)
    start = start_equilibrium(task.modules)

    def plan(by: float, start_at: float = 0.0):
        movement = Submovement(start_at, 0.2, (by, 0, 0, 0, 0, 0))
        spec = PhaseSpec("p", 100.0, {"right.hand": {}}, {}, {}, {}, None, "next")
        resting = plan_steps(spec, phase_motion(task.modules, spec, start), whole=False)
        moved = replace(spec, submovements={"right.hand": (movement,)})
        return resting, plan_steps(moved, phase_motion(task.modules, moved, start), whole=False)

    resting, nowhere = plan(0.0)
    assert nowhere == resting
    _, moving = plan(0.05, 2.0)
    assert FINEST_STEP <= moving.step < SHORTEST_STEP
    assert moving.integrated == pytest.approx(resting.integrated + 2.2)
    assert moving.integrated + moving.repeated == pytest.approx(100.0)


def test_the_prediction_goes_where_the_run_goes(tmp_path: Path) -> None:
    task = assembly(tmp_path)
    predicted = predict_motion(task).phases[0]
    hand = task.model.pose(predicted.q, "right_hand")
    goal = predicted.equilibrium.springs["right.hand"]
    start = task.model.pose(task.modules.posture, "right_hand")
    moved = start.rotation.T @ (goal.translation - start.translation)
    np.testing.assert_allclose(moved, [0.05, 0.06, 0.0], atol=1e-9)
    assert np.linalg.norm(hand.translation - goal.translation) < 0.02


def test_a_run_verifies_bit_by_bit(tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert invoke("run", task_file(tmp_path), "--out", out).return_value == 0
    assert "bit-equal" in invoke("replay", out, "--verify").output


def test_check_refuses_what_is_too_far_and_what_the_rate_cannot_follow(tmp_path: Path) -> None:
    far = refusal("check", task_file(tmp_path, DISTANCE=2.0))
    assert "equilibrium.right.hand" in far and "comes no nearer" in far
    short = task_file(tmp_path)
    short.write_text(
        short.read_text().replace("duration: 0.8, by: {x: -0.05}", "duration: 0.05, by: {x: -0.005}")
    )
    assert "valid" in invoke("check", short).output
    slow = refusal("check", short, "--rate", 100)
    assert "phases[1].equilibrium.right.hand.submovements[0].duration" in slow
    assert "0.05 s is less than 10 periods of the control, 0.1 s" in slow


def test_an_arm_that_is_left_out_takes_its_submovements_along(tmp_path: Path) -> None:
    path = task_file(tmp_path)
    text = path.read_text().replace("safety:", "  left: {mirror: right}\nsafety:")
    path.write_text(text)
    only = assemble(str(path), effects=None, rate=None, scale=1.0, arm="left").task.phases
    assert [phase.submovements for phase in only] == [{}, {}]
    assert "valid" in invoke("check", path, "--arm", "right").output
