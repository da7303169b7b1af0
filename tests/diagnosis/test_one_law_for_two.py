# SPDX-License-Identifier: BSD-3-Clause
"""One law is named in the place of two on one joint only where it is likelier than both together."""

import numpy as np
import pytest

from tests.diagnosis.test_diagnosis import JOINTS, answer, motion, torque
from tests.support.recordings import columns_of, save


@pytest.mark.parametrize(
    ("forward", "backward", "viscous", "named"),
    [
        (1.5, 0.5, 0.0, ["asymmetric_friction"]),
        (1.0, 1.0, 0.0, ["coulomb_friction"]),
        (1.0, 1.0, 1.2, ["coulomb_friction", "viscous_friction"]),
    ],
)
def test_one_law_is_named_for_two_where_it_is_likelier_than_both(tmp_path, forward, backward, viscous, named):
    """Dry friction and an offset together are an asymmetric friction; dry and viscous friction are no single law."""
    paths = []
    for index, kind in enumerate((0, 1, 2, 0)):
        dice = np.random.default_rng(index)
        t, q, v, a = motion(kind, 15.0)
        dry = np.where(v[:, 1] > 0.0, forward, -backward) * np.minimum(np.abs(v[:, 1]) / 0.01, 1.0)
        tau = torque(q, v, a, mass=1.0) + np.column_stack([0.0 * dry, dry + viscous * v[:, 1]])
        tau = tau + dice.normal(scale=0.05, size=q.shape)
        q = q + dice.normal(scale=1e-5, size=q.shape)
        paths.append(save(tmp_path, f"run{index}", columns_of(t, JOINTS, position=q, velocity=v, effort=tau)))
    code, found = answer(tmp_path, paths)
    assert code == 0 and sorted(cause["effect"] for cause in found["causes"]) == named
    assert all(cause["joints"] == ["elbow"] for cause in found["causes"])
