# SPDX-License-Identifier: BSD-3-Clause
"""Laws of dry friction are compared as they reverse: a difference between directions is not lost in a slow turn."""

import numpy as np
import pytest

from tests.diagnosis.test_diagnosis import JOINTS, answer, motion, torque
from tests.support.recordings import columns_of, save

TURN = 0.05
"""Speed over which friction changes its sign [rad/s], five times the usual one: no law of several numbers has it."""


@pytest.mark.parametrize(("difference", "named"), [(0.08, "asymmetric_friction"), (0.0, "coulomb_friction")])
def test_friction_that_turns_slowly_keeps_its_directions_apart(tmp_path, difference, named):
    paths = []
    for index, kind in enumerate((0, 1, 2, 3)):
        dice = np.random.default_rng(index)
        t, q, v, a = motion(kind, 12.0)
        turning = np.tanh(v[:, 1] / TURN)
        dry = 0.25 * turning + difference * np.abs(turning)
        tau = torque(q, v, a, mass=1.0) + np.column_stack([0.0 * dry, dry])
        tau = tau + dice.normal(scale=0.02, size=q.shape)
        q = q + dice.normal(scale=1e-5, size=q.shape)
        paths.append(save(tmp_path, f"run{index}", columns_of(t, JOINTS, position=q, velocity=v, effort=tau)))
    _, said = answer(tmp_path, paths)
    print(
        said["verdict"],
        [(c["effect"], c["parameters"], [e["effect"] for e in c["equivalent"]]) for c in said["causes"]],
    )
    first = said["causes"][0]
    assert (first["effect"], first["joints"], first["equivalent"]) == (named, ["elbow"], [])
    assert first["parameters"]["elbow"]["fc"]["value"] == pytest.approx(0.25, rel=0.15)
