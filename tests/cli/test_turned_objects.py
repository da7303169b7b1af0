# SPDX-License-Identifier: BSD-3-Clause
"""The user's path with an object on a hinge: check, analyze, run, look, verify; and a hinge that is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.episode.reader import read_episode
from impedance_modules.episode.run_picture import PICTURE_KINDS
from tests.cli.test_command_line import impedance, summary_of
from tests.support.forecast_tasks import write_task
from tests.support.paths import CHECKOUT

LEVER = (CHECKOUT / "tasks" / "thesis" / "turn-lever.yaml").read_text()
SHORT = (
    ("{name: hold, duration: 1}", "{name: hold, duration: 0.3}"),
    ("angle: 0.6}}, duration: 4}", "angle: 0.4}}, duration: 2}"),
    ("\n  - {name: wait, duration: 2}", ""),
    ("\n  - {name: back, equilibrium: {hinge: {angle: 0}}, duration: 4}", ""),
    ("{name: rest, duration: 2}", "{name: rest, duration: 1}"),
    ("friction: 1.0", "friction: 2.0"),
)


@pytest.fixture(scope="module")
def lever(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_task(tmp_path_factory.mktemp("lever"), LEVER, *SHORT)


def test_a_lever_is_checked_turned_and_verified(lever: Path) -> None:
    folder = lever.parent
    told = impedance("check", str(lever), cwd=folder).stdout
    assert "hinge of the object" in told and "friction of the hinge" in told
    impedance("run", str(lever), "--out", "run", cwd=folder)
    hinge = summary_of(folder / "run")["hinge"]
    assert 0.1 < hinge["final_angle"] <= hinge["highest_angle"] < 0.4
    assert 1.5 < hinge["peak_torque"] < 3.0
    drawn = read_episode(folder / "run", PICTURE_KINDS)
    assert set(drawn.extra) == {"hinge.angle", "hinge.torque"}
    whole = read_episode(folder / "run")
    assert np.array_equal(whole.extra["hinge.angle"], drawn.extra["hinge.angle"])
    assert whole.extra["hinge.angle"][-1] == hinge["final_angle"]
    # At rest the friction's torque is what the hands hold.
    assert np.mean(whole.extra["hinge.torque"][-500:]) == pytest.approx(2.0, abs=0.4)
    assert "bit-equal" in impedance("replay", "run", "--verify", cwd=folder).stdout


def test_analyze_tells_the_impedance_about_the_axis(lever: Path) -> None:
    told = impedance("analyze", str(lever), "--json", "a.json", cwd=lever.parent).stdout
    hinge = json.loads((lever.parent / "a.json").read_text())["object"]["hinge"]
    assert "about its hinge" in told and f"{hinge['stiffness']['sum']:.4g} N.m/rad" in told
    assert hinge["inertia"]["sum"] > hinge["inertia"]["object"] > 0.0
    assert hinge["own"] == {"friction": 2.0, "damping": 0.1, "stiffness": 0.0}


def test_a_hinge_that_cannot_be_is_refused_with_every_place_at_once(tmp_path: Path) -> None:
    task = write_task(
        tmp_path,
        LEVER,
        ("axis: [0, 0, -1]", "axis: [0, 0, 0]"),
        ("lower: -0.3", "lower: 2"),
        ("friction: 1.0", "friction: -1"),
    )
    line = next(i for i, text in enumerate(task.read_text().split("\n"), 1) if "axis: [0, 0, 0]" in text)
    told = impedance("run", str(task), "--out", "run", cwd=tmp_path, code=2).stderr
    assert told.count(f"task.yaml:{line}:") == 3 and "Traceback" not in told
    for words in ("axis of length 0", "lower stop, 2 rad, is above", "-1 N.m is less than the least allowed"):
        assert words in told
    assert not (tmp_path / "run").exists()
