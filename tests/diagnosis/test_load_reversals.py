# SPDX-License-Identifier: BSD-3-Clause
"""Play behind an encoder at the motor is found although nobody saw the link cross it."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.diagnosis.model_selection.load_reversals import load_reversal_note, rows_on_one_flank
from tests.diagnosis.test_diagnosis import JOINTS, answer, motion, torque
from tests.support.recordings import columns_of, save

SLOWER = 2.0


def recorded(
    folder: Path,
    play: float,
    joint: int = 0,
    about: tuple[float, float] = (0.4, 0.0),
    size: float = 1.0,
) -> list[Path]:
    """Motions about a posture [rad], with play [rad] at a joint; the motor crosses it where the joint's load reverses.

    About the posture that is given when none is, the hanging pendulum is passed, where the shoulder's load reverses.
    """
    paths = []
    for kind in range(4):
        random = np.random.default_rng(kind)
        t, q, v, a = motion(kind, 25.0)
        t, q, v, a = SLOWER * t, size * q + np.array(about), size * v / SLOWER, size * a / SLOWER**2
        load = torque(q, v, a, mass=1.0)
        motor = q + random.normal(scale=1e-5, size=q.shape)
        motor[:, joint] += 0.5 * play * np.tanh(load[:, joint] / 0.1)
        effort = load + random.normal(scale=0.02, size=q.shape)
        paths.append(save(folder, f"run{kind}", columns_of(t, JOINTS, position=motor, effort=effort)))
    return paths


@pytest.mark.parametrize("play", [0.03, 0.08])
def test_play_behind_the_encoder_is_named_with_its_size(tmp_path: Path, play: float) -> None:
    _, said = answer(tmp_path, recorded(tmp_path, play), "--encoder", "motor")
    first = said["causes"][0]
    assert (first["effect"], first["port"], first["joints"]) == ("backlash", "sensor", ["shoulder"])
    assert first["parameters"]["shoulder"]["b"]["value"] == pytest.approx(play, rel=0.15)
    assert any("the load of shoulder reverses" in words for words in said["data"]["warnings"])


def test_a_tight_gear_keeps_all_its_rows(tmp_path: Path) -> None:
    _, said = answer(tmp_path, recorded(tmp_path, 0.0), "--encoder", "motor")
    assert said["verdict"] == "no_gap" and not any("reverses" in words for words in said["data"]["warnings"])


@pytest.mark.parametrize(
    ("play", "side", "alike"), [(0.5, "motor", True), (-0.5, "motor", False), (0.5, "link", False)]
)
def test_play_that_is_never_crossed_is_told_with_the_offset_that_it_is(
    tmp_path: Path, play: float, side: str, alike: bool
) -> None:
    """A link that lies at one flank is half the gap behind the motor, never before it; its own encoder has no play."""
    _, said = answer(tmp_path, recorded(tmp_path, play, 1, about=(0.3, 0.6), size=0.4), "--encoder", side)
    first = said["causes"][0]
    assert (first["effect"], first["joints"]) == ("encoder_offset", ["elbow"])
    assert first["parameters"]["elbow"]["dq0"]["value"] == pytest.approx(play / 2.0, rel=0.1)
    assert ("backlash" in [other["effect"] for other in first["equivalent"]]) is alike
    assert said["verdict"] == ("ambiguous" if alike else "explained")


RATE, CUTOFF, SAMPLES, ORDER = 50.0, 10.0, 1000, 4
TIME = np.arange(SAMPLES) / RATE
SWAY = np.sin(2.0 * np.pi * 0.2 * TIME + 0.3)
AT_REVERSALS = np.where(np.abs(SWAY) < 0.2, 5.0, 1.0)


def flanks(load: np.ndarray, left: np.ndarray, side: str | None = "motor", residual: str = "link"):
    """Masks and joint of one recording of two joints, of which the second is loaded by (N,) and leaves (N,)."""
    item = SimpleNamespace(
        load=np.column_stack([np.ones(SAMPLES), load]),
        band=SimpleNamespace(rate=4.0 * RATE, step=4, cutoff=CUTOFF),
        signals=SimpleNamespace(encoder=lambda joint: side),
        tree=SimpleNamespace(joints=("shoulder", "elbow")),
    )
    fit = SimpleNamespace(
        residuals=lambda coefficients, r: [np.ones(SAMPLES - ORDER), left[ORDER:]],
        whole=SimpleNamespace(coefficients=None),
        design=SimpleNamespace(groups=[(residual, 0), (residual, 1)], whitening=SimpleNamespace(clear={})),
    )
    return rows_on_one_flank(fit, [item]), item


def test_a_load_that_reverses_masks_all_joints_a_filters_length_about_it() -> None:
    (rows, joint), item = flanks(SWAY, AT_REVERSALS)
    assert joint == 1 and sorted(rows) == [(0, 0), (0, 1)]
    least = 0.1 * np.sqrt(np.mean(SWAY**2))
    distance = np.abs(TIME[:, None] - TIME[np.abs(SWAY) <= least]).min(axis=1)
    assert not rows[0, 0][distance < 2.6 / CUTOFF].any() and rows[0, 0][distance > 2.6 / CUTOFF + 0.05].all()
    assert "the load of elbow reverses" in load_reversal_note(joint, rows, [item])


@pytest.mark.parametrize(
    ("load", "left", "side", "residual"),
    [
        (SWAY, np.ones(SAMPLES), "motor", "link"),  # nothing happens there
        (SWAY, AT_REVERSALS, "link", "link"),  # the link was seen
        (SWAY, AT_REVERSALS, None, "link"),  # nobody says where the encoder is
        (SWAY, AT_REVERSALS, "motor", "actuator"),  # the links' motion plays no part
        (np.sin(2.0 * np.pi * 3.0 * TIME), AT_REVERSALS, "motor", "link"),  # hardly ever loaded
        (SWAY + 2.0, AT_REVERSALS, "motor", "link"),  # never reverses
    ],
)
def test_other_rows_count(load, left, side, residual) -> None:
    (rows, joint), _ = flanks(load, left, side, residual)
    assert not rows and joint is None
