# SPDX-License-Identifier: BSD-3-Clause
"""Impedances add at the object: equal to the closed chain, in any order, in any frame, zero is zero."""

import itertools

import numpy as np
import pytest

from impedance_modules.modules.held_object import carry_weight, share_wrench, squeeze_forces
from impedance_modules.modules.mobility import carry_mobility, mobility, parallel_sum
from impedance_modules.modules.spring import Spring
from impedance_modules.robot.model import RobotModel
from impedance_modules.robot.pose import Pose, carry, rotate_six
from impedance_modules.spec.robot_spec import STANDARD_GRAVITY
from impedance_modules.superposition.net_stiffness import hand_damping, spring_stiffness
from impedance_modules.superposition.object_impedance import (
    HandImpedance,
    lever_arm_stiffness,
    squeeze_force,
    superpose,
    superpose_inertia,
)
from impedance_modules.superposition.operational_inertia import (
    OperationalInertia,
    carry_inertia,
    from_mobility,
    operational_inertia,
    without_reflected_inertia,
)
from tests.reference.closed_chain import ClosedChain
from tests.support.arm_samples import (
    TYPICAL_STIFFNESS,
    Array,
    baxter,
    derivative,
    displaced,
    hand_of,
    make_spring,
    random_pose,
    random_position,
    random_psd,
    random_rotation,
    relative,
    six_joint_pair,
)

MIRROR = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])


def random_hand(random: np.random.Generator) -> HandImpedance:
    inertia = random_psd(random, np.array([2.0, 2.0, 2.0, 0.1, 0.1, 0.1])) + 1e-3 * np.eye(6)
    return HandImpedance(
        offset=0.3 * random.normal(size=3),
        inertia=OperationalInertia(inertia, np.linalg.inv(inertia)),
        damping=random_psd(random, TYPICAL_STIFFNESS),
        stiffness=random_psd(random, TYPICAL_STIFFNESS),
        wrench=10.0 * random.normal(size=6),
        shared=np.zeros(6),
    )


def zero_hand() -> HandImpedance:
    """A hand that is there but offers nothing: infinitely mobile, no springs."""
    zero, nothing = np.zeros((6, 6)), np.zeros(6)
    mobile = OperationalInertia(zero, zero)
    return HandImpedance(np.array([0.1, 0.2, -0.3]), mobile, zero, zero, nothing, nothing)


def posed(model: RobotModel, q: Array) -> tuple[list, Array]:
    """Pose, Jacobian and inverse inertia of each hand; the point between the hands."""
    hands = [hand_of(model, limb, q) for limb in model.limbs.values()]
    return hands, np.mean([hand[0].translation for hand in hands], axis=0)


def carried_inertias(hands: list, origin: Array) -> list[OperationalInertia]:
    return [operational_inertia(J, Mi).carried(pose.translation - origin) for pose, J, Mi in hands]


def object_inertia(random: np.random.Generator, rotation: Array) -> tuple[Array, float, Array]:
    mass = 0.2 + 3.0 * random.random()
    moments = np.diag(0.02 * mass * (1.0 + random.random(3)))
    found = np.zeros((6, 6))
    found[:3, :3], found[3:, 3:] = mass * np.eye(3), rotation @ moments @ rotation.T
    return found, mass, moments


def matrices(found) -> list[Array]:
    return [found.inertia.inertia, found.inertia.mobility, found.damping, found.stiffness, found.wrench]


def test_sum_of_arms_equals_the_closed_chain() -> None:
    """200 random Baxter grasps: accelerations from rest under unit wrenches on the object, to 1e-9."""
    model = baxter()
    chain = ClosedChain(model, tuple(limb.hand for limb in model.limbs.values()))
    seeds, checked = itertools.count(), 0
    while checked < 200:
        random = np.random.default_rng(next(seeds))
        q = random_position(random, model)
        hands, between = posed(model, q)
        origin = between + 0.3 * random.normal(size=3)
        rotation = random_rotation(random)
        own, mass, moments = object_inertia(random, rotation)
        summed = superpose_inertia(carried_inertias(hands, origin), own)
        if summed.inertia is None or np.linalg.cond(summed.inertia) >= 1e6:
            continue
        chained = chain.acceleration_per_wrench(q, origin, rotation, (mass, moments))
        assert relative(summed.mobility, chained) < 1e-9
        assert relative(summed.inertia, np.linalg.inv(chained)) < 1e-9
        checked += 1


def test_parallel_sum_joins_a_singular_arm_like_the_closed_chain() -> None:
    """Two wrist axes in line: no inertia for that arm, but the mobilities still give the closed chain."""
    model = six_joint_pair()
    limbs = list(model.limbs.values())
    chain = ClosedChain(model, tuple(limb.hand for limb in limbs))
    for seed in range(10):
        random = np.random.default_rng(seed)
        q = random_position(random, model)
        q[limbs[0].joints[limbs[0].short_names.index("tilt")]] = 0.0
        hands, origin = posed(model, q)
        own, mass, moments = object_inertia(random, np.eye(3))
        arms = carried_inertias(hands, origin)
        assert arms[0].inertia is None and arms[1].inertia is not None
        summed = superpose_inertia(arms, own)
        assert summed.inertia is None
        chained = chain.acceleration_per_wrench(q, origin, np.eye(3), (mass, moments))
        assert relative(summed.mobility, chained) < 1e-9


def test_order_and_grouping_do_not_matter() -> None:
    random = np.random.default_rng(1)
    for _ in range(50):
        hands = [random_hand(random) for _ in range(3)]
        whole = superpose(hands, None)
        for order in itertools.permutations(hands):
            for one, other in zip(matrices(superpose(order, None)), matrices(whole), strict=True):
                assert relative(one, other) < 1e-11
        pair = superpose(hands[:2], None)
        grouped = superpose_inertia([pair.inertia, hands[2].inertia.carried(hands[2].offset)], None)
        assert relative(grouped.inertia, whole.inertia.inertia) < 1e-11
        assert relative(pair.stiffness + superpose(hands[2:], None).stiffness, whole.stiffness) < 1e-11


def test_mobilities_add_in_any_order() -> None:
    random = np.random.default_rng(2)
    for _ in range(50):
        parts = [random_psd(random, np.ones(6), rank) for rank in (6, 5, 6)]
        orders = [parallel_sum(parallel_sum(*pair), third) for *pair, third in itertools.permutations(parts)]
        for order in orders[1:]:
            assert relative(order, orders[0]) < 1e-7
        regular = [random_psd(random, np.ones(6)) + 0.1 * np.eye(6) for _ in range(2)]
        expected = np.linalg.inv(np.linalg.inv(regular[0]) + np.linalg.inv(regular[1]))
        assert relative(parallel_sum(*regular), expected) < 1e-10


def test_a_zero_module_changes_nothing() -> None:
    random = np.random.default_rng(3)
    for _ in range(20):
        hands = [random_hand(random) for _ in range(2)]
        with_zero, without = (
            matrices(superpose(all_hands, None)) for all_hands in ([*hands, zero_hand()], hands)
        )
        for one, other in zip(with_zero, without, strict=True):
            np.testing.assert_array_equal(one, other)


def test_the_sum_does_not_depend_on_where_or_how_it_is_looked_at() -> None:
    """Moved to another point of the object, or seen from turned axes, it is the same impedance."""
    random = np.random.default_rng(4)
    for _ in range(50):
        hands = [random_hand(random) for _ in range(2)]
        shift, turn = random.normal(size=3), random_rotation(random)
        here = superpose(hands, None)
        there = superpose([_seen(hand, shift, np.eye(3)) for hand in hands], None)
        assert relative(there.inertia.inertia, carry_inertia(here.inertia.inertia, shift)) < 1e-11
        assert relative(there.inertia.mobility, carry_mobility(here.inertia.mobility, shift)) < 1e-10
        assert relative(there.damping, carry_inertia(here.damping, shift)) < 1e-11
        assert relative(there.wrench, carry(shift).T @ here.wrench) < 1e-11
        # A net force at O turns its own lever arm about the new point.
        moved = carry_inertia(here.stiffness, shift) + lever_arm_stiffness(-here.wrench[:3], shift)
        assert relative(there.stiffness, moved) < 1e-11
        turned = superpose([_seen(hand, np.zeros(3), turn) for hand in hands], None)
        six = rotate_six(turn)
        for one, other in zip(matrices(turned)[:4], matrices(here)[:4], strict=True):
            assert relative(one, six @ other @ six.T) < 1e-10


def _seen(hand: HandImpedance, shift: Array, turn: Array) -> HandImpedance:
    """The same hand from an origin at -shift, in axes turned by ``turn``."""
    six = rotate_six(turn)
    return HandImpedance(
        offset=turn @ (hand.offset + shift),
        inertia=OperationalInertia(six @ hand.inertia.inertia @ six.T, six @ hand.inertia.mobility @ six.T),
        damping=six @ hand.damping @ six.T,
        stiffness=six @ hand.stiffness @ six.T,
        wrench=six @ hand.wrench,
        shared=six @ hand.shared,
    )


def _net_wrench(at: Pose, grasps: list[Pose], springs: list[Spring], targets: list[Pose]) -> Array:
    """Wrench on the object at ``at``: springs and a squeeze, each recomputed where its hand now is."""
    placed = [at @ grasp for grasp in grasps]
    offsets = np.array([hand.translation - at.translation for hand in placed])
    presses = np.hstack([squeeze_forces(offsets, 15.0), np.zeros((len(offsets), 3))])
    wrenches = [k.wrench(hand, to) for k, hand, to in zip(springs, placed, targets, strict=True)]
    return sum(carry(r).T @ (w + f) for r, w, f in zip(offsets, wrenches, presses, strict=True))


def test_stiffness_is_minus_the_derivative_of_the_modules_wrench() -> None:
    """Springs on both hands, deflected and squeezing, with a net wrench: move the object and measure."""
    random = np.random.default_rng(6)
    nothing = OperationalInertia(None, np.eye(6))
    for _ in range(30):
        pose = random_pose(random)
        grasps = [random_pose(random, 0.3) for _ in range(2)]
        springs = [make_spring(random_psd(random, TYPICAL_STIFFNESS)) for _ in range(2)]
        targets = [pose @ grasp @ random_pose(random, 0.1, 0.5) for grasp in grasps]
        hands = []
        for spring, grasp, target in zip(springs, grasps, targets, strict=True):
            hand = pose @ grasp
            K = spring_stiffness(spring, hand, target)
            offset = hand.translation - pose.translation
            hands.append(HandImpedance(offset, nothing, None, K, spring.wrench(hand, target), np.zeros(6)))
        found = superpose(hands, None)
        assert found.damping is None

        def wrench(step: Array, pose=pose, parts=(grasps, springs, targets)) -> Array:
            return _net_wrench(displaced(pose, step), *parts)

        assert relative(found.stiffness, -derivative(wrench)) < 1e-7
        np.testing.assert_allclose(found.wrench, wrench(np.zeros(6)), atol=1e-9)


def test_stiffness_is_symmetric_exactly_without_a_net_moment() -> None:
    random = np.random.default_rng(8)
    pose, spring = random_pose(random), make_spring(random_psd(random, TYPICAL_STIFFNESS))
    target = pose @ random_pose(random, 0.1, 0.5)
    K = spring_stiffness(spring, pose, target)
    moment = spring.wrench(pose, target)[3:]
    np.testing.assert_allclose((K - K.T)[3:, :3], 0.0, atol=1e-9)
    twist = (K - K.T)[3:, 3:]
    np.testing.assert_allclose([twist[2, 1], twist[0, 2], twist[1, 0]], moment, atol=1e-9)


def _mirrored_sum(model: RobotModel, q_half: Array) -> tuple[Array, Array]:
    """Object inertia and damping-like sum of two arms in mirrored postures, at a point of the mirror."""
    first, second = model.limbs.values()
    signs = np.array([model.spec.mirror.joint_sign[name] for name in first.short_names])
    q = np.zeros(model.n)
    q[first.joints], q[second.joints] = q_half, signs * q_half
    arms = carried_inertias(*posed(model, q))
    return superpose_inertia(arms, None).inertia, arms[0].inertia


def _coupling(matrix: Array) -> float:
    """Coupling of motions in the mirror plane (x, z, ry) with those across it (y, rx, rz)."""
    even, odd = MIRROR > 0, MIRROR < 0
    return float(np.max(np.abs(matrix[np.ix_(even, odd)])) / np.max(np.abs(matrix)))


def test_mirrored_arms_cancel_their_coupling(capsys: pytest.CaptureFixture[str]) -> None:
    """Exactly on mirrored arms; Baxter's two arms carry the same unmirrored links, so a remainder stays."""
    random = np.random.default_rng(9)
    pair, robot, remainder = six_joint_pair(), baxter(), []
    for _ in range(20):
        limb = next(iter(pair.limbs.values()))
        summed, alone = _mirrored_sum(pair, random_position(random, pair)[limb.joints])
        assert _coupling(summed) < 1e-10 < _coupling(alone)
        limb = next(iter(robot.limbs.values()))
        remainder.append(_coupling(_mirrored_sum(robot, random_position(random, robot)[limb.joints])[0]))
    with capsys.disabled():
        print(f"\nBaxter's mirrored postures leave {100 * np.median(remainder):.2f} % coupling (median)")
    assert 0.0 < np.median(remainder) < 0.05


def test_inertia_lives_where_the_posture_is_regular() -> None:
    model = baxter()
    limb = next(iter(model.limbs.values()))
    random = np.random.default_rng(10)
    _, J, inverse = hand_of(model, limb, random_position(random, model))
    found = operational_inertia(J, inverse)
    np.testing.assert_allclose(found.inertia @ found.mobility, np.eye(6), atol=1e-9)
    bare = without_reflected_inertia(inverse, model.reflected_inertia[limb.joints])
    assert np.all(np.linalg.eigvalsh(found.inertia - operational_inertia(J, bare).inertia) > -1e-9)
    flat = operational_inertia(np.vstack([J[:5], J[4]]), inverse)
    assert flat.inertia is None and np.all(np.isfinite(flat.mobility))
    assert from_mobility(np.zeros((6, 6))).inertia is None
    np.testing.assert_allclose(mobility(J, inverse), found.mobility)


def test_damping_at_the_hand_is_the_joints_plus_the_hands() -> None:
    model = baxter()
    limb = next(iter(model.limbs.values()))
    random = np.random.default_rng(12)
    _, J, _ = hand_of(model, limb, random_position(random, model))
    joints, end = np.diag(1.0 + random.random(7)), random_psd(random, TYPICAL_STIFFNESS)
    expected = np.linalg.inv(J @ np.linalg.inv(joints) @ J.T) + end
    assert relative(hand_damping(J, joints, end), expected) < 1e-9
    assert hand_damping(J, np.diag([1.0, 1, 1, 1, 1, 1, 0]), end) is None
    assert hand_damping(np.vstack([J[:5], J[4]]), joints, end) is None


@pytest.mark.parametrize("count", [2, 3, 4])
def test_squeeze_and_weight_leave_exactly_what_they_should(count: int) -> None:
    random = np.random.default_rng(count)
    for _ in range(50):
        offsets = 0.2 * random.normal(size=(count, 3))
        presses = squeeze_forces(offsets, 15.0)
        np.testing.assert_allclose(presses.sum(axis=0), 0.0, atol=1e-10)
        np.testing.assert_allclose(np.cross(offsets, presses).sum(axis=0), 0.0, atol=1e-10)
        lifts = carry_weight(offsets, 1.2)
        total = sum(carry(r).T @ w for r, w in zip(offsets, lifts, strict=True))
        np.testing.assert_allclose(total, [0, 0, 1.2 * STANDARD_GRAVITY, 0, 0, 0], atol=1e-10)
        wanted = random.normal(size=6)
        shared = share_wrench(offsets, wanted)
        total = sum(carry(r).T @ w for r, w in zip(offsets, shared, strict=True))
        np.testing.assert_allclose(total, wanted, atol=1e-10)


def test_two_hands_squeeze_along_the_line_between_them() -> None:
    offsets = np.array([[0.15, 0.0, 0.0], [-0.15, 0.0, 0.0]])
    np.testing.assert_allclose(squeeze_forces(offsets, 15.0), [[-15.0, 0, 0], [15.0, 0, 0]], atol=1e-12)
    np.testing.assert_array_equal(squeeze_forces(np.zeros((2, 3)), 15.0), np.zeros((2, 3)))
    nothing = OperationalInertia(None, np.eye(6))
    weight = carry_weight(offsets, 1.0)
    hands = [
        HandImpedance(r, nothing, None, None, np.zeros(6), w + np.append(f, np.zeros(3)))
        for r, w, f in zip(offsets, weight, squeeze_forces(offsets, 15.0), strict=True)
    ]
    found = superpose(hands, None)
    assert squeeze_force(hands, found.internal) == pytest.approx(15.0)
    np.testing.assert_allclose(found.wrench, [0, 0, STANDARD_GRAVITY, 0, 0, 0], atol=1e-12)
