# SPDX-License-Identifier: BSD-3-Clause
"""Laws of dry friction are compared as they reverse: small numbers of a richer law are not lost in a slow turn."""

import numpy as np
import pytest

from tests.diagnosis.test_diagnosis import JOINTS, answer, motion, torque
from tests.support.recordings import columns_of, save

TURN = 0.05
"""Speed over which friction changes its sign [rad/s], five times the usual one: no law of several numbers tries it."""
DRY = 0.25
"""Coulomb friction [N.m]."""


def named(folder, *, difference: float = 0.0, fall: float = 0.0, noise: float) -> dict:
    """First cause on the elbow, whose friction differs between directions, or falls over 0.15 rad/s."""
    paths = []
    for index, kind in enumerate((0, 1, 2, 3)):
        dice = np.random.default_rng(index)
        t, q, v, a = motion(kind, 12.0)
        turning = np.tanh(v[:, 1] / TURN)
        dry = (DRY + fall * np.exp(-((v[:, 1] / 0.15) ** 2))) * turning + difference * np.abs(turning)
        tau = torque(q, v, a, mass=1.02) + np.column_stack([0.0 * dry, dry])
        tau = tau + dice.normal(scale=noise, size=q.shape)
        q = q + dice.normal(scale=1e-5, size=q.shape)
        paths.append(save(folder, f"run{index}", columns_of(t, JOINTS, position=q, effort=tau)))
    first = answer(folder, paths)[1]["causes"][0]
    assert first["joints"] == ["elbow"]
    assert first["parameters"]["elbow"]["fc"]["value"] == pytest.approx(DRY, rel=0.1)
    return first


def test_a_fall_of_a_quarter_is_seen_beside_a_slow_turn(tmp_path):
    first = named(tmp_path, fall=0.06, noise=0.03)
    assert (first["effect"], first["equivalent"]) == ("stribeck_friction", [])
    assert first["parameters"]["elbow"]["fs"]["value"] == pytest.approx(DRY + 0.06, rel=0.1)


def test_a_difference_of_directions_beside_a_slow_turn_is_not_told_as_none(tmp_path):
    first = named(tmp_path, difference=0.03, noise=0.02)
    said = [first["effect"], *(other["effect"] for other in first["equivalent"])]
    assert "asymmetric_friction" in said


def test_friction_without_either_is_that_of_coulomb(tmp_path):
    first = named(tmp_path, noise=0.02)
    assert (first["effect"], first["equivalent"]) == ("coulomb_friction", [])
