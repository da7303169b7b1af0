# SPDX-License-Identifier: BSD-3-Clause
"""Compensation's laws: a gradient of an energy that is never negative, friction along the desired motion, a gain."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.compensator import Compensator, compensator_of
from impedance_modules.effects.compensate import compensate_patch
from impedance_modules.modules.compensation import compensate, compensation_energy
from impedance_modules.modules.equilibrium_velocity import (
    LEAST_STIFFNESS,
    LONGEST_LAG,
    equilibrium_velocity,
    follow_equilibrium,
)
from impedance_modules.modules.sum import lay_out, sum_modules, write_equilibrium, write_gains
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.patch_file import read_patch
from tests.support.arm_samples import Array, Random, baxter, random_position
from tests.support.effect_recordings import applied, write_patch
from tests.support.module_samples import (
    modules_in_force,
    random_damping,
    random_equilibrium,
    random_task,
)

pytestmark = pytest.mark.usefixtures("ways")

PERIOD = 1e-3


@cache
def modules_of(seed: int):
    return random_task(np.random.default_rng(seed), baxter(), held=False)


def compensator(folder: Path, *effects) -> Compensator:
    patch = read_patch(write_patch(folder, *(effect.entry() for effect in effects), robot="baxter"))
    return compensator_of(compensate_patch(baxter().spec, patch), modules_of(0), PERIOD)


def potentials(random: Random) -> list:
    """Weights, springs, constant torques and a leaning base, all at once."""
    joints = random.choice(baxter().joint_names, 3, replace=False)
    return [
        applied("payload", "link", "right_hand", m=random.uniform(0.1, 2.0), cx=0.1, cy=-0.05, cz=0.2),
        applied("link_inertia", "link", "left_upper_forearm", dm=-0.3, dhx=random.uniform(-0.02, 0.02)),
        applied("base_tilt", "link", "base", rx=random.uniform(-0.3, 0.3), ry=random.uniform(-0.3, 0.3)),
        applied("torque_offset", "actuator", str(joints[0]), c=random.uniform(-3.0, 3.0)),
        applied("torque_offset", "link", str(joints[1]), c=random.uniform(-3.0, 3.0)),
        applied("bench_spring", "contact", str(joints[1]), k=random.uniform(1.0, 20.0), q0=-0.3),
        applied("bench_spring", "contact", str(joints[2]), k=random.uniform(1.0, 20.0), q0=4.0),
    ]


def energy_at(found: Compensator, q: Array) -> float:
    found.update(q)
    return float(compensation_energy(found.record, q))


def added_at(found: Compensator, q: Array, others: Array, v: Array, scale: float = 1.0) -> Array:
    found.update(q)
    found.record.motion.velocity[:] = v
    compensate(found.record, others, q, scale)
    return found.record.effort.copy()


@pytest.mark.parametrize("seed", range(6))
def test_the_torque_is_the_gradient_of_the_energy(tmp_path: Path, seed: int) -> None:
    random, model = np.random.default_rng(seed), baxter()
    found, q = compensator(tmp_path, *potentials(random)), random_position(random, model)
    zero, step = np.zeros(model.n), 1e-5
    torque = added_at(found, q, zero, zero)
    slope = [
        (energy_at(found, q + step * along) - energy_at(found, q - step * along)) / (2.0 * step)
        for along in np.eye(model.n)
    ]
    np.testing.assert_allclose(torque, -np.array(slope), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(added_at(found, q, zero, zero, 0.3), 0.3 * torque, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_the_energy_is_never_negative_and_has_a_stated_bound(tmp_path: Path, seed: int) -> None:
    """In the joints' range, at its ends, and wherever a stop that gives way lets a joint go."""
    random, model = np.random.default_rng(seed), baxter()
    found = compensator(tmp_path, *potentials(random))
    low, high = model.column("position_min"), model.column("position_max")
    postures = [low, high, *random.uniform(low, high, (40, model.n)), *random.uniform(-4, 4, (20, model.n))]
    corners = np.where(random.random((40, model.n)) < 0.5, low, high)
    energies = [energy_at(found, q) for q in (*postures, *corners)]
    assert min(energies) >= 0.0
    assert max(energies) <= 2.0 * found.weight.bound + float(np.sum(2.0 * np.abs(tops(found)))) + 1e-9


def tops(found: Compensator) -> Array:
    """Largest change of every joint's potential over its range."""
    record, ends = found.record, []
    for q in np.linspace(record.lower, record.upper, 50):
        ends.append((record.offset + 0.5 * record.stiffness * q) * q)
    return np.ptp(ends, axis=0)


def test_the_weight_is_what_the_patched_model_weighs_more(tmp_path: Path) -> None:
    """A point mass on the hand, by the hand's Jacobian alone."""
    model, random = baxter(), np.random.default_rng(2)
    m, c = 0.7, np.array([0.02, -0.03, 0.1])
    centre = dict(zip(("cx", "cy", "cz"), c.tolist(), strict=True))
    found = compensator(tmp_path, applied("payload", "link", "right_hand", m=m, **centre))
    kinematics, zero = Kinematics(model, ("right_hand",)), np.zeros(model.n)
    for _ in range(5):
        q = random_position(random, model)
        kinematics.update(q, zero)
        J, arm = kinematics.jacobian_of("right_hand"), kinematics.pose("right_hand").rotation @ c
        lifted = J[2] + J[3] * arm[1] - J[4] * arm[0]
        np.testing.assert_allclose(added_at(found, q, zero, zero), m * 9.80665 * lifted, atol=2e-3 * m * 10)


@pytest.mark.parametrize("seed", range(4))
def test_a_moving_equilibrium_desires_the_joint_velocity_that_follows_it(seed: int) -> None:
    """Equilibria that move for a cycle as the arm would with a velocity v, by finite rotations, and then stand."""
    random, model = np.random.default_rng(seed), baxter()
    modules = modules_of(seed)
    found = lay_out(modules, model.n, None)
    damping = random_damping(random, modules)
    q = modules.posture + 0.05 * random.normal(size=model.n)
    v = random.normal(size=model.n)
    kinematics = Kinematics(model, modules.frames)
    kinematics.update(q, np.zeros(model.n))
    targets = random_equilibrium(random, modules, model, 1.0)
    write_gains(found, modules, damping)
    write_equilibrium(found, modules, targets)
    motion = equilibrium_velocity(len(targets.springs), model.n, PERIOD)
    follow_equilibrium(motion, found.springs, found.bias, kinematics.arms)
    assert not motion.velocity.any()
    for s, frame in enumerate(found.springs.frame):
        twist = kinematics.jacobian[frame] @ v * PERIOD
        found.springs.target_translation[s] += twist[:3]
        found.springs.target_rotation[s] = exp3(twist[3:]) @ found.springs.target_rotation[s]
    found.bias.rest[:] += v * PERIOD
    follow_equilibrium(motion, found.springs, found.bias, kinematics.arms)
    H, D = by_matrices(found, kinematics)
    lifted = H + LEAST_STIFFNESS * np.trace(H) / model.n * np.eye(model.n)
    lag = np.minimum(np.diag(D) / np.diag(lifted), LONGEST_LAG)
    expected = np.linalg.solve(lifted, H @ v) * PERIOD / (lag + PERIOD)
    for _ in range(3):
        np.testing.assert_allclose(motion.velocity, expected, rtol=1e-5, atol=1e-5)
        follow_equilibrium(motion, found.springs, found.bias, kinematics.arms)
        expected = expected * lag / (lag + PERIOD)


@pytest.mark.parametrize("seed", range(2))
def test_in_a_steady_motion_the_desired_velocity_is_that_of_the_equilibria(seed: int) -> None:
    random, model, modules = np.random.default_rng(seed), baxter(), modules_of(seed)
    found, v = lay_out(modules, model.n, None), random.normal(size=model.n)
    kinematics = Kinematics(model, modules.frames)
    kinematics.update(modules.posture, np.zeros(model.n))
    write_gains(found, modules, random_damping(random, modules))
    found.bias.stiffness[:] = 20.0
    motion = equilibrium_velocity(len(found.springs.frame), model.n, PERIOD)
    for _ in range(2500):
        follow_equilibrium(motion, found.springs, found.bias, kinematics.arms)
        for s, frame in enumerate(found.springs.frame):
            found.springs.target_translation[s] += (kinematics.jacobian[frame] @ v * PERIOD)[:3]
            motion.rotation[s] = np.eye(3)
            twist = kinematics.jacobian[frame] @ v * PERIOD
            found.springs.target_rotation[s] = exp3(twist[3:])
        found.bias.rest[:] += v * PERIOD
        if motion.known and np.linalg.norm(motion.velocity - v) < 0.02 * np.linalg.norm(v):
            return
    raise AssertionError(f"still {motion.velocity} and not {v}")


def by_matrices(found, kinematics: Kinematics) -> tuple[Array, Array]:
    """Stiffness and damping of all modules, over the joints."""
    H, D = np.diag(found.bias.stiffness), found.bias.damping.copy()
    for s, frame in enumerate(found.springs.frame):
        J = kinematics.jacobian[frame]
        H = H + J.T @ found.springs.stiffness[s] @ J
        D = D + J.T @ found.springs.damping[s] @ J
    return H, D


@pytest.mark.parametrize("seed", range(4))
def test_friction_is_overcome_along_the_desired_motion_and_nowhere_else(tmp_path: Path, seed: int) -> None:
    random, model = np.random.default_rng(seed), baxter()
    names = ("right_s0", "right_e1")
    found = compensator(
        tmp_path,
        *(applied("coulomb_friction", "actuator", name, fc=0.8) for name in names),
        *(applied("quadratic_drag", "link", name, c=0.5) for name in names),
        *(applied("load_dependent_friction", "actuator", name, kl=0.1) for name in names),
    )
    zero, q = np.zeros(model.n), random_position(random, model)
    others = random.normal(size=model.n)
    assert not added_at(found, q, others, zero).any()
    for _ in range(10):
        v = random.uniform(-1.5, 1.5, model.n)
        added = added_at(found, q, others, v)
        load = np.abs(others + found.record.carried)
        exact = np.tanh(v / 0.01) * (0.8 + 0.5 * v**2 + 0.1 * load)
        joints = np.isin(model.joint_names, names)
        np.testing.assert_allclose(added, np.where(joints, exact, 0.0), atol=2e-3)
        np.testing.assert_allclose(added_at(found, q, others, -v), -added, atol=1e-12)


def test_a_motor_that_gives_too_little_is_asked_for_more(tmp_path: Path) -> None:
    """S times the command and the weight that the robot adds is the torque wanted and that weight."""
    random, model = np.random.default_rng(3), baxter()
    found = compensator(
        tmp_path,
        applied("torque_gain", "actuator", "right_s1", s=0.8),
        applied("torque_offset", "link", "right_s1", c=1.5),
    )
    q, others, v = random_position(random, model), random.normal(size=model.n), np.zeros(model.n)
    command = others + added_at(found, q, others, v)
    j = model.joint_names.index("right_s1")
    weight = model.gravity(q)[j]
    assert 0.8 * (command[j] + weight) == pytest.approx(others[j] + 1.5 + weight)
    np.testing.assert_allclose(np.delete(command, j), np.delete(others, j))


def test_it_is_one_more_summand(tmp_path: Path) -> None:
    """The sum with it is the sum without it, and its own row."""
    random, model, modules = np.random.default_rng(5), baxter(), modules_of(0)
    found = compensator(tmp_path, *potentials(random))
    damping, targets = random_damping(random, modules), random_equilibrium(random, modules, model, 0.5)
    kinematics, q = Kinematics(model, modules.frames), modules.posture.copy()
    v = random.normal(size=model.n)
    kinematics.update(q, v)
    found.update(q)
    alone = modules_in_force(modules, targets, damping, model.n)
    together = lay_out(modules, model.n, found.record)
    write_gains(together, modules, damping)
    write_equilibrium(together, modules, targets)
    for record in (alone, together):
        sum_modules(record, kinematics.arms, q, v, 0.7)
    assert len(together.efforts) == len(alone.efforts) + 1
    np.testing.assert_array_equal(together.efforts[:-1], alone.efforts)
    np.testing.assert_array_equal(together.desired, alone.desired + together.efforts[-1])
    assert np.any(together.efforts[-1])


def test_an_equilibrium_that_turns_by_half_a_turn_a_second_is_followed() -> None:
    """The twist of a finite turn of a cycle is right to the square of its angle."""
    model, modules = baxter(), modules_of(0)
    found = lay_out(modules, model.n, None)
    motion = equilibrium_velocity(len(found.springs.frame), model.n, PERIOD)
    kinematics = Kinematics(model, modules.frames)
    kinematics.update(modules.posture, np.zeros(model.n))
    targets = {spring.name: spring.start for arm in modules.arms for spring in arm.springs}
    for s, pose in enumerate(targets.values()):
        found.springs.target_rotation[s] = pose.rotation
    follow_equilibrium(motion, found.springs, found.bias, kinematics.arms)
    turn = Pose(exp3(np.array([0.0, np.pi * PERIOD, 0.0])), np.zeros(3))
    last = len(targets) - 1
    found.springs.target_rotation[last] = turn.rotation @ found.springs.target_rotation[last]
    follow_equilibrium(motion, found.springs, found.bias, kinematics.arms)
    np.testing.assert_allclose(motion.twist, [0, 0, 0, 0, np.pi, 0], atol=1e-5)


def test_an_arm_that_takes_no_part_is_left_alone(tmp_path: Path) -> None:
    random, model = np.random.default_rng(7), baxter()
    patch = read_patch(
        write_patch(
            tmp_path,
            *(effect.entry() for effect in potentials(random)),
            applied("torque_gain", "actuator", "left_s1", s=0.8).entry(),
            applied("coulomb_friction", "link", "left_s0", fc=1.0).entry(),
            robot="baxter",
        )
    )
    both = modules_of(0)
    alone = replace(both, arms=tuple(arm for arm in both.arms if arm.limb.name == "right"))
    right = model.limbs["right"].joints
    found = compensator_of(compensate_patch(model.spec, patch), alone, PERIOD)
    all_of_it = compensator_of(compensate_patch(model.spec, patch), both, PERIOD)
    q, others, v = random_position(random, model), random.normal(size=model.n), np.ones(model.n)
    added, everywhere = added_at(found, q, others, v), added_at(all_of_it, q, others, v)
    np.testing.assert_allclose(added[right], everywhere[right], rtol=1e-9, atol=1e-9)
    assert not np.delete(added, right).any()
    assert np.any(np.delete(everywhere, right))


def test_each_direction_has_its_own_friction(tmp_path: Path) -> None:
    """Harder ahead than back: fc + da against fc - da."""
    model = baxter()
    found = compensator(
        tmp_path, applied("asymmetric_friction", "actuator", "right_e0", fc=1.0, da=0.4, dv=0.0)
    )
    q, zero, j = modules_of(0).posture, np.zeros(model.n), model.joint_names.index("right_e0")
    assert added_at(found, q, zero, np.ones(model.n))[j] == pytest.approx(1.4, abs=1e-6)
    assert added_at(found, q, zero, -np.ones(model.n))[j] == pytest.approx(-0.6, abs=1e-6)
