# SPDX-License-Identifier: BSD-3-Clause
"""What must be true of the network before a run may command a robot: which robot, whose, and who else."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.gates_types import Gate
from impedance_modules.backends.baxter.ros.messages import (
    AssemblyState,
    CollisionDetectionState,
    DigitalIOState,
    EndpointState,
    JointState,
    Message,
    SEAJointState,
)
from impedance_modules.backends.baxter.ros.transport import Offer, Transport
from impedance_modules.backends.baxter.ros.wire import checksum_of

CLEANUP = "'rosnode cleanup' has the master forget one that is gone for good"
"""Of a node that the master knows and that does not answer: it counts as living until somebody says otherwise."""


def software_gate(transport: Transport) -> Gate:
    """Is it the master of a robot with the software that is known here?"""
    version = transport.get_parameter(topics.SOFTWARE_VERSION)
    remedy = f"the master of a Baxter with software {topics.SUPPORTED_SOFTWARE}x in ROS_MASTER_URI"
    if version is None:
        found = f"the master has no parameter {topics.SOFTWARE_VERSION}: it is no Baxter's"
        return Gate("software", False, found, remedy, for_motion=False)
    fits = str(version).startswith(topics.SUPPORTED_SOFTWARE)
    return Gate("software", fits, f"version {version}", remedy, for_motion=False)


def one_robot_gate(transport: Transport) -> Gate:
    """Does exactly one living node say what state the robot is in?"""
    offers = transport.offers_of(topics.ROBOT_STATE)
    present = [_named(offer) for offer in offers if not offer.gone]
    aside = _aside(offers)
    if len(present) == 1:
        return Gate("one robot", True, f"{present[0]} alone publishes /robot/state{aside}", "")
    if not present:
        found = f"nobody publishes /robot/state{aside}"
        return Gate("one robot", False, found, "a robot that has booted", for_motion=False)
    found = f"{' and '.join(present)} publish /robot/state: which robot is meant?{aside}"
    remedy = f"end the simulators and doubles on this master; {CLEANUP}"
    return Gate("one robot", False, found, remedy, for_motion=False)


def messages_gate(transport: Transport, limbs: Sequence[str]) -> Gate:
    """Do those we listen to send what we expect?"""
    heard: list[tuple[str, type[Message]]] = [
        (topics.ROBOT_STATE, AssemblyState),
        (topics.JOINT_STATES, JointState),
    ]
    for limb in limbs:
        heard += [
            (topics.sea_state(limb), SEAJointState),
            (topics.endpoint_state(limb), EndpointState),
            (topics.collision_state(limb), CollisionDetectionState),
            (topics.cuff(limb), DigitalIOState),
        ]
    wrong, asked = [], 0
    for topic, kind in heard:
        for offer in transport.offers_of(topic):
            asked += 1
            if offer.problem is None and not _means(offer, kind):
                wrong.append(f"{offer.node} sends {topic} as {offer.ros_type} {offer.checksum}")
            elif offer.problem is not None and not offer.gone:
                wrong.append(f"{offer.node} does not answer for {topic}: {offer.problem}")
    if wrong:
        remedy = f"a robot with software {topics.SUPPORTED_SOFTWARE}x, whose messages are the ones known here"
        return Gate("messages", False, "; ".join(wrong), remedy, for_motion=False)
    return Gate("messages", True, f"{asked} publishers send what is expected", "", for_motion=False)


def _means(offer: Offer, kind: type[Message]) -> bool:
    return offer.ros_type == kind.ros_type and offer.checksum == checksum_of(kind)


def alone_gate(transport: Transport, limbs: Sequence[str]) -> Gate:
    """Does nobody else command the limbs?"""
    others: dict[str, list[str]] = {}
    asides: dict[str, Offer] = {}
    for limb in limbs:
        for offer in transport.offers_of(topics.joint_command(limb)):
            if offer.gone:
                asides[offer.node] = offer
            else:
                others.setdefault(_named(offer), []).append(limb)
    aside = _aside(asides.values())
    if others:
        named = (f"{node} ({' and '.join(commanded)})" for node, commanded in others.items())
        remedy = f"end the other controllers first; {CLEANUP}"
        return Gate("nobody else", False, f"commanded by {', '.join(named)}{aside}", remedy)
    return Gate("nobody else", True, f"nobody else commands {' and '.join(limbs)}{aside}", "")


def _named(offer: Offer) -> str:
    return offer.node if offer.problem is None else f"{offer.node}, which {offer.problem},"


def _aside(offers: Iterable[Offer]) -> str:
    """Names the registrations that the dead have left behind, after a semicolon; nothing where there are none."""
    dead = [offer.node for offer in offers if offer.gone]
    if not dead:
        return ""
    left = "a registration of" if len(dead) == 1 else "registrations of"
    verbs = ("answers", "is", "it") if len(dead) == 1 else ("answer", "are", "them")
    return (
        f"; {left} {', '.join(dead)}, which no longer {verbs[0]}, {verbs[1]} ignored;"
        f" 'rosnode cleanup' removes {verbs[2]}"
    )
