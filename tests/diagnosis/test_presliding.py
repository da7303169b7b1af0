# SPDX-License-Identifier: BSD-3-Clause
"""Dry friction that bends before it slides, over any way up to a milliradian, is dry friction of its own size."""

from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection.forward_selection import Selector
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.dry_reversals import PRESLIDING, REGULARISATION, SHARP
from impedance_modules.effects.joint_motion import REGULARISATION_VELOCITY, follow, sign
from tests.diagnosis.test_diagnosis import JOINTS, answer, motion, torque
from tests.support.recordings import columns_of, save

FRICTION = 1.5


def reversals_found(tmp_path, monkeypatch, sign_of):
    """How the sign of an elbow's dry friction is found to turn: the shapes of its law, which is named with its size.

    ``sign_of`` gives that sign (N,) from the elbow's position and speed.
    """
    shapes = []
    simplest = Selector.simplest

    def seen(selector, model):
        shapes[:] = [term.shaped.shape for term in model if term.key[0] == "coulomb_friction"]
        return simplest(selector, model)

    monkeypatch.setattr(Selector, "simplest", seen)
    paths = []
    for index, kind in enumerate((0, 1, 2, 0)):
        dice = np.random.default_rng(index)
        t, q, v, a = motion(kind, 15.0)
        friction = FRICTION * sign_of(q[:, 1], v[:, 1])
        tau = torque(q, v, a, mass=1.0) + np.column_stack([0.0 * friction, friction])
        tau = tau + dice.normal(scale=0.02, size=q.shape)
        q = q + dice.normal(scale=1e-6, size=q.shape)
        paths.append(save(tmp_path, f"run{index}", columns_of(t, JOINTS, position=q, velocity=v, effort=tau)))
    _, said = answer(tmp_path, paths)
    (cause,) = said["causes"]
    assert (cause["effect"], cause["joints"]) == ("coulomb_friction", ["elbow"])
    assert cause["parameters"]["elbow"]["fc"]["value"] == pytest.approx(FRICTION, rel=0.03)
    return shapes


@pytest.mark.parametrize("stretch", [0.25e-3, 0.55e-3, 0.8e-3])
def test_the_way_until_dry_friction_slides_is_found(tmp_path, monkeypatch, stretch):
    """Between two of the ways that are tried first, where both are hundreds of nats worse than the true one."""
    shapes = reversals_found(tmp_path, monkeypatch, lambda q, v: follow(q, stretch))
    assert [shape[PRESLIDING] for shape in shapes] == [pytest.approx(stretch, rel=0.2)]


@pytest.mark.parametrize(
    "multiple",
    [0.2, 0.45, pytest.param(1.0, marks=pytest.mark.long), pytest.param(4.0, marks=pytest.mark.long)],
)
def test_the_speed_over_which_dry_friction_turns_is_found(tmp_path, monkeypatch, multiple):
    """A sign that is sharper than the usual one is no Stribeck friction: it looks higher at low speed, as that does."""
    speed = multiple * REGULARISATION_VELOCITY
    shapes = reversals_found(tmp_path, monkeypatch, lambda q, v: sign(v, speed))
    assert [shape.get(REGULARISATION, 1.0) for shape in shapes] == [pytest.approx(multiple, rel=0.3)]


@pytest.mark.parametrize("effect", sorted(e for e, law in CATALOGUE.items() if law.dry))
def test_every_dry_law_tries_a_sharper_sign(effect):
    """Each of its own shapes, so that no law is preferred for the sign that it was given."""
    law = CATALOGUE[effect]
    model = SimpleNamespace(sliding=np.zeros(1, dtype=bool), joint_names=("elbow",))
    site = SimpleNamespace(signals=SimpleNamespace(model=model), joint=0)
    own = ({"vs": 0.1}, {"vs": 0.3}) if "vs" in law.shape else ({},)
    found = law.with_reversal_shapes(site, own)
    sharp = [
        {k: v for k, v in shape.items() if k != REGULARISATION}
        for shape in found
        if shape.get(REGULARISATION) == SHARP
    ]
    assert sharp == list(own)
    assert law.nearest(REGULARISATION, 0.01) == 0.1 and law.nearest(REGULARISATION, 20.0) == 7.0
