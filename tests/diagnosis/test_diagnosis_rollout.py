# SPDX-License-Identifier: BSD-3-Clause
"""Re-seeded rollouts of the plant: what they measure, and what a diagnosis makes of them."""

from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from impedance_modules.diagnosis.data.nominal_model import model_of_urdf
from impedance_modules.diagnosis.data.rigid_tree import read_tree
from impedance_modules.diagnosis.gap_result import total_shrink
from impedance_modules.diagnosis.report.diagnosis_files import rollout_object
from impedance_modules.diagnosis.rollout.rollout_error import floor_of_repeats, judge
from impedance_modules.diagnosis.rollout.simulated_robot import (
    apply_causes,
    body_changes,
    no_nuisance,
    robot_of_model,
)
from impedance_modules.diagnosis.rollout_result import LeftOut, no_rollout
from impedance_modules.effects.joint_motion import JointHistory
from impedance_modules.errors import BadInput
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.plant.rollout_plant import RolloutPlant, RolloutStart
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.patch_file import EffectSpec, PatchQuantity, read_patch
from impedance_modules.spec.schema import load_schema
from tests.diagnosis import test_diagnosis as pendulum
from tests.diagnosis.test_diagnosis import diagnosed
from tests.support.plant_recordings import MOVING, START, patch_text, record, robot_folder, two_joints

VISCOUS = patch_text("viscous_friction", "actuator", "port_lift", fv=(4.0, "N.m.s/rad"))


def causes(found: dict, effect: str, joint: str) -> list[dict]:
    return [cause for cause in found["causes"] if cause["effect"] == effect and joint in cause["joints"]]


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return robot_folder(tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def viscous(tmp_path_factory: pytest.TempPathFactory, robot: Path) -> tuple[Path, list[Path], dict]:
    """Recordings of a plant with friction, and their diagnosis with its patch."""
    folder = tmp_path_factory.mktemp("viscous")
    logs = record(folder, robot, VISCOUS)
    _, found = diagnosed(folder, *logs, "--robot", robot, "--patch", folder / "found.yaml")
    return folder, logs, found


def test_the_command_drives_whole_joints_and_the_cause_closes_the_gap(viscous: tuple) -> None:
    found = viscous[2]
    rollout = found["gap"]["rollout"]
    assert rollout["driven_by"] == "command" and rollout["noise_floor_from"] == "repeats"
    assert rollout["windows"] >= 10 and set(rollout["per_joint"]) == set(MOVING)
    lift = rollout["per_joint"]["port_lift"]["position"]
    assert lift["before"] > 20.0 * lift["noise_floor"]
    assert lift["after"] < 2.0 * lift["noise_floor"]
    growth = rollout["growth"]["before"]["port_lift"]
    assert growth == sorted(growth)
    (cause,) = causes(found, "viscous_friction", "port_lift")
    assert cause["rollout"]["verdict"] == "helps"


@pytest.fixture(scope="module")
def looped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The robot with joints that feed their torque back to their motors."""
    robot = robot_folder(tmp_path_factory.mktemp("looped"))
    text = (robot / "robot.yaml").read_text().replace("turn: rigid", "turn: 1200")
    (robot / "robot.yaml").write_text(text + "\ninner_torque_loop: {gain: 1.5}\n")
    return robot


def test_friction_behind_an_inner_torque_loop_is_found_with_its_own_size(
    tmp_path: Path, looped: Path
) -> None:
    """The loop hides most of a drive's friction from the command; the motor's torque is computed back."""
    logs = record(tmp_path, looped, VISCOUS)
    _, found = diagnosed(tmp_path, *logs, "--robot", looped)
    (cause,) = causes(found, "viscous_friction", "port_lift")
    assert cause["port"] == "actuator"
    assert cause["parameters"]["port_lift"]["fv"]["value"] == pytest.approx(4.0, rel=0.1)
    assert cause["rollout"]["verdict"] == "helps"


def test_clean_recordings_behind_an_inner_torque_loop_name_nothing(tmp_path: Path, looped: Path) -> None:
    _, found = diagnosed(tmp_path, *record(tmp_path, looped, None), "--robot", looped)
    assert found["causes"] == []


def test_with_the_patch_applied_neither_torque_nor_rollout_shows_the_gap(viscous: tuple, robot: Path) -> None:
    folder, logs, found = viscous
    _, again = diagnosed(folder, *logs, "--robot", robot, "--effects", folder / "found.yaml")
    assert not causes(again, "viscous_friction", "port_lift")
    first, second = (f["gap"]["rollout"]["per_joint"]["port_lift"]["position"] for f in (found, again))
    assert second["before"] < 0.05 * first["before"]


@pytest.mark.parametrize(
    ("truth", "stated"),
    [
        (
            patch_text("bench_spring", "contact", "port_lift", k=(12.0, "N.m/rad"), q0=(-0.3, "rad")),
            "bench_spring",
        ),
        (
            patch_text("parallel_spring", "link", "port_lift", k=(12.0, "N.m/rad"), q0=(-0.3, "rad")),
            "parallel_spring",
        ),
    ],
)
def test_the_patch_of_a_spring_says_whether_the_robot_carries_it(
    tmp_path: Path, robot: Path, truth: str, stated: str
) -> None:
    """The robot carries its own weight. A spring that it knows, it carries, too; one outside would change nothing."""
    logs, patch = record(tmp_path, robot, truth), tmp_path / "found.yaml"
    _, found = diagnosed(tmp_path, *logs, "--robot", robot, "--patch", patch)
    (cause,) = causes(found, "parallel_spring", "port_lift")
    assert [entry.effect for entry in read_patch(patch).effects] == [stated]
    _, again = diagnosed(tmp_path, *logs, "--robot", robot, "--effects", patch)
    assert not causes(again, "parallel_spring", "port_lift")
    if stated == "bench_spring":
        assert cause["rollout"]["verdict"] == "helps"
        first, second = (f["gap"]["rollout"]["per_joint"]["port_lift"]["position"] for f in (found, again))
        assert second["before"] < 0.05 * first["before"]


def test_causes_are_relative_to_numbers_that_a_patch_replaces(tmp_path: Path, robot: Path) -> None:
    """Told that a rotor weighs nothing, the diagnosis names its inertia, not the robot file's on top of it."""
    nothing = patch_text("reflected_inertia", "actuator", "port_bend", Ia=(0.0, "kg.m^2"))
    (tmp_path / "told.yaml").write_text(nothing)
    logs = record(tmp_path, robot, None)
    _, found = diagnosed(tmp_path, *logs, "--robot", robot, "--effects", tmp_path / "told.yaml")
    (cause,) = [c for c in found["causes"] if c["effect"] == "reflected_inertia"]
    assert cause["joints"] == ["port_bend"]
    assert cause["parameters"]["port_bend"]["Ia"]["value"] == pytest.approx(0.3, rel=0.1)


def test_a_cause_is_judged_by_ratios_and_only_when_clear() -> None:
    random = np.random.default_rng(3)
    noise = np.exp(0.3 * random.normal(size=20))
    size = 10.0 ** random.uniform(-2.0, 2.0, 20)
    assert judge(size * noise, size).verdict == "no difference"
    assert judge(3.0 * size * noise, size).verdict == "helps"
    assert judge(size, 3.0 * size * noise).verdict == "worsens"
    assert judge(3.0 * size[:1], size[:1]).verdict == "no difference"


def test_the_noise_floor_is_the_difference_of_repeats() -> None:
    random = np.random.default_rng(4)
    shared = np.repeat(random.normal(size=(200, 5, 3)), 2, axis=0)
    errors = shared + 0.1 * random.normal(size=shared.shape)
    pairs = [(i, i + 1) for i in range(0, 400, 2)]
    np.testing.assert_allclose(floor_of_repeats(errors, pairs), 0.1, rtol=0.1)
    floor = np.array([0.1, 0.1, 0.1])
    assert total_shrink(5.0 * floor, floor, floor) == 1.0
    assert total_shrink(5.0 * floor, 5.0 * floor, floor) == 0.0
    assert total_shrink(0.5 * floor, floor, floor) is None


def test_links_are_adjusted_only_as_far_as_they_stay_physical(robot: Path) -> None:
    tree = read_tree(robot / "six_joint_pair.urdf", MOVING)
    mild = 0.03 * tree.inertia
    assert [c.parameters for c in body_changes(tree.bodies, mild)] == [
        pytest.approx(tuple(0.03 * body.inertia)) for body in tree.bodies
    ]
    for change, body in zip(body_changes(tree.bodies, -3.0 * tree.inertia), tree.bodies, strict=True):
        assert 0.0 < change.parameters[0] / -body.inertia[0] < 1.0


def test_without_any_torque_the_reason_is_given_why_nothing_was_simulated(viscous: tuple) -> None:
    """What schema and user get when there is nothing to drive a plant with."""
    rollout = rollout_object(no_rollout(LeftOut("all", "no torque")))
    gap = {**viscous[2]["gap"], "rollout": rollout}
    jsonschema.validate({**viscous[2], "gap": gap}, load_schema("diagnosis"))
    assert rollout == {"windows": 0, "left_out": [{"what": "all", "why": "no torque"}]}


def test_continuous_joints_are_simulated_too(tmp_path: Path) -> None:
    """A URDF with a continuous joint, rigid drives, effort at the link alone."""
    logs, urdf = pendulum.record(tmp_path, "viscous_friction", seconds=8.0), tmp_path / "robot.urdf"
    urdf.write_text(pendulum.URDF.replace('"elbow" type="revolute"', '"elbow" type="continuous"'))
    rollout = diagnosed(tmp_path, *logs, "--urdf", urdf)[1]["gap"]["rollout"]
    assert rollout["driven_by"] == "effort"
    elbow = rollout["per_joint"]["elbow"]["position"]
    assert elbow["before"] > 20.0 * elbow["noise_floor"] and elbow["shrink"] > 0.95


def test_a_plant_from_the_same_state_moves_the_same_way(robot: Path) -> None:
    """Started amid a run, from its true state and with its torques, the plant goes on as the run did."""
    spec = two_joints(robot)
    options = PlantOptions(rate=1000.0, seed=0, noise=False, step=1e-3)
    model = RobotModel(replace(spec, gravity_compensation="none"))
    ran, seeded = (kind(model, [], None, options) for kind in (Plant, RolloutPlant))
    for plant in (ran, seeded):
        plant.reset(START)
    t = np.arange(400) / 1000.0
    commands = ran.start_command + np.column_stack([3.0 * np.sin(9.0 * t), 2.0 * np.sin(14.0 * t)])
    states = []
    for k, torque in enumerate(commands):
        states.append((ran.position, ran.velocity, ran.load, ran.motor_position, ran.motor_velocity))
        ran.advance(torque if k >= ran.delay else ran.start_command)
    begin = 100
    q, v, load, theta, w = states[begin]
    stiffness = 1.0 / model.spring_compliance()
    acting = commands[begin - ran.delay]
    now = one_motion(0.1, (q, v, theta, w, acting, load, acting, q, v))
    seeded.seed(RolloutStart(0.1, q, v, load, stiffness * (w - v), acting, now))
    positions, velocities = seeded.roll(commands[begin - ran.delay : -ran.delay], None)
    expected = np.array([state[:2] for state in states])
    np.testing.assert_allclose(positions[:-1], expected[begin + 1 :, 0], atol=1e-9)
    np.testing.assert_allclose(velocities[:-1], expected[begin + 1 :, 1], atol=1e-7)


def test_a_joint_that_runs_away_ends_its_window(robot: Path) -> None:
    """A light joint with a torque far beyond its own: what no computation can follow is no traceback."""
    options = PlantOptions(rate=1000.0, seed=0, noise=False, step=1e-3)
    plant = RolloutPlant(
        RobotModel(replace(two_joints(robot), gravity_compensation="none")), [], None, options
    )
    plant.reset(START)
    positions, velocities = plant.roll(np.full((400, 2), 1e12), None)
    assert np.isnan(positions[-1]).all() and np.isnan(velocities[-1]).all()
    assert np.isfinite(plant.position).all() and np.isfinite(plant.velocity).all()


def one_motion(time: float, arrays: tuple[np.ndarray, ...]) -> JointHistory:
    """A history of one motion, its fields in their order."""
    names = [field.name for field in JointHistory._layout.fields]
    return JointHistory(
        **dict(zip(names, [np.array([time]), *(a[None].copy() for a in arrays)], strict=True))
    )


SLIDE = """<robot name="slide"><link name="base"/>
<link name="cart"><inertial><mass value="5"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="rail" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-3" upper="3" velocity="9" effort="50"/></joint></robot>"""


def test_a_prismatic_joint_has_friction_in_its_own_units(tmp_path: Path) -> None:
    (tmp_path / "slide.urdf").write_text(SLIDE)
    model = model_of_urdf(tmp_path / "slide.urdf", ["rail"])
    robot = robot_of_model(model, tmp_path / "slide.urdf", "effort", "none")

    def friction(unit: str) -> EffectSpec:
        numbers = {"rail": {"fv": PatchQuantity(4.0, unit, None)}}
        return EffectSpec("viscous_friction", ("rail",), "link", numbers, {})

    perturbed = apply_causes(robot, [friction("N.s/m")], no_nuisance(model.tree), model.tree)
    still, rest = np.zeros(1), np.ones(1)
    now = one_motion(0.0, (still, rest, still, rest, still, still, still, still, still))
    perturbed.plant.seed(RolloutStart(0.0, still, rest, still, still, still, now))
    _, velocity = perturbed.plant.roll(np.zeros((500, 1)), None)
    assert velocity[-1, 0] == pytest.approx(np.exp(-4.0 / 5.0 * 0.5), rel=1e-6)
    with pytest.raises(BadInput, match=r"fv is in N\.s/m, not in 'N\.m\.s/rad'"):
        apply_causes(robot, [friction("N.m.s/rad")], no_nuisance(model.tree), model.tree)


def test_the_weak_floor_follows_from_noise_of_state_and_torque(tmp_path: Path) -> None:
    """Recordings that match the model but for noise: rollouts stray by about the floor, without any repeat."""
    logs = pendulum.record(tmp_path, "nothing", seconds=12.0)[2:]
    rollout = pendulum.answer(tmp_path, logs)[1]["gap"]["rollout"]
    assert rollout["noise_floor_from"] == "weak"
    for joint in rollout["per_joint"].values():
        for found in joint.values():
            assert 0.3 < found["after"] / found["noise_floor"] < 3.0
