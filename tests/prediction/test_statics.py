# SPDX-License-Identifier: BSD-3-Clause
"""Rest on the thesis's terrain: where the potential energy is least, whatever the search begins with."""

from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.assembly import Assembly
from impedance_modules.modules.spring import displacement_of
from impedance_modules.plant.sheet import Sheet
from impedance_modules.prediction.contact_geometry import TOO_DEEP, place_surface
from impedance_modules.prediction.forecast import forecast_task
from impedance_modules.prediction.held_by_friction import held_by_friction
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import PredictedPhase, predict_motion
from impedance_modules.prediction.statics import SURROUNDINGS, Loads, Rest, analyse_state, find_rest
from tests.support.commands import invoke
from tests.support.forecast_tasks import BOX, assembled, predicted, write_task
from tests.support.paths import CHECKOUT

HAND = "right_hand"
TERRAIN = (CHECKOUT / "tasks" / "thesis" / "slide-over.yaml").read_text()
SOFT = "stiffness: {s0: 0.005, s1: 5, e0: 5, e1: 0.005, w0: 0.005, w1: 5, w2: 5}"
STAY = 3
"""Index of the phase in which the hand leans on the block and its equilibria stand still."""


def rest_of(assembly: Assembly, phase: PredictedPhase, loads: Loads = SURROUNDINGS) -> Rest:
    rest = find_rest(Mechanism(assembly), phase.setting, phase.q, loads)
    assert rest is not None
    return rest


def potential(assembly: Assembly, phase: PredictedPhase, q: np.ndarray) -> float:
    """Springs, joint springs, table and bent sheet [J], written out without the search's own forces."""
    mechanism = Mechanism(assembly)
    mechanism.update(q, np.zeros_like(q))
    (arm,) = phase.modules.arms
    turned = q[arm.bias.joints] - phase.equilibrium.rests[arm.limb.name]
    total = 0.5 * float(turned @ (arm.bias.stiffness * turned))
    for spring in arm.springs:
        moved = displacement_of(
            mechanism.kinematics.pose(spring.frame), phase.equilibrium.springs[spring.name]
        )
        total += 0.5 * float(moved @ (spring.world_stiffness @ moved))
    hand = mechanism.kinematics.pose(HAND).translation
    table, sheet = assembly.task.environment
    total += 0.5 * table.stiffness * max(0.0, table.height - hand[2]) ** 2
    placed = place_surface(sheet)
    local = placed.rotation.T @ (hand - placed.origin)
    under = Sheet(sheet.sheet).point(float(local[0]))
    if under is not None and abs(local[1]) <= 0.5 * sheet.sheet.width and local[2] > under.height - TOO_DEEP:
        net = 1.0 / (1.0 / sheet.stiffness + under.compliance)
        total += 0.5 * net * max(0.0, under.height - local[2]) ** 2
    return total


@pytest.mark.parametrize("name", ["lean", "to-the-left", "stay", "back"])
def test_a_hand_rests_on_the_sheet_where_the_energy_is_least(name: str) -> None:
    """Along every joint-space direction that the Hessian by finite differences names, the softest too."""
    assembly = assembled("slide-over")
    phase = next(phase for phase in predict_motion(assembly).phases if phase.name == name)
    rest = rest_of(assembly, phase)
    joints, step = Mechanism(assembly).joints, 1e-4

    def energy(moved: np.ndarray) -> float:
        q = rest.q.copy()
        q[joints] += moved
        return potential(assembly, phase, q)

    axes = step * np.eye(len(joints))
    slope = np.array([energy(a) - energy(-a) for a in axes]) / (2.0 * step)
    curved = [[energy(a + b) - energy(a - b) - energy(b - a) + energy(-a - b) for b in axes] for a in axes]
    values = np.linalg.eigvalsh(np.array(curved) / (4.0 * step**2))
    assert np.max(np.abs(slope)) < 2e-4
    assert values[0] > 5e-3 and values[-1] > 1e3


def test_the_rest_does_not_depend_on_where_the_search_begins() -> None:
    """From up to 0.15 rad away on every joint, inside the surface or above it, one rest is found."""
    random = np.random.default_rng(4)
    assembly = assembled("slide-over")
    phase = predict_motion(assembly).phases[STAY]
    mechanism, rest = Mechanism(assembly), rest_of(assembly, phase)
    for _ in range(10):
        start = phase.q.copy()
        start[mechanism.joints] += random.uniform(-0.15, 0.15, mechanism.k)
        found = find_rest(mechanism, phase.setting, start)
        assert found is not None
        np.testing.assert_allclose(found.q, rest.q, atol=1e-6)


def test_hands_that_do_not_agree_on_the_object_are_closed(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    assembly = assembled(write_task(tmp_path, BOX))
    phase, mechanism = predict_motion(assembly).phases[0], Mechanism(assembly)
    rest = rest_of(assembly, phase)
    for _ in range(5):
        start = rest.q.copy()
        start[mechanism.joints] += random.uniform(-0.1, 0.1, mechanism.k)
        found = find_rest(mechanism, phase.setting, start)
        assert found is not None
        np.testing.assert_allclose(found.q, rest.q, atol=1e-6)


def test_both_verbs_find_the_rest_that_was_missing() -> None:
    printed = invoke("check", "slide-over").stdout
    assert "no static equilibrium" not in printed
    assert "at rest where 'stay' ends" in invoke("analyze", "slide-over", "--phase", "stay").stdout


def test_a_rest_that_is_far_off_in_time_is_noted_and_another_is_not() -> None:
    """With next to no spring the wrist turns for minutes; the linear creep at rest has that time constant."""
    assembly, prediction = predicted("slide-over")
    found = forecast_task(assembly, prediction).phases[STAY]
    mechanism, rest, phase = Mechanism(assembly), prediction.rests[STAY], found.predicted
    way = rest.q - phase.q
    assert found.slow.joint == "right_w0" == assembly.model.joint_names[int(np.argmax(np.abs(way)))]
    assert found.slow.angle == way[assembly.model.joint_names.index("right_w0")]
    (arm,) = analyse_state(mechanism, phase.setting, rest.q).arms.values()
    damping = arm.system.damping + np.diag(assembly.model.column("motor_damping")[mechanism.joints])
    creep = np.linalg.eigvals(np.linalg.solve(damping, arm.system.stiffness)).real
    assert found.slow.time_constant == pytest.approx(1.0 / np.min(creep), rel=0.05)
    assert "until it rests right_w0 still turns by" in invoke("check", "slide-over").stdout.replace("\n", " ")
    assert "until it rests" not in invoke("check", "press-and-slide").stdout


def test_a_hand_that_nothing_stops_has_no_rest(tmp_path: Path) -> None:
    """The springs of a hand pull it down for ever: a force without stiffness, and no joint springs."""
    free = (
        (SOFT, SOFT.replace("0.005", "0").replace(": 5", ": 0")),
        ("z: 50}", "z: 0}"),
        (
            "        damping: {x: 30",
            "        axes: {z: {force: -3, speed_limit: 0.1}}\n        damping: {x: 30",
        ),
        ("height: -0.30", "height: -20"),
        ("position: [0.634, -0.50, -0.30]", "position: [0.634, -0.50, -20]"),
    )
    assembly = assembled(write_task(tmp_path, TERRAIN, *free))
    phase = predict_motion(assembly).phases[0]
    assert find_rest(Mechanism(assembly), phase.setting, phase.q) is None


def test_friction_holds_no_hand_that_is_free_and_none_on_smooth_ground(tmp_path: Path) -> None:
    assembly = assembled(write_task(tmp_path, TERRAIN, ("friction: 0.2", "friction: 0")))
    phases = predict_motion(assembly).phases
    for phase in (phases[0], phases[STAY]):
        rest = rest_of(assembly, phase)
        assert held_by_friction(Mechanism(assembly), phase.setting, rest, phase.q, HAND) is None


def test_a_hand_that_comes_from_far_stops_where_friction_and_springs_balance(tmp_path: Path) -> None:
    """The longer the way, the surer the friction is all used: the statics pushed by it rest there."""
    assembly = assembled("slide-over")
    phase = predict_motion(assembly).phases[STAY]
    mechanism, rest = Mechanism(assembly), rest_of(assembly, phase)
    far = phase.q.copy()
    far[assembly.model.joint_names.index("right_s0")] -= 0.05
    found = held_by_friction(mechanism, phase.setting, rest, far, HAND)
    assert found is not None
    smooth = assembly.model.pose(rest.q, HAND).translation
    came_from = assembly.model.pose(far, HAND).translation
    assert 0.008 < np.linalg.norm(found.position - smooth) < 0.9 * np.linalg.norm(came_from - smooth)
    back = (came_from - smooth) / np.linalg.norm(came_from - smooth)
    pushed = rest_of(
        assembly, phase, Loads({HAND: np.append(found.force * back, np.zeros(3))}, surfaces=True)
    )
    mechanism.update(pushed.q, np.zeros_like(pushed.q))
    np.testing.assert_allclose(mechanism.kinematics.pose(HAND).translation, found.position, atol=1e-3)


def test_friction_does_not_push_a_hand_back() -> None:
    """A phase that ends nearer to its rest than friction reaches leaves the hand where it is."""
    assembly = assembled("slide-over")
    phase = predict_motion(assembly).phases[1]
    found = held_by_friction(Mechanism(assembly), phase.setting, rest_of(assembly, phase), phase.q, HAND)
    assert found is not None
    np.testing.assert_array_equal(found.position, assembly.model.pose(phase.q, HAND).translation)
