# SPDX-License-Identifier: BSD-3-Clause
"""MuJoCo's robot obeys the plant's equations: open loop it moves as the plant does, with every effect that it has."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.backends.mujoco.contact_law import CONTACT_IMPEDANCE, softness
from impedance_modules.backends.mujoco.mujoco_plant import MujocoPlant
from impedance_modules.backends.mujoco.scene import build_scene
from impedance_modules.backends.mujoco.worn_effects import worn_effects
from impedance_modules.effects.apply import apply_patch, apply_to_plant
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.errors import BadFile, PlantNotFinite
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.plant.rigid_object import ObjectBody
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.task import PushSpec, SurfaceSpec
from tests.support.effect_recordings import AppliedEffect, applied, patch_of, start
from tests.support.plant_parts import SIX_JOINTS, box, exact, spec_of, undamped

RATE = 1000.0
A, L, S, P = "actuator", "link", "sensor", "port_"

WORN = {
    "viscous_friction": [applied("viscous_friction", port, P + "lift", fv=1.7) for port in (A, L)],
    "coulomb_friction": [applied("coulomb_friction", port, P + "lift", fc=1.7) for port in (A, L)],
    "quadratic_drag": [applied("quadratic_drag", A, P + "lift", c=2.2)],
    "reflected_inertia": [applied("reflected_inertia", A, P + "lift", Ia=0.9)],
    "joint_elasticity": [applied("joint_elasticity", A, P + "lift", K=300.0)],
    "payload": [applied("payload", L, P + "flange", m=0.9, cx=0.04, cy=0.02, cz=0.1)],
    "base_tilt": [applied("base_tilt", L, "base", rx=0.1, ry=-0.2)],
    "parallel_spring": [applied("parallel_spring", L, P + "lift", k=90.0, preload=-9.0)],
    "bench_spring": [applied("bench_spring", "contact", P + "lift", k=9.0, q0=0.3, d=0.2)],
    "torque_gain": [applied("torque_gain", A, P + "lift", s=0.8)],
    "torque_saturation": [applied("torque_saturation", A, P + "lift", limit=14.0)],
    "actuator_lag": [applied("actuator_lag", A, P + "lift", T=0.02)],
    "command_delay": [applied("command_delay", "timing", P + "lift", T=0.02)],
    "crosstalk": [applied("crosstalk", A, f"{P}lift<-{P}bend", c=0.2)],
    "encoder_offset": [applied("encoder_offset", S, P + "lift", dq0=0.05)],
}
"""Effects, at the ports where MuJoCo's robot has them."""

REFUSED = [
    applied("hysteresis", A, P + "lift", s0=900.0, fc=1.0),
    applied("torque_ripple", A, P + "lift", A=1.0, N=8.0),
    applied("friction_drift", A, P + "lift", fv=1.0, k=0.5, T=10.0),
    applied("buoyancy", L, P + "flange", m=0.5, cx=0.0, cy=0.0, cz=0.0),
]


def pull(time: float) -> np.ndarray:
    """Torques (12,) on both arms beside those that carry their weight [N.m]."""
    joint = np.arange(12)
    size = np.array([6.0, 6.0, 4.0, 0.7, 0.7, 0.4] * 2)
    return (-1.0) ** joint * size * np.sin(7.0 * time + joint)


def robot_on_mujoco(
    spec: RobotSpec,
    entries: list[AppliedEffect] = (),
    surfaces: tuple[SurfaceSpec, ...] = (),
    held: ObjectBody | None = None,
    pushes: tuple[PushSpec, ...] = (),
    at: Callable[[RobotModel], np.ndarray] = start,
) -> MujocoPlant:
    patch = patch_of("six_joint_pair", entries) if entries else None
    model = RobotModel(spec if patch is None else apply_patch(spec, patch))
    worn = worn_effects(model, patch)
    scene = build_scene(model, surfaces, held, at(model), worn.plant)
    subject = MujocoPlant(model, scene, worn, PlantOptions(rate=RATE, seed=0), pushes)
    subject.reset(at(model))
    return subject


def built_in(spec: RobotSpec, entries: list[AppliedEffect] = (), **more: object) -> Plant:
    patch = patch_of("six_joint_pair", entries) if entries else None
    model = RobotModel(spec if patch is None else apply_patch(spec, patch))
    effects = None if patch is None else apply_to_plant(model, patch)
    surfaces, held = more.pop("surfaces", ()), more.pop("held", None)
    subject = Plant(model, surfaces, held, PlantOptions(rate=RATE, seed=0), effects, **more)
    subject.reset(start(model))
    return subject


def motion(
    subject: Plant | MujocoPlant, seconds: float = 0.4, strength: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and measured torques of a pull from the start, (N, 12) each."""
    rows = []
    for k in range(round(seconds * RATE)):
        subject.advance(subject.start_command + strength * pull(k / RATE))
        state = subject.sense()
        rows.append((state.position, state.effort))
    positions, efforts = zip(*rows, strict=True)
    return np.array(positions), np.array(efforts)


def palms_on_a_box(model: RobotModel) -> np.ndarray:
    """Palms 0.3 m apart that face each other, as the robot's file says."""
    angles = {
        "turn": 0.13236,
        "lift": 0.97313,
        "bend": -1.85784,
        "roll": -1.67345,
        "tilt": 1.6545,
        "spin": 0.68178,
    }
    mirrored = {name: -angle if name in ("roll", "tilt") else angle for name, angle in angles.items()}
    return model.position({"port": angles, "starboard": mirrored})


def apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max())


def test_without_effects_both_move_and_measure_alike() -> None:
    spec = exact(spec_of(SIX_JOINTS))
    (q, effort), (q_mujoco, effort_mujoco) = motion(built_in(spec)), motion(robot_on_mujoco(spec))
    assert np.ptp(q, axis=0).min() > 0.02, "every joint moves"
    assert apart(q, q_mujoco) < 1e-3
    assert apart(effort, effort_mujoco) < 0.02 * np.ptp(effort)


@cache
def nominal_motions() -> tuple[np.ndarray, np.ndarray]:
    spec = exact(spec_of(SIX_JOINTS))
    return motion(built_in(spec))[0], motion(robot_on_mujoco(spec))[0]


@pytest.mark.parametrize("name", WORN)
def test_an_effect_changes_mujocos_robot_as_it_changes_the_plant(name: str) -> None:
    spec = exact(spec_of(SIX_JOINTS))
    (q, effort), (q_mujoco, effort_mujoco) = (
        motion(make(spec, WORN[name])) for make in (built_in, robot_on_mujoco)
    )
    nominal, nominal_mujoco = nominal_motions()
    changed = apart(q, nominal)
    assert changed > 2e-3
    assert apart(q - nominal, q_mujoco - nominal_mujoco) < 0.1 * changed
    assert apart(effort[100:], effort_mujoco[100:]) < 0.1 * np.ptp(effort)


def test_play_lets_the_motor_lead_its_loaded_link_by_half_the_gap() -> None:
    """At rest theta - q = tau / K + b / 2; within the gap nothing is passed on, and the link falls freely."""
    spec = exact(spec_of(SIX_JOINTS))
    subject = robot_on_mujoco(spec, [applied("backlash", A, P + "lift", b=0.06)])
    joint = subject.model.joint_names.index(P + "lift")
    for _ in range(300):
        subject.advance(subject.start_command)
    state, lead = subject.sense(), subject.motor_position - subject.position
    stiffness = subject.model.joints[joint].spring_stiffness
    assert abs(state.effort[joint]) > 3.0
    expected = state.effort[joint] / stiffness + 0.03 * np.sign(state.effort[joint])
    assert lead[joint] == pytest.approx(expected, abs=1e-9)
    away = subject.start_command.copy()
    away[joint] -= 20.0 * np.sign(state.effort[joint])
    while abs(lead[joint]) > 0.029:
        subject.advance(away)
        lead = subject.motor_position - subject.position
    assert subject.sense().effort[joint] == 0.0


@pytest.mark.parametrize("entry", REFUSED, ids=lambda entry: entry.effect)
def test_what_it_cannot_have_is_refused_by_its_name(entry: AppliedEffect) -> None:
    spec = exact(spec_of(SIX_JOINTS))
    with pytest.raises(BadFile) as refused:
        robot_on_mujoco(spec, [*WORN["payload"], entry])
    said = str(refused.value)
    assert entry.effect in said and "--backend sim" in said and "payload" not in said
    assert CATALOGUE[entry.effect].not_exported in said


def test_a_start_with_a_held_box_is_an_equilibrium() -> None:
    spec = exact(spec_of(SIX_JOINTS))
    model = RobotModel(spec)
    hands = tuple(limb.hand for limb in model.limbs.values())
    for grasp, friction in (("weld", None), ("friction", 0.6)):
        held = ObjectBody(
            box(
                held_by=tuple(model.limbs), grasp=grasp, friction=friction, squeeze=20.0, size=(0.2, 0.3, 0.2)
            ),
            hands,
        )
        subject = robot_on_mujoco(spec, held=held, at=palms_on_a_box)
        mujoco.mj_forward(subject.scene.compiled, subject.data)
        assert np.abs(subject.data.qacc).max() < 0.5, grasp
        place = subject.data.body("impedance/object").xpos.copy()
        for _ in range(1000):
            subject.advance(subject.start_command)
        assert apart(subject.data.body("impedance/object").xpos, place) < 1e-3, grasp


@settings(max_examples=20, deadline=None)
@given(
    mass=st.floats(0.05, 20.0),
    stiffness=st.floats(500.0, 20000.0),
    ratio=st.floats(0.5, 1.5),
)
def test_a_body_sinks_into_a_surface_as_far_as_its_spring_says(
    mass: float, stiffness: float, ratio: float
) -> None:
    """m g = k r, whatever the mass and however damped."""
    spec = mujoco.MjSpec()
    spec.option.timestep = 2.5e-4
    ball = spec.worldbody.add_body(
        mass=mass, ipos=np.zeros(3), inertia=np.full(3, mass), explicitinertial=True
    )
    ball.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, 1.0])
    ball.add_geom(name="ball", size=[0.1, 0.0, 0.0], contype=0)
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, pos=[0.0, 0.0, -0.1], size=[0, 0, 1], contype=0
    )
    damping = 2.0 * ratio * np.sqrt(mass * stiffness)
    soft = softness(stiffness, damping, 1.0 / mass, CONTACT_IMPEDANCE)
    spec.add_pair(geomname1="ball", geomname2="floor", condim=1, solref=soft.solref, solimp=soft.solimp)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, round(40.0 * ratio * np.sqrt(mass / stiffness) / 2.5e-4))
    assert -data.qpos[0] == pytest.approx(mass * 9.81 / stiffness, rel=1e-3)


def test_energy_comes_from_the_drives_alone() -> None:
    """Undamped, nobody compensating weight: kinetic and potential energy grow by the work of the command."""
    subject = robot_on_mujoco(undamped(spec_of(SIX_JOINTS)))
    physics, data = subject.scene.compiled, subject.data
    physics.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    mujoco.mj_forward(physics, data)
    before = float(data.energy.sum())
    motion(subject, 0.3)
    mujoco.mj_forward(physics, data)
    gained = float(data.energy.sum()) - before
    assert abs(subject.motor_work) > 0.5
    assert gained == pytest.approx(subject.motor_work, abs=0.02 * abs(subject.motor_work))


def test_a_push_gives_a_loose_box_its_momentum() -> None:
    spec = exact(spec_of(SIX_JOINTS))
    push = PushSpec("object", (3.0, 0.0, 0.0, 0.0, 0.0, 0.0), start=0.0, rise=0.0, hold=0.2, fall=0.0)
    loose = ObjectBody(box(position=(2.0, 0.0, 1.0), mass=2.0), ())
    subject = robot_on_mujoco(spec, held=loose, pushes=(push,))
    for _ in range(300):
        subject.advance(subject.start_command)
    velocity = subject.data.joint("impedance/object").qvel
    assert velocity[:3] == pytest.approx([0.3, 0.0, -9.81 * 0.3], rel=1e-6, abs=1e-9)
    assert np.abs(velocity[3:]).max() < 1e-9


def test_no_command_beyond_the_joints_effort_reaches_the_motor() -> None:
    subject = robot_on_mujoco(exact(spec_of(SIX_JOINTS)))
    limit = subject.model.column("effort_max")
    subject.advance(10.0 * limit)
    subject.sense()
    forces = subject.data.actuator_force[subject.scene.indices.command]
    np.testing.assert_allclose(forces, limit)


def test_silence_beyond_the_time_out_holds_the_robot() -> None:
    subject = robot_on_mujoco(exact(spec_of(SIX_JOINTS)))
    motion(subject, 0.1)
    for _ in range(round(0.6 * RATE)):
        subject.advance(None)
    held = subject.position.copy()
    for _ in range(round(0.2 * RATE)):
        subject.advance(None)
    assert np.abs(subject.velocity).max() < 1e-2 and apart(subject.position, held) < 1e-3


def test_a_state_that_flies_apart_is_said() -> None:
    subject = robot_on_mujoco(exact(spec_of(SIX_JOINTS)))
    subject.data.qvel[3] = np.nan
    with pytest.raises(PlantNotFinite, match=r"not finite at 0\.0010 s in MuJoCo"):
        subject.advance(None)
