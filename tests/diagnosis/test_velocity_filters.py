# SPDX-License-Identifier: BSD-3-Clause
"""Reported velocities of which the lag is known, and not the filter: what its second order leaves is no finding."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lsim

from impedance_modules.diagnosis.data.log import Log
from impedance_modules.diagnosis.data.nominal_model import model_of_urdf
from impedance_modules.diagnosis.data.rigid_dynamics import BatchedRigidModel
from impedance_modules.diagnosis.regression.nuisance_columns import FILTER_PRIOR, build_nuisance
from impedance_modules.diagnosis.residuals.band import CommonBand
from impedance_modules.diagnosis.residuals.preparation import prepare
from impedance_modules.effects.catalogue import CATALOGUE
from tests.support.pressed_recordings import JOINTS, URDF

LAG = 0.012  # s
RATE = 250.0  # Hz


def filter_of(damping: float) -> tuple[list[float], list[float]]:
    """Numerator and denominator of a filter with two poles whose lag is `LAG`; 1 / (1 + T s) for none."""
    if not damping:
        return [1.0], [LAG, 1.0]
    pole = 2.0 * damping / LAG
    return [1.0], [1.0 / pole**2, 2.0 * damping / pole, 1.0]


def prepared(damping: float, further: float = 0.0):
    """A recording whose velocities a filter has passed, the first joint's one more lag as well, and its nuisance."""
    random = np.random.default_rng(5)
    time = np.arange(0.0, 20.0, 1.0 / RATE)
    rates = 2.0 * np.pi * random.uniform(0.3, 1.5, (3, len(JOINTS)))
    phase = random.uniform(0.0, 6.0, rates.shape)
    angle = time[:, None, None] * rates + phase
    position = 0.1 * np.sin(angle).sum(axis=1)
    velocity = 0.1 * (rates * np.cos(angle)).sum(axis=1)
    reported = np.column_stack([lsim(filter_of(damping), v, time)[1] for v in velocity.T])
    if further:
        reported[:, 0] = lsim(([1.0], [further, 1.0]), reported[:, 0], time)[1]
    log = Log(*("run", "run", RATE, position, reported, 0.0 * position, None, None, "joint_sensor", "none"))
    model = replace(model_of_urdf(URDF, JOINTS), velocity_filter=LAG)
    item = prepare(log, model, BatchedRigidModel.of_tree(URDF, model.tree), CommonBand.of(RATE, 12.0))
    return item, build_nuisance([item], model.tree.inertia)


@pytest.mark.parametrize(
    ("damping", "second"),
    [(0.0, 0.0), (1.0, -0.25), (np.sqrt(0.5), -0.5), (0.5, -1.0)],
    ids=["one pole", "two equal poles", "Butterworth", "resonant"],
)
def test_filters_of_the_same_lag_differ_by_one_number_that_all_joints_share(damping, second):
    item, nuisance = prepared(damping)
    for g, (residual, joint) in enumerate(nuisance.groups):
        if residual != "velocity":
            continue
        columns, left = nuisance.columns[0][g][50:], item.residuals["velocity"][50:, joint]
        found, *_ = np.linalg.lstsq(columns, left, rcond=None)
        rest = left - columns @ found
        moved = item.residuals["velocity"][50:, joint].std()
        last = found[-1] * FILTER_PRIOR
        assert last == pytest.approx(second, abs=0.05)
        assert rest.std() < max(0.1 * moved, 2e-5)
    seen = [
        ids[-1]
        for (residual, _), ids in zip(nuisance.groups, nuisance.ids, strict=True)
        if residual == "velocity"
    ]
    assert len(seen) == len(JOINTS) and len(set(seen)) == 1


def test_a_velocity_that_nobody_filters_has_no_such_number():
    item, _ = prepared(0.0)
    assert build_nuisance([item], item.tree.inertia).size
    bare = replace(item, filter_nuisance=0.0 * item.filter_nuisance)
    with_it, without = (build_nuisance([one], one.tree.inertia) for one in (item, bare))
    for (residual, _), more, less in zip(with_it.groups, with_it.ids, without.ids, strict=True):
        assert len(more) - len(less) == (residual == "velocity")


@pytest.mark.parametrize("further", [0.004, 0.018, 0.05])
def test_a_further_lag_is_that_of_what_the_stated_filter_gives(further):
    """Not of the joint's own velocity: its number would be wrong by up to the stated filter's."""
    item, _ = prepared(0.0, further)
    shape = {"T": further}
    site = SimpleNamespace(joint=0, signals=item.signals)
    column = CATALOGUE["velocity_filter_lag"].in_residual(site, "velocity", shape)
    left = (item.residuals["velocity"][:, 0] - item.band.condense(column.fixed)[:, 0])[50:]
    assert left.std() < 0.01 * item.residuals["velocity"][50:, 0].std()
