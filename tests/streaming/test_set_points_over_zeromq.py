# SPDX-License-Identifier: BSD-3-Clause
"""The wire: two programs send to a run, one counts; the run follows it in real time, and says how it is."""

import socket
import threading
import time

import pytest

from impedance_modules.episode.reader import read_episode
from impedance_modules.errors import BadInput
from impedance_modules.streaming.inbox import Inbox
from impedance_modules.streaming.receiver import SetPointReceiver, listening_address
from impedance_modules.streaming.sender import SetPointSender
from tests.support.commands import invoke, refusal
from tests.support.led_arms import led_assembly, started


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def one_answer(sender, targets):
    sender.send(targets)
    return sender.answers(wait=20.0)[-1]


def test_one_of_two_senders_counts_and_both_are_answered(tmp_path):
    controller = started(led_assembly(tmp_path))
    inbox = Inbox(controller.assembly.task.set_points)
    inbox.begin("follow", controller.following)
    address = f"tcp://127.0.0.1:{free_port()}"
    receiver = SetPointReceiver(address, inbox)
    try:
        with pytest.raises(BadInput, match="valid: a free port"):
            SetPointReceiver(address, inbox)
        place = controller.following.translation[0].tolist()
        with SetPointSender(address) as one, SetPointSender(address) as two:
            first = one_answer(one, {"right.hand": {"position": place}})
            second = one_answer(two, {"right.hand": {"position": place}})
            third = one_answer(one, {"right.hand": {"position": [9, 9, 9]}})
    finally:
        receiver.close()
        receiver.close()
    assert first == {"sequence": 1, "accepted": True, "reason": None, "state": None}
    assert not second["accepted"] and "is sending" in second["reason"]
    assert third["sequence"] == 2 and "up to step" in third["reason"]
    assert (inbox.accepted, inbox.refused) == (1, 2)


def test_a_run_follows_a_program_and_its_recording_verifies(tmp_path):
    """By the command line, as a user has it: ``run --listen`` here, a sender beside it."""
    led_assembly(tmp_path, force=0.0)
    address = f"127.0.0.1:{free_port()}"
    over, answers = threading.Event(), []

    def send() -> None:
        with SetPointSender(f"tcp://{address}") as sender:
            goal = None
            while not over.is_set():
                asked = {"position": goal} if goal is not None else {"stiffness": [300, 200, 100, 8, 8, 8]}
                sender.send({"left.hand": asked})
                for answer in sender.answers(wait=0.02):
                    answers.append(answer)
                    state = answer["state"]
                    if goal is None and state is not None and state["listening"]:
                        x, y, z = state["equilibria"]["left.hand"][:3]
                        goal = [x + 0.05, y, z]
                time.sleep(0.01)

    thread = threading.Thread(target=send)
    thread.start()
    began = time.perf_counter()
    try:
        code = invoke(
            "run", tmp_path / "led.yaml", "--listen", address, "--out", tmp_path / "run"
        ).return_value
    finally:
        over.set()
        thread.join()
    assert code == 0 and time.perf_counter() - began > 1.2
    assert any(answer["accepted"] for answer in answers)
    refused = {answer["reason"] for answer in answers if not answer["accepted"]}
    assert any("does not listen" in reason for reason in refused) or refused <= {None}
    episode = read_episode(tmp_path / "run")
    assert episode.target["left_hand"][:, 0].max() - episode.target["left_hand"][0, 0] > 0.02
    assert invoke("replay", tmp_path / "run", "--verify").return_value == 0


def test_listening_needs_a_task_that_does():
    assert "has no 'set_points'" in refusal("run", "soft-hold", "--listen")


@pytest.mark.parametrize(
    ("given", "address"),
    [
        ("", "tcp://127.0.0.1:5586"),
        (":6000", "tcp://127.0.0.1:6000"),
        ("0.0.0.0", "tcp://0.0.0.0:5586"),
        ("robot.lan:7000", "tcp://robot.lan:7000"),
    ],
)
def test_where_it_listens(given, address):
    assert listening_address(given) == address


@pytest.mark.parametrize("given", ["localhost:port", ":0", ":70000", ":"])
def test_a_port_that_is_none_is_refused(given):
    with pytest.raises(BadInput, match="is no port"):
        listening_address(given)
