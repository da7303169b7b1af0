# SPDX-License-Identifier: BSD-3-Clause
"""Switches a robot's power on and off, as Rethink's SDK does; only at a person's request.

    enable   publish True at 100 Hz until /robot/state says enabled, 2 s at most
    disable  publish False likewise, 5 s at most
    reset    publish Empty until nothing is stopped or in error, 3 s at most; it disables

Tucked arms are within their own collision avoidance field, which blocks enabling until it is suppressed, from before
the request until it is done.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.ros.messages import AssemblyState, Bool, Empty
from impedance_modules.backends.baxter.ros.transport import Publisher, Transport
from impedance_modules.errors import ImpedanceError

PERIOD = 0.01
"""Between two requests [s]."""

ATTACH_TIME = 0.3
"""A robot needs about 0.24 s to subscribe to a new publisher [s]."""

ENABLE_TIME, DISABLE_TIME, RESET_TIME = 2.0, 5.0, 3.0
"""How long the SDK repeats each request [s]; the last one is ours."""

SUPPRESSION_TIME = 0.5
"""Time for which collision avoidance is suppressed before power comes on [s]."""

STATE_TIME = 3.0
"""Longest wait for the first /robot/state [s]."""

BUTTONS = {
    AssemblyState.BUTTON_UNPRESSED: "e-stop button not pressed",
    AssemblyState.BUTTON_PRESSED: "e-stop button pressed",
    AssemblyState.BUTTON_UNKNOWN: "stopped by something else than the button",
    AssemblyState.BUTTON_RELEASED: "e-stop button released, not yet reset",
}

SOURCES = {
    AssemblyState.SOURCE_NONE: "",
    AssemblyState.SOURCE_USER: "by a person",
    AssemblyState.SOURCE_UNKNOWN: "by an unknown source",
    AssemblyState.SOURCE_FAULT: "by a joint fault",
    AssemblyState.SOURCE_BRAIN: "by a lost heartbeat",
}


class PowerRefusedError(ImpedanceError):
    """The robot does not carry out a request; the message says what it reports and what to do."""


class Power:
    """Sends requests for power to one robot.

    Attributes:
        state: Newest /robot/state, or None.
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._received = threading.Event()
        self.state: AssemblyState | None = None
        transport.subscribe(topics.ROBOT_STATE, AssemblyState, self._on_state)

    def wait(self) -> AssemblyState:
        """Waits for the robot's state.

        Raises:
            PowerRefusedError: It publishes none, or two robots do.
        """
        if not self._received.wait(STATE_TIME):
            named = ", ".join(self._transport.publishers_of(topics.ROBOT_STATE)) or "nobody"
            raise PowerRefusedError(
                f"no {topics.ROBOT_STATE} for {STATE_TIME:g} s; registered to publish it: {named}"
                " (valid: a robot that is on, at ROS_MASTER_URI; ROS_IP = this machine in its network)"
            )
        alive = [
            publisher.node
            for publisher in self._transport.publisher_info(topics.ROBOT_STATE)
            if not publisher.gone
        ]
        if len(alive) > 1:
            raise PowerRefusedError(
                f"{len(alive)} nodes publish {topics.ROBOT_STATE}: {', '.join(alive)}; is a simulator still running?"
                " (valid: exactly one; end the others)"
            )
        return self._newest()

    def enable(self, limbs: Sequence[str]) -> None:
        """Switches power on.

        Args:
            limbs: Whose collision avoidance is suppressed before and meanwhile; none for arms that are not tucked.

        Raises:
            PowerRefusedError: The robot is stopped, or does not switch on.
        """
        state = self.wait()
        if state.stopped:
            raise PowerRefusedError(f"not enabled: {describe(state)} (valid: {_remedy(state)})")
        if state.enabled:
            return
        suppressions = [self._transport.advertise(topics.suppress_avoidance(limb), Empty) for limb in limbs]
        publisher = self._transport.advertise(topics.ENABLE, Bool)
        try:
            time.sleep(ATTACH_TIME)
            self._repeat(SUPPRESSION_TIME if limbs else 0.0, suppressions, lambda: False)
            ask = partial(publisher.send, Bool(data=True))
            done = self._repeat_request(ask, suppressions, lambda s: s.enabled, ENABLE_TIME)
        finally:
            publisher.close()
            for suppression in suppressions:
                suppression.close()
        if not done:
            hint = "" if limbs else "; arms that are tucked need --tucked"
            raise PowerRefusedError(
                f"the robot does not switch on: {describe(self._newest())}"
                f" (valid: nothing within the arms' force field{hint}; see /diagnostics)"
            )

    def disable(self) -> None:
        """Switches power off; the arms sink.

        Raises:
            PowerRefusedError: The robot does not switch off.
        """
        self.wait()
        publisher = self._transport.advertise(topics.ENABLE, Bool)
        ask = partial(publisher.send, Bool(data=False))
        self._ask(publisher, ask, lambda s: not s.enabled, DISABLE_TIME, "does not switch off")

    def reset(self) -> None:
        """Clears stops and faults, which disables too.

        Raises:
            PowerRefusedError: The button is pressed, or the fault stays.
        """
        state = self.wait()
        if state.stopped and state.estop_button == AssemblyState.BUTTON_PRESSED:
            raise PowerRefusedError(f"not reset: {describe(state)} (valid: {_remedy(state)})")
        publisher = self._transport.advertise(topics.RESET, Empty)
        self._ask(publisher, partial(publisher.send, Empty()), _is_clear, RESET_TIME, "cannot be reset")

    def _ask(
        self,
        publisher: Publisher[Bool] | Publisher[Empty],
        ask: Callable[[], None],
        done: Callable[[AssemblyState], bool],
        seconds: float,
        failure: str,
    ) -> None:
        try:
            time.sleep(ATTACH_TIME)
            if not self._repeat_request(ask, (), done, seconds):
                raise PowerRefusedError(f"the robot {failure}: {describe(self._newest())} (see /diagnostics)")
        finally:
            publisher.close()

    def _repeat_request(
        self,
        ask: Callable[[], None],
        suppressions: Sequence[Publisher[Empty]],
        done: Callable[[AssemblyState], bool],
        seconds: float,
    ) -> bool:
        """Repeats a request until the robot has done it; False when it has not in time."""

        def request_and_check() -> bool:
            ask()
            return done(self._newest())

        return self._repeat(seconds, suppressions, request_and_check)

    def _repeat(
        self,
        seconds: float,
        suppressions: Sequence[Publisher[Empty]],
        done: Callable[[], bool],
    ) -> bool:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for publisher in suppressions:
                publisher.send(Empty())
            if done():
                return True
            time.sleep(PERIOD)
        return False

    def _on_state(self, message: AssemblyState, received: float) -> None:  # noqa: ARG002 - a callback's signature
        self.state = message
        self._received.set()

    def _newest(self) -> AssemblyState:
        if self.state is None:
            raise PowerRefusedError(f"no {topics.ROBOT_STATE} yet (valid: wait for it first)")
        return self.state


def _is_clear(state: AssemblyState) -> bool:
    return not (state.stopped or state.enabled or state.error or state.estop_button or state.estop_source)


def describe(state: AssemblyState) -> str:
    """Puts a robot's state into words."""
    words = ["enabled" if state.enabled else "disabled"]
    words += ["stopped"] * state.stopped + ["in error"] * state.error
    if state.stopped or state.estop_button:
        words.append(BUTTONS.get(state.estop_button, f"button {state.estop_button}"))
        words.append(SOURCES.get(state.estop_source, f"source {state.estop_source}"))
    return ", ".join(word for word in words if word)


def _remedy(state: AssemblyState) -> str:
    release = "turn the e-stop button to release it, then " * (
        state.estop_button == AssemblyState.BUTTON_PRESSED
    )
    return f"{release}'impedance baxter enable --reset'"
