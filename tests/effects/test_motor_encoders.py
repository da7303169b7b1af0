# SPDX-License-Identifier: BSD-3-Clause
"""Encoders on the motors' side of an elastic or loose joint: columns against an arm of textbook equations."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.recorded_signals import Signals
from impedance_modules.effects.regressor import Site
from impedance_modules.effects.rigid_model import RigidModel
from tests.reference.two_link_arm import (
    DAMPING,
    ROTOR,
    TwoLinkRecording,
    two_link_recording,
    urdf,
)

JOINTS = ("joint_1", "joint_2")
STIFFNESS, PLAY = np.array([2500.0, 900.0]), np.array([0.0, 0.0])
CHANNELS = ("link", "motor", "whole")
INNER = slice(60, -60)


@pytest.fixture(scope="module")
def rigid(tmp_path_factory: pytest.TempPathFactory) -> RigidModel:
    path = Path(tmp_path_factory.mktemp("arm")) / "arm.urdf"
    path.write_text(urdf())
    return RigidModel.from_urdf(path, JOINTS)


def signals_of(rigid: RigidModel, log: TwoLinkRecording, residual: str, **more: object) -> Signals:
    """What is logged beside the motors' positions: the springs' torque, the motors', or what was asked of them."""
    v = np.gradient(log.motor, log.time, axis=0)
    plain = Signals(
        model=rigid,
        time=log.time,
        position=log.motor,
        velocity=v,
        acceleration=v,
        effort={"link": log.spring, "motor": log.drive, "whole": None}[residual],
        drive=log.drive if residual == "whole" else None,
        position_command=None,
        reflected_inertia=ROTOR,
        motor_damping=DAMPING,
        spring_compliance=np.zeros(2),
        effort_source="motor" if residual == "motor" else "joint_sensor",
        **more,
    )
    velocity = plain.rate_of(log.motor)
    return replace(plain, velocity=velocity, acceleration=plain.rate_of(velocity))


def residual_of(s: Signals, residual: str) -> np.ndarray:
    """As the diagnosis computes it of a rigid arm, whose position the encoders are taken to read."""
    if residual == "link":
        return s.effort - s.rigid
    torque = s.drive if residual == "whole" else s.effort
    return torque - s.rigid - s.reflected_inertia * s.acceleration - s.motor_damping * s.velocity


def fitted(effect: str, s: Signals, residual: str) -> tuple[dict[str, dict[str, float]], float]:
    """Both joints' numbers by least squares over both rows, and the part of the residual that is left."""
    target = residual_of(s, residual)[INNER].ravel()
    sites = [Site(s, joint, "sensor") for joint in JOINTS]
    found = [CATALOGUE[effect].regressor(site, residual, {}) for site in sites]
    columns = np.column_stack([one.columns[INNER].reshape(len(target), -1) for one in found])
    numbers = np.linalg.lstsq(columns, target, rcond=None)[0]
    left = np.linalg.norm(target - columns @ numbers) / np.linalg.norm(target)
    values = [CATALOGUE[effect].values(numbers[[i]], {}, site) for i, site in enumerate(sites)]
    return dict(zip(JOINTS, values, strict=True)), float(left)


@pytest.mark.parametrize("residual", CHANNELS)
@pytest.mark.parametrize("seed", [1, 2])
def test_an_elastic_joint_read_at_its_motor_gives_its_stiffness_back(
    rigid: RigidModel, residual: str, seed: int
) -> None:
    log = two_link_recording(STIFFNESS, PLAY, seed)
    values, left = fitted("joint_elasticity", signals_of(rigid, log, residual), residual)
    assert left < 0.1
    for joint, truth in zip(JOINTS, STIFFNESS, strict=True):
        # Without a sensor the load is computed where the motor is, not the link: of the order of M (2 pi f)^2 / K.
        assert values[joint]["K"] == pytest.approx(truth, rel=0.01 if residual == "link" else 0.08)


def test_the_same_recording_is_no_spring_before_an_encoder_at_the_link(rigid: RigidModel) -> None:
    """A stated side is taken at its word, and only the right one explains the recording."""
    s = signals_of(rigid, two_link_recording(STIFFNESS, PLAY, 1), "motor")
    spring = CATALOGUE["joint_elasticity"]
    for side, port in (("link", "sensor"), ("motor", "actuator")):
        assert spring.regressor(Site(replace(s, encoders=(side, side)), "joint_1", port), "motor", {}) is None
    column = spring.regressor(Site(s, "joint_1", "actuator"), "motor", {}).columns[INNER, 0]
    target = residual_of(s, "motor")[INNER, 0]
    best = np.linalg.lstsq(column, target, rcond=None)[0]
    assert np.linalg.norm(target - column @ best) > 0.5 * np.linalg.norm(target)


def test_play_read_at_the_motor_gives_its_gap_back(rigid: RigidModel) -> None:
    """Stiff springs, so that the gap is what shows; the second joint's load changes its sign."""
    stiff, play = np.array([2e4, 2e4]), np.array([0.0, 0.02])
    log = two_link_recording(stiff, play, 5, seconds=12.0, centre=(0.6, 1.0))
    assert log.spring[:, 1].min() < 0.0 < log.spring[:, 1].max()
    s = signals_of(rigid, log, "link")
    column = CATALOGUE["backlash"].regressor(Site(s, "joint_2", "sensor"), "link", {}).columns
    target = residual_of(s, "link")
    # A crossing takes some milliseconds, and nobody measures where the motor is meanwhile.
    smooth = signal.butter(2, 6.0, fs=500.0, output="sos")
    x, y = (
        signal.sosfiltfilt(smooth, values, axis=0)[200:-200].ravel() for values in (column[:, :, 0], target)
    )
    gap = float(x @ y / (x @ x))
    assert gap == pytest.approx(0.02, rel=0.25)
    assert np.linalg.norm(y - gap * x) < 0.6 * np.linalg.norm(y)


def test_a_spring_that_is_known_is_no_gap_behind_an_encoder_at_the_motor(rigid: RigidModel) -> None:
    """With the side and the springs stated, the columns are about what the stiffness lacks."""
    log = two_link_recording(STIFFNESS, PLAY, 3)
    s = signals_of(rigid, log, "link")
    v = s.rate_of(log.link)
    known = replace(
        s, position=log.link, velocity=v, acceleration=s.rate_of(v),
        spring_compliance=1.0 / STIFFNESS, encoders=("motor", "motor"),
    )  # fmt: skip
    assert np.allclose(known.encoder_position, log.motor, atol=1e-12)
    assert np.allclose(known.encoder_velocity[INNER], s.velocity[INNER], atol=1e-6)
    assert np.linalg.norm(residual_of(known, "link")[INNER]) < 1e-3 * np.linalg.norm(log.spring)
    values = CATALOGUE["joint_elasticity"].values(np.zeros(1), {}, Site(known, "joint_2", "sensor"))
    assert values["K"] == pytest.approx(STIFFNESS[1])
