# SPDX-License-Identifier: BSD-3-Clause
"""Equilibria move continuously, arrive where the phase says, and carry all grasps with the object."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from impedance_modules.errors import BadInput
from impedance_modules.modules.arms import TaskModules, with_phase_gains
from impedance_modules.modules.equilibrium import Equilibrium, PhaseMotion, phase_motion, start_equilibrium
from impedance_modules.modules.minimum_jerk import minimum_jerk, minimum_jerk_slope
from impedance_modules.modules.pose_motion import pose_motion
from impedance_modules.modules.spring import displacement_of
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import exp3, log3
from impedance_modules.spec.task import AXES, HybridAxis, PhaseSpec, Sine
from tests.support.arm_samples import Array, baxter, displaced, make_spring, random_pose, random_position
from tests.support.module_samples import arm_module, hold


def phase(duration: float = 2.0, equilibrium=None, posture=None, axes=None, stiffness=None) -> PhaseSpec:
    changes = (equilibrium or {}, posture or {}, axes or {}, stiffness or {})
    return PhaseSpec("phase", duration, *changes, None, "next")


def holding_arms(random: np.random.Generator) -> TaskModules:
    """Baxter's arms with a hand spring and an elbow spring each; the hands hold a box."""
    model = baxter()
    q = random_position(random, model)

    def arm(limb):
        elbow = next(frame for frame in model.frames if frame.endswith("lower_elbow") and limb.name in frame)
        stiffness = np.diag([300.0, 300, 300, 10, 10, 10])
        springs = [
            make_spring(stiffness, frame, limb.name, name, random_pose(random), model.pose(q, frame))
            for name, frame in (("hand", limb.hand), ("elbow", elbow))
        ]
        return arm_module(limb, springs, q, np.ones(7))

    return hold(TaskModules(tuple(arm(limb) for limb in model.limbs.values()), None, q), model)


def distance(one: Equilibrium, other: Equilibrium) -> float:
    """Largest move of any equilibrium [m, rad]."""
    moves = [np.abs(displacement_of(one.springs[name], other.springs[name])).max() for name in one.springs]
    rests = [np.abs(one.rests[limb] - other.rests[limb]).max() for limb in one.rests]
    return float(max(moves + rests))


def test_minimum_jerk_starts_and_ends_at_rest() -> None:
    assert [minimum_jerk(x) for x in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    for x in np.linspace(0.05, 0.95, 10):
        slope = (minimum_jerk(x + 1e-6) - minimum_jerk(x - 1e-6)) / 2e-6
        assert minimum_jerk_slope(x) == pytest.approx(slope, rel=1e-6)
    assert minimum_jerk_slope(0.0) == minimum_jerk_slope(1.0) == minimum_jerk_slope(1.5) == 0.0


def random_coordinates(random: np.random.Generator, sines: bool) -> dict:
    found = {}
    for axis in random.choice(AXES, size=random.integers(1, 7), replace=False):
        wave = sines and random.random() < 0.5
        center = float(random.normal()) if random.random() < 0.5 else None
        sine = Sine(0.3 * random.random(), random.random(), center) if wave else None
        found[str(axis)] = sine or float(random.normal())
    return found


@pytest.mark.parametrize("sines", [False, True])
@pytest.mark.parametrize("seed", range(20))
def test_motion_is_continuous_and_its_velocity_is_its_derivative(seed: int, sines: bool) -> None:
    random = np.random.default_rng(seed)
    current = random_pose(random)
    motion = pose_motion(random_pose(random), current, random_coordinates(random, sines), 2.0)
    np.testing.assert_allclose(displacement_of(motion.pose(0.0), current), 0.0, atol=1e-7)
    for clock in np.linspace(0.01, 2.5, 40):
        slope = displacement_of(motion.pose(clock + 1e-6), motion.pose(clock - 1e-6)) / 2e-6
        np.testing.assert_allclose(motion.velocity(clock), slope, atol=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_motion_arrives_at_the_absolute_coordinates(seed: int) -> None:
    """Named coordinates become what the file says, in the frozen frame; omitted ones keep their value."""
    random = np.random.default_rng(seed)
    current = random_pose(random, angle=1.0)
    coordinates = {"x": 0.3, "z": -0.2} if seed % 2 else {"y": 0.1, "rz": 0.4}
    reference = current @ Pose(exp3(0.3 * random.normal(size=3)), random.normal(size=3))
    before = _coordinates(reference, current)
    motion = pose_motion(reference, current, coordinates, 2.0)
    after = _coordinates(reference, motion.pose(2.0))
    for index, axis in enumerate(AXES):
        expected = coordinates.get(axis, before[index])
        assert after[index] == pytest.approx(expected, abs=1e-9)


def _coordinates(reference: Pose, pose: Pose) -> Array:
    inside = reference.inverse() @ pose
    return np.concatenate([inside.translation, log3(inside.rotation)])


def test_rotation_takes_the_shortest_way() -> None:
    """From +170 to -170 degrees is 20 degrees, not 340; also while another coordinate swings."""
    current = Pose(exp3(np.array([0.0, 0.0, math.radians(170.0)])), np.zeros(3))
    for extra in ({}, {"rx": Sine(0.1, 1.0, None)}):
        motion = pose_motion(Pose.identity(), current, {"rz": math.radians(-170.0), **extra}, 1.0)
        angles = [log3(motion.pose(t).rotation @ current.rotation.T) for t in np.linspace(0.0, 1.0, 50)]
        assert max(np.linalg.norm(angle) for angle in angles) < math.radians(45.0)
        end = pose_motion(Pose.identity(), current, {"rz": math.radians(-170.0)}, 1.0).pose(1.0)
        assert np.linalg.norm(log3(end.rotation @ exp3(np.array([0, 0, math.radians(-170.0)])).T)) < 1e-9


def test_sine_swings_about_its_centre_or_where_it_started() -> None:
    current = Pose(np.eye(3), np.array([0.5, 0.2, 0.0]))
    sines = {"y": Sine(0.1, 0.25, None), "x": Sine(0.1, 0.25, 0.7)}
    motion = pose_motion(Pose.identity(), current, sines, 2.0)
    for clock in (0.0, 1.0, 3.0, 7.3):
        y = 0.2 + 0.1 * math.sin(2 * math.pi * 0.25 * clock)
        assert motion.pose(clock).translation[1] == pytest.approx(y, abs=1e-12)
    assert motion.pose(0.0).translation[0] == pytest.approx(0.5)
    assert motion.pose(3.0).translation[0] == pytest.approx(0.7 - 0.1)


def random_phase(random: np.random.Generator, modules: TaskModules) -> PhaseSpec:
    limb = modules.arms[0].limb
    equilibrium = {f"{limb.name}.elbow": random_coordinates(random, True)}
    moved = "object" if random.random() < 0.5 else f"{modules.arms[1].limb.name}.hand"
    equilibrium[moved] = random_coordinates(random, True)
    posture = {limb.name: {limb.short_names[2]: float(random.normal())}}
    return phase(0.5 + random.random(), equilibrium, posture)


@pytest.mark.parametrize("seed", range(10))
def test_phases_join_without_a_jump_wherever_the_last_one_stopped(seed: int) -> None:
    random = np.random.default_rng(seed)
    modules = holding_arms(random)
    now = start_equilibrium(modules)
    for _ in range(4):
        motion = phase_motion(modules, random_phase(random, modules), now)
        assert distance(motion.at(0.0), now) < 1e-7
        stop = motion.duration * random.random()
        clocks = np.linspace(0.0, stop, 200)
        steps = [distance(motion.at(a), motion.at(b)) for a, b in pairwise(clocks)]
        speed = max(np.abs(v).max() for t in clocks for v in motion.velocities(t).values())
        assert max(steps) < 2.0 * (speed + 10.0) * (clocks[1] - clocks[0])
        now = motion.at(stop)


@pytest.mark.parametrize("seed", range(6))
def test_every_springs_velocity_is_the_derivative_of_its_equilibrium(seed: int) -> None:
    """Those that move by themselves, those that ride on the object, and those that rest."""
    random = np.random.default_rng(seed)
    modules = holding_arms(random)
    motion = phase_motion(modules, random_phase(random, modules), start_equilibrium(modules))
    for clock in (0.2, 0.4):
        velocities = motion.velocities(clock)
        ahead, behind = (motion.at(clock + step).springs for step in (1e-6, -1e-6))
        assert set(velocities) == set(ahead)
        for name, velocity in velocities.items():
            slope = displacement_of(ahead[name], behind[name]) / 2e-6
            np.testing.assert_allclose(velocity, slope, atol=1e-5)


def moving_object(modules: TaskModules, coordinates: dict) -> PhaseMotion:
    return phase_motion(modules, phase(1.0, {"object": coordinates}), start_equilibrium(modules))


@pytest.mark.parametrize("seed", range(5))
def test_an_object_target_moves_all_grasps_rigidly(seed: int) -> None:
    random = np.random.default_rng(seed)
    modules = holding_arms(random)
    motion = moving_object(modules, {"x": 0.7, "rz": 0.5, "ry": Sine(0.2, 0.5, None)})
    start = start_equilibrium(modules)
    for clock in (0.0, 0.3, 0.9, 1.4):
        now = motion.at(clock)
        for name in modules.held.springs:
            before = start.object.inverse() @ start.springs[name]
            after = now.object.inverse() @ now.springs[name]
            np.testing.assert_allclose(after.rotation, before.rotation, atol=1e-9)
            np.testing.assert_allclose(after.translation, before.translation, atol=1e-9)
            ahead, behind = (motion.at(clock + step).springs[name] for step in (1e-6, -1e-6))
            slope = displacement_of(ahead, behind) / 2e-6
            if clock > 0.0:
                np.testing.assert_allclose(motion.velocities(clock)[name], slope, atol=1e-6)
        elbow = next(name for name in start.springs if name.endswith("elbow"))
        assert np.all(displacement_of(now.springs[elbow], start.springs[elbow]) == 0.0)
    assert motion.at(1.0).object.translation[0] == pytest.approx(0.7)


def test_posture_and_gains_change_with_the_phase() -> None:
    modules = holding_arms(np.random.default_rng(0))
    limb = modules.arms[0].limb
    name = f"{limb.name}.hand"
    softer = np.diag([100.0, 100, 100, 5, 5, 5])
    spec = phase(
        posture={limb.name: {limb.short_names[1]: 0.25}},
        axes={name: {"z": HybridAxis(-12.0, 0.1)}},
        stiffness={name: softer},
    )
    motion = phase_motion(modules, spec, start_equilibrium(modules))
    rest = motion.at(2.0).rests[limb.name]
    assert rest[1] == pytest.approx(0.25) and rest[0] == modules.arms[0].bias.rest[0]
    changed = with_phase_gains(modules, spec).arms[0].springs[0]
    np.testing.assert_array_equal(changed.stiffness, softer)
    assert changed.force[2] == -12.0 and changed.damping[2, 2] == pytest.approx(120.0)
    assert with_phase_gains(modules, spec).arms[1] == modules.arms[1]


def test_unknown_targets_are_refused_with_the_valid_ones() -> None:
    modules = holding_arms(np.random.default_rng(0))
    name = modules.arms[0].springs[0].name
    with pytest.raises(BadInput, match=f"did you mean '{name}'"):
        phase_motion(modules, phase(equilibrium={name + "d": {"x": 0.1}}), start_equilibrium(modules))
    empty = replace(modules, held=None)
    with pytest.raises(BadInput, match="no target 'object'"):
        phase_motion(empty, phase(equilibrium={"object": {"x": 0.1}}), start_equilibrium(empty))


def test_a_displacement_is_measured_in_world_axes() -> None:
    random = np.random.default_rng(1)
    target, step = random_pose(random), 0.01 * random.normal(size=6)
    np.testing.assert_allclose(displacement_of(displaced(target, step), target), step, atol=1e-12)
