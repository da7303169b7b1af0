# SPDX-License-Identifier: BSD-3-Clause
"""A robot that plays a joint path back by itself: it follows in the air, gives up or pauses at what it meets."""

import json
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.assembly import Assembly
from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import BadFile, BadInput
from impedance_modules.plant.playback import JointPath, Playback, PlaybackMode
from impedance_modules.runs.playback_run import make_playback
from impedance_modules.spec.task import SurfaceSpec
from tests.support.commands import invoke, refusal
from tests.support.forecast_tasks import assembled
from tests.support.paths import CHECKOUT

TASK = CHECKOUT / "tasks" / "thesis" / "slide-over-position.yaml"


@cache
def assembly() -> Assembly:
    return assembled(TASK)


def swing(seconds: float = 3.0, reach: float = 0.5) -> JointPath:
    """The right shoulder turns by ``reach`` [rad]; everything else stays."""
    task = assembly()
    time = np.linspace(0.0, seconds, 61)
    position = np.tile(task.modules.posture, (time.size, 1))
    share = (time / seconds) ** 2 * (3.0 - 2.0 * time / seconds)
    position[:, task.model.joint_names.index("right_s0")] -= reach * share
    return JointPath(time, position)


def play(mode: str, path: JointPath, *surfaces: SurfaceSpec) -> tuple[Playback, list[float]]:
    task = assembly()
    order = replace(task.task.playback, mode=mode)
    there = replace(task, task=replace(task.task, playback=order, environment=surfaces))
    playback = make_playback(there, path, 0)
    playback.start()
    place, away = task.model.joint_names.index("right_s0"), []
    for _ in range(4000):
        if playback.done:
            break
        state = playback.tick()
        away.append(playback.wanted[place] - state.position[place])
    return playback, away


def wall() -> SurfaceSpec:
    """A block beside the right hand, in the way of the swing."""
    hand = assembly().model.pose(assembly().modules.posture, "right_hand").translation
    middle = (hand[0], hand[1] - 0.10, hand[2])
    return SurfaceSpec("box", None, middle, (0.0, 0.0, 0.0), (0.8, 0.1, 0.4), 20000.0, 100.0, 0.3)


def test_in_the_air_the_joints_follow_as_the_modes_say() -> None:
    path, spec = swing(), assembly().robot.playback
    place = assembly().model.joint_names.index("right_s0")
    for mode in PlaybackMode:
        playback, away = play(mode.value, path)
        assert not playback.stopped and not playback.collisions
        assert playback.now == pytest.approx(3.0, abs=0.02)
        # Both trail like a first-order lag: e' = v - e / T.
        lag = spec.position_lag if mode is PlaybackMode.POSITION else 1.0 / spec.velocity_gain
        wanted, error = np.array([path.at(1e-3 * k)[place] for k in range(1501)]), 0.0
        for step in np.diff(wanted):
            error += step - 1e-3 * error / lag
        assert away[1500] == pytest.approx(error, rel=0.1)
        assert max(map(abs, away)) < spec.position_tolerance


def test_what_is_in_the_way_ends_position_mode_and_pauses_velocity_mode() -> None:
    path = swing()
    stopped, _ = play("position", path, wall())
    assert "right_s0 is 0.20" in stopped.stopped and "at most 0.2 rad" in stopped.stopped
    held = stopped.state.position.copy()
    for _ in range(500):
        stopped.tick()
    assert np.abs(stopped.state.position - held).max() < 0.03
    pausing, away = play("velocity", path, wall())
    assert not pausing.stopped and pausing.now == pytest.approx(3.0, abs=0.02)
    assert pausing.collisions[0][1:] == ("right", "impact")
    assert max(map(abs, away)) > assembly().robot.playback.position_tolerance


def test_a_path_is_a_path() -> None:
    path = JointPath(np.array([2.0, 3.0]), np.array([[0.0, 1.0], [1.0, 3.0]]))
    np.testing.assert_allclose([path.at(t)[1] for t in (-1.0, 0.0, 0.25, 1.0, 9.0)], [1, 1, 1.5, 3, 3])
    with pytest.raises(BadInput, match="ascending"):
        JointPath(np.array([0.0, 0.0]), np.zeros((2, 1)))


def short_task(folder: Path, **changes: str) -> Path:
    """A playback whose path takes two seconds: a hand's breadth down, taught in the air, to a table that is there."""
    text = TASK.read_text()
    head = text[: text.index("environment:")]
    plane = "{surface: plane, height: -0.30, stiffness: 20000, damping: 100, friction: 0.2}"
    phase = "{name: down, equilibrium: {right.hand: {z: -0.50}}, beyond_reach: true, duration: 2}"
    play = f"playback: {{mode: {changes.get('mode', 'velocity')}, taught_on: []}}"
    text = f"{head}environment:\n  - {plane}\n{play}\nphases:\n  - {phase}\n"
    (folder / "down.yaml").write_text(text + changes.get("more", ""))
    return folder / "down.yaml"


def test_a_task_is_taught_played_back_and_recorded(tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = invoke("run", short_task(tmp_path), "--out", out)
    summary = json.loads((out / "summary.json").read_text())
    assert not result.return_value and "played to its end" in result.output
    assert summary["hands"]["right_hand"]["peak_force"] > 3.0
    episode, lesson = read_episode(out), read_episode(out / "taught")
    assert lesson.pose["right_hand"][-1, 2] < -0.33 and episode.pose["right_hand"][-1, 2] > -0.315
    # What was commanded is what was taught, and no torque is claimed that nobody sent.
    joint = "right_s1"
    np.testing.assert_allclose(episode.position_command[joint][-1], lesson.position[joint][-1], atol=0.02)
    assert not episode.effort_command and episode.metadata["task"] is None
    again = ("--log", out / "taught", "--out", tmp_path / "again", "--duration", 0.5)
    assert not invoke("run", tmp_path / "down.yaml", *again).return_value
    assert read_episode(tmp_path / "again").time[-1] == pytest.approx(0.5, abs=0.01)


def test_what_a_playback_cannot_do_is_refused(tmp_path: Path) -> None:
    task = short_task(tmp_path)
    asked = {"built-in plant only": ("--backend", "replay"), "neither a viewer": ("--view",)}
    for words, options in asked.items():
        assert words in refusal("run", task, *options, "--out", tmp_path / "none")
        assert not (tmp_path / "none").exists()
    pushed = short_task(tmp_path, more="pushes: [{target: right, wrench: {z: 2}, start: 1, hold: 0.5}]\n")
    with pytest.raises(BadFile, match="pushes: a robot that plays a path back is not pushed"):
        assembled(pushed)
    robot = tmp_path / "robots" / "mute"
    shutil.copytree(TASK.parents[2] / "robots" / "baxter", robot)
    lines = (robot / "robot.yaml").read_text().replace("name: baxter", "name: mute")
    start, end = lines.index("playback:"), lines.index("collision: #")
    (robot / "robot.yaml").write_text(lines[:start] + lines[end:])
    mute = short_task(tmp_path)
    mute.write_text(mute.read_text().replace("robot: baxter", "robot: mute"))
    with pytest.raises(BadFile, match="plays nothing back"):
        assembled(mute)
