# SPDX-License-Identifier: BSD-3-Clause
"""The laws of the plant say what plain equations of motion say, in random states with everything acting; both ways."""

import copy
import os
import pickle

import numpy as np
import pinocchio as pin
import pytest

from impedance_modules.compiled import use_machine_code
from impedance_modules.plant.equations_of_motion import evaluate_rate
from impedance_modules.plant.joints import ELASTIC, JOINT, spring_torque, stop_torque, update_loads
from impedance_modules.plant.links import accelerate, link_table, place_links
from impedance_modules.plant.plant_state import StateVector, state_vector
from impedance_modules.spec.task import SheetSpec, SurfaceSpec
from tests.reference.plant_equations import plain_rate, plain_spring_torque
from tests.support.plant_parts import (
    BAXTER,
    SIX_JOINTS,
    in_both_hands,
    middle,
    plane,
    plant,
    spec_of,
    with_every,
)

SHEET = SurfaceSpec(
    "sheet", None, (0.0, 0.0, 0.0), (0.0, 0.02, 0.4), None, stiffness=20000.0, damping=50.0, friction=0.4,
    sheet=SheetSpec(((-2.0, 0.0), (-0.1, 0.002), (0.05, 0.0), (2.0, 0.0)), 4.0, 40.0),
)  # fmt: skip


def shaken(folder, grasp: str, seed: int):
    """A plant in a random state: object between the hands, points in the surface, joints at their stops."""
    rng = np.random.default_rng(seed)
    spec = with_every(spec_of(folder), spring_damping=0.3)
    held = in_both_hands(spec, grasp=grasp, friction=0.5 if grasp == "friction" else None, squeeze=15.0)
    subject = plant(spec, [plane(-0.2, friction=0.4), SHEET], held)
    # At rest as by ``reset``, which would check the step as well: slow as plain Python.
    use_machine_code(os.environ.get("LAWS_RUN_AS") != "python")
    subject._start.rest(middle(subject.model) + 0.1 * rng.normal(size=subject.model.n))
    state, n = subject.state, subject.model.n
    start, joints, contacts = state.start, state.joints, state.contacts
    low = min(start.object_position[2], *state.hands["translation"][:, 2])
    state.surfaces["translation"][0, 2] = low
    # Over the whole sheet, the points that are low enough press it by up to some millimetres.
    state.surfaces["translation"][1] = start.object_position - [0.0, 0.0, 0.099]
    for name in ("command", "assist", "effect_motor", "effect_link", "hold_position"):
        joints[name] = rng.normal(size=n)
    joints["hold_stiffness"], joints["hold_damping"] = rng.uniform(0, 300, n), rng.uniform(0, 5, n)
    joints["upper"][:3], joints["lower"][-3:] = -10.0, 10.0
    for part in (start.velocity, start.motor_position, start.motor_velocity):
        part[:] = rng.normal(size=n) * 0.3
    start.object_velocity[:] = rng.normal(size=3)
    start.object_momentum[:] = 0.05 * rng.normal(size=3)
    subject._integrator.refresh()
    contacts["near"] = rng.integers(0, 2, contacts.size)
    contacts["distance"] = rng.uniform(-2e-3, 1e-3, contacts.size)
    contacts["normal"] = [_unit(rng) for _ in range(contacts.size)]
    contacts["lever"] = 0.1 * rng.normal(size=(contacts.size, 3))
    contacts["stretch"] = 1e-4 * rng.normal(size=(contacts.size, 3))
    state.push_wrench[:] = rng.normal(size=(state.hands.size + 1, 6))
    state.hands["deflection"] += 2e-5 * rng.normal(size=(state.hands.size, 3))
    other = np.random.default_rng(seed)
    contacts["splinter"] = other.integers(-1, 1, contacts.size)
    joints["half_gap"] = other.choice([0.0, 0.05], n)
    size = 4 * n + 12
    state.stage.whole[:size] = start.whole[:size] + 2e-4 * rng.normal(size=size)
    return subject


def _unit(rng: np.random.Generator) -> np.ndarray:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


@pytest.mark.parametrize("folder", [BAXTER, SIX_JOINTS])
@pytest.mark.parametrize("grasp", ["weld", "friction"])
def test_the_laws_rate_is_the_plain_rate(folder, grasp, ways) -> None:
    largest = np.zeros(2)
    for seed in range(10 if ways == "machine code" else 2):
        subject = shaken(folder, grasp, seed)
        use_machine_code(ways == "machine code")
        state, n = subject.state, subject.model.n
        plain = plain_rate(state, subject._integrator.links)
        evaluate_rate(state)
        fast = state.rate.whole.copy()
        fast[n : 2 * n] = state.acceleration
        tied = state.joints["kind"] != ELASTIC
        fast[3 * n : 4 * n][tied] = state.acceleration[tied]
        numbers = np.delete(fast[: 4 * n + 12], np.arange(4 * n + 3, 4 * n + 6))
        np.testing.assert_allclose(numbers, plain, rtol=1e-9, atol=1e-9 * np.abs(plain).max())
        assert np.abs(state.contact_wrench).max() + np.abs(state.grasp_wrench).max() > 1.0
        largest = np.maximum(largest, [np.abs(state.contact_wrench).max(), np.abs(state.grasp_wrench).max()])
    assert largest[0] > 1.0 and (largest[1] > 1.0 or ways == "python")


def test_a_torque_on_a_joint_is_power_where_the_counters_say(ways) -> None:
    """Each power is its torque times its velocity; the springs' losses are never negative."""
    subject = shaken(BAXTER, "weld", 3)
    use_machine_code(ways == "machine code")
    evaluate_rate(subject.state)
    state, joints = subject.state, subject.state.joints
    stage, work = state.stage, state.rate.work[0]
    assert work.command_work == pytest.approx(joints["command"] @ stage.motor_velocity)
    assert work.effect_work == pytest.approx(
        joints["effect_motor"] @ stage.motor_velocity + joints["effect_link"] @ stage.velocity
    )
    assert work.motor_loss == pytest.approx(joints["motor_damping"] @ stage.motor_velocity**2)
    assert work.contact_work == pytest.approx(np.sum(state.contact_wrench * state.twist))
    assert work.grasp_work == pytest.approx(np.sum(state.grasp_wrench * state.twist))
    assert work.push_work == pytest.approx(np.sum(state.push_wrench * state.twist))


def test_a_gear_with_play_pushes_and_never_pulls(ways) -> None:
    """The torque of one joint against the plain formula, through the gap and at every speed; stops likewise."""
    table = np.zeros(1, JOINT).view(np.recarray)
    joint = table[0]
    joint.stiffness, joint.spring_damping, joint.half_gap = 200.0, 2.0, 0.01
    joint.lower, joint.upper, joint.stop_stiffness, joint.stop_damping = -1.0, 1.0, 500.0, 5.0
    for lead in np.linspace(-0.03, 0.03, 13):
        for speed in (-3.0, 0.0, 3.0):
            expected = plain_spring_torque(table, np.array([lead]), np.array([speed]))[0]
            assert spring_torque(joint, lead, speed) == pytest.approx(expected, abs=1e-12)
            assert spring_torque(joint, lead, speed) * lead >= 0.0
    assert spring_torque(joint, 0.009, 1.0) == 0.0
    assert spring_torque(joint, 0.02, 0.0) == pytest.approx(2.0)
    assert stop_torque(joint, 1.01, 0.0) == pytest.approx(-5.0)
    assert stop_torque(joint, -1.01, 0.1) == pytest.approx(4.5)
    assert stop_torque(joint, 1.01, -2.0) == stop_torque(joint, 0.99, 2.0) == 0.0


def test_the_load_of_a_rigid_joint_lacks_its_rotors_inertia(ways) -> None:
    subject = shaken(SIX_JOINTS, "weld", 1)
    use_machine_code(ways == "machine code")
    state, rigid = subject.state, subject.state.joints["kind"] == 1
    evaluate_rate(state)
    state.rate.velocity[:] = state.acceleration
    before = state.joints["load"].copy()
    update_loads(state)
    lost = (before - state.joints["load"])[rigid]
    np.testing.assert_allclose(lost, (state.joints["reflected_inertia"] * state.acceleration)[rigid])
    assert np.abs(lost).max() > 0.0


def test_a_copy_of_a_state_has_parts_of_its_own() -> None:
    vector = state_vector(2)
    for other in (copy.deepcopy(vector), pickle.loads(pickle.dumps(vector))):
        assert isinstance(other, StateVector)
        other.velocity[1], other.work[0].push_work = 3.0, 4.0
        assert other.whole[3] == 3.0 and other.whole[-1] == 4.0
        assert not vector.whole.any()


def random_tree(rng: np.random.Generator, joints: int) -> pin.Model:
    """A tree of hinges and slides about random axes, some of its joints geared, under a random gravity."""
    model = pin.Model()
    for _ in range(joints):
        kind = pin.JointModelRevoluteUnaligned if rng.random() < 0.7 else pin.JointModelPrismaticUnaligned
        parent, name = int(rng.integers(0, model.njoints)), f"joint {model.njoints}"
        index = model.addJoint(parent, kind(_unit(rng)), pin.SE3.Random(), name)
        model.appendBodyToJoint(index, pin.Inertia.Random(), pin.SE3.Random())
    model.armature = rng.choice([0.0, 0.3], joints)
    model.gravity.linear = rng.normal(size=3)
    return model


def test_the_links_move_as_pinocchios(ways) -> None:
    """Poses, axes and accelerations of random trees: the articulated-body algorithm against the borrowed one."""
    rng = np.random.default_rng(2)
    pin.seed(2)
    for joints in range(1, 25) if ways == "machine code" else (1, 2, 5, 9):
        model = random_tree(rng, joints)
        data, table = model.createData(), link_table(model)
        q, v, torque, acceleration = *rng.normal(size=(3, joints)), np.empty(joints)
        place_links(table, q)
        accelerate(table, v, torque, acceleration)
        expected = pin.aba(model, data, q, v, torque)
        np.testing.assert_allclose(acceleration, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
        axes = pin.computeJointJacobians(model, data, q).reshape(6, -1)
        np.testing.assert_allclose(table["axis"][1:], axes.T, atol=1e-12)
        for i in range(1, joints + 1):
            np.testing.assert_allclose(table["rotation"][i], data.oMi[i].rotation, atol=1e-12)
            np.testing.assert_allclose(table["translation"][i], data.oMi[i].translation, atol=1e-12)


def test_a_period_as_python_is_the_period_as_machine_code() -> None:
    """Box on a sheet and a table, held by slipping palms: some steps of the same plant, interpreted and compiled."""
    ends = []
    for machine_code in (True, False):
        subject = shaken(SIX_JOINTS, "friction", 4)
        use_machine_code(machine_code)
        try:
            subject._integrator.advance(2)
        finally:
            use_machine_code()
        ends.append(subject.state.start.whole.copy())
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-12, atol=1e-12)
