# SPDX-License-Identifier: BSD-3-Clause
"""A controller answers any torque that it does not know: no softer loop is named for it, and no gap is denied."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.recorded_signals import differentiate
from impedance_modules.effects.regressor import Site
from tests.diagnosis.test_diagnosis import JOINTS, answer, motion, torque
from tests.support.recordings import columns_of, save

STIFFNESS, DAMPING = 60.0, 6.0


def followed(asked: np.ndarray, time: np.ndarray, stiffness: float) -> np.ndarray:
    """Tracking error e (N,) of a loop that must ask for a torque: k e + d de/dt = u."""
    error, step = np.zeros_like(asked), time[1] - time[0]
    for i in range(len(time) - 1):
        error[i + 1] = error[i] + step * (asked[i] - stiffness * error[i]) / DAMPING
    return error


def recorded(folder: Path, kind: int, *, dead: float = 0.0, softer: float = 0.0) -> Path:
    """A servo whose feedforward lacks a fifth of its load and overcomes a damping that is not there.

    Its shoulder's motor has a dead zone [N.m], or its loop is softer than stated by a part: the motor gives
    tau = c - dead sign(c) - softer k e of a command c, which sees the position's noise.
    """
    dice = np.random.default_rng(kind)
    t, q, v, a = motion(kind, 20.0)
    tau = torque(q, v, a, mass=1.0)
    lost = dead * np.tanh(tau[:, 0] / 0.02)
    error = followed(0.2 * tau[:, 0] + 0.4 * v[:, 0] + lost, t, (1.0 - softer) * STIFFNESS)
    noise = dice.normal(scale=1e-5, size=q.shape)
    aim, command = q.copy(), tau + dice.normal(scale=0.005, size=q.shape)
    aim[:, 0] += error
    seen = STIFFNESS * noise[:, 0] + DAMPING * differentiate(noise[:, 0], t)
    command[:, 0] += lost + softer * STIFFNESS * error - seen
    columns = columns_of(t, JOINTS, position=q + noise, position_command=aim, effort_command=command)
    return save(folder, f"run{kind}", columns)


def test_a_dead_zone_is_no_softer_loop_and_is_still_seen(tmp_path: Path) -> None:
    _, said = answer(tmp_path, [recorded(tmp_path, kind, dead=0.5) for kind in range(4)])
    assert said["verdict"] in {"unexplained", "partly_explained"}
    assert "controller_gain" not in {cause["effect"] for cause in said["causes"]}


def test_a_loop_that_is_softer_by_a_part_is_named_with_its_size(tmp_path: Path) -> None:
    _, said = answer(tmp_path, [recorded(tmp_path, kind, softer=0.4) for kind in range(4)])
    first = said["causes"][0]
    assert (first["effect"], first["joints"]) == ("controller_gain", ["shoulder"])
    assert first["parameters"]["shoulder"]["dkp"]["value"] == pytest.approx(-0.4 * STIFFNESS, rel=0.1)


def sites(stiffness: float, damping: float, seed: int, *, commanded: bool = True) -> list[Site]:
    """Two recordings of a joint whose command has what the motion asked for needs, and answers errors."""
    out = []
    for number in range(2):
        dice = np.random.default_rng([seed, number])
        t = np.arange(400) / 100.0
        phases = (np.outer(t, dice.uniform(1, 9, 5)) + dice.uniform(0, 6, 5) for _ in range(3))
        q, e, tau = (np.sin(phase).sum(axis=1, keepdims=True) for phase in phases)
        signals = SimpleNamespace(
            position=q, velocity=differentiate(q, t), torque_of_aim=(tau, 0.0 * tau),
            rate_of=lambda x, t=t: differentiate(x, t), joint=lambda name: 0, weight=0.0 * q,
            position_command=q + e if commanded else None,
            drive=tau + stiffness * e + damping * differentiate(e, t),
        )  # fmt: skip
        out.append(Site(signals, "elbow", "actuator"))
    return out


@given(st.floats(0.1, 1e4), st.floats(0.0, 1e2), st.floats(-3.0, 3.0), st.integers(0, 1000))
def test_what_takes_the_whole_answer_back_contradicts_the_command(
    stiffness: float, damping: float, part: float, seed: int
) -> None:
    said = CATALOGUE["controller_gain"].contradicted(
        {"dkp": -part * stiffness, "dkd": 0.0}, sites(stiffness, damping, seed)
    )
    if abs(part - 2.0 / 3.0) > 1e-3:
        assert (said is not None) is (part > 2.0 / 3.0)


def test_without_a_recorded_aim_nothing_is_contradicted() -> None:
    loop = CATALOGUE["controller_gain"]
    assert loop.contradicted({"dkp": -50.0}, sites(5.0, 1.0, 0, commanded=False)) is None
    assert "command itself shows 5 +- " in str(loop.contradicted({"dkp": -5.0}, sites(5.0, 1.0, 0)))


@pytest.mark.parametrize(("dkp", "denied"), [(-0.5, True), (-0.01, True), (0.0, False), (0.5, False)])
def test_a_loop_that_its_command_does_not_show_may_only_be_stiffer(dkp: float, denied: bool) -> None:
    said = CATALOGUE["controller_gain"].contradicted({"dkp": dkp}, sites(-5.0, 1.0, 0))
    assert (said is not None) is denied


def test_an_error_in_proportion_to_what_is_fed_forward_shows_no_stiffness() -> None:
    recordings = sites(5.0, 0.0, 3)
    for site in recordings:
        # A slow motion whose error follows its load, but for a thousandth of it.
        load = 0.1 * (site.signals.position_command - site.signals.position)
        dice = np.random.default_rng(0)
        site.signals.torque_of_aim = (load * (1.0 + 1e-3 * dice.normal(size=load.shape)), 0.0 * load)
        site.signals.drive = site.signals.drive + dice.normal(scale=0.1, size=load.shape)
    assert CATALOGUE["controller_gain"].contradicted({"dkp": -1.0}, recordings) is not None
