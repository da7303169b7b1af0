# SPDX-License-Identifier: BSD-3-Clause
"""Effects within the plant's step: one text both ways, the same step for all of them, and the laws they state."""

import copy
from collections.abc import Iterator
from itertools import pairwise, product

import numpy as np
import pinocchio as pin
import pytest

from impedance_modules.compiled import Law, compiled, use_machine_code
from impedance_modules.effects.drive_path import DrivePath
from impedance_modules.effects.effect import JointLaw
from impedance_modules.effects.hysteresis import BristleTorque
from impedance_modules.effects.joint_law_torque import LawTorque, PythonLawTorque
from impedance_modules.effects.joint_motion import CompiledTorque, JointSample, Shape, joint_motion
from impedance_modules.effects.link_poses import (
    add_point_force,
    on_joint_axes,
    point_of_link,
    point_velocity,
    poses_at,
)
from impedance_modules.effects.plant_builder import PlantBuilder
from impedance_modules.errors import BadInput
from impedance_modules.plant.integrator import advance_steps
from impedance_modules.plant.joints import ELASTIC
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.records import Matrix, Row, Vector
from impedance_modules.robot.model import RobotModel
from tests.effects.test_effects_applied import RUNS
from tests.support.effect_recordings import applied, nominal, plant_with, start
from tests.support.plant_parts import SIX_JOINTS, spec_of


@pytest.fixture(autouse=True)
def as_before() -> Iterator[None]:
    before = Law.in_machine_code
    yield
    Law.in_machine_code = before


def moved(plant: Plant, periods: int, seed: int = 0) -> np.ndarray:
    """Where a plant is after random torques."""
    random = np.random.default_rng(seed)
    for _ in range(periods):
        plant.aim(plant.position + 0.1, np.full(plant.model.n, 0.2))
        plant.advance(plant.start_command + 3.0 * random.normal(size=plant.model.n))
    return plant.state.start.whole.copy()


@pytest.mark.parametrize("run", [run for run in RUNS if run not in ("sensors", "clock", "play")])
def test_every_effect_moves_the_plant_alike_both_ways(run) -> None:
    ends = []
    for on in (False, True):
        plant = plant_with(nominal(0.3), RUNS[run])
        plant.reset(start(plant.model))
        moved(plant, 1)
        use_machine_code(on)
        ends.append(moved(plant, 3))
        use_machine_code()
    nothing = plant_with(nominal(0.3), ())
    nothing.reset(start(nothing.model))
    moved(nothing, 1)
    assert np.abs(moved(nothing, 3) - ends[0]).max() > 1e-6
    np.testing.assert_allclose(*ends, rtol=1e-11, atol=1e-11)


def test_no_set_of_effects_needs_machine_code_of_its_own_for_the_step() -> None:
    use_machine_code()
    for run in ("motors", "links", "drives", "water"):
        plant = plant_with(nominal(0.3), RUNS[run])
        plant.reset(start(plant.model))
        plant.advance(plant.start_command)
    assert len(advance_steps.machine_code.overloads) == 1


def test_a_plant_with_effects_is_not_copied() -> None:
    plant = plant_with(nominal(0.3), RUNS["motors"])
    with pytest.raises(BadInput, match="cannot be copied"):
        copy.deepcopy(plant.state)
    assert copy.deepcopy(plant_with(nominal(0.3), ()).state).n == plant.model.n


@compiled
def cubic(sample: Row, shape: Vector, columns: Matrix) -> None:
    """v^3."""
    columns[0] = sample.velocity**3


class Cubic(JointLaw):
    """An effect with a compiled text."""

    law = cubic


class PythonCubic(JointLaw):
    """The same one in Python."""

    def basis(self, sample: JointSample, shape: Shape) -> np.ndarray:
        """v^3."""
        return (sample.velocity**3)[..., None]


@pytest.mark.parametrize("port", ["actuator", "link"])
def test_an_effect_in_python_is_the_same_as_one_with_a_compiled_text(port) -> None:
    ends = []
    for effect, kind in ((Cubic(), LawTorque), (PythonCubic(), PythonLawTorque)):
        model = RobotModel(nominal(0.3))
        builder = PlantBuilder(model)
        names = model.joint_names
        text = effect.law
        coefficients = np.linspace(1.0, 3.0, len(names))[:, None]
        builder.add_law(effect.basis, port, names, coefficients=coefficients, shape={}, text=text)
        (torque,) = builder.torques
        assert isinstance(torque, kind) and isinstance(torque, CompiledTorque) == (kind is LawTorque)
        plant = Plant(model, [], None, PlantOptions(1000.0, 0, noise=False, step=0.5e-3), builder.finish())
        plant.reset(start(model))
        ends.append(moved(plant, 30))
    np.testing.assert_allclose(*ends, rtol=1e-11, atol=1e-13)


def test_a_law_without_text_and_basis_is_refused() -> None:
    with pytest.raises(TypeError, match="has no law"):
        type("Empty", (JointLaw,), {})


def test_a_force_on_a_link_loads_the_joints_by_its_jacobian(ways) -> None:
    model, random = RobotModel(spec_of(SIX_JOINTS)), np.random.default_rng(1)
    data, axes = model.pin_model.createData(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    for link in ("port_palm", "starboard_forearm"):
        q, v, force, offset = (random.normal(size=size) for size in (model.n, model.n, 3, 3))
        links, (body, place, turned) = poses_at(model, q), on_joint_axes(model, link, offset)
        J = pin.computeFrameJacobian(model.pin_model, data, q, model.frame_id(link), axes)
        pin.updateFramePlacements(model.pin_model, data)
        frame = data.oMf[model.frame_id(link)]
        arm = frame.rotation @ offset
        point, torque, velocity = np.zeros(3), np.zeros(model.n), np.zeros(3)
        point_of_link(links, body, place, point)
        np.testing.assert_allclose(point, frame.translation + arm, atol=1e-12)
        np.testing.assert_allclose(links.rotation[body] @ turned, frame.rotation, atol=1e-12)
        add_point_force(links, body, point, force, torque)
        np.testing.assert_allclose(torque, J.T @ [*force, *np.cross(arm, force)], atol=1e-12)
        point_velocity(links, body, point, v, velocity)
        twist = J @ v
        np.testing.assert_allclose(velocity, twist[:3] + np.cross(twist[3:], arm), atol=1e-12)


def test_a_drive_delays_clips_scales_mixes_and_lags(ways) -> None:
    """Against the statement itself, sample by sample, with whole arrays."""
    n, step, random = 3, 0.5e-3, np.random.default_rng(4)
    delay, lag = np.array([0.0, 2.0, 3.0]) * step, np.array([0.0, 0.004, 0.001])
    limit, gain, mix = np.array([np.inf, 2.0, 1.5]), np.array([1.0, 0.9, 1.2]), np.zeros((n, n))
    mix[0, 2], mix[2, 1] = 0.2, -0.1
    drive, motion = DrivePath(delay, limit, gain, mix, lag), joint_motion(n)
    asked = 3.0 * random.normal(size=(40, n))
    assist = random.normal(size=n)
    motion.command[:], motion.drive[:] = asked[0], asked[0] + assist
    drive.start(motion, step)

    def wanted(k: int) -> np.ndarray:
        late = [asked[max(0, k - round(d / step)), i] for i, d in enumerate(delay)]
        clipped = np.clip(np.array(late) + assist, -limit, limit)
        return gain * clipped + mix @ clipped

    slow, share = wanted(0), np.where(lag > 0.0, 1.0 - np.exp(-step / np.maximum(lag, 1e-9)), 1.0)
    for k, command in enumerate(asked):
        motion.command[:], motion.drive[:] = command, command + assist
        now = np.where(lag > 0.0, slow + 0.5 * share * (wanted(k) - slow), wanted(k))
        np.testing.assert_allclose(drive.torque(motion), now - motion.drive, atol=1e-12)
        drive.settle(motion)
        slow = slow + share * (wanted(k) - slow)


def test_bristles_take_energy_and_slip_at_their_friction(ways) -> None:
    lacks = {1.0: lambda way: np.exp(-way), 1.5: lambda way: (1.0 + 0.5 * way) ** -2}
    for port, exponent in product(("motor", "link"), lacks):
        bristles = BristleTorque(port, np.array([1]), np.array([0.7]), np.array([0.02]), np.array([exponent]))
        motion = joint_motion(2)
        position = motion.motor_position if port == "motor" else motion.position
        bristles.start(motion, 1e-3)
        work, path = 0.0, np.concatenate([np.linspace(0.0, 0.3, 301), np.linspace(0.3, -0.1, 401)])
        torques = []
        for a, b in pairwise(path):
            position[1] = 0.5 * (a + b)
            torque = bristles.torque(motion)
            torques.append(torque[1])
            assert torque[0] == 0.0
            work += torque[1] * (b - a)
            position[1] = b
            bristles.settle(motion)
        slips = 0.7 * (1.0 - lacks[exponent](0.2995 / 0.02))
        assert torques[299] == pytest.approx(-slips, rel=1e-9) and slips <= torques[-1] < 0.7
        assert torques[5] == pytest.approx(-0.7 * (1.0 - lacks[exponent](0.0055 / 0.02)), rel=1e-9)
        assert work < -0.7 * 0.6


PAIRS = ("port_roll<-port_spin", "port_lift<-port_bend", "starboard_turn<-starboard_lift")


@pytest.mark.parametrize("pair", PAIRS)
def test_coupled_motors_load_each_other_by_their_accelerations(pair, ways) -> None:
    """What is added to each motor is minus the coupling inertia times the acceleration that comes of it."""
    plant = plant_with(nominal(0.3), (applied("transmission_coupling", "actuator", pair, Ia=0.004),))
    plant.reset(start(plant.model))
    moved(plant, 3)
    use_machine_code(ways == "machine code")
    plant.state.stage.whole[:] = plant.state.start.whole
    plant._integrator.rate()
    i, j = (plant.model.joint_names.index(name) for name in pair.split("<-"))
    elastic = plant.state.joints["kind"] == ELASTIC
    motors = np.where(elastic, plant.state.rate.motor_velocity, plant.state.acceleration)
    added = plant.state.joints["effect_motor"]
    assert abs(added[i]) > 1e-6
    np.testing.assert_allclose(added[[i, j]], -0.004 * motors[[j, i]], rtol=1e-9)
    assert np.count_nonzero(added) == 2
