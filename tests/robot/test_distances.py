# SPDX-License-Identifier: BSD-3-Clause
"""Distance rows are true derivatives, and a pair that is left alone cannot matter meanwhile."""

import numpy as np
import pinocchio as pin
import pytest

from impedance_modules.robot.distances import LONGEST_WAIT, QUICKEST, Distances, free_time
from impedance_modules.robot.kinematics import Kinematics
from tests.support.arm_samples import baxter, random_position

PERIOD, HORIZON, TIME, MARGIN = 1e-3, 7e-3, 0.2, 0.03


def measuring(*, everything: bool = True) -> tuple[Kinematics, Distances]:
    """Distances of Baxter's pairs; ``everything`` makes each pair matter in every cycle."""
    model = baxter()
    kinematics = Kinematics(model, [limb.hand for limb in model.limbs.values()])
    margin = 100.0 if everything else MARGIN
    pairs = model.spec.collision.pairs
    found = Distances(kinematics, pairs, margin=margin, approach_time=TIME, horizon=HORIZON, period=PERIOD)
    return kinematics, found


def distances_at(kinematics: Kinematics, distances: Distances, q: np.ndarray) -> np.ndarray:
    still = np.zeros(kinematics.model.n)
    kinematics.update(q, still)
    distances.update(q, still)
    return distances.distance.copy()


def test_gradient_is_the_derivative_of_the_distance() -> None:
    random = np.random.default_rng(0)
    kinematics, distances = measuring()
    step, checked = 1e-6, 0
    for _ in range(10):
        q, along = random_position(random, kinematics.model), random.normal(size=kinematics.model.n)
        here = distances_at(kinematics, distances, q)
        rate = distances.gradient @ along
        there, back = (distances_at(kinematics, distances, q + s * along) for s in (step, -step))
        measured = (there - back) / (2.0 * step)
        # At a kink the closest points jump and one-sided slopes differ: not a derivative.
        bend = (there + back - 2.0 * here) / step
        smooth = (np.abs(bend) < 1e-3) & (here > 1e-3)
        np.testing.assert_allclose(measured[smooth], rate[smooth], atol=2e-4)
        checked += int(smooth.sum())
    assert checked > 60


@pytest.mark.parametrize("seed", range(4))
def test_pair_left_alone_cannot_matter(seed: int) -> None:
    """Closing speeds that grow as fast as declared, all the way: the row of a skipped cycle would be idle."""
    random = np.random.default_rng(seed)
    _, distances = measuring(everything=False)
    for _ in range(2000):
        d, c = float(random.uniform(0.0, 1.0)), float(random.uniform(-1.0, 1.5))
        free = free_time(distances.state, d, c)
        assert 0.0 <= free <= LONGEST_WAIT
        for t in np.append(random.uniform(0.0, free, 3), free):
            pull = float(random.uniform(0.5, 1.0)) * QUICKEST if t < free else QUICKEST
            closing = max(c, 0.0) + pull * t
            distance = d - max(c, 0.0) * t - 0.5 * pull * t**2
            allowed = ((distance - MARGIN) / TIME - closing) / HORIZON
            assert free == 0.0 or allowed >= QUICKEST - 1e-6
        if 0.0 < free < LONGEST_WAIT and c >= 0.0:
            later = free * 1.02
            closing, distance = c + QUICKEST * later, d - c * later - 0.5 * QUICKEST * later**2
            assert ((distance - MARGIN) / TIME - closing) / HORIZON < QUICKEST


def test_random_motion_never_makes_a_skipped_pair_matter() -> None:
    """A smooth random motion of both arms; every skipped pair is measured on the side and must be idle."""
    random = np.random.default_rng(8)
    kinematics, distances = measuring(everything=False)
    truth_kinematics, truth = measuring()
    model = kinematics.model
    low, high = model.column("position_min"), model.column("position_max")
    middle, size = 0.5 * (low + high), 0.25 * (high - low)
    rate, phase = random.uniform(0.5, 2.0, model.n), random.uniform(0.0, 6.0, model.n)
    measured, skipped, previous = 0, 0, None
    for k in range(1500):
        t = k * PERIOD
        q = middle + size * np.sin(rate * t + phase)
        v = size * rate * np.cos(rate * t + phase)
        kinematics.update(q, v)
        before = list(distances.state.due)
        distances.update(q, v)
        measured += sum(due <= distances.state.cycle for due in before)
        truth_kinematics.update(q, v)
        truth.update(q, v)
        closing = -(truth.gradient @ v)
        growth = np.zeros_like(closing) if previous is None else (closing - previous) / PERIOD
        previous = closing
        alone = ~distances.gradient.any(axis=1)
        # The assumption: no closing speed grows faster than QUICKEST (closest points may jump).
        honest = growth < QUICKEST
        allowed = ((truth.distance - MARGIN) / TIME - closing) / HORIZON
        assert (allowed >= growth)[alone & honest].all()
        skipped += int(alone.sum())
    pairs = len(distances.pairs)
    assert measured < 0.25 * 1500 * pairs
    assert skipped > 0.5 * 1500 * pairs


def test_at_rest_most_cycles_measure_nothing_and_none_measures_two_pairs() -> None:
    kinematics, distances = measuring(everything=False)
    model, still = kinematics.model, np.zeros(kinematics.model.n)
    q = 0.5 * (model.column("position_min") + model.column("position_max"))
    distances_at(kinematics, distances, q)
    tally = []
    for _ in range(500):
        before = list(distances.state.due)
        distances.update(q, still)
        tally.append(sum(due <= distances.state.cycle for due in before))
    idle = distances.distance > 0.1
    assert idle.sum() >= 8
    assert np.mean(np.array(tally) == 0) > 0.5
    assert max(tally) <= 1 + int((~idle).sum())


def test_state_that_is_not_finite_measures_nothing() -> None:
    kinematics, distances = measuring()
    n = kinematics.model.n
    q, nothing = np.full(n, 0.1), np.full(n, np.nan)
    before = distances_at(kinematics, distances, q)
    distances.update(q, nothing)
    distances_at(kinematics, distances, nothing)
    assert np.array_equal(distances.distance, before)


def test_pinocchio_keeps_the_joint_jacobian_where_it_is() -> None:
    kinematics, distances = measuring()
    view = kinematics.pin_data.J
    random = np.random.default_rng(1)
    for _ in range(3):
        q = random_position(random, kinematics.model)
        kinematics.update(q, np.zeros(kinematics.model.n))
        model = kinematics.model.pin_model
        assert np.array_equal(view, pin.computeJointJacobians(model, model.createData(), q))
    assert np.shares_memory(view, distances._world_jacobian)


def test_drift_is_how_the_distance_accelerates_at_constant_speed() -> None:
    """Second differences of the distance along straight ways in joint angles, where nothing jumps."""
    random = np.random.default_rng(3)
    kinematics, distances = measuring()
    n, checked, largest = kinematics.model.n, 0, 0.0
    for _ in range(12):
        q, v = random_position(random, kinematics.model), random.uniform(-1.0, 1.0, n)
        measured, drift = [], []
        distances.state.cycle += 1000
        for k in range(80):
            kinematics.update(q + v * k * PERIOD, v)
            distances.update(q + v * k * PERIOD, v)
            measured.append(distances.distance.copy())
            drift.append(distances.drift.copy())
        d = np.array(measured)
        # The estimate lags by its time constant, ten cycles; second differences over ten of them, around then.
        bends = [(d[k + 10] - 2.0 * d[k] + d[k - 10]) / (10 * PERIOD) ** 2 for k in (40, 50, 60)]
        smooth = (np.ptp(bends, axis=0) < 0.3) & (d.min(axis=0) > 1e-3)
        np.testing.assert_allclose(drift[60][smooth], bends[1][smooth], atol=0.1)
        found = drift[60]
        checked, largest = checked + int(smooth.sum()), max(largest, np.abs(found[smooth]).max(initial=0.0))
    assert checked > 60
    assert largest > 1.0


def test_drift_of_a_pair_that_changed_its_closest_shapes_begins_anew() -> None:
    """What the gradient of other shapes was says nothing about how this one turns."""
    kinematics, distances = measuring()
    v = np.full(kinematics.model.n, 0.5)
    for k in range(5):
        kinematics.update(v * k * PERIOD, v)
        distances.update(v * k * PERIOD, v)
    assert np.abs(distances.drift).max() > 0.0
    distances.state.shapes[:] += 1
    kinematics.update(v * 5 * PERIOD, v)
    distances.update(v * 5 * PERIOD, v)
    assert not distances.drift.any()
    distances.state.cycle += 1000
    kinematics.update(v * 6 * PERIOD, v)
    distances.update(v * 6 * PERIOD, v)
    assert not distances.drift.any()
