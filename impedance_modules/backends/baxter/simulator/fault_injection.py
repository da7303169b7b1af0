# SPDX-License-Identifier: BSD-3-Clause
"""Fault injection: faults as text, on the command line with a time or on a topic at once, and their effect on messages.

    NAME            switches a fault on (or does it once)
    NAME VALUE      with a number, a side or a word
    NAME off        switches it off

On the command line ``@5`` in front means five seconds after the start: ``@5 silence``.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from impedance_modules.backends.baxter.ros.messages import JointState, Message
from impedance_modules.errors import BadInput, nearest

SWITCHES = {
    "silence": "the arms' state topics fall silent; the gripper's go on",
    "freeze": "state topics repeat their last message",
    "duplicate": "a second node publishes the robot's state",
    "dead": "a node that no longer exists is registered as publisher of the robot's state",
    "wrong-md5": "the robot's state is sent as another type",
    "partial": "joint states leave out one arm joint",
    "nan": "measured efforts are not numbers",
}
"""Faults that are on or off."""

NUMBERS = {
    "drop": ("share of state messages that are lost, 0 to 1", 0.0, 1.0),
    "delay": ("state messages come this late [s], 0 to 5", 0.0, 5.0),
    "clock-step": ("the robot's clock jumps by [s]", -1e6, 1e6),
    "restart": ("the robot's nodes vanish and come back after [s], 0 to 60", 0.0, 60.0),
}
"""Faults with a number: what it is, lowest, highest."""

ACTS = {
    "estop": "a person presses the e-stop button",
    "estop-release": "a person releases it",
    "joint-fault": "a joint board fails",
}
"""What happens once."""

ON_LIMB = {
    "cuff": ("LIMB", "a person squeezes a cuff ('cuff off' lets go of all)"),
    "push": ("LIMB FX FY FZ [S]", "a person pushes a hand, base axes [N], for S seconds (default 1)"),
    "thing": ("LIMB WIDTH", "something WIDTH m wide is between a gripper's fingers ('thing off': nothing)"),
    "gripper-uncalibrated": ("LIMB", "a gripper has lost its calibration"),
    "gripper-error": ("LIMB", "a gripper reports an error and stands"),
    "gripper-silent": ("LIMB", "a gripper publishes no state"),
}
"""What happens to one limb: what follows the name, and what it is."""

OFF = "off"

Send = Callable[[], None]


@dataclass(frozen=True)
class InjectedFault:
    """One fault of a script.

    Attributes:
        at: When [s]; None for at once.
        name: Which.
        on: False switches it off.
        limb: For those that concern one.
        numbers: Its numbers.
    """

    at: float | None
    name: str
    on: bool
    limb: str | None
    numbers: tuple[float, ...]


def describe() -> str:
    """Lists every fault, one per line, with its syntax and what it does."""
    rows = list(SWITCHES.items())
    rows += [(f"{name} VALUE", text) for name, (text, _, _) in NUMBERS.items()]
    rows += list(ACTS.items())
    rows += [(f"{name} {words}", text) for name, (words, text) in ON_LIMB.items()]
    width = max(len(written) for written, _ in rows)
    return "\n".join(f"{written:<{width}}  {text}" for written, text in rows)


def parse_fault(text: str, limbs: tuple[str, ...]) -> InjectedFault:
    """Reads one fault.

    Raises:
        BadInput: It is none; the message lists what is valid.
    """
    words = text.split()
    at: float | None = None
    if words and words[0].startswith("@"):
        at = _number(words.pop(0)[1:], text, 0.0, math.inf)
    known = (*SWITCHES, *NUMBERS, *ACTS, *ON_LIMB)
    if not words or words[0] not in known:
        name = words[0] if words else ""
        raise BadInput(f"fault '{text}': no fault '{name}'{nearest(name, known)} (valid: {', '.join(known)})")
    name, rest = words[0], words[1:]
    if rest == [OFF] and name not in ACTS and name not in ("clock-step", "restart", "push"):
        return InjectedFault(at, name, False, None, ())
    if name in SWITCHES or name in ACTS:
        if rest:
            raise BadInput(f"fault '{text}': '{rest[0]}' is too much (valid: {name}, {name} off)")
        return InjectedFault(at, name, True, None, ())
    if name in NUMBERS:
        what, low, high = NUMBERS[name]
        if len(rest) != 1:
            raise BadInput(f"fault '{text}': {name} needs one number (valid: {what})")
        return InjectedFault(at, name, True, None, (_number(rest[0], text, low, high),))
    return _on_limb(at, name, rest, text, limbs)


def _on_limb(
    at: float | None, name: str, rest: list[str], text: str, limbs: tuple[str, ...]
) -> InjectedFault:
    counts = {"push": (4, 5), "thing": (2,)}.get(name, (1,))
    if len(rest) not in counts or rest[0] not in limbs:
        words, what = ON_LIMB[name]
        raise BadInput(f"fault '{text}': {what} (valid: {name} {words}, limbs {', '.join(limbs)})")
    numbers = tuple(_number(word, text, -1000.0, 1000.0) for word in rest[1:])
    return InjectedFault(at, name, True, rest[0], numbers)


def _number(word: str, text: str, low: float, high: float) -> float:
    try:
        value = float(word)
    except ValueError:
        raise BadInput(f"fault '{text}': '{word}' is not a number") from None
    if not low <= value <= high:
        raise BadInput(f"fault '{text}': {word} (valid: {low:g} to {high:g})")
    return value


@dataclass
class MessageFaults:
    """Faults of outgoing messages that are in force: lost, late, repeated, incomplete, or not a number.

    Attributes:
        silence, freeze, partial, nan: See ``SWITCHES``.
        drop: Share of messages lost.
        delay: Of the others [s].
        clock_step: Of the robot's clock [s].
        joint: Which joint ``partial`` leaves out.
    """

    joint: str
    seed: int
    silence: bool = False
    freeze: bool = False
    partial: bool = False
    nan: bool = False
    drop: float = 0.0
    delay: float = 0.0
    clock_step: float = 0.0
    _delayed: deque[tuple[float, Send]] = field(default_factory=deque)
    _frozen: dict[tuple[str, str], Message] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._random = np.random.default_rng(self.seed)

    def send_through(
        self, place: tuple[str, str], message: Message, now: float, send: Callable[[Message], None]
    ) -> None:
        """Sends a message of one node's topic, changed, delayed or dropped as the faults in force say."""
        message = self._distorted(place, message)
        if self.silence or (self.drop > 0.0 and self._random.random() < self.drop):
            return
        if self.delay > 0.0 or self._delayed:
            self._delayed.append((now + self.delay, lambda: send(message)))
        else:
            send(message)

    def release(self, now: float) -> None:
        """Sends what has been delayed long enough."""
        while self._delayed and self._delayed[0][0] <= now:
            self._delayed.popleft()[1]()

    def _distorted(self, place: tuple[str, str], message: Message) -> Message:
        if self.freeze:
            return self._frozen.setdefault(place, message)
        self._frozen.clear()
        if isinstance(message, JointState) and self.partial:
            message = _without(message, self.joint)
        if isinstance(message, JointState) and self.nan:
            message = replace(message, effort=(math.nan,) * len(message.effort))
        return message


def _without(message: JointState, joint: str) -> JointState:
    """Leaves one joint out."""
    kept = [i for i, name in enumerate(message.name) if name != joint]
    return replace(
        message,
        name=tuple(message.name[i] for i in kept),
        position=tuple(message.position[i] for i in kept),
        velocity=tuple(message.velocity[i] for i in kept),
        effort=tuple(message.effort[i] for i in kept),
    )
