# SPDX-License-Identifier: BSD-3-Clause
"""Springs between two arms: exact gradients, internal forces, exchange, splitting, and dampers that only take."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.between_spring import BetweenSpring, build_between_spring, springs_at
from impedance_modules.modules.damping import Damping, phase_damping
from impedance_modules.modules.equilibrium import Equilibrium, start_equilibrium
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3, log3
from impedance_modules.spec.between_spec import BetweenSpec, FrameOfArm
from impedance_modules.superposition.coupled_arms import joint_coupling, pair_stiffness
from tests.support.arm_samples import (
    ROBOTS,
    TYPICAL_STIFFNESS,
    Random,
    baxter,
    derivative,
    displaced,
    random_pose,
    random_position,
    random_psd,
    random_rotation,
)
from tests.support.both_ways import ways  # noqa: F401 - a fixture
from tests.support.module_samples import arm_module, module_sum, random_damping

SEEDS = st.integers(0, 2**32 - 1)


def ends(model: RobotModel) -> tuple[FrameOfArm, FrameOfArm]:
    first, second = tuple(model.limbs.values())[:2]
    return FrameOfArm(first.name, first.hand), FrameOfArm(second.name, second.hand)


def random_spec(random: Random, model: RobotModel, name: str = "grip") -> BetweenSpec:
    first, second = ends(model)
    axes = random.choice(np.array([None, first, second]))
    stiffness = random_psd(random, TYPICAL_STIFFNESS)
    return BetweenSpec(name, first, second, axes, stiffness, None, 0.7, {})


def with_springs(random: Random, model: RobotModel, *specs: BetweenSpec) -> TaskModules:
    """Two arms with joint springs of random stiffness, and springs between them."""
    q = random_position(random, model)
    arms = [
        arm_module(limb, [], q, random.uniform(1.0, 30.0, len(limb.joints)), ratio=0.7)
        for limb in tuple(model.limbs.values())[:2]
    ]
    between = tuple(build_between_spring(spec, model, q) for spec in specs)
    return TaskModules(tuple(arms), None, q, between)


def moved_rests(random: Random, modules: TaskModules) -> Equilibrium:
    """Every spring between arms relaxed somewhere else."""
    start = start_equilibrium(modules)
    rests = {s.name: random_pose(random, size=0.1, angle=1.0) for s in modules.between}
    return replace(start, springs={**start.springs, **rests})


def near(random: Random, modules: TaskModules) -> np.ndarray:
    return modules.posture + 0.2 * random.normal(size=modules.posture.size)


def geometry(model: RobotModel, modules: TaskModules, q: np.ndarray) -> Kinematics:
    kinematics = Kinematics(model, modules.frames)
    kinematics.update(q, np.zeros_like(q))
    return kinematics


def random_dampers(random: Random, modules: TaskModules) -> Damping:
    found = random_damping(random, modules)
    return replace(
        found, between_modal={s.name: random_psd(random, 0.1 * TYPICAL_STIFFNESS) for s in modules.between}
    )


@pytest.mark.usefixtures("ways")
@ROBOTS
@pytest.mark.parametrize("seed", range(10))
def test_torque_is_minus_the_gradient_of_the_energy(robot, seed: int) -> None:
    random, model = np.random.default_rng(seed), robot()
    modules = with_springs(random, model, random_spec(random, model))
    targets, q, still = moved_rests(random, modules), near(random, modules), np.zeros(model.n)
    damping = random_dampers(random, modules)

    def energy(step: np.ndarray) -> float:
        at = q + step
        return module_sum(modules, geometry(model, modules, at), targets, at, still, damping)[1]

    found, _ = module_sum(modules, geometry(model, modules, q), targets, q, still, damping)
    slope = (
        np.array(
            [(energy(h) - energy(-h)) * 8 - (energy(2 * h) - energy(-2 * h)) for h in 1e-3 * np.eye(model.n)]
        )
        / 12e-3
    )
    np.testing.assert_allclose(found.desired, -slope, atol=1e-8 * max(1.0, np.abs(slope).max()))


@pytest.mark.usefixtures("ways")
@given(SEEDS)
@settings(max_examples=20)
def test_forces_are_internal_and_a_common_motion_changes_nothing(seed: int) -> None:
    """The wrenches of both ends sum to zero about any point; both frames carried along as one body feel nothing."""
    random, model = np.random.default_rng(seed), baxter()
    modules = with_springs(random, model, random_spec(random, model))
    spring, rest = modules.between[0], random_pose(random, size=0.1, angle=1.0)
    kinematics = geometry(model, modules, near(random, modules))
    slots = [kinematics.frames.index(frame) for frame in spring.frames]
    before = springs_at([spring], kinematics, {spring.name: rest})
    force, moment = np.zeros(3), np.zeros(3)
    for end, slot in enumerate(slots):
        w = before.wrench[0, 6 * end : 6 * end + 6]
        force, moment = force + w[:3], moment + w[3:] + np.cross(kinematics.translation[slot], w[:3])
    size = np.abs(before.wrench).max()
    np.testing.assert_allclose([*force, *moment], 0.0, atol=1e-11 * size)
    carried = random_pose(random)
    for slot in slots:
        kinematics.rotation[slot] = carried.rotation @ kinematics.rotation[slot]
        kinematics.translation[slot] = carried.rotation @ kinematics.translation[slot] + carried.translation
    after = springs_at([spring], kinematics, {spring.name: rest})
    np.testing.assert_allclose(after.error, before.error, atol=1e-10)
    turn = np.kron(np.eye(4), carried.rotation)
    np.testing.assert_allclose(after.wrench[0], turn @ before.wrench[0], atol=1e-9 * size)


@given(SEEDS)
@settings(max_examples=30)
def test_frames_may_be_exchanged(seed: int) -> None:
    """Distances and turns change their sign with the order of the frames; energy and torques stay."""
    random, model = np.random.default_rng(seed), baxter()
    spec = random_spec(random, model)
    swapped = replace(spec, first=spec.second, second=spec.first)
    one = with_springs(np.random.default_rng(seed), model, spec)
    other = with_springs(np.random.default_rng(seed), model, swapped)
    q, rest = near(random, one), random_pose(random, size=0.1, angle=1.0)
    opposite = Pose(rest.rotation.T, -rest.translation)
    v, damping = random.normal(size=model.n), random_dampers(random, one)
    found = [
        module_sum(
            modules,
            geometry(model, modules, q),
            replace(start_equilibrium(modules), springs={"grip": to}),
            q,
            v,
            damping,
        )
        for modules, to in ((one, rest), (other, opposite))
    ]
    assert found[1][1] == pytest.approx(found[0][1], rel=1e-11)
    np.testing.assert_allclose(found[1][0].desired, found[0][0].desired, rtol=1e-9, atol=1e-9)


def test_it_is_relaxed_at_the_posture_and_where_its_rest_says() -> None:
    random, model = np.random.default_rng(3), baxter()
    modules = with_springs(random, model, random_spec(random, model))
    kinematics = geometry(model, modules, modules.posture)
    rests = {"grip": modules.between[0].start}
    np.testing.assert_allclose(springs_at(modules.between, kinematics, rests).error, 0.0, atol=1e-12)
    spec = replace(modules.between[0].spec, rest={"x": 0.3, "rz": 0.2})
    start = build_between_spring(spec, model, modules.posture).start
    assert start.translation[0] == 0.3 and start.translation[1] == rests["grip"].translation[1]
    np.testing.assert_allclose(log3(start.rotation), [0, 0, 0.2], atol=1e-12)


def test_coordinates_are_those_of_the_first_frame_seen_from_the_second() -> None:
    """In world axes at the posture: push the first frame by 1 cm along y, and e is 1 cm along y."""
    random, model = np.random.default_rng(5), baxter()
    spec = replace(random_spec(random, model), expressed_in=None, stiffness=np.diag(TYPICAL_STIFFNESS))
    modules = with_springs(random, model, spec)
    kinematics = geometry(model, modules, modules.posture)
    slot = kinematics.frames.index(spec.first.frame)
    kinematics.translation[slot] += [0.0, 0.01, 0.0]
    found = springs_at(modules.between, kinematics, {"grip": modules.between[0].start})
    np.testing.assert_allclose(found.error[0], [0, 0.01, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found.wrench[0, :3], [0, -3.0, 0], atol=1e-9)
    turn = exp3(np.array([0.0, 0.0, 0.1]))
    kinematics.rotation[slot] = turn @ kinematics.rotation[slot]
    again = springs_at(modules.between, kinematics, {"grip": modules.between[0].start})
    np.testing.assert_allclose(again.error[0, 3:], [0, 0, 0.1], atol=1e-12)


@given(SEEDS)
@settings(max_examples=15)
def test_without_stiffness_and_damping_it_changes_nothing_and_cut_in_two_neither(seed: int) -> None:
    random, model = np.random.default_rng(seed), baxter()
    spec, share = random_spec(random, model), float(random.uniform(0.1, 0.9))
    nothing = replace(spec, stiffness=np.zeros((6, 6)), damping_ratio=None)
    halves = [
        replace(spec, name=f"p{k}", stiffness=part * spec.stiffness)
        for k, part in ((0, share), (1, 1 - share))
    ]
    v, step = random.normal(size=model.n), 0.2 * random.normal(size=model.n)
    found = []
    for specs in ((), (nothing,), (spec,), halves):
        modules = with_springs(np.random.default_rng(seed), model, *specs)
        kinematics = geometry(model, modules, modules.posture + step)
        damping = phase_damping(modules, kinematics)
        targets = start_equilibrium(modules)
        q = modules.posture + step
        found.append(module_sum(modules, kinematics, targets, q, v, damping))
    for one, other in ((0, 1), (2, 3)):
        assert found[other][1] == pytest.approx(found[one][1], rel=1e-10)
        np.testing.assert_allclose(found[other][0].desired, found[one][0].desired, rtol=1e-8, atol=1e-9)


@given(SEEDS)
@settings(max_examples=15)
def test_dampers_take_energy_and_leave_a_common_motion_alone(seed: int) -> None:
    random, model = np.random.default_rng(seed), baxter()
    modules = with_springs(random, model, random_spec(random, model))
    q = near(random, modules)
    kinematics = geometry(model, modules, q)
    damping = phase_damping(modules, kinematics)
    D = joint_coupling(modules, kinematics, start_equilibrium(modules), damping).damping
    values = np.linalg.eigvalsh(0.5 * (D + D.T))
    assert values[0] >= -1e-10 * values[-1] and values[-1] > 0.0
    spring = modules.between[0]
    J = np.vstack([kinematics.jacobian_of(frame) for frame in spring.frames])
    poses = [kinematics.pose(frame).translation for frame in spring.frames]
    twist = random.normal(size=6)
    common = np.concatenate([np.r_[twist[:3] + np.cross(twist[3:], p), twist[3:]] for p in poses])
    v = np.linalg.lstsq(J, common, rcond=None)[0]
    assert abs(v @ D @ v) <= 1e-8 * values[-1] * (v @ v)


@pytest.mark.parametrize("seed", range(5))
@ROBOTS
def test_each_mode_of_the_relative_motion_has_the_declared_ratio(robot, seed: int) -> None:
    """Free arms, no other spring: in joint space every mode with stiffness swings with zeta."""
    random, model = np.random.default_rng(seed), robot()
    modules = with_springs(random, model, random_spec(random, model))
    kinematics = geometry(model, modules, modules.posture)
    found = joint_coupling(
        modules, kinematics, start_equilibrium(modules), phase_damping(modules, kinematics)
    )
    inverse = kinematics.inverse_inertia
    factor = np.linalg.cholesky(inverse)
    squared, modes = np.linalg.eigh(factor.T @ found.stiffness @ factor)
    stiff = squared > 1e-6 * squared[-1]
    damped = np.diag(modes.T @ factor.T @ found.damping @ factor @ modes)[stiff]
    np.testing.assert_allclose(damped / (2.0 * np.sqrt(squared[stiff])), 0.7, rtol=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_pair_stiffness_is_minus_the_derivative_of_both_wrenches(seed: int) -> None:
    random, model = np.random.default_rng(seed), baxter()
    modules = with_springs(random, model, random_spec(random, model))
    spring, rest = modules.between[0], random_pose(random, size=0.2, angle=1.0)
    first, second = random_pose(random), Pose.identity()
    second = Pose(
        first.rotation @ random_rotation(random, 1.0), first.translation + 0.3 * random.normal(size=3)
    )
    K = pair_stiffness(spring, first, second, rest)
    by_first = derivative(lambda h: wrench_of(spring, displaced(first, h), second, rest), step=1e-3)
    by_second = derivative(lambda h: wrench_of(spring, first, displaced(second, h), rest), step=1e-3)
    slope = -np.hstack([by_first, by_second])
    np.testing.assert_allclose(K, slope, atol=1e-7 * np.abs(K).max())


def wrench_of(spring: BetweenSpring, first: Pose, second: Pose, rest: Pose) -> np.ndarray:
    """By moving the frames of a robot's state by hand."""
    kinematics = Kinematics(baxter(), spring.frames)
    kinematics.update(np.zeros(baxter().n), np.zeros(baxter().n))
    for slot, pose in enumerate((first, second)):
        kinematics.rotation[slot], kinematics.translation[slot] = pose.rotation, pose.translation
    return springs_at([spring], kinematics, {spring.name: rest}).wrench[0].copy()


@pytest.mark.parametrize("seed", range(5))
def test_joint_stiffness_is_minus_the_derivative_of_the_torque(seed: int) -> None:
    random, model = np.random.default_rng(seed), baxter()
    modules = with_springs(random, model, random_spec(random, model))
    targets, q = moved_rests(random, modules), near(random, modules)
    damping = random_dampers(random, modules)

    def effort(step: np.ndarray) -> np.ndarray:
        return joint_coupling(modules, geometry(model, modules, q + step), targets, damping).effort

    slope = (
        np.array(
            [(effort(h) - effort(-h)) * 8 - (effort(2 * h) - effort(-2 * h)) for h in 1e-3 * np.eye(model.n)]
        ).T
        / 12e-3
    )
    found = joint_coupling(modules, geometry(model, modules, q), targets, damping)
    np.testing.assert_allclose(found.stiffness, -slope, atol=1e-7 * np.abs(slope).max())
    assert found.groups == (tuple(model.limbs)[:2],)
