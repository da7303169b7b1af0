# SPDX-License-Identifier: BSD-3-Clause
"""What must be true of a robot before a run may command it; every no comes with a remedy."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.robot_link import RobotLink
from impedance_modules.backends.baxter.ros.messages import (
    AssemblyState,
    CollisionDetectionState,
    DigitalIOState,
    EndpointState,
    JointState,
    Message,
    SEAJointState,
)
from impedance_modules.backends.baxter.ros.transport import PublisherInfo, Transport
from impedance_modules.backends.baxter.ros.wire import checksum_of
from impedance_modules.backends.baxter.served_description import DescriptionComparison
from impedance_modules.backends.baxter.stops import why_off
from impedance_modules.errors import RobotRefused
from impedance_modules.robot.model import RobotModel

LOWEST_RATE = 0.5 * topics.DEFAULT_STATE_RATE
"""Fewer states per second than this are no running robot [Hz]."""


NEED_POWER = ("power", "collision", "cuff", "weight", "effort")
"""Gates whose answer means nothing while the motors have no power."""


@dataclass(frozen=True)
class CheckedRobot:
    """What the results look at.

    Attributes:
        link: Listening for a second or more.
        model: With the calibrated mounts.
        comparison: Of the served description with ours.
        limbs: Those that are to be commanded.
    """

    link: RobotLink
    model: RobotModel
    comparison: DescriptionComparison
    limbs: Sequence[str]


def run_checks(subject: CheckedRobot, now: float) -> tuple[PreflightResult, ...]:
    """Asks every question, without sending anything.

    Args:
        subject: The robot as it is seen from here.
        now: Monotonic time [s].
    """
    transport = subject.link.transport
    return (
        check_software(transport),
        check_one_robot(transport),
        check_messages(transport, subject.limbs),
        _check_joints(subject.link),
        _check_rate(subject.link, now),
        _check_description(subject.comparison),
        check_nobody_else(transport, subject.limbs),
        _check_power(subject.link.robot),
        _check_collision(subject),
        _check_cuff(subject),
        check_range(subject.link, subject.model, subject.limbs),
        *(check_hand(subject.link, subject.model, limb) for limb in subject.limbs),
        *(check_weight(subject.link, subject.model, limb) for limb in subject.limbs),
        *(check_effort(subject.link, subject.model, limb) for limb in subject.limbs),
    )


def refuse_failed(results: Iterable[PreflightResult], *, commanding: bool) -> None:
    """Refuses a robot of which a result is closed.

    Args:
        results: From ``run_checks``.
        commanding: False where only listening is wanted; results that matter for motion alone are then passed by.

    Raises:
        RobotRefused: Every closed result with its reason and remedy.
    """
    closed = [
        result for result in results if result.passed is False and (commanding or not result.for_motion)
    ]
    if closed:
        lines = [f"{result.name}: {result.found} (valid: {result.remedy})" for result in closed]
        raise RobotRefused("the robot must not be moved now; nothing was sent\n  " + "\n  ".join(lines))


def checks_before_power(results: Iterable[PreflightResult], *, tucked: bool) -> list[PreflightResult]:
    """Leaves out what only a robot with power can tell, and the range of arms that are said to be tucked."""
    return [
        result
        for result in results
        if result.name.split()[0] not in NEED_POWER and not (tucked and result.name == "range")
    ]


def _check_joints(link: RobotLink) -> PreflightResult:
    remedy = "a robot whose /robot/joint_states names them all"
    missing = link.merge.missing
    if missing:
        return PreflightResult(
            "joints", False, f"never reported: {', '.join(missing)}", remedy, for_motion=False
        )
    if link.sample is None:
        return PreflightResult("joints", False, "no complete state yet", remedy, for_motion=False)
    state = link.sample.state
    if not np.isfinite(np.concatenate([state.position, state.velocity, state.effort])).all():
        found = "an angle, rate or torque is not finite"
        return PreflightResult("joints", False, found, "a robot whose sensors work", for_motion=False)
    nodes = {offer.node for offer in link.transport.publisher_info(topics.JOINT_STATES) if not offer.gone}
    if topics.REALTIME_NODE not in nodes:
        found = f"{' and '.join(sorted(nodes))} publish the joint states, not {topics.REALTIME_NODE}"
        return PreflightResult("joints", False, found, "a robot's own real-time loop", for_motion=True)
    return PreflightResult("joints", True, f"{len(state.position)} joints of the model reported", "")


def _check_rate(link: RobotLink, now: float) -> PreflightResult:
    rate = link.rate(now)
    found = f"states come at {rate:.0f} Hz"
    remedy = "a wired, quiet network" if rate > 0.0 else "a robot that has booted and names all its joints"
    return PreflightResult("rate", rate >= LOWEST_RATE, found, remedy, for_motion=False)


def _check_description(comparison: DescriptionComparison) -> PreflightResult:
    remedy = "the robot folder of this very robot, or a robot as it left the factory"
    if comparison.problems:
        return PreflightResult("description", False, "; ".join(comparison.problems), remedy)
    found = "; ".join(comparison.notes) if comparison.notes else "is our model"
    return PreflightResult("description", True, found, "")


def _check_power(robot: AssemblyState | None) -> PreflightResult:
    if robot is None:
        return PreflightResult("power", False, "/robot/state says nothing", "a robot that has booted")
    why = why_off(robot)
    if why is None and robot.error:
        why = "the robot reports an error"
    remedy = "release the e-stop, then 'impedance baxter enable' with the e-stop in hand"
    return PreflightResult("power", why is None, "enabled" if why is None else why, remedy)


def _check_collision(subject: CheckedRobot) -> PreflightResult:
    felt = [limb for limb in subject.limbs if subject.link.collision.get(limb, False)]
    found = f"felt by {' and '.join(felt)}" if felt else "none felt"
    return PreflightResult("collision", not felt, found, "arms that touch nothing; wait two seconds")


def _check_cuff(subject: CheckedRobot) -> PreflightResult:
    squeezed = [limb for limb in subject.limbs if subject.link.squeezed.get(limb, False)]
    found = f"squeezed at {' and '.join(squeezed)}" if squeezed else "free"
    return PreflightResult("cuff", not squeezed, found, "let go of the cuff")


@dataclass(frozen=True)
class PreflightResult:
    """One condition.

    Attributes:
        name: Short.
        passed: None where the robot does not tell.
        found: What was seen.
        remedy: What would be valid; said when closed.
        for_motion: Matters only where the robot is to be commanded.
    """

    name: str
    passed: bool | None
    found: str
    remedy: str
    for_motion: bool = True


CLEANUP = "'rosnode cleanup' has the master forget one that is gone for good"
"""Of a node that the master knows and that does not answer: it counts as living until somebody says otherwise."""


def check_software(transport: Transport) -> PreflightResult:
    """Is it the master of a robot with the software that is known here?"""
    version = transport.get_parameter(topics.SOFTWARE_VERSION)
    remedy = f"the master of a Baxter with software {topics.SUPPORTED_SOFTWARE}x in ROS_MASTER_URI"
    if version is None:
        found = f"the master has no parameter {topics.SOFTWARE_VERSION}: it is no Baxter's"
        return PreflightResult("software", False, found, remedy, for_motion=False)
    fits = str(version).startswith(topics.SUPPORTED_SOFTWARE)
    return PreflightResult("software", fits, f"version {version}", remedy, for_motion=False)


def check_one_robot(transport: Transport) -> PreflightResult:
    """Does exactly one living node say what state the robot is in?"""
    offers = transport.publisher_info(topics.ROBOT_STATE)
    present = [_name_of(offer) for offer in offers if not offer.gone]
    aside = _ignored_text(offers)
    if len(present) == 1:
        return PreflightResult("one robot", True, f"{present[0]} alone publishes /robot/state{aside}", "")
    if not present:
        found = f"nobody publishes /robot/state{aside}"
        return PreflightResult("one robot", False, found, "a robot that has booted", for_motion=False)
    found = f"{' and '.join(present)} publish /robot/state: which robot is meant?{aside}"
    remedy = f"end the simulators and doubles on this master; {CLEANUP}"
    return PreflightResult("one robot", False, found, remedy, for_motion=False)


def check_messages(transport: Transport, limbs: Sequence[str]) -> PreflightResult:
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
        for offer in transport.publisher_info(topic):
            asked += 1
            if offer.problem is None and not _matches(offer, kind):
                wrong.append(f"{offer.node} sends {topic} as {offer.ros_type} {offer.checksum}")
            elif offer.problem is not None and not offer.gone:
                wrong.append(f"{offer.node} does not answer for {topic}: {offer.problem}")
    if wrong:
        remedy = f"a robot with software {topics.SUPPORTED_SOFTWARE}x, whose messages are the ones known here"
        return PreflightResult("messages", False, "; ".join(wrong), remedy, for_motion=False)
    return PreflightResult(
        "messages", True, f"{asked} publishers send what is expected", "", for_motion=False
    )


def _matches(offer: PublisherInfo, kind: type[Message]) -> bool:
    return offer.ros_type == kind.ros_type and offer.checksum == checksum_of(kind)


def check_nobody_else(transport: Transport, limbs: Sequence[str]) -> PreflightResult:
    """Does nobody else command the limbs?"""
    others: dict[str, list[str]] = {}
    asides: dict[str, PublisherInfo] = {}
    for limb in limbs:
        for offer in transport.publisher_info(topics.joint_command(limb)):
            if offer.gone:
                asides[offer.node] = offer
            else:
                others.setdefault(_name_of(offer), []).append(limb)
    aside = _ignored_text(asides.values())
    if others:
        named = (f"{node} ({' and '.join(commanded)})" for node, commanded in others.items())
        remedy = f"end the other controllers first; {CLEANUP}"
        return PreflightResult("nobody else", False, f"commanded by {', '.join(named)}{aside}", remedy)
    return PreflightResult("nobody else", True, f"nobody else commands {' and '.join(limbs)}{aside}", "")


def _name_of(offer: PublisherInfo) -> str:
    return offer.node if offer.problem is None else f"{offer.node}, which {offer.problem},"


def _ignored_text(offers: Iterable[PublisherInfo]) -> str:
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


RANGE_MARGIN = 0.01
"""Every joint at least this far inside its range [rad]; a tucked Baxter is outside."""

TIP = 0.025
"""endpoint_state is about the gripper's tip, this far beyond the hand along its z axis [m] (baxter_common)."""

SAME_HAND = 0.005
"""The robot's idea of where its hand is may differ from ours by this much [m]."""

SAME_WEIGHT = 3.0
"""The robot's gravity torque may differ from ours by this much on any joint [N.m]: a gripper that we do not model."""

SAME_EFFORT = 6.0
"""At rest a joint's measured torque may differ from our model's by this much [N.m]."""


def check_range(link: RobotLink, model: RobotModel, limbs: Sequence[str]) -> PreflightResult:
    """Asks whether the arms are within their ranges."""
    if link.sample is None:
        return PreflightResult("range", False, "no state of the arms", "a robot that has booted")
    q = link.sample.state.position
    low, high = model.column("position_min") + RANGE_MARGIN, model.column("position_max") - RANGE_MARGIN
    joints = np.concatenate([model.limbs[limb].joints for limb in limbs])
    outside = [
        f"{model.joint_names[j]} at {q[j]:.3f} rad (range {low[j]:.3f} to {high[j]:.3f})"
        for j in joints
        if not low[j] <= q[j] <= high[j]
    ]
    if outside:
        remedy = "arms untucked: 'impedance baxter untuck', with power by 'baxter enable --tucked'"
        return PreflightResult("range", False, ", ".join(outside), remedy)
    return PreflightResult("range", True, "all joints inside their ranges", "")


def check_hand(link: RobotLink, model: RobotModel, limb: str) -> PreflightResult:
    """Asks whether the robot's forward kinematics and ours agree: wrong model, wrong tip, wrong robot."""
    name = f"hand {limb}"
    message = link.endpoint.get(limb)
    if message is None or link.sample is None:
        return PreflightResult(name, None, "the robot does not say where its hand is", "")
    hand = model.pose(link.sample.state.position, model.limbs[limb].hand)
    tip = hand.translation + hand.rotation @ np.array([0.0, 0.0, TIP])
    place = message.pose.position
    off = float(np.linalg.norm(tip - np.array([place.x, place.y, place.z])))
    found = f"{1e3 * off:.1f} mm from where the robot has it"
    return PreflightResult(
        name, off < SAME_HAND, found, f"below {1e3 * SAME_HAND:g} mm: arms at rest, our model's hand"
    )


def check_weight(link: RobotLink, model: RobotModel, limb: str) -> PreflightResult:
    """Asks whether the robot's gravity torque and ours agree; a robot that carries a tool knows, we do not.

    ``gravity_only`` is the weight alone: springs beside the joints that a patch lets the model wear are not in it.
    """
    name = f"weight {limb}"
    message = link.sea.get(limb)
    names = model.limbs[limb].joint_names
    if message is None or link.sample is None or len(message.gravity_only) != len(message.name):
        return PreflightResult(name, None, "the robot does not say what its arm weighs", "")
    said = dict(zip(message.name, message.gravity_only, strict=True))
    if not set(names) <= set(said):
        return PreflightResult(name, None, "the robot does not say what its arm weighs", "")
    q = link.sample.state.position
    ours = (model.gravity(q) - model.winding(q))[model.limbs[limb].joints]
    off = np.abs(ours - np.array([said[joint] for joint in names]))
    worst = int(np.argmax(off))
    found = f"gravity torques differ by at most {off[worst]:.2f} N.m ({names[worst]})"
    remedy = f"below {SAME_WEIGHT:g} N.m: a tool in the model (a patch), or none on the arm"
    return PreflightResult(name, bool(off[worst] < SAME_WEIGHT), found, remedy)


def check_effort(link: RobotLink, model: RobotModel, limb: str) -> PreflightResult:
    """Asks whether the measured torques at rest are what our model expects; never closed (``contact_gate`` is).

    A Baxter's shoulders have springs beside the drive, which carry part of the arm's weight; our model has
    them only if a patch says so. Without it, a force at the hand is felt where there is none.
    """
    name = f"effort {limb}"
    if link.sample is None:
        return PreflightResult(name, None, "no state of the arms", "")
    joints = model.limbs[limb].joints
    state = link.sample.state
    off = np.abs(state.effort - model.gravity(state.position))[joints]
    worst = int(np.argmax(off))
    found = f"at rest, torques differ from our model's by at most {off[worst]:.1f} N.m"
    if off[worst] <= SAME_EFFORT:
        return PreflightResult(name, True, found, "")
    found += (
        f" ({model.limbs[limb].joint_names[worst]}): a spring beside the joint, a tool, a touch? A task that waits for"
        " contact needs a patch that has it (record, diagnose, run --effects), and is refused without"
    )
    return PreflightResult(name, None, found, "")
