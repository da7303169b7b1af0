# SPDX-License-Identifier: BSD-3-Clause
"""Roughness from position and force: what a window says, what is refused, and the command."""

import json
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.roughness_detection import Directions, Window, WindowFinder
from tests.support.commands import invoke, refusal
from tests.support.recordings import save

TOWARDS = Directions(np.array([-1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
RATE, STROKES = 100.0, 9


def rubbing(
    shake: float, friction: float, *, hertz: float = 20.0, push: float = 5.0, drift: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """To and fro along x at 0.3 Hz; friction, a shaking force of one amplitude, and a slow drift."""
    time = np.arange(0.0, STROKES / 0.3, 1.0 / RATE)
    place = np.zeros((time.size, 3))
    place[:, 0] = 0.5 + 0.12 * np.sin(2.0 * np.pi * 0.3 * time)
    sense = np.sign(np.cos(2.0 * np.pi * 0.3 * time))
    force = np.zeros((time.size, 3))
    force[:, 0] = -friction * push * sense + shake * np.sin(2.0 * np.pi * hertz * time) + drift * place[:, 0]
    force[:, 2] = push
    return time, place, force


def windows_of(time: np.ndarray, place: np.ndarray, force: np.ndarray) -> list[Window]:
    finder = WindowFinder(TOWARDS)
    found = (finder.add(*row) for row in zip(time, place, force, strict=True))
    return [window for window in found if window is not None]


@pytest.mark.parametrize(("shake", "friction", "push"), [(0.5, 0.3, 5.0), (2.0, 0.8, 2.0)])
def test_a_window_measures_the_shaking_and_the_friction(shake, friction, push) -> None:
    windows = windows_of(*rubbing(shake, friction, push=push))
    assert len(windows) == STROKES
    for window in windows:
        assert window.band == pytest.approx(shake / np.sqrt(2.0), rel=0.03)
        assert window.friction == pytest.approx(friction, rel=0.05)
        assert window.normal == pytest.approx(push)


def test_what_is_slow_or_outside_the_band_does_not_count() -> None:
    for numbers in ({"hertz": 6.25}, {"hertz": 37.5}, {"hertz": 0.01, "drift": 10.0}):
        assert max(window.band for window in windows_of(*rubbing(1.0, 0.3, **numbers))) < 0.1


def test_strokes_that_stick_or_lift_off_give_no_window() -> None:
    time, place, force = rubbing(0.1, 0.3)
    force[time < 10.0, 2] = 0.0
    stuck = time > 20.0
    place[stuck, 0] = place[stuck, 0][0] + 0.004 * np.sin(2.0 * np.pi * 1.2 * time[stuck])
    windows = windows_of(time, place, force)
    assert 2 <= len(windows) <= 4 and all(9.0 < window.start < 20.5 for window in windows)


def recorded(folder: Path, **kept: bool) -> Path:
    """An episode with a hand's pose and, if kept, the force on it."""
    time, place, force = rubbing(0.5, 0.4)
    columns = {"time": time, "position.elbow": np.zeros(time.size)}
    columns |= {f"pose.palm.{axis}": place[:, k] for k, axis in enumerate("xyz")}
    columns |= {f"pose.palm.{axis}": np.zeros(time.size) for axis in ("qx", "qy", "qz")}
    columns["pose.palm.qw"] = np.ones(time.size)
    if kept.get("wrench", True):
        pressed = force * (1.0 if kept.get("contact", True) else 0.01)
        columns |= {f"wrench.palm.{axis}": pressed[:, k] for k, axis in enumerate(("fx", "fy", "fz"))}
    return save(folder, "rub", columns, robot="somebody", effort_source=None)


def test_the_command_prints_and_writes_what_the_windows_say(tmp_path: Path) -> None:
    path = tmp_path / "out" / "found.json"
    assert "palm" in invoke("roughness", recorded(tmp_path), "--json", path).output
    found = json.loads(path.read_text())
    assert found["along"] == pytest.approx([-1.0, 0.0, 0.0]) and found["force_from"] == "wrench"
    assert len(found["windows"]) == STROKES
    assert np.mean([window["friction"] for window in found["windows"]]) == pytest.approx(0.4, rel=0.05)


@pytest.mark.parametrize(
    ("options", "kept", "missing"),
    [
        ([], {"wrench": False}, "no force"),
        ([], {"contact": False}, "no contact"),
        (["--windows", "12"], {}, "too few windows: 9"),
        (["--to", "8"], {}, "too few windows: 2"),
        (["--along", "y"], {}, "too few windows: 0"),
        (["--hand", "thumb"], {}, "no force on 'thumb'"),
        (["--along", "up"], {}, "'up' is no direction"),
        (["--from", "5", "--to", "4"], {}, "no time lies between"),
    ],
)
def test_a_request_that_cannot_be_met_says_what_is_missing(tmp_path, options, kept, missing) -> None:
    assert missing in refusal("roughness", recorded(tmp_path, **kept), *options)
