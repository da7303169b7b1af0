# SPDX-License-Identifier: BSD-3-Clause
"""What is known about an effect before any number: its law, symbols, units, bounds, signature and rivals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Port = Literal["actuator", "link", "sensor", "timing", "contact"]
"""Where an effect acts: command to effort, effort to motion, what is reported, when, or on the outside."""

Place = Literal[
    "command",
    "drive",
    "motor",
    "transmission",
    "torque_sensor",
    "link",
    "encoder",
    "motor_encoder",
    "velocity_estimate",
    "clock",
    "base",
    "surroundings",
]
"""Where in the chain from command to log a real machine has an effect; finer than its port.

    command -> drive -> motor -> transmission -> torque_sensor -> link -> encoder -> velocity_estimate -> clock (log)
                        motor_encoder

The drive makes a motor's torque of a command; the motor is the rotor's side of the gear; the transmission is gear and
spring between rotor and link; the torque sensor reads what passes there. The encoder reads the link or, where a joint
has a motor encoder instead, the rotor; the velocity estimate is made of what it reads. Base and surroundings act on the
links from outside.
"""

USUAL_PLACES: Mapping[Port, Place] = {
    "actuator": "motor",
    "link": "link",
    "timing": "command",
    "contact": "surroundings",
}
"""Place of an effect at a port, where its description says nothing else."""

KeyKind = Literal["joint", "pair", "body", "base", "log", "surface", "object"]
"""What carries an effect's numbers: a joint, ``JOINT<-OTHER``, a link, the base, the whole recording, a surface or the
object in the hands."""


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes:
        symbol: As patches and diagnoses write it.
        unit: For a revolute joint.
        meaning: In words.
        lower, upper: Physical bounds.
        positive: The lower bound itself is excluded.
        left_out: What its absence means; None if it must be given.
        linear_unit: For a prismatic joint; empty where the unit is the same.
        neutral: Value at which it changes nothing.
    """

    symbol: str
    unit: str
    meaning: str
    lower: float = -math.inf
    upper: float = math.inf
    positive: bool = False
    left_out: str | None = None
    linear_unit: str = ""
    neutral: float = 0.0

    @property
    def bounds(self) -> str:
        """The physical bounds in words; empty if there are none."""
        low = f"{'above' if self.positive else 'at least'} {self.lower:g}" if self.lower > -math.inf else ""
        high = f"at most {self.upper:g}" if self.upper < math.inf else ""
        return ", ".join(part for part in (low, high) if part)

    def admits(self, value: float) -> bool:
        """Says whether a value is finite and within the physical bounds."""
        above = value > self.lower if self.positive else value >= self.lower
        return math.isfinite(value) and above and value <= self.upper


LINEAR_UNITS = {
    "rad": "m",
    "rad/s": "m/s",
    "N.m": "N",
    "N.m/rad": "N/m",
    "N.m.s/rad": "N.s/m",
    "N.m.s^2/rad^2": "N.s^2/m^2",
    "kg.m^2": "kg",
}
"""Unit of a number of a revolute joint -> that of the same number of a prismatic one."""


def joint_parameter(symbol: str, unit: str, meaning: str, **rest: Any) -> Parameter:
    """Describes a number of a joint by its unit for one that turns; what it is for one that slides follows."""
    return Parameter(symbol, unit, meaning, linear_unit=LINEAR_UNITS[unit], **rest)


AT_EITHER_SIDE = (
    "The plant, as a torque at the motor (port actuator) or at the link; the controller does not know it."
)


@dataclass(frozen=True, kw_only=True)
class Description:
    """An effect in words; what is left out is that of a torque by a law of one joint's motion.

    Attributes:
        id: Of the contract.
        sentence: What happens, physically.
        equation: Its law; torques are those that the real joint consumes beyond the nominal model.
        parameters: Its numbers.
        ports: Where it can act.
        places: Port -> place in the chain, where it is not the usual one.
        keys: What can carry its numbers.
        signature: How it shows in a residual.
        confusable_with: Ids that look alike.
        excitation: The motion that tells it apart.
        reference: Where the law comes from.
        applied: What of it the plant does, and what the model knows.
    """

    id: str
    sentence: str
    equation: str
    parameters: tuple[Parameter, ...]
    ports: tuple[Port, ...] = ("actuator", "link")
    places: Mapping[Port, Place] = field(default_factory=dict)
    keys: tuple[KeyKind, ...] = ("joint",)
    signature: str
    confusable_with: tuple[str, ...]
    excitation: str
    reference: str
    applied: str = AT_EITHER_SIDE

    def parameter(self, symbol: str) -> Parameter:
        """Finds a parameter by its symbol; ``KeyError`` if there is none."""
        return {parameter.symbol: parameter for parameter in self.parameters}[symbol]

    def place(self, port: Port) -> Place:
        """Gives the place in the chain at which it acts at a port."""
        return self.places[port] if port in self.places else USUAL_PLACES[port]

    @property
    def symbols(self) -> tuple[str, ...]:
        """All symbols, in order."""
        return tuple(parameter.symbol for parameter in self.parameters)


def same_unit(given: str, valid: tuple[str, ...]) -> bool:
    """Says whether a unit is one of the valid ones, however its product and power signs are written."""
    return _plain(given) in {_plain(unit) for unit in valid}


def _plain(unit: str) -> str:
    text = unit.strip()
    for sign in ("·", "*", "⋅"):
        text = text.replace(sign, ".")
    return text.replace("^", "").replace("²", "2").replace(" ", "")
