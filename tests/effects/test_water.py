"""Laws of links under water: buoyancy is conservative, drag only takes energy, added mass is inertia without weight."""

import numpy as np
import pinocchio as pin

from impedance_modules.effects.joint_motion import joint_motion
from impedance_modules.effects.link_poses import poses_at
from impedance_modules.effects.water import BuoyancyTorque, DragTorque
from impedance_modules.plant.links import accelerate, link_table, place_links
from impedance_modules.robot.model import RobotModel
from tests.plant.test_plant_equations import random_tree
from tests.support.effect_recordings import applied, plant_with, start
from tests.support.plant_parts import SIX_JOINTS, spec_of, undamped

L = "link"
LIFT = applied("buoyancy", L, "port_palm", m=1.1, cx=0.02, cy=-0.03, cz=0.05)
ALONG = (
    applied(
        "added_mass", L, "port_forearm", mx=1.9, my=0.4, mz=0.1, Ix=0.004, Iz=0.006, cx=0.0, cy=0.03, cz=0.1
    ),
    applied("added_mass", L, "port_palm", mx=0.3, my=0.2, cx=0.0, cy=0.0, cz=0.02),
)
DRAG = applied("fluid_drag", L, "starboard_forearm", dx=9.0, dy=16.0, cx=0.0, cy=0.02, cz=0.12)


def moving(entries, seed: int):
    """An undamped robot that nobody drives, with effects, thrown from its start posture."""
    subject = plant_with(undamped(spec_of(SIX_JOINTS)), entries)
    subject.reset(start(subject.model))
    subject.place(np.random.default_rng(seed).uniform(-1, 1, subject.model.n), np.zeros(subject.model.n))
    return subject


def drift(subject, periods: int) -> None:
    for _ in range(periods):
        subject.advance(np.zeros(subject.model.n))


def sunk(subject, q: np.ndarray) -> float:
    """Energy that sinking the displaced water of ``LIFT`` has stored: -m g z of its centre [J]."""
    water, hand = LIFT.numbers, subject.model.pose(q, LIFT.key)
    centre = hand.translation + hand.rotation @ [water["cx"], water["cy"], water["cz"]]
    return -water["m"] * 9.81 * float(centre[2])


def test_buoyancy_is_the_slope_of_a_potential_and_gives_back_what_it_took() -> None:
    subject = moving((LIFT,), 1)
    (lift,) = (t for t in subject._integrator.effects if isinstance(t, BuoyancyTorque))
    random = np.random.default_rng(2)
    for q in random.uniform(-1.5, 1.5, (10, subject.model.n)):
        slope = [(sunk(subject, q + e) - sunk(subject, q - e)) / 2e-6 for e in 1e-6 * np.eye(q.size)]
        np.testing.assert_allclose(lift.lift(q), -np.array(slope), atol=1e-7)
    subject = moving((LIFT,), 1)
    before, low = subject.energy(), sunk(subject, subject.position)
    drift(subject, 200)
    after, high = subject.energy(), sunk(subject, subject.position)
    assert abs(high - low) > 0.05
    assert abs(after.effect_work + high - low) < 1e-6
    assert abs(after.imbalance(before)) < 1e-6


def test_buoyancy_lifts_by_the_weight_of_what_is_displaced() -> None:
    model = RobotModel(spec_of(SIX_JOINTS))
    q, centre = start(model), np.array([0.02, -0.03, 0.05])
    lift = BuoyancyTorque(model, {"port_palm": (1.1, centre)})
    data = model.pin_model.createData()
    palm, axes = model.frame_id("port_palm"), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    J = pin.computeFrameJacobian(model.pin_model, data, q, palm, axes)
    arm = model.pose(q, "port_palm").rotation @ centre
    force = np.array([0.0, 0.0, 1.1 * 9.81])
    expected = J.T @ np.concatenate([force, np.cross(arm, force)])
    np.testing.assert_allclose(lift.lift(q), expected, atol=1e-9)


def test_drag_takes_energy_in_every_motion_and_the_balance_holds() -> None:
    model = RobotModel(spec_of(SIX_JOINTS))
    random = np.random.default_rng(3)
    links = {"port_palm": (random.uniform(0, 20, 3), random.normal(size=3) * 0.1)}
    drag = DragTorque(model, links)
    for _ in range(50):
        links, v = poses_at(model, random.uniform(-2, 2, model.n)), random.normal(size=model.n)
        motion = joint_motion(model.n, links, velocity=v)
        assert drag.torque(motion) @ motion.velocity <= 0.0
    once = drag.torque(motion)
    motion.velocity[:] *= 3.0
    np.testing.assert_allclose(drag.torque(motion), 9.0 * once, rtol=1e-12)
    subject = moving((DRAG,), 4)
    before = subject.energy()
    drift(subject, 150)
    after = subject.energy()
    assert after.effect_work < -1e-3
    assert abs(after.imbalance(before)) < 1e-6 * before.kinetic + 1e-9


def test_added_mass_alike_in_all_directions_is_a_point_mass_without_weight() -> None:
    """On random trees, against pinocchio's own rigid bodies whose weight is carried by somebody."""
    random = np.random.default_rng(5)
    pin.seed(5)
    for joints in range(1, 15):
        model = random_tree(random, joints)
        heavy, water = pin.Model(model), np.zeros((joints, 6, 6))
        for i in range(joints):
            mass, centre = random.uniform(0.1, 3.0), random.normal(size=3)
            X = pin.SE3(np.eye(3), centre).inverse().action
            water[i] = X.T @ np.diag([mass, mass, mass, 0.0, 0.0, 0.0]) @ X
            heavy.appendBodyToJoint(i + 1, pin.Inertia(mass, centre, np.zeros((3, 3))), pin.SE3.Identity())
        table, acceleration = link_table(model, water), np.empty(joints)
        q, v, torque = random.normal(size=(3, joints))
        place_links(table, q)
        accelerate(table, v, torque, acceleration)
        weight = [np.array(pin.computeGeneralizedGravity(m, m.createData(), q)) for m in (heavy, model)]
        expected = pin.aba(heavy, heavy.createData(), q, v, torque + weight[0] - weight[1])
        np.testing.assert_allclose(acceleration, expected, rtol=1e-8, atol=1e-9 * np.abs(expected).max())


def test_added_mass_keeps_energy_and_only_adds_inertia() -> None:
    """Different along every axis, no rigid body has it: energy is conserved still, and no motion gets lighter."""
    subject = moving(ALONG, 6)
    dry = moving((), 6)
    water = subject.state.links["added_mass"][1:]
    assert min(np.linalg.eigvalsh(w).min() for w in water) > -1e-12
    before = subject.energy()
    assert before.links > dry.energy().links + 0.01
    drift(subject, 200)
    assert np.abs(subject.position - dry.position).max() > 0.05
    assert abs(subject.energy().imbalance(before)) < 1e-6 * before.kinetic
    dry.reset(subject.position)
    wet, without = subject._integrator.link_mobility(), dry._integrator.link_mobility()
    assert np.linalg.eigvalsh(without - wet).min() > -1e-9
    np.testing.assert_allclose(wet, responses(subject), atol=1e-9)


def responses(subject) -> np.ndarray:
    """Accelerations of the plant's links at rest per unit torque on each joint (n, n)."""
    n, table = subject.model.n, subject.state.links
    place_links(table, subject.position)
    out = np.empty((n + 1, n))
    for i, torque in enumerate(np.vstack([np.eye(n), np.zeros(n)])):
        accelerate(table, np.zeros(n), torque, out[i])
    return (out[:n] - out[n]).T


def test_added_mass_has_no_weight() -> None:
    subject = plant_with(spec_of(SIX_JOINTS), ALONG)
    subject.reset(start(subject.model))
    for _ in range(100):
        subject.advance(subject.start_command)
    assert np.abs(subject.position - start(subject.model)).max() < 1e-5
