# SPDX-License-Identifier: BSD-3-Clause
"""Single laws of the plant on small states, as Python and as machine code: geometry, friction, wood, steps, sensors."""

from __future__ import annotations

import math
import os

import numpy as np
import pinocchio as pin
import pytest

from impedance_modules.compiled import use_machine_code
from impedance_modules.plant.equations_of_motion import evaluate_rate, hand_motion
from impedance_modules.plant.grasp import grasp_forces
from impedance_modules.plant.integrator import begin_step, next_stage, place
from impedance_modules.plant.joints import RIGID, measurable_torques, motor_positions, spring_deflections
from impedance_modules.plant.links import accelerate, link_table, place_links, water_inertia
from impedance_modules.plant.palm import update_slipping_palms
from impedance_modules.plant.plant import Plant
from impedance_modules.plant.point_contact import CLEARANCE, contact_forces, update_friction_springs
from impedance_modules.plant.rigid_object import object_motion, update_object_rotation
from impedance_modules.plant.sensors import Readings, read_encoders, report
from impedance_modules.plant.sheet import Sheet
from impedance_modules.plant.wood import CELL, update_wood
from impedance_modules.robot.pose import carry
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.task import RoughnessSpec, SheetSpec, SplintersSpec, WoodSpec
from tests.reference.bent_sheet import bent_sheet_force
from tests.support.both_ways import ways  # noqa: F401 - a fixture
from tests.support.plant_parts import (
    BAXTER,
    SIX_JOINTS,
    block,
    in_both_hands,
    loose,
    middle,
    plane,
    plant,
    posture,
    spec_of,
    with_every,
)

pytestmark = pytest.mark.usefixtures("ways")
AS_PYTHON = os.environ.get("LAWS_RUN_AS") == "python"
TOP, HALF = np.array([2.0, 0.0, 0.5]), np.array([0.3, 0.2, 0.1])
TURN = exp3(np.array([0.1, -0.2, 0.3]))


def at_rest(spec, surfaces=(), held=None, way: str = "python", **options) -> Plant:
    """A plant put at rest without checking its step, which is slow as plain Python; laws run as asked afterwards."""
    subject = plant(spec, surfaces, held, **options)
    use_machine_code(not AS_PYTHON)
    position = middle(subject.model) if spec.name == "six_joint_pair" else posture(subject.model)
    subject._start.rest(position)
    use_machine_code(way == "machine code")
    return subject


def test_hands_stand_and_move_as_pinocchios(ways) -> None:  # noqa: F811
    subject = at_rest(spec_of(BAXTER), way=ways)
    rng, state, model = np.random.default_rng(1), subject.state, subject.model
    state.start.position[:] += 0.3 * rng.normal(size=model.n)
    place(state, CLEARANCE)
    data, axes = model.pin_model.createData(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    for hand, jacobian, frame in zip(state.hands, state.jacobian, subject.frames, strict=True):
        pose = model.pose(state.start.position, frame)
        np.testing.assert_allclose(hand["rotation"], pose.rotation, atol=1e-12)
        np.testing.assert_allclose(hand["translation"], pose.translation, atol=1e-12)
        index = model.frame_id(frame)
        expected = pin.computeFrameJacobian(model.pin_model, data, state.start.position, index, axes)
        np.testing.assert_allclose(jacobian, expected, atol=1e-12)


def test_water_adds_inertia_and_no_weight(ways) -> None:  # noqa: F811
    """(M + A) q'' = tau - g with A = sum J^T W J, at rest; a moving link's own axes carry W along."""
    subject = at_rest(spec_of(SIX_JOINTS), way=ways)
    links, model, rng = subject._integrator.links, subject.model, np.random.default_rng(2)
    half = rng.normal(size=(model.n, 6, 6))
    table = link_table(links, half @ half.transpose(0, 2, 1))
    q, torque, acceleration = middle(model) + 0.2, rng.normal(size=model.n), np.empty(model.n)
    place_links(table, q)
    accelerate(table, np.zeros(model.n), torque, acceleration)
    data = links.createData()
    inertia = pin.crba(links, data, q) + water_inertia(links, table, q)
    weight = pin.computeGeneralizedGravity(links, data, q)
    np.testing.assert_allclose(inertia @ acceleration, torque - weight, rtol=1e-9, atol=1e-9)


def test_distances_are_those_of_a_turned_box(ways) -> None:  # noqa: F811
    rotation = np.array([0.3, -0.2, 0.5])
    board = block(tuple(TOP), tuple(2.0 * HALF), rotation=tuple(rotation))
    subject = at_rest(spec_of(SIX_JOINTS), [board], loose(shape="sphere", size=(0.002,)), ways)
    ball, rng = subject.state.contacts[-1], np.random.default_rng(4)
    for _ in range(40):
        local = rng.uniform(-1.02, 1.02, 3) * HALF
        subject.state.start.object_position[:] = TOP + exp3(rotation) @ local
        subject._integrator.refresh()
        beyond = np.abs(local) - HALF
        expected = np.linalg.norm(np.maximum(beyond, 0.0)) + min(0.0, beyond.max()) - 0.001
        assert ball["near"] == 1
        assert ball["distance"] == pytest.approx(expected, abs=1e-6)


def pressed(way: str, **numbers: float) -> Plant:
    """A ball of 10 cm, 1 mm deep in a plane."""
    ball = loose(shape="sphere", size=(0.1,), position=(2.0, 0.0, 0.049))
    subject = at_rest(spec_of(SIX_JOINTS), [plane(0.0, **numbers)], ball, way)
    subject._integrator.refresh()
    return subject


def test_a_point_is_pushed_out_within_the_cone_of_friction(ways) -> None:  # noqa: F811
    """Straight down: N = k d - c d'. Sideways: the spring's force up to mu N, and the spring no longer than that."""
    subject = pressed(ways)
    state, contact = subject.state, subject.state.contacts[-1]
    wrench, body = state.contact_wrench[-1], state.hands.size
    for shift, reach in ((1e-5, 0.2), (2e-3, 6.0)):
        state.contact_wrench[:], contact["stretch"] = 0.0, 0.0
        state.displacement[body], state.twist[body] = [shift, 0, 0, 0, 0, 0], [0, 0, -0.02, 0, 0, 0]
        power = contact_forces(state)
        assert wrench[2] == pytest.approx(20000.0 * 1e-3 + 50.0 * 0.02)
        assert wrench[0] == pytest.approx(-min(20000.0 * shift, 0.3 * wrench[2]))
        assert wrench[4] == pytest.approx(-0.049 * wrench[0], rel=0.03)
        assert power == pytest.approx(-0.02 * wrench[2])
        update_friction_springs(state)
        assert contact["stretch"][0] == pytest.approx(min(shift, 0.3 * wrench[2] / 20000.0))
        assert contact["slip"] == pytest.approx(max(0.0, shift - 0.3 * wrench[2] / 20000.0))
        assert abs(wrench[0]) < reach + 0.5
    state.twist[body] = [0, 0, 0.5, 0, 0, 0]
    state.contact_wrench[:] = 0.0
    contact_forces(state)
    assert np.abs(state.contact_wrench).max() == 0.0


def test_grasp_forces_cancel_and_stay_in_their_cone(ways) -> None:  # noqa: F811
    """Forces and moments of hands and object about one point sum to nothing; palms slip at mu N and mu N r."""
    spec = spec_of(SIX_JOINTS)
    held = in_both_hands(spec, grasp="friction", friction=0.5, squeeze=15.0)
    subject = at_rest(spec, [], held, ways)
    state, rng = subject.state, np.random.default_rng(5)
    state.start.object_momentum[:] = 0.01 * rng.normal(size=3)
    begin_step(state)
    state.stage.position[:] += 1e-6 * rng.normal(size=subject.model.n)
    state.stage.object_rotation[:] = 2e-4 * rng.normal(size=3)
    state.stage.object_position[:] += [0.0, 0.0, 2e-4]
    hand_motion(state)
    object_motion(state)
    state.grasp_wrench[:] = 0.0
    power = grasp_forces(state)
    assert power == pytest.approx(np.sum(state.grasp_wrench * state.twist))
    where = [hand["translation"] + state.displacement[h, :3] for h, hand in enumerate(state.hands)]
    where.append(state.stage.object_position)
    total = sum(carry(at).T @ wrench for at, wrench in zip(where, state.grasp_wrench, strict=True))
    np.testing.assert_allclose(total, 0.0, atol=1e-9)
    update_slipping_palms(state)
    for h, hand in enumerate(state.hands):
        normal = state.body.rotation_now @ hand["normal"]
        force, moment = state.grasp_wrench[h, :3], state.grasp_wrench[h, 3:]
        N = -float(force @ normal)
        assert pytest.approx(hand["normal_force"]) == N and N > 1.0
        assert np.linalg.norm(force + N * normal) <= 0.5 * N * (1.0 + 1e-9)
        assert np.linalg.norm(moment) <= 0.5 * N * hand["palm_radius"] * (1.0 + 1e-9)


def test_slipping_palms_rest_where_friction_just_holds(ways) -> None:  # noqa: F811
    """After a slip the couplings, placed anew, are deflected by friction's bound and no more."""
    spec = spec_of(SIX_JOINTS)
    held = in_both_hands(spec, grasp="friction", friction=0.5, squeeze=15.0)
    subject = at_rest(spec, [], held, ways)
    state = subject.state
    begin_step(state)
    state.stage.object_position[2] += 2e-4
    state.stage.object_rotation[:] = [3e-4, 0.0, 4e-4]
    hand_motion(state)
    object_motion(state)
    state.grasp_wrench[:] = 0.0
    grasp_forces(state)
    update_slipping_palms(state)
    update_object_rotation(state)
    state.start.whole[:] = state.stage.whole
    np.testing.assert_allclose(state.body.rotation, exp3(np.array([3e-4, 0.0, 4e-4])), atol=1e-12)
    begin_step(state)
    for hand in state.hands:
        normal, bound = state.body.rotation @ hand["normal"], 0.5 * hand["normal_force"]
        along = hand["deflection"] - (hand["deflection"] @ normal) * normal
        assert np.linalg.norm(along) == pytest.approx(bound / hand["linear_stiffness"], rel=1e-3)
        most = bound * hand["palm_radius"] / hand["angular_stiffness"]
        assert np.linalg.norm(hand["angular_deflection"]) <= most * (1.0 + 1e-3)


def test_the_object_falls_and_turns_by_its_equations(ways) -> None:  # noqa: F811
    subject = at_rest(spec_of(SIX_JOINTS), [], loose(size=(0.3, 0.2, 0.1)), ways)
    state = subject.state
    state.body.rotation[:] = TURN
    spin = np.array([0.5, -1.0, 2.0])
    state.start.object_momentum[:] = TURN @ (state.body.inertia * (TURN.T @ spin))
    begin_step(state)
    evaluate_rate(state)
    np.testing.assert_allclose(state.rate.object_velocity, [0.0, 0.0, -9.81])
    np.testing.assert_allclose(state.rate.object_rotation, spin)
    np.testing.assert_allclose(state.twist[-1, 3:], spin)
    assert not state.rate.object_momentum.any()
    turned = np.array([0.02, 0.01, -0.03])
    state.stage.object_rotation[:] = turned
    update_object_rotation(state)
    np.testing.assert_allclose(state.body.rotation, exp3(turned) @ TURN, atol=1e-12)
    assert not state.stage.object_rotation.any()


def test_a_sheet_pushes_as_a_beam_over_its_supports(ways) -> None:  # noqa: F811
    sheet = Sheet(SheetSpec(((-0.4, 0.0), (-0.1, 0.01), (0.05, 0.0), (0.4, 0.02)), 0.3, 2.0))
    rng = np.random.default_rng(7)
    for _ in range(20):
        x = rng.uniform(-0.4, 0.4)
        local = np.array([x, rng.uniform(-0.16, 0.16), sheet.point(x).height - rng.uniform(-1e-3, 5e-3)])
        force, expected = sheet.force(local, 5000.0), bent_sheet_force(sheet._row, local, 5000.0)
        np.testing.assert_allclose(np.zeros(3) if force is None else force, expected, rtol=1e-8, atol=1e-9)


def test_wood_wears_by_friction_work_and_splinters_bear_what_friction_does_not(ways) -> None:  # noqa: F811
    """The grid's sum is the work, r = exp(-e / w) is in the friction, D' = exp(10 (f / F - 1)) / T; then it breaks."""
    wood = WoodSpec(3, RoughnessSpec(1e-6, 0.02, 0.4, 500.0), SplintersSpec(400.0, (2.0, 2.0), 0.2, 0.3))
    board = block((2.0, 0.0, 0.0), (0.4, 0.4, 0.1), wood=wood)
    ball = loose(shape="sphere", size=(0.1,), position=(2.013, 0.007, 0.0995))
    subject = at_rest(spec_of(SIX_JOINTS), [board], ball, ways)
    subject._integrator.refresh()
    state, contact = subject.state, subject.state.contacts[-1]
    assert contact["friction"] == pytest.approx(0.3 + 0.4)
    contact["touching"], contact["normal_force"], contact["slip"] = 1, 10.0, 1e-3
    update_wood(state, 1e-3)
    work = 0.7 * 10.0 * 1e-3
    assert state.friction_work.sum() * CELL**2 == pytest.approx(work)
    assert state.woods[0]["friction_work"] == pytest.approx(work)
    held = int(contact["splinter"])
    assert held >= 0
    begin_step(state)
    share = (contact["friction"] - 0.3) / 0.4
    corners = np.exp(-np.sort(state.friction_work)[-4:] / 500.0)
    assert corners.min() < share < corners.max()
    contact["slip"], contact["stretch"] = 0.0, [(0.7 * 10.0 + 1.5) / 20000.0, 0.0, 0.0]
    contact["friction"] = 0.7
    update_wood(state, 1e-3)
    assert state.splinters[held]["damage"] == pytest.approx(1e-3 / 0.2 * math.exp(10.0 * (1.5 / 2.0 - 1.0)))
    state.splinters[held]["damage"] = 0.9999
    update_wood(state, 1e-3)
    assert state.splinters[held]["broken"] == 1 and contact["splinter"] == -1
    assert contact["stretch"][0] == pytest.approx(0.7 * 10.0 / 20000.0)
    set_free = 0.5 / 20000.0 * ((0.7 * 10.0 + 1.5) ** 2 - (0.7 * 10.0) ** 2)
    assert state.woods[0]["splinter_work"] == pytest.approx(set_free)
    update_wood(state, 1e-3)
    assert contact["splinter"] != held


def test_four_stages_are_the_runge_kutta_method(ways) -> None:  # noqa: F811
    """x' = -a x: the step multiplies x by 1 + z + z^2/2 + z^3/6 + z^4/24, for all joints and the object."""
    subject = at_rest(with_every(spec_of(BAXTER), motor_damping=0.0), way=ways)
    state, step = subject.state, 0.3
    rates = -np.linspace(0.1, 2.0, state.start.whole.size)
    state.start.whole[:] = np.random.default_rng(4).normal(size=rates.size)
    state.stage.whole[:] = state.start.whole
    for stage in range(1, 5):
        state.rate.whole[:] = rates * state.stage.whole
        state.acceleration[:] = state.rate.velocity
        next_stage(state, stage, step)
    z = step * rates
    gain = 1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0
    np.testing.assert_allclose(state.stage.whole, gain * state.start.whole, rtol=1e-12)


def test_sensors_see_the_deflection_through_the_play_and_ideal_motors_lead(ways) -> None:  # noqa: F811
    subject = at_rest(spec_of(SIX_JOINTS), way=ways)
    state, out = subject.state, np.empty(subject.model.n)
    state.joints["half_gap"] = 0.01
    state.start.motor_position[:] = state.start.position + 0.03
    state.joints["load"], state.joints["motor"] = 7.0, 3.0
    elastic = state.joints["kind"] == 0
    spring_deflections(state, out)
    np.testing.assert_allclose(out, np.where(elastic, 0.02, 0.0))
    measurable_torques(state, out)
    np.testing.assert_allclose(out, np.where(elastic, state.joints["stiffness"] * 0.02, 7.0))
    state.joints["kind"], state.joints["stiffness"] = 2, 600.0
    motor_positions(state, out)
    np.testing.assert_allclose(out, state.start.position + 3.0 / 600.0)
    state.joints["kind"] = RIGID
    motor_positions(state, out)
    np.testing.assert_allclose(out, state.start.motor_position)


def test_readings_have_offset_noise_and_grid_and_the_velocity_lags(ways) -> None:  # noqa: F811
    vectors = {name: np.zeros(2) for name in ("position", "estimate", "velocity")}
    readings = Readings(
        offset=np.array([0.01, 0.0]),
        lag_share=np.array([1.0, 0.5]),
        **vectors,
        grid=1e-3,
        effort_grid=0.1,
        period=0.001,
        share=0.2,
    )
    read_encoders(readings, np.array([0.5, 0.5]), np.array([0.0, 0.0006]))
    np.testing.assert_allclose(readings.position, [0.51, 0.501])
    np.testing.assert_allclose(readings.estimate, [0.2 * 510.0, 0.2 * 501.0])
    np.testing.assert_allclose(readings.velocity, [0.2 * 510.0, 0.5 * 0.2 * 501.0])
    read_encoders(readings, np.array([0.5, 0.5]), np.array([0.0, 0.0006]))
    np.testing.assert_allclose(readings.estimate, [0.8 * 0.2 * 510.0, 0.8 * 0.2 * 501.0])
    out = np.empty((3, 2))
    report(readings, np.array([1.23, -1.0]), np.array([0.04, 0.0]), out)
    np.testing.assert_allclose(out[2], [1.3, -1.0])
    np.testing.assert_array_equal(out[:2], [readings.position, readings.velocity])
