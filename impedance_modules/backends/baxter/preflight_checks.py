# SPDX-License-Identifier: BSD-3-Clause
"""What must be true of a robot before a run may command it; every no comes with a remedy."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.gates_model import effort_gate, gravity_gate, hand_gate, range_gate
from impedance_modules.backends.baxter.gates_network import (
    alone_gate,
    messages_gate,
    one_robot_gate,
    software_gate,
)
from impedance_modules.backends.baxter.gates_types import Gate
from impedance_modules.backends.baxter.robot_link import RobotLink
from impedance_modules.backends.baxter.ros.messages import AssemblyState
from impedance_modules.backends.baxter.served_description import Comparison
from impedance_modules.backends.baxter.stop_rules import why_off
from impedance_modules.errors import RobotRefused
from impedance_modules.robot.model import RobotModel

LOWEST_RATE = 0.5 * topics.DEFAULT_STATE_RATE
"""Fewer states per second than this are no running robot [Hz]."""


NEED_POWER = ("power", "collision", "cuff", "weight", "effort")
"""Gates whose answer means nothing while the motors have no power."""


@dataclass(frozen=True)
class Subject:
    """What the gates look at.

    Attributes:
        link: Listening for a second or more.
        model: With the calibrated mounts.
        comparison: Of the served description with ours.
        limbs: Those that are to be commanded.
    """

    link: RobotLink
    model: RobotModel
    comparison: Comparison
    limbs: Sequence[str]


def judge(subject: Subject, now: float) -> tuple[Gate, ...]:
    """Asks every question, without sending anything.

    Args:
        subject: The robot as it is seen from here.
        now: Monotonic time [s].
    """
    transport = subject.link.transport
    return (
        software_gate(transport),
        one_robot_gate(transport),
        messages_gate(transport, subject.limbs),
        _joints(subject.link),
        _rate(subject.link, now),
        _description(subject.comparison),
        alone_gate(transport, subject.limbs),
        _power(subject.link.robot),
        _collision(subject),
        _cuff(subject),
        range_gate(subject.link, subject.model, subject.limbs),
        *(hand_gate(subject.link, subject.model, limb) for limb in subject.limbs),
        *(gravity_gate(subject.link, subject.model, limb) for limb in subject.limbs),
        *(effort_gate(subject.link, subject.model, limb) for limb in subject.limbs),
    )


def refuse_closed(gates: Iterable[Gate], *, commanding: bool) -> None:
    """Refuses a robot of which a gate is closed.

    Args:
        gates: From ``judge``.
        commanding: False where only listening is wanted; gates that matter for motion alone are then passed by.

    Raises:
        RobotRefused: Every closed gate with its reason and remedy.
    """
    closed = [gate for gate in gates if gate.passed is False and (commanding or not gate.for_motion)]
    if closed:
        lines = [f"{gate.name}: {gate.found} (valid: {gate.remedy})" for gate in closed]
        raise RobotRefused("the robot must not be moved now; nothing was sent\n  " + "\n  ".join(lines))


def before_power(gates: Iterable[Gate], *, tucked: bool) -> list[Gate]:
    """Leaves out what only a robot with power can tell, and the range of arms that are said to be tucked."""
    return [
        gate
        for gate in gates
        if gate.name.split()[0] not in NEED_POWER and not (tucked and gate.name == "range")
    ]


def _joints(link: RobotLink) -> Gate:
    remedy = "a robot whose /robot/joint_states names them all"
    missing = link.merge.missing
    if missing:
        return Gate("joints", False, f"never reported: {', '.join(missing)}", remedy, for_motion=False)
    if link.sample is None:
        return Gate("joints", False, "no complete state yet", remedy, for_motion=False)
    state = link.sample.state
    if not np.isfinite(np.concatenate([state.position, state.velocity, state.effort])).all():
        found = "an angle, rate or torque is not finite"
        return Gate("joints", False, found, "a robot whose sensors work", for_motion=False)
    nodes = {offer.node for offer in link.transport.offers_of(topics.JOINT_STATES) if not offer.gone}
    if topics.REALTIME_NODE not in nodes:
        found = f"{' and '.join(sorted(nodes))} publish the joint states, not {topics.REALTIME_NODE}"
        return Gate("joints", False, found, "a robot's own real-time loop", for_motion=True)
    return Gate("joints", True, f"{len(state.position)} joints of the model reported", "")


def _rate(link: RobotLink, now: float) -> Gate:
    rate = link.rate(now)
    found = f"states come at {rate:.0f} Hz"
    remedy = "a wired, quiet network" if rate > 0.0 else "a robot that has booted and names all its joints"
    return Gate("rate", rate >= LOWEST_RATE, found, remedy, for_motion=False)


def _description(comparison: Comparison) -> Gate:
    remedy = "the robot folder of this very robot, or a robot as it left the factory"
    if comparison.problems:
        return Gate("description", False, "; ".join(comparison.problems), remedy)
    found = "; ".join(comparison.notes) if comparison.notes else "is our model"
    return Gate("description", True, found, "")


def _power(robot: AssemblyState | None) -> Gate:
    if robot is None:
        return Gate("power", False, "/robot/state says nothing", "a robot that has booted")
    why = why_off(robot)
    if why is None and robot.error:
        why = "the robot reports an error"
    remedy = "release the e-stop, then 'impedance baxter enable' with the e-stop in hand"
    return Gate("power", why is None, "enabled" if why is None else why, remedy)


def _collision(subject: Subject) -> Gate:
    felt = [limb for limb in subject.limbs if subject.link.collision.get(limb, False)]
    found = f"felt by {' and '.join(felt)}" if felt else "none felt"
    return Gate("collision", not felt, found, "arms that touch nothing; wait two seconds")


def _cuff(subject: Subject) -> Gate:
    squeezed = [limb for limb in subject.limbs if subject.link.squeezed.get(limb, False)]
    found = f"squeezed at {' and '.join(squeezed)}" if squeezed else "free"
    return Gate("cuff", not squeezed, found, "let go of the cuff")
