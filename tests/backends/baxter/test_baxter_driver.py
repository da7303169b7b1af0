# SPDX-License-Identifier: BSD-3-Clause
"""A robot is commanded only once it listens to its commands and to its time-out."""

from __future__ import annotations

import time

import pytest

from impedance_modules.backends.baxter import driver, topics
from impedance_modules.backends.baxter.driver import Commander

LIMBS = dict.fromkeys(("left", "right"))
TIME_OUT = topics.command_timeout("right")


class SlowRobot:
    """A transport whose robot subscribes to each topic at a time of its own [s]."""

    def __init__(self, at: dict[str, float]) -> None:
        self._at, self._begin = at, time.monotonic()

    def advertise(self, topic, _message_type, *, latch=False):
        del latch
        return SlowTopic(self._begin + self._at.get(topic, 0.0))


class SlowTopic:
    def __init__(self, subscribed: float) -> None:
        self._subscribed = subscribed

    def connections(self) -> int:
        return int(time.monotonic() >= self._subscribed)


@pytest.fixture(autouse=True)
def short_limits(monkeypatch) -> None:
    monkeypatch.setattr(driver, "ATTACH_TIME", 0.0)
    monkeypatch.setattr(driver, "ATTACH_LIMIT", 0.2)


def test_a_time_out_that_is_subscribed_late_is_waited_for() -> None:
    begin = time.monotonic()
    assert Commander(SlowRobot({TIME_OUT: 0.1}), LIMBS).wait_for_subscribers() == ()
    assert time.monotonic() - begin >= 0.1


@pytest.mark.parametrize("topic", [TIME_OUT, topics.joint_command("left")])
def test_a_topic_without_subscriber_is_named(topic: str) -> None:
    assert Commander(SlowRobot({topic: 60.0}), LIMBS).wait_for_subscribers() == (topic,)
