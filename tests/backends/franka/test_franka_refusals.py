# SPDX-License-Identifier: BSD-3-Clause
"""Robot files, options and connection files that Franka arms cannot be run with: refused before any connection."""

from pathlib import Path

import pytest

from impedance_modules.backends.franka.franka_checks import refuse_unfit_robot
from impedance_modules.cli.connection_options import Reached
from impedance_modules.errors import BadFile, BadInput
from impedance_modules.spec.connection_file import read_connection
from impedance_modules.spec.robot_reader import read_robot
from tests.support.franka_simulator import NO_FRANKA

robots_of_the_simulator = pytest.mark.skipif(bool(NO_FRANKA), reason=NO_FRANKA)


def refusal(robot, addresses: dict[str, str]) -> str:
    with pytest.raises(BadInput) as found:
        refuse_unfit_robot(robot, addresses)
    return str(found.value)


@robots_of_the_simulator
def test_every_reason_is_told_at_once(tmp_path) -> None:
    from tests.support.franka_robot import write_robot

    robot = read_robot(write_robot(tmp_path / "arms", ("right", "left"), gravity="command", joints=6))
    said = refusal(robot, {"right": "10.0.0.1", "middle": "10.0.0.1"})
    assert "would carry it twice" in said
    assert said.count("a Franka arm has 7") == 2
    assert "no address for limb 'left'" in said
    assert "'middle', which is no limb" in said


@robots_of_the_simulator
def test_two_limbs_need_two_robots(tmp_path) -> None:
    from tests.support.franka_robot import write_robot

    robot = read_robot(write_robot(tmp_path / "arms", ("right", "left")))
    assert "two limbs have one address" in refusal(robot, {"right": "10.0.0.1", "left": "10.0.0.1"})
    refuse_unfit_robot(robot, {"right": "10.0.0.1", "left": "10.0.0.2"})


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        (("10.0.0.1",), "not LIMB=HOST"),
        (("right=",), "not LIMB=HOST"),
        (("right=10.0.0.1", "right=10.0.0.2"), "has an address already"),
    ],
)
def test_addresses_that_cannot_be_read(entries, words) -> None:
    robot = read_robot("two_planar_arms")
    with pytest.raises(BadInput, match=words):
        Reached(None, entries, False).of_franka(robot)


def test_options_win_over_the_file(tmp_path) -> None:
    path = tmp_path / "lab.yaml"
    path.write_text("format: 1\nfranka: {addresses: {right: a.lab, left: b.lab}, watch: {silent: 0.1}}\n")
    found = Reached(path, ("left=c.lab",), False).of_franka(read_robot("two_planar_arms"))
    assert found.addresses == {"right": "a.lab", "left": "c.lab"}
    assert found.watch.silent == 0.1 and found.realtime


@pytest.mark.parametrize("option", [(Path("lab.yaml"), (), False), (None, ("a",), False), (None, (), True)])
def test_other_backends_refuse_the_options(option) -> None:
    with pytest.raises(BadInput, match="does not use it"):
        Reached(*option).refuse_unused("sim")
    Reached(None, (), False).refuse_unused("sim")


def test_problems_of_a_connection_file_have_their_line(tmp_path) -> None:
    path = tmp_path / "lab.yaml"
    path.write_text(
        "format: 1\nfranka:\n  addresses: {right: http://x/}\n  watch: {silent: 3}\n  realtime: maybe\n"
    )
    with pytest.raises(BadFile) as found:
        read_connection(path)
    text = str(found.value)
    assert f"{path}:3:" in text and f"{path}:4:" in text and f"{path}:5:" in text


def test_taking_what_has_arrived_never_waits_whatever_time_out_other_libraries_set(monkeypatch) -> None:
    """As rospy sets one for all new sockets: a robot that reports on and on would be listened to for ever."""
    import os
    import socket
    import subprocess

    from impedance_modules.backends.franka import arm_link
    from impedance_modules.backends.franka.arm_link import ArmWatch

    kept = []
    monkeypatch.setattr(subprocess, "Popen", lambda words, pass_fds, **rest: kept.append(os.dup(pass_fds[0])))
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(60.0)
    try:
        link = arm_link.ArmLink("right", "127.0.0.1", ArmWatch(), realtime=False)
    finally:
        socket.setdefaulttimeout(before)
    link.drain()
    assert link.report is None and link.stop is None and link._channel.gettimeout() == 0.0
