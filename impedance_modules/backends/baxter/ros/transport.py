# SPDX-License-Identifier: BSD-3-Clause
"""The interface to ROS: topics, parameters, and who publishes what; two implementations, one more in the tests.

Rules that every transport keeps (``tests/backends/baxter/test_transports.py`` runs them over all of them):

- A subscriber receives from *every* publisher of its topic, also from those that come later, and keeps only the newest
  message of each: older ones that came while a callback ran are dropped, never delivered late.
- The receive time is ``time.monotonic()`` on this machine, so a step of any clock does not matter.
- ``send`` never waits for a subscriber.
- A node that ended without unregistering, and one that publishes another message type, do no harm;
  ``publisher_info`` names them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.errors import ImpedanceError

M = TypeVar("M", bound=Message)
M_contra = TypeVar("M_contra", bound=Message, contravariant=True)

ParameterValue = bool | int | float | str | Sequence["ParameterValue"] | Mapping[str, "ParameterValue"]
"""What a parameter server holds."""

Callback = Callable[[M, float], None]
"""Takes a message and the time at which it arrived [s, monotonic]; runs in a thread of the transport."""


class NoMasterError(ImpedanceError):
    """The ROS master cannot be reached, or what answers is no master; the message says what to set."""


class TransportClosedError(ImpedanceError):
    """A transport was used after it was closed."""


@dataclass(frozen=True)
class PublisherInfo:
    """What one publisher of a topic answers.

    Attributes:
        node: Its name.
        ros_type: Message type it sends; None when it could not be asked.
        checksum: MD5 of that type; None when it could not be asked.
        problem: Why it could not be asked; None when it answered.
        gone: It ended without unregistering. False where that is not certain.
    """

    node: str
    ros_type: str | None
    checksum: str | None
    problem: str | None
    gone: bool = False


class Publisher(Protocol[M_contra]):
    """A topic to write to."""

    def send(self, message: M_contra) -> None:
        """Sends to all present subscribers; never waits."""

    def connections(self) -> int:
        """Counts the subscribers."""

    def close(self) -> None:
        """Stops publishing; may be called twice."""


class Subscription(Protocol):
    """A topic that is subscribed to."""

    def close(self) -> None:
        """Unsubscribes; no callback begins afterwards. May be called twice."""


class Transport(Protocol):
    """One node."""

    def advertise(self, topic: str, message_type: type[M], *, latch: bool = False) -> Publisher[M]:
        """Becomes a publisher of a topic.

        Args:
            topic: Full name.
            message_type: What is sent.
            latch: Subscribers that connect later get the last message.
        """

    def subscribe(self, topic: str, message_type: type[M], callback: Callback[M]) -> Subscription:
        """Subscribes to every publisher of a topic."""

    def get_parameter(self, name: str) -> ParameterValue | None:
        """Returns a parameter, or None if it is not set."""

    def set_parameter(self, name: str, value: ParameterValue) -> None:
        """Sets a parameter."""

    def publishers_of(self, topic: str) -> tuple[str, ...]:
        """Names the nodes registered as publishers of a topic, also those that have ended, sorted."""

    def publisher_info(self, topic: str) -> tuple[PublisherInfo, ...]:
        """Asks every publisher of a topic, but not this node, what it sends; takes up to a second."""

    def close(self) -> None:
        """Withdraws everything this node has registered; may be called twice."""
