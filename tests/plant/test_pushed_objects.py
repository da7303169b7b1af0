# SPDX-License-Identifier: BSD-3-Clause
"""Objects pushed in, through and out of two hands: finite, no energy from nowhere, momentum kept, held again."""

from __future__ import annotations

import numpy as np
import pytest

from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.plant.rigid_object import ObjectBody
from impedance_modules.plant.step_stability import SHORTEST_STEP, StepTooShort, palm_modes, plant_modes
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.task import PushSpec
from tests.support.both_ways import machine_code  # noqa: F401 - a fixture
from tests.support.plant_parts import BAXTER, exact, in_both_hands, plane, posture, spec_of

pytestmark = pytest.mark.usefixtures("machine_code")
PALMS = {
    "right": {
        "s0": 0.1475, "s1": 0.0817, "e0": 0.7377, "e1": 1.2614, "w0": 0.6488, "w1": 1.1937, "w2": -0.0420,
    },
}  # fmt: skip
"""Palms inward, as in box-hold."""


def held_plant(held: ObjectBody, *pushes: PushSpec, **options: object) -> Plant:
    """Two palms of Baxter on an object's sides, at rest, over a floor."""
    spec = exact(spec_of(BAXTER))
    model = RobotModel(spec)
    sign = spec.mirror.joint_sign
    start = posture(model, {**PALMS, "left": {name: sign[name] * q for name, q in PALMS["right"].items()}})
    asked = PlantOptions(**{"rate": 1000.0, "seed": 0, **options})
    height = float(model.pose(start, model.limbs["right"].hand).translation[2]) - 0.5
    subject = Plant(model, [plane(height)], held, asked, pushes=pushes)
    subject.reset(start)
    return subject


def carry_on(subject: Plant, start: np.ndarray) -> None:
    """One period under springs to the start posture."""
    state = subject.sense()
    subject.advance(subject.start_command + 30.0 * (start - state.position) - state.velocity)


def drawn(rng: np.random.Generator) -> tuple[ObjectBody, PushSpec]:
    """An object between the palms and a push of 5 to 100 N in any direction."""
    shape = str(rng.choice(["box", "cylinder", "sphere"]))
    size = {"box": (0.3, 0.2, 0.2), "cylinder": (0.2, 0.25), "sphere": (0.2,)}[shape]
    held = in_both_hands(
        exact(spec_of(BAXTER)), shape=shape, size=size, grasp="friction", mass=float(rng.uniform(0.3, 3.0)),
        friction=float(rng.uniform(0.1, 1.2)), squeeze=float(rng.uniform(0.0, 40.0)),
        carry_weight=bool(rng.random() < 0.7),
    )  # fmt: skip
    force = rng.normal(size=3)
    force *= np.exp(rng.uniform(np.log(5.0), np.log(100.0))) / np.linalg.norm(force)
    wrench = (*force, *rng.normal(scale=0.3, size=3))
    return held, PushSpec(
        "object", wrench, 0.02, float(rng.uniform(0.0, 0.05)), float(rng.uniform(0.02, 0.3)), 0.0
    )


@pytest.mark.parametrize("seed", range(8))
def test_a_pushed_object_stays_finite_and_gains_no_energy(seed: int) -> None:
    """Every number finite; what the grasp takes is never given back; all work is accounted for; forces in the cone."""
    rng = np.random.default_rng(seed)
    held, push = drawn(rng)
    subject = held_plant(held, push, rate=float(rng.choice([500.0, 1000.0])))
    start, before, taken, turned = subject.position, subject.energy(), 0.0, 1e-3
    for _ in range(round(0.7 / subject.division.loop / subject.division.loops)):
        carry_on(subject, start)
        assert np.isfinite(subject.state.start.whole).all()
        book = subject.energy()
        lost = book.dissipated(before)
        assert book.grasp >= 0.0
        # The integrator's error, 16 times smaller at half the step: hands move along arcs, within a step along chords.
        assert lost["grasp"] >= taken - 1e-6, "the grasp gave back what it had taken"
        taken = max(taken, lost["grasp"])
        works = abs(book.command_work) + abs(book.robot_work) + abs(book.push_work)
        turned = max(turned, works + sum(lost.values()))
        assert abs(book.imbalance(before)) < 1e-3 * turned
        for hand, frame in zip(subject.state.hands, subject.frames, strict=True):
            force, normal = subject.grasp_wrench(frame)[:3], subject.state.body.rotation_now @ hand["normal"]
            pressed = -float(force @ normal)
            assert pressed >= -1e-12
            assert (
                np.linalg.norm(force + pressed * normal) <= hand["friction"] * pressed * (1.0 + 1e-4) + 1e-9
            )
    print(f"object at {np.linalg.norm(subject.object_twist[:3]):.2f} m/s, {taken:.3f} J rubbed away")


def test_a_box_pushed_out_of_the_hands_falls_and_comes_to_rest_on_the_floor() -> None:
    """60 N down for 0.15 s: let go for good, then gravity, then the floor; no hand reaches it there."""
    held = in_both_hands(exact(spec_of(BAXTER)), grasp="friction", friction=0.3, squeeze=10.0)
    subject = held_plant(held, PushSpec("object", (0, 0, -60.0, 0, 0, 0), 0.0, 0.0, 0.15, 0.0))
    start, speeds = subject.position, []
    for _ in range(1800):
        carry_on(subject, start)
        speeds.append(float(np.linalg.norm(subject.object_twist[:3])))
    assert max(speeds) > 1.5 and speeds[-1] < 0.01
    assert subject.contact_wrench("object")[2] == pytest.approx(1.2 * 9.81, rel=0.05)
    assert not any(subject.grasp_wrench(frame).any() for frame in subject.frames)


def test_momentum_changes_by_the_forces_that_act() -> None:
    """Of the object, through slip and loss: m u is the sum of weight, push and the hands' forces over time."""
    held = in_both_hands(exact(spec_of(BAXTER)), grasp="friction", friction=0.4, squeeze=15.0)
    subject = held_plant(held, PushSpec("object", (5.0, 0, -25.0, 0, 0, 0), 0.0, 0.05, 0.2, 0.0), rate=4000.0)
    start, impulse = subject.position, np.zeros(3)
    last = subject.grasp_wrench("object")[:3]
    for _ in range(700):
        carry_on(subject, start)
        now = subject.grasp_wrench("object")[:3]
        forces = 0.5 * (last + now) + subject.push_wrench("object")[:3] + [0.0, 0.0, -1.2 * 9.81]
        impulse, last = impulse + forces / 4000.0, now
    np.testing.assert_allclose(1.2 * subject.object_twist[:3], impulse, atol=0.02 * np.linalg.norm(impulse))
    assert np.linalg.norm(impulse) > 0.3


def test_hands_that_were_pushed_off_take_hold_again() -> None:
    """Both hands are pulled off a box without weight and come back: they press and carry friction as before."""
    held = in_both_hands(
        exact(spec_of(BAXTER)), grasp="friction", friction=0.6, squeeze=15.0, carry_weight=False
    )
    off = {"right": (0.0, -20.0), "left": (0.0, 20.0)}
    pushes = [PushSpec(arm, (*force, 0, 0, 0, 0), 0.05, 0.0, 0.05, 0.0) for arm, force in off.items()]
    subject = held_plant(held, *pushes, gravity=(0.0, 0.0, 0.0))
    start, touching = subject.position, []
    for _ in range(1200):
        carry_on(subject, start)
        touching.append([bool(subject.grasp_wrench(frame).any()) for frame in subject.frames])
    found = np.array(touching)
    assert found[:40].all() and not found[60:100].any()
    assert found[-100:].all()
    squeezes = [np.linalg.norm(subject.grasp_wrench(frame)[:3]) for frame in subject.frames]
    assert squeezes[0] == pytest.approx(15.0, rel=0.3) and squeezes[1] == pytest.approx(15.0, rel=0.3)


def test_a_light_object_is_stepped_finer_and_one_too_light_is_refused() -> None:
    """The step is the longest whole part of 0.25 ms that keeps every mode stable; the box's own keeps it."""
    spec = exact(spec_of(BAXTER))
    steps = {}
    for mass, size in ((1.2, (0.3, 0.2, 0.2)), (0.02, (0.05, 0.2, 0.05))):
        subject = held_plant(
            in_both_hands(spec, grasp="friction", friction=0.5, squeeze=15.0, mass=mass, size=size)
        )
        steps[mass] = subject.division.step
        modes = np.concatenate([plant_modes(subject._integrator), palm_modes(subject._integrator)])
        z = steps[mass] * modes[np.abs(modes) > 1e3]
        assert np.abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))).max() < 1.0
    assert steps[1.2] == 0.25e-3 and SHORTEST_STEP <= steps[0.02] < 0.05e-3
    light = in_both_hands(
        spec, grasp="friction", friction=0.5, squeeze=15.0, mass=1e-5, size=(0.05, 0.2, 0.05)
    )
    with pytest.raises(StepTooShort, match="object between palms has a mode") as refused:
        held_plant(light)
    assert refused.value.part.kind == "object"


def test_palm_modes_bound_the_modes_at_any_posture_and_place() -> None:
    """Wherever the hands stand on the box, the linearised plant has no mode that is faster."""
    rng = np.random.default_rng(3)
    spec = exact(spec_of(BAXTER))
    for _ in range(4):
        size = tuple(rng.uniform(0.15, 0.35, 3))
        subject = held_plant(in_both_hands(spec, grasp="friction", friction=2.0, squeeze=30.0, size=size))
        bound = float(np.abs(palm_modes(subject._integrator)).max())
        joints = 1500.0  # [rad/s] the fastest of the arms' own, without an object
        assert np.abs(plant_modes(subject._integrator)).max() <= max(bound, joints)
