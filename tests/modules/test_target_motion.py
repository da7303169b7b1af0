# SPDX-License-Identifier: BSD-3-Clause
"""Dampers that count from the moving equilibrium: right speeds, no braking on the way, the same claim."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Ending, Supervisor
from impedance_modules.modules.sum import sum_modules
from impedance_modules.modules.target_motion import difference_twist
from impedance_modules.robot.rotation import exp3
from impedance_modules.robot.state import RobotState
from impedance_modules.runs.task_plant import sim_backend
from tests.support.adversity import Books, Pushes
from tests.support.led_arms import started

SEEDS = st.integers(0, 2**32 - 1)

TASK = """
format: 1
name: on-the-way
robot: baxter
arms:
  right:
    posture: {s0: 0.5462, s1: -0.6994, e0: 0.3534, e1: 1.7099, w0: -0.4574, w1: 0.6431, w2: 0.3692}
    joint_bias:
      {stiffness: {s0: 2, s1: 2, e0: 2, e1: 2, w0: 1, w1: 1, w2: 1}, damping_ratio: 0.7, damping_against: AGAINST}
    springs:
      - name: hand
        frame: right_hand
        expressed_in: right_hand
        stiffness: {x: 300, y: 200, z: 300, rx: 5, ry: 5, rz: 5}
        damping_ratio: 0.7
        damping_against: AGAINST
  left: {mirror: right}
safety: {tank: {initial: TANK, max: 8, floor: 0.1}}
phases:
  - name: away
    equilibrium: {right.hand: {x: 0.08, z: 0.05, ry: 0.2}, left.hand: {x: 0.08, y: 0.05}}
    posture: {right: {e0: 0.5, w0: -0.6}}
    duration: 1.0
  - {name: back, equilibrium: {right.hand: {x: 0, z: 0, ry: 0}, left.hand: {x: 0, y: 0}}, duration: 0.6}
"""


def assembly(folder, against="equilibrium", tank=4.0) -> Assembly:
    path = folder / f"{against}.yaml"
    path.write_text(TASK.replace("AGAINST", against).replace("TANK", str(tank)), encoding="utf-8")
    return assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)


@given(seed=SEEDS)
@settings(max_examples=50)
def test_a_small_displacement_is_the_twist_times_the_time(seed):
    random, out = np.random.default_rng(seed), np.empty(6)
    rotation, place, twist = exp3(random.normal(size=3)), random.normal(size=3), random.normal(size=6)
    h = 1e-4
    difference_twist(exp3(h * twist[3:]) @ rotation, place + h * twist[:3], rotation, place, out)
    np.testing.assert_allclose(out / h, twist, atol=1e-6)


def test_on_the_way_the_modules_know_how_fast_their_equilibria_move(tmp_path):
    """Against the phase's own derivative, through a whole phase; a robot that stands is asked to move with them."""
    task = assembly(tmp_path)
    controller = started(task)
    n, modules = task.model.n, controller.cycle.modules
    names = [spring.name for arm in task.modules.arms for spring in arm.springs]
    for k in range(1, 900):
        controller.tick(RobotState(k * task.period, task.modules.posture, np.zeros(n), np.zeros(n)))
        if k % 50 == 0 and controller.cycle.admitted == 1.0:
            middle = controller.clock - 0.5 * task.period
            twists, rates = controller.motion.velocities(middle), controller.motion.rest_rates(middle)
            for s, name in enumerate(names):
                np.testing.assert_allclose(modules.springs.target_twist[s], twists[name], atol=1e-6)
            rest = np.concatenate([rates[arm.limb.name] for arm in task.modules.arms])
            joints = np.concatenate([arm.limb.joints for arm in task.modules.arms])
            np.testing.assert_allclose(modules.bias.rest_velocity[joints], rest, atol=1e-6)


def test_what_moves_with_its_equilibrium_is_not_braked(tmp_path):
    """J v = V_d and v = v_0: no damper does anything, whatever the gains."""
    controller = started(assembly(tmp_path))
    cycle, random = controller.cycle, np.random.default_rng(0)
    modules, arms, q = cycle.modules, cycle.arms, controller.assembly.modules.posture
    v = random.normal(size=q.size)
    for s, f in enumerate(modules.springs.frame):
        modules.springs.target_twist[s] = arms.jacobian[f] @ v
    modules.bias.rest_velocity[:] = v
    sum_modules(modules, arms, q, v, 1.0)
    moving = modules.desired.copy()
    modules.springs.target_twist[:], modules.bias.rest_velocity[:] = 0.0, 0.0
    sum_modules(modules, arms, q, np.zeros(q.size), 1.0)
    np.testing.assert_allclose(moving, modules.desired, atol=1e-9)


def run(task: Assembly, seed: int = 0, push: float = 0.0) -> tuple[Books, float]:
    """Runs it; the books, and how far the hands were from their equilibria [m RMS]."""
    backend, supervisor, apart = sim_backend(task, seed), Supervisor(task), []
    if push:
        backend.plant.torques.append(Pushes(np.random.default_rng(seed), task.model.n, push, 1.0))
    books = Books(supervisor, backend.plant)

    def watch(state, effort, late, asked):
        books.watch(state, effort, late, asked)
        cycle = supervisor.controller.cycle
        apart.append(cycle.arms.translation[:2] - cycle.modules.springs.target_translation[:2])

    first = backend.start()
    supervisor.start(first)
    run_loop(
        supervisor, backend, first.state, watch, Interrupt(), duration=None, paced=False, read_only=False
    )
    return books, float(np.sqrt(np.mean(np.sum(np.square(apart), axis=2))))


def test_hands_trail_less_than_half_as_far_and_the_tank_pays(tmp_path):
    books, close = run(assembly(tmp_path))
    behind, far = run(assembly(tmp_path, "world"))
    assert books.supervisor.ending is behind.supervisor.ending is Ending.DONE
    assert close < 0.5 * far
    assert books.least_margin > -1e-6 and books.largest_error < 1e-6
    assert books.plant.motor_work > behind.plant.motor_work


@pytest.mark.parametrize("seed", range(3))
def test_the_claim_holds_with_little_in_the_tank_and_while_pushed(tmp_path, seed):
    books, _ = run(assembly(tmp_path, tank=0.4), seed, push=6.0)
    assert books.least_margin > -1e-6


def test_against_the_world_is_what_is_left_out(tmp_path):
    """The key's default: the same torques to the last bit."""
    stated = assembly(tmp_path, "world")
    text = TASK.replace("TANK", "4.0").replace(", damping_against: AGAINST", "")
    path = tmp_path / "left-out.yaml"
    path.write_text(text.replace("        damping_against: AGAINST\n", ""), encoding="utf-8")
    omitted = assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)
    found = [run(task)[0].plant.motor_work for task in (stated, omitted)]
    assert found[0] == found[1]


@pytest.mark.parametrize("blend", [None, 0.2, 1.0])
def test_gains_come_in_over_the_time_that_a_phase_states(tmp_path, blend):
    """By minimum jerk: half of the change at half of the time, all of it at its end; half a second unless stated."""
    stated = "" if blend is None else f", blend: {blend}"
    text = TASK.replace("TANK", "4.0").replace("AGAINST", "world")
    head = text[: text.index("phases:")]
    phases = (
        "phases:\n  - {name: stiff, duration: 0.1}\n  - {name: soft, stiffness: {right.hand:"
        f" {{x: 100, y: 100, z: 100, rx: 5, ry: 5, rz: 5}}}}, duration: 2{stated}}}\n"
    )
    (tmp_path / "blend.yaml").write_text(head + phases, encoding="utf-8")
    task = assemble(str(tmp_path / "blend.yaml"), effects=None, rate=None, scale=1.0, arm=None)
    controller, n = started(task), task.model.n
    before = controller.cycle.modules.springs.stiffness[0].copy()
    controller.next_phase(task.task.phases[1])
    time, seen = 0.5 if blend is None else blend, []
    for k in range(1, round(time / task.period) + 2):
        controller.tick(RobotState(k * task.period, task.modules.posture, np.zeros(n), np.zeros(n)))
        seen.append(controller.cycle.modules.springs.stiffness[0].copy())
    goal = task.modules.arms[0].springs[0].in_world(np.diag([100.0, 100, 100, 5, 5, 5]))
    middle = seen[round(0.5 * time / task.period) - 1]
    np.testing.assert_allclose(middle, 0.5 * (before + goal), atol=1e-9)
    np.testing.assert_allclose(seen[-1], goal, atol=1e-9)
