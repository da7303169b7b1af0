# SPDX-License-Identifier: BSD-3-Clause
"""Which messages count: whole or not at all, one sender, rising, fresh, within the task's limits."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.control.equilibrium_following import following_nothing
from impedance_modules.errors import BadInput
from impedance_modules.robot.state import RobotState
from impedance_modules.streaming.inbox import Inbox
from impedance_modules.streaming.set_point_message import LONGEST, make_message, read_message
from tests.support.led_arms import led_assembly, quaternion, started

STATE = RobotState(0.0, np.zeros(14), np.zeros(14), np.zeros(14))


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture(scope="module")
def controller(tmp_path_factory):
    return started(led_assembly(tmp_path_factory.mktemp("led")))


@pytest.fixture
def led(controller):
    """An inbox in a phase that listens, its clock, and what follows."""
    clock, following = Clock(), controller.following
    following.fresh[:] = 0
    inbox = Inbox(controller.assembly.task.set_points, clock=clock, calendar=clock)
    inbox.begin("follow", following)
    return inbox, clock, following


def message(sequence=1, target="right.hand", sent=None, **asked):
    raw = {"sequence": sequence, "targets": {target: asked}}
    return make_message(raw if sent is None else {**raw, "sent": sent})


def near(following, k=0, away=0.05):
    return (following.translation[k] + [away, 0.0, 0.0]).tolist()


def written(inbox, following):
    inbox.write(following, STATE)
    return following.fresh.tolist()


def test_a_message_counts_until_it_is_too_old(led):
    inbox, clock, following = led
    assert written(inbox, following) == [0, 0]
    inbox.put(message(position=near(following)), "one")
    assert written(inbox, following) == [1, 0]
    np.testing.assert_array_equal(following.goal[0, :3], near(following))
    clock.now += 0.1
    assert written(inbox, following) == [1, 0]
    clock.now += 0.001
    assert written(inbox, following) == [0, 0]


def test_what_a_message_leaves_out_stays_as_it_is(led):
    inbox, _, following = led
    inbox.put(message(stiffness=[0.0] * 6), "one")
    written(inbox, following)
    np.testing.assert_array_equal(following.goal[0, :3], following.translation[0])
    assert not following.stiffness[0].any()
    np.testing.assert_array_equal(following.force[0], following.stated_force[0])
    inbox.put(message(2, position=near(following)), "one")
    written(inbox, following)
    np.testing.assert_array_equal(following.stiffness[0], np.diag(following.stated_stiffness[0]))


REFUSED = {
    "far": (lambda f: message(position=near(f, away=0.121)), "valid: up to step, 0.12 m"),
    "turned": (
        lambda f: message(rotation=quaternion(np.array([0, 0, 3.0])).tolist()),
        "valid: up to turn, 0.5 rad",
    ),
    "stiff": (lambda f: message(stiffness=[301, 0, 0, 0, 0, 0]), "from 0 to 300, which the task states"),
    "free axis": (lambda f: message(force=[0, 0, 0, 0, 0, 0.1]), "from 0 to 0, which the task states"),
    "pull": (lambda f: message(force=[0, 0, 4, 0, 0, 0]), "from 0 to -4"),
    "target": (lambda f: message(target="right.hnad", position=near(f)), "did you mean 'right.hand'"),
    "old": (lambda f: message(sent=99.0, position=near(f)), "sent 1 s ago"),
    "future": (lambda f: message(sent=103.0, position=near(f)), "sent 3 s in the future"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_message_beyond_the_limits_is_refused_whole(led, name):
    inbox, _, following = led
    make, reason = REFUSED[name]
    asked = make(following)
    sound = message(target="left.hand", position=near(following, 1)).targets
    both = type(asked)(asked.sequence, {**sound, **asked.targets}, asked.sent)
    with pytest.raises(BadInput) as refusal:
        inbox.put(both, "one")
    assert reason in str(refusal.value)
    assert written(inbox, following) == [0, 0] and inbox.refused == 1


def test_a_sequence_must_rise(led):
    inbox, _, following = led
    inbox.put(message(7, position=near(following)), "one")
    for sequence in (7, 6):
        with pytest.raises(BadInput, match=f"sequence {sequence} after 7"):
            inbox.put(message(sequence, position=near(following)), "one")


def test_there_is_one_sender_until_it_is_silent(led):
    inbox, clock, following = led
    inbox.put(message(7, position=near(following)), "one")
    with pytest.raises(BadInput, match="one is sending"):
        inbox.put(message(1, position=near(following)), "two")
    clock.now += 1.001
    inbox.put(message(1, position=near(following)), "two")
    with pytest.raises(BadInput, match="two is sending"):
        inbox.put(message(8, position=near(following)), "one")


def test_nothing_counts_before_its_phase_or_after_it(led, controller):
    inbox, _, following = led
    inbox.put(message(1, position=near(following)), "one")
    inbox.begin("again", following)
    assert written(inbox, following) == [0, 0]
    inbox.begin("pause", following_nothing())
    with pytest.raises(BadInput, match="phase 'pause' does not listen"):
        inbox.put(message(2, position=near(following)), "one")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"", "no JSON"),
        (b'{"sequence": 1, "targets": {"right.hand": {"position": [NaN, 0, 0]}}}', "not finite"),
        (b'{"sequence": 1, "targets": {"right.hand": {"position": [1e999, 0, 0]}}}', "too large"),
        (b'{"sequence": 1, "targets": {"right.hand": {"position": [0, 0]}}}', "too short"),
        (b'{"sequence": 1, "targets": {"right.hand": {"rotation": [0, 0, 0, 1.1]}}}', "a unit quaternion"),
        (b'{"sequence": 1, "targets": {"right.hand": {"stiffness": [-1, 0, 0, 0, 0, 0]}}}', "minimum of 0"),
        (b'{"sequence": 1, "targets": {"right.hand": {"pose": [0]}}}', "'pose' was unexpected"),
        (b'{"targets": {"right.hand": {"position": [0, 0, 0]}}}', "'sequence' is a required"),
        (b" " * (LONGEST + 1), "65537 bytes"),
    ],
)
def test_a_message_that_is_none_is_refused(text, reason):
    with pytest.raises(BadInput) as refusal:
        read_message(text)
    assert reason in str(refusal.value)


def test_a_program_in_the_same_process_cannot_send_what_is_not_finite():
    with pytest.raises(BadInput, match="valid: finite numbers"):
        message(position=[np.nan, 0.0, 0.0])


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=7)
        | st.dictionaries(
            st.sampled_from(["sequence", "targets", "right.hand", "position", "rotation", "sent"]), inner
        )
    ),
    max_leaves=20,
)


@given(raw=JSON)
@settings(max_examples=200)
def test_whatever_comes_is_read_or_refused(raw):
    try:
        found = read_message(json.dumps(raw).encode())
    except BadInput:
        return
    assert found.targets
