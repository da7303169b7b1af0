# SPDX-License-Identifier: BSD-3-Clause
"""Enable and disable as a person does it, against the double on a real ROS master."""

from __future__ import annotations

from pathlib import Path

import pytest

from impedance_modules.cli.main import impedance as command_line
from impedance_modules.errors import BadInput
from tests.support.baxter_process import double, impedance

pytestmark = pytest.mark.ros


def test_power_goes_on_and_off_only_as_told(master: str, tmp_path: Path) -> None:
    with double(tmp_path, master) as robot:
        refused = impedance("baxter", "enable")
        assert refused.returncode == 2 and "--tucked" in refused.stderr
        assert "right_s1 at -2.1" in refused.stderr and not robot.last()["enabled"]
        on = impedance("baxter", "enable", "--tucked")
        assert (on.returncode, on.stdout) == (0, "enabled\n"), on.stderr
        robot.fault("estop")
        pressed = impedance("baxter", "enable", "--reset", "--tucked")
        assert pressed.returncode == 2 and "turn the e-stop button" in pressed.stderr
        robot.fault("estop-release")
        robot.wait_for("estop-release")
        released = impedance("baxter", "enable", "--tucked")
        assert released.returncode == 2 and "enable --reset" in released.stderr
        assert not robot.lines()[-1]["enabled"]
        on = impedance("baxter", "enable", "--reset", "--tucked", "--transport", "sockets")
        assert (on.returncode, on.stdout) == (0, "enabled\n"), on.stderr
        off = impedance("baxter", "disable")
        assert (off.returncode, off.stdout) == (0, "disabled\n"), off.stderr


@pytest.mark.parametrize(
    ("options", "reason"),
    [(["--software-version", "1.1.1"], "1.1.1"), (["--mount-offset", "left=0,0,0.09"], "mount")],
)
def test_another_robot_gets_no_power(master: str, tmp_path: Path, options: list[str], reason: str) -> None:
    with double(tmp_path, master, "--posture", "tucked", *options) as robot:
        for verb in (("enable", "--tucked"), ("untuck", "--enable")):
            refused = impedance("baxter", *verb)
            assert refused.returncode == 2 and reason in refused.stderr and "(valid: " in refused.stderr
        assert not robot.last()["enabled"]
        assert not [line for line in robot.lines() if "enabled" in line["event"]]


def test_two_robots_are_none(master: str, tmp_path: Path) -> None:
    with double(tmp_path, master, "--posture", "neutral", "--fault", "duplicate"):
        refused = impedance("baxter", "enable")
        assert refused.returncode == 2 and "/another_robot" in refused.stderr


def test_nobody_there(master: str) -> None:
    # Whether it says "nobody" or names somebody long gone depends on what earlier tests left with the master.
    silent = impedance("baxter", "enable")
    assert silent.returncode == 2 and "no /robot/state" in silent.stderr and "ROS_MASTER_URI" in silent.stderr


def test_bad_words_for_the_double_are_refused_before_it_stands(master: str) -> None:
    for words, part in (
        (("--fault", "estopp"), "did you mean 'estop'"),
        (("--posture", "standing"), "tucked"),
        (("--mount-offset", "left=1"), "LIMB=X,Y,Z"),
        (("--mount-offset", "lef=0,0,0.01"), "did you mean 'left'"),
        (("--mount-offset", "left=0,0,9"), "at most 0.1 m"),
        (("--duration", "0"), "above 0"),
    ):
        with pytest.raises(BadInput, match=part.replace("?", ".")):
            command_line.main(["baxter", "fake", *words], standalone_mode=False)


def test_no_master_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    for verb in ("fake", "enable", "disable"):
        refused = impedance("baxter", verb)
        assert refused.returncode == 2 and "127.0.0.1:9" in refused.stderr, refused.stderr
