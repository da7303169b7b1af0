# SPDX-License-Identifier: BSD-3-Clause
"""One law is named in the place of two on one joint only where it is likelier than both together."""

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection.forward_selection import Selector
from impedance_modules.diagnosis.regression.model_fit import term_of
from tests.diagnosis.test_diagnosis import JOINTS, answer, motion, torque
from tests.support.recordings import columns_of, save


def begin_with(selector, *effects):
    """Terms of the elbow, each in the first of its shapes."""
    layouts = [
        next(one for one in selector.design.layouts if one.shaped.key == (effect, "elbow", "link"))
        for effect in effects
    ]
    return [term_of(selector.design, layout) for layout in layouts]


@pytest.mark.parametrize(
    ("forward", "backward", "viscous", "begun", "named"),
    [
        (1.5, 0.5, 0.0, ["coulomb_friction", "torque_offset"], ["asymmetric_friction"]),
        (
            1.0,
            1.0,
            1.2,
            ["coulomb_friction", "viscous_friction"],
            ["coulomb_friction", "viscous_friction"],
        ),
    ],
)
def test_two_laws_that_one_holds_are_one(tmp_path, monkeypatch, forward, backward, viscous, begun, named):
    """Dry friction and an offset together are an asymmetric friction; dry and viscous friction are no single law."""
    monkeypatch.setattr(Selector, "simplest", lambda selector, model: begin_with(selector, *begun))
    paths = []
    for index, kind in enumerate((0, 1, 2, 0)):
        dice = np.random.default_rng(index)
        t, q, v, a = motion(kind, 15.0)
        dry = np.where(v[:, 1] > 0.0, forward, -backward) * np.minimum(np.abs(v[:, 1]) / 0.01, 1.0)
        tau = torque(q, v, a, mass=1.0) + np.column_stack([0.0 * dry, dry + viscous * v[:, 1]])
        tau = tau + dice.normal(scale=0.05, size=q.shape)
        q = q + dice.normal(scale=1e-5, size=q.shape)
        paths.append(save(tmp_path, f"run{index}", columns_of(t, JOINTS, position=q, velocity=v, effort=tau)))
    _, said = answer(tmp_path, paths)
    assert sorted(cause["effect"] for cause in said["causes"]) == named
