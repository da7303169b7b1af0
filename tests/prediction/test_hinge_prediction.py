# SPDX-License-Identifier: BSD-3-Clause
"""A hinge foretold: the sum about its axis against constrained dynamics, angles and rests against the plant."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.plant.hinge_forces import axis_torque
from impedance_modules.prediction.analysis import analyse_task
from impedance_modules.prediction.analysis_json import analysis_json
from impedance_modules.prediction.forecast import forecast_task
from impedance_modules.prediction.hinge_resistance import HingeResistance
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.statics import Loads, find_rest
from impedance_modules.runs.task_plant import sim_backend
from impedance_modules.spec.hinge_spec import HingeSpec
from tests.support.forecast_tasks import assembled, predicted, write_task
from tests.support.paths import CHECKOUT, TESTS

THESIS = CHECKOUT / "tasks" / "thesis"
LEVER, WHEEL = (THESIS / f"turn-{name}.yaml" for name in ("lever", "wheel"))
EVERY_KEY = TESTS / "data" / "every-hinge-key.yaml"
TURN = "{hinge: {angle: 0.6}}"
FRICTION = "friction: 1.0"
both = pytest.mark.parametrize("task", [LEVER, WHEEL], ids=lambda path: path.stem)


def at_start(task: Path):
    """The mechanism at the start posture, and what pulls there."""
    assembly = assembled(task)
    mechanism, modules = Mechanism(assembly), assembly.modules
    mechanism.update(modules.posture, np.zeros_like(modules.posture))
    damping = phase_damping(modules, mechanism.kinematics)
    return assembly, mechanism, Setting(modules, start_equilibrium(modules), damping)


def constrained_inertia(mechanism: Mechanism) -> float:
    """A unit torque about the axis on M qdd + A^T lambda = J^T, A qdd = 0: nobody adds modules there."""
    rows, gap = mechanism.grasp_rows()
    _, along = mechanism.hinge_motion()
    k, r = mechanism.k, len(rows)
    np.testing.assert_allclose(gap, 0.0, atol=1e-9)
    matrix = np.block([[mechanism.inertia(), rows.T], [rows, np.zeros((r, r))]])
    acceleration = np.linalg.solve(matrix, np.concatenate([along, np.zeros(r)]))[:k]
    return 1.0 / float(along @ acceleration)


@both
def test_the_inertia_about_the_axis_is_that_of_the_constrained_mechanism(task: Path) -> None:
    assembly, mechanism, _ = at_start(task)
    found = analyse_task(assembly, None).hinge
    assert found.inertia.sum == pytest.approx(constrained_inertia(mechanism), rel=1e-9)


def test_arms_without_an_inertia_of_their_own_have_one_about_the_axis(tmp_path: Path) -> None:
    """Planar arms have no 6x6 inertia; turned, the block in both of them has."""
    hinge = "grasp: weld, hinge: {point: [1.55, 1.1, 0.3], axis: [0, 0, 2]}}"
    planar = write_task(tmp_path, (THESIS / "planar-arms.yaml").read_text(), ("grasp: weld}", hinge))
    assembly, mechanism, _ = at_start(planar)
    analysis = analyse_task(assembly, None)
    assert analysis.object.inertia is None and set(analysis.hinge.inertia.arms.values()) == {None}
    assert analysis.hinge.inertia.sum == pytest.approx(constrained_inertia(mechanism), rel=1e-9)


@both
def test_the_stiffness_about_the_axis_is_how_far_a_torque_turns_it_at_rest(task: Path) -> None:
    """Static equilibria of the whole mechanism under a small torque, friction left out."""
    assembly, mechanism, setting = at_start(task)
    found = analyse_task(assembly, None).hinge
    axis, angles = assembly.modules.held.hinge.axis, []
    for torque in (0.05, -0.05):
        push = np.concatenate([np.zeros(3), torque * axis])
        rest = find_rest(
            mechanism, setting, assembly.modules.posture, Loads({"object": push}, surfaces=False)
        )
        mechanism.update(rest.q, np.zeros_like(rest.q))
        angles.append(mechanism.hinge_motion()[0])
        np.testing.assert_allclose(mechanism.grasp_rows()[1], 0.0, atol=1e-9)
    assert 0.1 / (angles[0] - angles[1]) == pytest.approx(found.stiffness.sum, rel=1e-3)


@both
def test_the_parts_about_the_axis_add_up_to_the_sum(task: Path) -> None:
    analysis = analyse_task(assembled(task), None)
    for part in (analysis.hinge.inertia, analysis.hinge.damping, analysis.hinge.stiffness):
        assert part.sum == pytest.approx(sum(part.arms.values()) + sum(part.more.values()), rel=1e-12)
        assert len(part.arms) == len(analysis.arms)
    S = assembled(task).modules.held.hinge.motion(analysis.object.position)
    assert analysis.hinge.inertia.sum == pytest.approx(float(S @ analysis.object.inertia @ S), rel=1e-9)
    assert analysis.hinge.stiffness.sum == pytest.approx(float(S @ analysis.object.stiffness @ S), rel=1e-6)
    told = analysis_json(analysis)["object"]["hinge"]
    assert told["stiffness"]["sum"] == analysis.hinge.stiffness.sum and told["own"]["friction"] == 1.0


def test_loads_that_turn_count_at_rest_too() -> None:
    """At a phase's end the springs pull: K about the axis is still minus the derivative of the torque."""
    assembly, prediction = predicted(LEVER)
    phase, rest = prediction.motion.phases[1], prediction.rests[1]
    found = analyse_task(assembly, "turn").hinge
    mechanism, angles = Mechanism(assembly), []
    loose = Setting(phase.modules, phase.equilibrium, phase.damping)
    axis = assembly.modules.held.hinge.axis
    for torque in (found.torque - 0.02, found.torque + 0.02):
        push = np.concatenate([np.zeros(3), -torque * axis])
        other = find_rest(mechanism, loose, rest.q, Loads({"object": push}, surfaces=False))
        mechanism.update(other.q, np.zeros_like(other.q))
        angles.append(mechanism.hinge_motion()[0])
    assert 0.04 / (angles[0] - angles[1]) == pytest.approx(found.stiffness.sum, rel=2e-3)
    assert 0.5 * (angles[0] + angles[1]) == pytest.approx(found.angle, abs=1e-5)
    assert found.torque == pytest.approx(1.0, abs=1e-6)


def watched_angles(task: Path, seconds: float) -> np.ndarray:
    """(N, 2) time [s] and true angle [rad] on the plant, noise and all."""
    assembly, rows = assembled(task), []
    supervisor, backend = Supervisor(assembly), sim_backend(assembly, 0)
    first = backend.start()
    supervisor.start(first)
    run_loop(
        supervisor,
        backend,
        first.state,
        lambda *_: rows.append((backend.plant.time, backend.plant.hinge_angle)),
        Interrupt(),
        duration=seconds,
        paced=False,
        read_only=False,
    )
    return np.array(rows)


@pytest.mark.parametrize("task", [LEVER, WHEEL, EVERY_KEY], ids=lambda path: path.stem)
def test_the_predicted_angle_is_the_plants(task: Path) -> None:
    """Sticking, slipping, against a stop and on a return spring: within a few milliradians at all times."""
    assembly, prediction = predicted(task)
    mechanism, foretold = Mechanism(assembly), []
    for sample in prediction.motion.samples:
        mechanism.update(sample.q, sample.velocity)
        foretold.append((sample.time, mechanism.hinge_motion()[0]))
    seconds = 1.1 if task == EVERY_KEY else 3.0  # then contact is judged, from noisy efforts
    time, angle = watched_angles(task, seconds).T
    expected = np.interp(time, *np.array(foretold).T)
    before = time < min(seconds, foretold[-1][0])
    assert np.ptp(angle) > 0.04
    assert np.max(np.abs(angle - expected)[before]) < 0.004


def forecast_of(task: Path):
    assembly, prediction = predicted(task)
    return forecast_task(assembly, prediction)


def test_check_foretells_angle_torque_and_energy(tmp_path: Path) -> None:
    forecast = forecast_of(LEVER)
    turn, back = forecast.phases[1].hinge, forecast.phases[3].hinge
    assert turn.turns and 0.3 < turn.ended < turn.target and turn.torque == pytest.approx(-1.0, abs=0.01)
    assert back.began > 0.4 and back.torque == pytest.approx(1.0, abs=0.01)
    assert turn.off_arc == pytest.approx((0.0, 0.0), abs=1e-9) and not forecast.notes
    # Friction takes its torque times the way: to and fro, twice nearly the whole angle.
    turned = abs(turn.ended) + abs(back.ended - turn.ended)
    assert forecast.tank.costs["friction of the hinge"] == pytest.approx(turned, rel=0.35)


def test_check_says_that_a_stuck_valve_does_not_turn(tmp_path: Path) -> None:
    stuck = write_task(
        tmp_path, LEVER.read_text(), (FRICTION, "friction: 50"), (TURN, "{hinge: {angle: 0.2}}")
    )
    forecast = forecast_of(stuck)
    turn, wait = forecast.phases[1].hinge, forecast.phases[2].hinge
    assert not turn.turns and abs(turn.ended) < 2e-3
    stiffness = analyse_task(assembled(stuck), None).hinge.stiffness.sum
    assert abs(turn.torque) > abs(wait.torque) * 0.9 and wait.torque == pytest.approx(
        -0.2 * stiffness, rel=0.2
    )
    assert any(
        "the hinge does not turn" in note and "friction holds up to 50.00 N.m" in note
        for note in forecast.notes
    )


def test_check_says_that_a_stop_holds(tmp_path: Path) -> None:
    changes = ("upper: 1.2", "upper: 0.2"), ("initial: 3.2", "initial: 5")
    forecast = forecast_of(write_task(tmp_path, LEVER.read_text(), *changes))
    turn = forecast.phases[1].hinge
    assert turn.stop == "upper" and turn.ended == pytest.approx(0.2, abs=3e-3)
    assert any("comes to its upper stop" in note for note in forecast.notes)


def test_check_says_how_far_a_straight_target_leaves_the_arc(tmp_path: Path) -> None:
    """A chord instead of an arc: 0.25 m times (1 - cos) away at its end."""
    straight = write_task(tmp_path, LEVER.read_text(), (TURN, "{object: {x: 0.5}}"))
    forecast = forecast_of(straight)
    turn = forecast.phases[1].hinge
    assert turn.driven and turn.off_arc[0] == pytest.approx(0.15, abs=1e-6)
    assert any("off the hinge's arc" in note and "bearing" in note for note in forecast.notes)


def test_neither_the_point_along_the_axis_nor_its_length_changes_a_forecast(tmp_path: Path) -> None:
    other = write_task(
        tmp_path,
        LEVER.read_text(),
        ("point: [0.65, 0.15, 0.05]", "point: [0.65, 0.15, 0.35]"),
        ("axis: [0, 0, -1]", "axis: [0, 0, -7]"),
    )
    one, two = (forecast_of(task).phases[1].hinge for task in (LEVER, other))
    assert (one.ended, one.torque) == pytest.approx((two.ended, two.torque), abs=1e-6)


torques = st.floats(0.0, 3.0)


@given(
    free=st.floats(-2.0, 2.0),
    lightness=st.floats(1e-4, 10.0),
    step=st.floats(1e-4, 0.05),
    friction=torques,
    damping=torques,
    stiffness=torques,
    angle=st.floats(-0.5, 0.5),
    bent=st.floats(-1e-3, 1e-3),
)
@settings(max_examples=80, deadline=None)
def test_the_implicit_torque_solves_its_equation(
    free, lightness, step, friction, damping, stiffness, angle, bent
) -> None:
    """w = w_0 + m tau(phi + s w, w), whatever sticks, slips or stops."""
    held = assembled_held()
    spec = HingeSpec((0, 0, 0), (0, 0, 1), friction, damping, stiffness, 0.1, 0.0, -0.3, 0.3)
    hinge = HingeResistance(replace_hinge(held, spec))
    hinge.state.angle, hinge.state.friction_rest = angle, angle - bent
    torque = hinge.solve(free, lightness, step)
    rate = free + lightness * torque
    law = float(axis_torque(hinge.state, angle + step * rate, rate))
    assert lightness * abs(law - torque) < 1e-8 * (1.0 + abs(rate) + lightness * abs(torque))


KEPT: dict[str, object] = {}


def assembled_held():
    if "held" not in KEPT:
        KEPT["held"] = assembled(LEVER).modules.held
    return KEPT["held"]


def replace_hinge(held, spec: HingeSpec):
    return replace(held, spec=replace(held.spec, hinge=spec))
