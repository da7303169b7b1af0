# SPDX-License-Identifier: BSD-3-Clause
"""Preflight checks: what must be true of a Baxter before a run may command it; a failed check names its remedy.

Three groups: the network (which robot, whose messages, who else commands it), the robot's own state (power, collision,
cuff, range), and its agreement with our model (description, hands, weight, torques at rest). Nothing is sent.
"""

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
from impedance_modules.backends.preflight import PreflightResult
from impedance_modules.robot.model import RobotModel

LOWEST_RATE = 0.5 * topics.DEFAULT_STATE_RATE
"""Fewer states per second than this are no running robot [Hz]."""

NEED_POWER = ("power", "collision", "cuff", "weight", "effort")
"""Checks whose answer means nothing while the motors have no power."""

CLEANUP = "'rosnode cleanup' has the master forget one that is gone for good"
"""Remedy for a node that the master lists and that does not answer: it counts as alive until it is removed there."""

RANGE_MARGIN = 0.01
"""Every joint at least this far inside its range [rad]; a tucked Baxter is outside."""

TIP = 0.025
"""``endpoint_state`` gives the gripper's tip, this far beyond the hand along its z axis [m] (baxter_common)."""

SAME_HAND = 0.005
"""Largest difference between the robot's forward kinematics and ours [m]."""

SAME_WEIGHT = 3.0
"""Largest difference between the robot's gravity torque and ours on any joint [N.m]: a gripper that we do not model."""

SAME_EFFORT = 6.0
"""Largest difference between a joint's measured torque at rest and our model's [N.m]."""


@dataclass(frozen=True)
class CheckedRobot:
    """What the checks are made on.

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
    """Makes every check, without sending anything.

    Args:
        subject: The robot, as received so far.
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


def checks_before_power(results: Iterable[PreflightResult], *, tucked: bool) -> list[PreflightResult]:
    """Leaves out what only a robot with power can answer, and the range of arms that are said to be tucked."""
    return [
        result
        for result in results
        if result.name.split()[0] not in NEED_POWER and not (tucked and result.name == "range")
    ]


def check_software(transport: Transport) -> PreflightResult:
    """Checks that the master belongs to a robot with the supported software."""
    version = transport.get_parameter(topics.SOFTWARE_VERSION)
    remedy = f"the master of a Baxter with software {topics.SUPPORTED_SOFTWARE}x in ROS_MASTER_URI"
    if version is None:
        found = f"the master has no parameter {topics.SOFTWARE_VERSION}: it is no Baxter's"
        return PreflightResult("software", False, found, remedy, for_motion=False)
    fits = str(version).startswith(topics.SUPPORTED_SOFTWARE)
    return PreflightResult("software", fits, f"version {version}", remedy, for_motion=False)


def check_one_robot(transport: Transport) -> PreflightResult:
    """Checks that exactly one running node publishes the robot's state."""
    publishers = transport.publisher_info(topics.ROBOT_STATE)
    present = [_name_of(publisher) for publisher in publishers if not publisher.gone]
    ignored = _ignored_text(publishers)
    if len(present) == 1:
        return PreflightResult("one robot", True, f"{present[0]} alone publishes /robot/state{ignored}", "")
    if not present:
        found = f"nobody publishes /robot/state{ignored}"
        return PreflightResult("one robot", False, found, "a robot that has booted", for_motion=False)
    found = f"{' and '.join(present)} publish /robot/state: which robot is meant?{ignored}"
    remedy = f"end the other simulators on this master; {CLEANUP}"
    return PreflightResult("one robot", False, found, remedy, for_motion=False)


def check_messages(transport: Transport, limbs: Sequence[str]) -> PreflightResult:
    """Checks type and checksum of every topic that is read."""
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
        for publisher in transport.publisher_info(topic):
            asked += 1
            if publisher.problem is None and not _matches(publisher, kind):
                wrong.append(f"{publisher.node} sends {topic} as {publisher.ros_type} {publisher.checksum}")
            elif publisher.problem is not None and not publisher.gone:
                wrong.append(f"{publisher.node} does not answer for {topic}: {publisher.problem}")
    if wrong:
        remedy = f"a robot with software {topics.SUPPORTED_SOFTWARE}x, whose messages are the ones known here"
        return PreflightResult("messages", False, "; ".join(wrong), remedy, for_motion=False)
    return PreflightResult(
        "messages", True, f"{asked} publishers send what is expected", "", for_motion=False
    )


def check_nobody_else(transport: Transport, limbs: Sequence[str]) -> PreflightResult:
    """Checks that no other node commands the limbs."""
    others: dict[str, list[str]] = {}
    ended: dict[str, PublisherInfo] = {}
    for limb in limbs:
        for publisher in transport.publisher_info(topics.joint_command(limb)):
            if publisher.gone:
                ended[publisher.node] = publisher
            else:
                others.setdefault(_name_of(publisher), []).append(limb)
    ignored = _ignored_text(ended.values())
    if others:
        named = (f"{node} ({' and '.join(commanded)})" for node, commanded in others.items())
        remedy = f"end the other controllers first; {CLEANUP}"
        return PreflightResult("nobody else", False, f"commanded by {', '.join(named)}{ignored}", remedy)
    return PreflightResult("nobody else", True, f"nobody else commands {' and '.join(limbs)}{ignored}", "")


def check_range(link: RobotLink, model: RobotModel, limbs: Sequence[str]) -> PreflightResult:
    """Checks that the arms are within their ranges."""
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
    """Checks that the robot's forward kinematics agree with ours; they do not for a wrong model, tip or robot."""
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
    """Checks that the robot's gravity torque agrees with ours; it does not if the robot knows of a tool and we do not.

    ``gravity_only`` is the weight alone: parallel springs that a patch adds to the model are not in it.
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
    ours = (model.gravity(q) - model.parallel_spring_effort(q))[model.limbs[limb].joints]
    off = np.abs(ours - np.array([said[joint] for joint in names]))
    worst = int(np.argmax(off))
    found = f"gravity torques differ by at most {off[worst]:.2f} N.m ({names[worst]})"
    remedy = f"below {SAME_WEIGHT:g} N.m: a tool in the model (a patch), or none on the arm"
    return PreflightResult(name, bool(off[worst] < SAME_WEIGHT), found, remedy)


def check_effort(link: RobotLink, model: RobotModel, limb: str) -> PreflightResult:
    """Compares the measured torques at rest with our model; never fails (the contact check of a task does).

    A Baxter's shoulders have parallel springs, which carry part of the arm's weight; our model has them only
    if a patch says so. Without it, the contact detection reports a force at the hand where there is none.
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
        f" ({model.limbs[limb].joint_names[worst]}): a parallel spring, a tool, a contact? A task that waits for"
        " contact needs a patch that has it (record, diagnose, run --effects), and is refused without"
    )
    return PreflightResult(name, None, found, "")


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
    nodes = {
        publisher.node
        for publisher in link.transport.publisher_info(topics.JOINT_STATES)
        if not publisher.gone
    }
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
    hit = [limb for limb in subject.limbs if subject.link.collision.get(limb, False)]
    found = f"reported by {' and '.join(hit)}" if hit else "none reported"
    return PreflightResult("collision", not hit, found, "arms that touch nothing; wait two seconds")


def _check_cuff(subject: CheckedRobot) -> PreflightResult:
    squeezed = [limb for limb in subject.limbs if subject.link.squeezed.get(limb, False)]
    found = f"squeezed at {' and '.join(squeezed)}" if squeezed else "free"
    return PreflightResult("cuff", not squeezed, found, "let go of the cuff")


def _matches(publisher: PublisherInfo, kind: type[Message]) -> bool:
    return publisher.ros_type == kind.ros_type and publisher.checksum == checksum_of(kind)


def _name_of(publisher: PublisherInfo) -> str:
    return publisher.node if publisher.problem is None else f"{publisher.node}, which {publisher.problem},"


def _ignored_text(publishers: Iterable[PublisherInfo]) -> str:
    """Names the registrations of nodes that have ended, after a semicolon; empty where there are none."""
    ended = [publisher.node for publisher in publishers if publisher.gone]
    if not ended:
        return ""
    left = "a registration of" if len(ended) == 1 else "registrations of"
    verbs = ("answers", "is", "it") if len(ended) == 1 else ("answer", "are", "them")
    return (
        f"; {left} {', '.join(ended)}, which no longer {verbs[0]}, {verbs[1]} ignored;"
        f" 'rosnode cleanup' removes {verbs[2]}"
    )
