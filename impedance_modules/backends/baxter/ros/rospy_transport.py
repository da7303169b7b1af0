# SPDX-License-Identifier: BSD-3-Clause
"""A ROS node by rospy, where ROS 1 is installed, and ``connect``, which takes plain sockets where it is not.

rospy transports the topics; requests to the master go by our own client.
"""

from __future__ import annotations

import importlib.util
import io
import os
import threading
import time
from collections.abc import Mapping
from functools import cache
from typing import Any, Generic, TypeVar

from impedance_modules.backends.baxter.ros.master_client import (
    MasterClient,
    MasterTransport,
    check_own_host,
    master_uri_of,
    own_host,
)
from impedance_modules.backends.baxter.ros.message_definitions import full_text
from impedance_modules.backends.baxter.ros.messages import MESSAGE_TYPES, Message
from impedance_modules.backends.baxter.ros.socket_transport import SocketTransport
from impedance_modules.backends.baxter.ros.tcp_connection import LENGTH, SubscriberConnection
from impedance_modules.backends.baxter.ros.transport import (
    Callback,
    Transport,
    TransportClosedError,
)
from impedance_modules.backends.baxter.ros.wire import checksum_of, decode, encode
from impedance_modules.errors import BadInput, ImpedanceError

M = TypeVar("M", bound=Message)

HOW_TO_INSTALL = (
    "rospy cannot be imported: {why}. It comes with ROS 1; on Debian 12:\n"
    "  apt-get install --no-install-recommends python3-rospy python3-roslaunch python3-sensor-msgs rosout\n"
    "and this package in a venv that sees it:\n"
    "  /usr/bin/python3 -m venv --system-site-packages VENV\n"
    "Without any ROS, --transport sockets does the same by Python's standard library."
)

TAKE_OVER_LOCK = threading.Lock()
"""Two threads may be the first to send on a connection; only one may take it over."""

KINDS = ("auto", "rospy", "sockets")
"""Names on the command line; ``auto`` is rospy where it can be imported, else sockets."""


def connect(kind: str, purpose: str, environment: Mapping[str, str] = os.environ) -> Transport:
    """Opens a node on the master that ROS_MASTER_URI names.

    Args:
        kind: One of ``KINDS``.
        purpose: Becomes part of the node's name, e.g. ``check``; the process's number makes it unique.
        environment: Of the process.

    Raises:
        BadInput: Another kind.
        NoMasterError: No master answers; the message says what to set.
        NoRospyError: rospy was asked for and is not installed.
    """
    if kind not in KINDS:
        raise BadInput(f"transport '{kind}' (valid: {', '.join(KINDS)})")
    name, uri = f"/impedance_{purpose}_{os.getpid()}", master_uri_of(environment)
    by_rospy = kind == "rospy" or (kind == "auto" and importlib.util.find_spec("rospy") is not None)
    return RospyTransport(name, uri) if by_rospy else SocketTransport(name, uri)


class NoRospyError(ImpedanceError):
    """ROS 1 is not installed where this Python looks; the message says what to install."""


class RospyTransport(MasterTransport):
    """The ROS node of this process; rospy knows only one, and none after it has been closed."""

    def __init__(self, node_name: str, master_uri: str) -> None:
        """Starts the node.

        Args:
            node_name: Full name.
            master_uri: Must be what ``ROS_MASTER_URI`` says, which is where rospy looks.

        Raises:
            NoRospyError: rospy is not installed.
            NoMasterError: No master answers, or this machine's own name (ROS_IP) is wrong.
            TransportClosedError: This process has closed its node before.
        """
        try:
            import rospy  # noqa: PLC0415 - an optional dependency of this transport alone
        except ImportError as error:
            raise NoRospyError(HOW_TO_INSTALL.format(why=error)) from error
        if rospy.core.is_shutdown_requested():
            raise TransportClosedError("rospy has been shut down in this process and cannot start again")
        MasterClient(master_uri, node_name).check()
        check_own_host(own_host(os.environ, master_uri))
        self._rospy = rospy
        rospy.init_node(
            node_name.lstrip("/"), disable_signals=True, disable_rosout=True, disable_rostime=True
        )
        super().__init__(str(rospy.get_name()), master_uri)
        self._parts: list[_Publisher[Any] | _Subscription[Any]] = []
        self._subscribers: dict[str, dict[Any, SubscriberConnection]] = {}

    def advertise(self, topic: str, message_type: type[M], *, latch: bool = False) -> _Publisher[M]:
        """Becomes a publisher of a topic."""
        self._check()
        handle = self._rospy.Publisher(
            topic, _ros_class(message_type.ros_type), queue_size=1, tcp_nodelay=True, latch=latch
        )
        subscribers = None if latch else self._subscribers.setdefault(topic, {})
        publisher = _Publisher(topic, message_type, handle, subscribers)
        self._parts.append(publisher)
        return publisher

    def subscribe(self, topic: str, message_type: type[M], callback: Callback[M]) -> _Subscription[M]:
        """Subscribes to every publisher of a topic."""
        self._check()
        subscription = _Subscription(callback)
        subscription.handle = self._rospy.Subscriber(
            topic, _ros_class(message_type.ros_type), subscription.receive, queue_size=1, tcp_nodelay=True
        )
        self._parts.append(subscription)
        return subscription

    def close(self) -> None:
        """Unregisters everything and ends the node; rospy cannot start another one in this process."""
        if self._closed:
            return
        self._closed = True
        # Subscriptions first: a callback may send.
        for part in sorted(self._parts, key=lambda part: isinstance(part, _Publisher)):
            part.close()
        self._unregister_all(str(self._rospy.get_node_uri()))
        self._rospy.signal_shutdown("the transport is closed")


class _Publisher(Generic[M]):
    """A publisher of rospy, without rospy's queue.

    rospy registers the topic and exchanges headers with every subscriber. A message is then sent in the calling thread:
    rospy would pass it to a thread of its own, and a command would wait for the interpreter once more. Latched messages
    are not urgent and are sent by rospy.
    """

    def __init__(
        self, topic: str, kind: type[M], handle: Any, subscribers: dict[Any, SubscriberConnection] | None
    ) -> None:
        """Takes rospy's handle, and the connections taken over so far; None for a latched topic."""
        self._topic, self._wrap, self._handle = topic, _ros_class(kind.ros_type), handle
        self._subscribers, self._closed = subscribers, False

    def send(self, message: M) -> None:
        """Sends to all present subscribers; never waits."""
        if self._closed:
            raise TransportClosedError(f"{self._topic}: the publisher is closed")
        if self._subscribers is None:
            self._handle.publish(self._wrap(message))
            return
        data = encode(message)
        frame = LENGTH.pack(len(data)) + data
        # rospy removes both when another thread closes the publisher meanwhile.
        impl = self._handle.impl
        for connection in (None if impl is None else impl.connections) or ():
            subscriber = self._subscribers.get(connection) or self._take_over(self._subscribers, connection)
            if subscriber is not None:
                subscriber.send(frame)

    def connections(self) -> int:
        """Counts the subscribers."""
        return 0 if self._closed else int(self._handle.get_num_connections())

    def close(self) -> None:
        """Stops publishing."""
        if not self._closed:
            self._closed = True
            self._handle.unregister()

    def _take_over(
        self, subscribers: dict[Any, SubscriberConnection], connection: Any
    ) -> SubscriberConnection | None:
        """Takes over the sending on one of rospy's connections; None for one that has just ended."""
        with TAKE_OVER_LOCK:
            known, own = subscribers.get(connection), connection.socket
            if known is not None or own is None:
                return known
            try:
                # A second handle on the same connection: rospy closes its own when it likes.
                subscribers[connection] = SubscriberConnection(
                    own.dup(), lambda _: self._remove(subscribers, connection)
                )
            except OSError:
                return None
            return subscribers[connection]

    def _remove(self, subscribers: dict[Any, SubscriberConnection], connection: Any) -> None:
        """Removes a connection that is over from rospy."""
        subscribers.pop(connection, None)
        if self._closed:
            return
        try:
            connection.close()
        except (AttributeError, TypeError):
            # rospy is closing the same connection in another thread, and is not protected against that.
            return


class _Subscription(Generic[M]):
    def __init__(self, callback: Callback[M]) -> None:
        self.handle: Any = None
        self._callback = callback
        self._calling = threading.RLock()
        self._closed = False

    def receive(self, wrapped: Any) -> None:
        """Passes a message on, with the time at which it was read."""
        with self._calling:
            if not self._closed:
                self._callback(wrapped.message, wrapped.received)

    def close(self) -> None:
        """Unsubscribes; no callback begins afterwards."""
        with self._calling:
            if self._closed:
                return
            self._closed = True
        self.handle.unregister()


@cache
def _ros_class(ros_type: str) -> Any:
    """Makes the class that rospy needs for a message: type, checksum and full text; bytes by our own encoding."""
    kind = MESSAGE_TYPES[ros_type]
    import genpy  # noqa: PLC0415 - comes with rospy

    class Wrapped(genpy.Message):  # type: ignore[misc]
        __slots__ = ("message", "received")
        _type, _md5sum = kind.ros_type, checksum_of(kind)
        _full_text, _has_header = full_text(kind.ros_type), False
        _slot_types = ()

        def __init__(self, message: Message | None = None) -> None:
            self.message, self.received = message, 0.0

        def _get_types(self) -> tuple[str, ...]:
            return ()

        def serialize(self, buffer: io.BytesIO) -> None:
            if self.message is None:
                raise genpy.SerializationError(f"{self._type}: nothing to send")
            buffer.write(encode(self.message))

        def deserialize(self, data: bytes) -> Any:
            self.received = time.monotonic()
            self.message = decode(kind, bytes(data))
            return self

    Wrapped.__name__ = kind.__name__
    return Wrapped
