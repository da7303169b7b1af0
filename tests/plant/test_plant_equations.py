# SPDX-License-Identifier: BSD-3-Clause
"""The compiled stages say what the plain equations of motion say, in random states with everything acting."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from impedance_modules.plant.integrator import rate
from impedance_modules.plant.links import accelerate, link_table, place_links
from impedance_modules.plant.plant_state import PUSH_ROW, RATE, STAGE, START
from impedance_modules.robot import rotation as compiled_rotation
from impedance_modules.robot.rotation import exp3, log3
from impedance_modules.spec.task import SheetSpec, SurfaceSpec
from tests.reference.plant_equations import plain_rate
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
    surface="sheet",
    height=None,
    position=(0.0, 0.0, 0.0),
    rotation=(0.0, 0.02, 0.4),
    size=None,
    stiffness=20000.0,
    damping=50.0,
    friction=0.4,
    sheet=SheetSpec(((-2.0, 0.0), (-0.1, 0.002), (0.05, 0.0), (2.0, 0.0)), 4.0, 40.0),
)


def shaken(folder, grasp: str, seed: int):
    """A plant in a random state: object between the hands, points in the surface, joints at their stops."""
    rng = np.random.default_rng(seed)
    spec = with_every(spec_of(folder), spring_damping=0.3)
    held = in_both_hands(spec, grasp=grasp, friction=0.5 if grasp == "friction" else None, squeeze=15.0)
    subject = plant(spec, [plane(-0.2, friction=0.4), SHEET], held)
    subject.reset(middle(subject.model) + 0.1 * rng.normal(size=subject.model.n))
    memory, n = subject._memory, subject.model.n
    low = min(memory.part("object_position")[2], *memory.hands["translation"][:, 2])
    memory.surfaces["translation"][0, 2] = low
    # Over the whole sheet, the points that are low enough press it by up to some millimetres.
    memory.surfaces["translation"][1] = memory.part("object_position") - [0.0, 0.0, 0.099]
    joints = memory.joints
    for name in ("command", "assist", "extra_motor", "extra_link", "hold_position"):
        joints[name] = rng.normal(size=n)
    joints["hold_stiffness"], joints["hold_damping"] = rng.uniform(0, 300, n), rng.uniform(0, 5, n)
    joints["upper"][:3], joints["lower"][-3:] = -10.0, 10.0
    memory.state[START, n : 4 * n] = rng.normal(size=3 * n) * 0.3
    memory.part("object_velocity")[:] = rng.normal(size=3)
    memory.part("object_momentum")[:] = 0.05 * rng.normal(size=3)
    subject._integrator.refresh()
    contacts = memory.contacts
    contacts["near"] = rng.integers(0, 2, contacts.size)
    contacts["distance"] = rng.uniform(-2e-3, 1e-3, contacts.size)
    contacts["normal"] = [_unit(rng) for _ in range(contacts.size)]
    contacts["arm"] = 0.1 * rng.normal(size=(contacts.size, 3))
    contacts["slip"] = 1e-4 * rng.normal(size=(contacts.size, 3))
    memory.wrench[:, PUSH_ROW] = rng.normal(size=(memory.hands.size + 1, 6))
    memory.hands["stretch"] += 2e-5 * rng.normal(size=(memory.hands.size, 3))
    contacts["caught"] = np.random.default_rng(seed).integers(-1, 1, contacts.size)
    size = 4 * n + 12
    memory.state[STAGE, :size] = memory.state[START, :size] + 2e-4 * rng.normal(size=size)
    return subject


def _unit(rng: np.random.Generator) -> np.ndarray:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


@pytest.mark.parametrize("folder", [BAXTER, SIX_JOINTS])
@pytest.mark.parametrize("grasp", ["weld", "friction"])
def test_the_compiled_rate_is_the_plain_rate(folder, grasp) -> None:
    for seed in range(10):
        subject = shaken(folder, grasp, seed)
        memory, n, integrator = subject._memory, subject.model.n, subject._integrator
        plain = plain_rate(memory, integrator.links)
        rate(*integrator.tables)
        acceleration = memory.acceleration
        fast = memory.state[RATE].copy()
        fast[n : 2 * n] = acceleration
        tied = memory.joints["kind"] != 0
        fast[3 * n : 4 * n][tied] = acceleration[tied]
        numbers = np.delete(fast[: 4 * n + 12], np.arange(4 * n + 3, 4 * n + 6))
        np.testing.assert_allclose(numbers, plain, rtol=1e-9, atol=1e-9 * np.abs(plain).max())
        assert np.abs(memory.wrench).max() > 1.0
        assert (memory.contacts["touching"] == 1).sum() > 0


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


def test_the_compiled_links_move_as_pinocchios() -> None:
    """Poses, axes and accelerations of random trees: the articulated-body algorithm against the borrowed one."""
    rng = np.random.default_rng(2)
    pin.seed(2)
    for joints in range(1, 25):
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


class Nothing:
    """A worn torque of zero, which sends the plant the slow way round."""

    port = "motor"

    def torque(self, motion) -> np.ndarray:
        return np.zeros_like(motion.position)

    def settle(self, motion) -> None:
        pass


def test_a_period_in_one_call_is_its_stages_one_by_one() -> None:
    """Box on a table, pushed about: the same run with an effect of nothing asked at every stage, to the last bit."""
    spec, held = spec_of(BAXTER), in_both_hands(spec_of(BAXTER), squeeze=15.0)
    bare = plant(spec, [], held)
    bare.reset(middle(bare.model))
    table = plane(float(bare.object_pose.translation[2]) - 0.0995)
    ends = []
    for worn in ([], [Nothing()]):
        subject = plant(spec, [table], held)
        subject.torques.extend(worn)
        subject.reset(middle(subject.model))
        pressed, rng = 0.0, np.random.default_rng(3)
        for _ in range(100):
            subject.advance(subject.start_command + rng.normal(size=subject.model.n))
            pressed = max(pressed, subject.contact_wrench("object")[2])
        assert pressed > 1.0
        ends.append(subject._memory.state[START].copy())
    np.testing.assert_array_equal(*ends)


def test_the_compiled_rotations_are_the_plain_ones() -> None:
    rng, matrix, vector = np.random.default_rng(0), np.empty((3, 3)), np.empty(3)
    for size in (1e-9, 1e-5, 1e-2, 1.0, 3.0):
        phi = rng.normal(size=3)
        phi *= size / np.linalg.norm(phi)
        compiled_rotation.exponential(phi, matrix)
        np.testing.assert_allclose(matrix, exp3(phi), atol=1e-14)
        compiled_rotation.logarithm(matrix, vector)
        np.testing.assert_allclose(vector, log3(exp3(phi)), rtol=1e-10, atol=1e-15)


def test_a_rotation_vectors_rate_is_its_derivative() -> None:
    """phi' agrees with log(exp(h w) exp(phi)) by finite difference, up to the fourth order left out."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        phi, spin, rate, h = 0.05 * rng.normal(size=3), rng.normal(size=3), np.zeros(3), 1e-6
        compiled_rotation.add_rotation_rate(phi, spin, rate)
        change = (log3(exp3(h * spin) @ exp3(phi)) - log3(exp3(-h * spin) @ exp3(phi))) / (2.0 * h)
        np.testing.assert_allclose(rate, change, atol=1e-6)
