# SPDX-License-Identifier: BSD-3-Clause
"""Obstacles: distances, a bounded push that is the gradient of its energy, a damper that only takes; predictions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.control.assembly import assemble
from impedance_modules.errors import BadFile
from impedance_modules.modules.arms import TaskModules
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.modules.obstacle import Obstacle, clear, obstacles_at, push_energy
from impedance_modules.prediction.analysis import analyse_task
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.prediction.forecast import forecast_task
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.between_spec import FrameOfArm
from impedance_modules.spec.obstacle_spec import LENGTHS, ObstacleSpec
from impedance_modules.superposition.coupled_arms import joint_coupling
from tests.support.arm_samples import ROBOTS, Random, baxter, random_position
from tests.support.both_ways import ways  # noqa: F401 - a fixture
from tests.support.module_samples import arm_module, module_sum
from tests.support.paths import CHECKOUT

SEEDS = st.integers(0, 2**32 - 1)
TASK = (CHECKOUT / "tasks" / "any-robot" / "around-a-post.yaml").read_text()


def random_obstacle(random: Random, model: RobotModel, q: np.ndarray, name: str = "post") -> Obstacle:
    """Of any shape, 0 to 15 cm away from a hand, which it guards with the other one."""
    limbs = tuple(model.limbs.values())[:2]
    shape = str(random.choice(list(LENGTHS)))
    size = tuple(float(length) for length in random.uniform(0.02, 0.2, LENGTHS[shape]))
    hand = model.pose(q, limbs[0].hand).translation
    x, y, z = hand + random.normal(size=3) * 0.1
    rx, ry, rz = random.normal(size=3)
    guards = tuple(FrameOfArm(limb.name, limb.hand) for limb in limbs)
    k, b = float(random.uniform(100, 1000)), float(random.uniform(0, 30))
    return Obstacle(ObstacleSpec(name, shape, (x, y, z), (rx, ry, rz), size, 0.15, k, b, guards))


def guarded(random: Random, model: RobotModel, *, count: int = 1) -> TaskModules:
    q = random_position(random, model)
    limbs = tuple(model.limbs.values())[:2]
    arms = tuple(arm_module(limb, [], q, random.uniform(1.0, 30.0, len(limb.joints))) for limb in limbs)
    obstacles = tuple(random_obstacle(random, model, q, f"o{k}") for k in range(count))
    return TaskModules(arms, None, q, (), obstacles)


def summed(model: RobotModel, modules: TaskModules, q: np.ndarray, v: np.ndarray, scale: float = 1.0):
    kinematics = Kinematics(model, modules.frames)
    kinematics.update(q, v)
    damping = phase_damping(modules, kinematics)
    return module_sum(modules, kinematics, start_equilibrium(modules), q, v, damping, scale)


@pytest.mark.usefixtures("ways")
@ROBOTS
@pytest.mark.parametrize("seed", range(12))
def test_torque_is_minus_the_gradient_of_the_energy(robot, seed: int) -> None:
    random, model = np.random.default_rng(seed), robot()
    modules = guarded(random, model, count=2)
    q, still = modules.posture, np.zeros(model.n)
    found, _ = summed(model, modules, q, still)
    slope = [
        (summed(model, modules, q + h, still)[1] - summed(model, modules, q - h, still)[1]) / 2e-6
        for h in 1e-6 * np.eye(model.n)
    ]
    np.testing.assert_allclose(found.desired, -np.array(slope), atol=1e-4 * max(1.0, np.abs(slope).max()))


@given(SEEDS)
@settings(max_examples=60)
def test_distance_is_that_of_the_nearest_point_of_the_body(seed: int) -> None:
    """Against points sampled on the body: no point is nearer, and one step along -n from outside meets it."""
    random, model = np.random.default_rng(seed), baxter()
    modules = guarded(random, model)
    spec = modules.obstacles[0].spec
    kinematics = Kinematics(model, modules.frames)
    kinematics.update(modules.posture, np.zeros(model.n))
    laid_out = obstacles_at(modules.obstacles, kinematics)
    point, normal = np.array(spec.position) + random.normal(size=3) * 0.3, np.zeros(3)
    d = clear(laid_out, 0, point, normal)
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    axes, size = exp3(np.array(spec.rotation)), np.array(spec.size)
    local = axes.T @ (point - spec.position)
    if spec.shape == "sphere":
        assert d == pytest.approx(np.linalg.norm(local) - size[0] / 2)
    elif spec.shape == "plane":
        assert d == pytest.approx(local[2])
    elif spec.shape == "capsule":
        along = np.linspace(-size[1] / 2, size[1] / 2, 20001)
        line = np.linalg.norm(local - np.outer(along, [0, 0, 1]), axis=1).min()
        assert d == pytest.approx(line - size[0] / 2, abs=1e-6)
    elif d > 0.0:
        assert d == pytest.approx(np.linalg.norm(local - np.clip(local, -size / 2, size / 2)))
    else:
        assert d == pytest.approx(np.max(np.abs(local) - size / 2))
    if d > 0.0:
        assert clear(laid_out, 0, point - d * normal, np.zeros(3)) == pytest.approx(0.0, abs=1e-9)


@given(st.floats(-0.2, 0.5), st.floats(1, 1000), st.floats(0.01, 0.3))
def test_push_is_nothing_beyond_its_distance_and_bounded_everywhere(s: float, k: float, D: float) -> None:
    h = 1e-6
    slope = (push_energy(k, D, s + h) - push_energy(k, D, s - h)) / (2 * h)
    assert push_energy(k, D, min(s, 0.0)) == 0.0
    assert slope == pytest.approx(k * min(max(s, 0.0), D), abs=k * h + 1e-6)
    assert slope <= k * D * (1.0 + 1e-6) + 1e-6


@given(SEEDS)
@settings(max_examples=25)
def test_damper_takes_energy_and_relaxing_leaves_it(seed: int) -> None:
    random, model = np.random.default_rng(seed), baxter()
    modules = guarded(random, model, count=2)
    q, v = modules.posture, random.normal(size=model.n)
    moving, still = (
        summed(model, modules, q, velocity)[0].obstacles.effort.copy() for velocity in (v, 0 * v)
    )
    assert float((moving - still).sum(axis=0) @ v) <= 1e-12
    relaxed = summed(model, modules, q, v, 0.25)[0].obstacles.effort
    np.testing.assert_allclose(relaxed, 0.25 * still + (moving - still), atol=1e-10)


@pytest.mark.parametrize("seed", range(8))
def test_joint_stiffness_is_minus_the_derivative_of_the_torque(seed: int) -> None:
    random, model = np.random.default_rng(seed), baxter()
    modules = guarded(random, model)

    def coupled(q: np.ndarray):
        kinematics = Kinematics(model, modules.frames)
        kinematics.update(q, np.zeros(model.n))
        return joint_coupling(
            modules, kinematics, start_equilibrium(modules), phase_damping(modules, kinematics)
        )

    q = modules.posture
    slope = np.array(
        [(coupled(q + h).effort - coupled(q - h).effort) / 2e-6 for h in 1e-6 * np.eye(model.n)]
    ).T
    found = coupled(q)
    np.testing.assert_allclose(found.stiffness, -slope, atol=1e-4 * max(1.0, np.abs(slope).max()))
    assert np.linalg.eigvalsh(found.damping)[0] >= -1e-9


def checked(folder: Path, text: str):
    path = folder / "task.yaml"
    path.write_text(text)
    assembly = assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)
    return assembly, refuse_infeasible(assembly)


def test_check_says_how_near_the_hand_comes_and_what_leads_through(tmp_path: Path) -> None:
    assembly, prediction = checked(tmp_path, TASK)
    (one,) = prediction.approaches
    assert 0.02 < one.clearance < 0.05 and one.push == pytest.approx(1200 * (0.05 - one.clearance))
    notes = "\n".join(forecast_task(assembly, prediction).notes)
    assert "'right_hand' comes within" in notes and "leads through 'post'" in notes


def test_a_posture_or_a_way_inside_an_obstacle_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadFile, match=r"obstacles\[0\]: 'right_hand' begins \d+ mm inside this obstacle"):
        checked(tmp_path, TASK.replace("[0.61, -0.17, 0.1]", "[0.6, -0.25, 0.1]"))
    weak = TASK.replace("stiffness: 1200", "stiffness: 20").replace("[0.03, 0.4]", "[0.06, 0.4]")
    with pytest.raises(BadFile, match=r"obstacles\[0\]: 'right_hand' is predicted to come \d+ mm inside"):
        checked(tmp_path, weak)


def test_analyze_counts_its_stiffness(tmp_path: Path) -> None:
    """Where the push begins, 45 mm from the surface: the hand is stiffer towards it by about the push's stiffness."""
    beside = TASK.replace("[0.61, -0.17, 0.1]", "[0.6, -0.19, 0.1]")
    path = tmp_path / "task.yaml"
    found = []
    for text in (TASK, beside):
        path.write_text(text)
        assembly = assemble(str(path), effects=None, rate=None, scale=1.0, arm=None)
        found.append(analyse_task(assembly, None).arms["right"].stiffness[1, 1])
    assert found[1] - found[0] == pytest.approx(1200.0, rel=0.05)


def test_one_arm_keeps_the_guards_of_that_arm() -> None:
    assembly = assemble("around-a-post", effects=None, rate=None, scale=0.5, arm="right")
    (one,) = assembly.modules.obstacles
    assert one.spec.stiffness == 600.0 and one.frames == ("right_hand",)
    assert replace(one.spec, damping=0.0).largest_force == pytest.approx(30.0)
