# SPDX-License-Identifier: BSD-3-Clause
"""What the simulated Baxter publishes: its state as the robot's own messages, on which topics and how often."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.ros import messages
from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.backends.baxter.simulator.electric_gripper import ElectricGripper, properties
from impedance_modules.backends.baxter.simulator.joint_boards import CommandMode, LimbActivity
from impedance_modules.backends.baxter.simulator.parameters import (
    DEFAULT_RATE,
    FASTEST_RATE,
    GRIPPER_RATE,
    SLOW_RATE,
    SLOWEST_RATE,
    STATE_RATE,
    TICK,
)
from impedance_modules.backends.baxter.simulator.simulated_baxter import SimulatedBaxter
from impedance_modules.robot.model import Limb
from impedance_modules.robot.pose import carry
from impedance_modules.robot.rotation import log3

HEAD_NOD = "head_nod"
GRIPPER_TIP = 0.025
"""From the hand's frame to the gripper's tip, which endpoint states describe, along its z axis [m]."""

FINGERS = ("l_finger_joint", "r_finger_joint")
FINGER_OPENING = 0.01
"""Of the motionless gripper [m]."""

Make = Callable[[int], Message]
"""Builds a message from a stamp [ns]."""

GRIPPER_NODE = "/end_effector_publisher"
"""Publishes the grippers' joint states, on the same topic as ``topics.REALTIME_NODE`` the arms'."""


class MessageBuilder:
    """Builds every message of one robot; names and orders as the real one has them."""

    def __init__(self, robot: SimulatedBaxter) -> None:
        self._robot = robot
        model = robot.model
        self._sorted = np.argsort(model.joint_names)
        heads = [HEAD_NOD] * robot.options.head_nod + sorted(model.spec.locked)
        self._head_angles = tuple(model.spec.locked.get(name, 0.0) for name in heads)
        self._names = (*heads, *(model.joint_names[i] for i in self._sorted))
        self._fingers = tuple(
            f"{limb}_gripper_{finger}" for limb in sorted(model.limbs) for finger in FINGERS
        )
        self._seq = 0

    def header(self, stamp: int, frame: str) -> messages.Header:
        """Counts and stamps a message; ``stamp`` in ns on the robot's clock."""
        self._seq += 1
        return messages.Header(self._seq, stamp, frame)

    def joint_states(self, stamp: int) -> messages.JointState:
        """Head first, then both arms, in alphabetical order."""
        state, order = self._robot.state, self._sorted
        zeros = (0.0,) * len(self._head_angles)
        return messages.JointState(
            self.header(stamp, ""),
            self._names,
            self._head_angles + floats(state.position[order]),
            zeros + floats(state.velocity[order]),
            zeros + floats(state.effort[order]),
        )

    def reference_states(self, stamp: int) -> messages.JointState:
        """References of the arms' servos, in the joint states' order."""
        robot, order = self._robot, self._sorted
        position, velocity = robot.state.position.copy(), np.zeros(robot.model.n)
        for drive in robot.limbs.values():
            if drive.served:
                position[drive.limb.joints] = drive.reference.position
                velocity[drive.limb.joints] = drive.reference.velocity
        zeros = (0.0,) * len(self._head_angles)
        return messages.JointState(
            self.header(stamp, ""),
            self._names,
            self._head_angles + floats(position[order]),
            zeros + floats(velocity[order]),
            (0.0,) * len(self._names),
        )

    def gripper_states(self, stamp: int) -> messages.JointState:
        """The fingers alone, which do not move."""
        zeros = (0.0,) * len(self._fingers)
        opening = (FINGER_OPENING,) * len(self._fingers)
        return messages.JointState(self.header(stamp, ""), self._fingers, opening, zeros, zeros)

    def assembly(self, stamp: int) -> messages.AssemblyState:  # noqa: ARG002 - as every builder of messages
        """Power and stops."""
        return self._robot.machine.state

    def sea_joints(self, limb: Limb, stamp: int) -> messages.SEAJointState:
        """One arm's joints in full, from the shoulder outwards.

        Spring efforts are the springs' own torque on the joints (docs/baxter.md), the robot adds their negative.
        """
        robot, joints = self._robot, limb.joints
        drive = robot.limbs[limb.name]
        weight, springs = robot.plant.compensation(robot.state.position)
        powered = float(robot.machine.state.enabled)
        acting = powered * (not robot.suppressed(limb.name, "suppress_gravity_compensation"))
        reference = drive.reference
        torque = drive.activity is LimbActivity.COMMANDED and drive.mode is CommandMode.TORQUE
        measured = robot.state.position[joints]
        zeros = np.zeros(joints.size)
        return messages.SEAJointState(
            header=self.header(stamp, "base"),
            name=limb.joint_names,
            commanded_position=floats(reference.position if drive.served and powered else measured),
            commanded_velocity=floats(reference.velocity if drive.served and powered else zeros),
            commanded_acceleration=floats(zeros),
            commanded_effort=floats(drive.command if torque else robot.integral_effort(drive)),
            actual_position=floats(measured),
            actual_velocity=floats(robot.state.velocity[joints]),
            actual_effort=floats(robot.state.effort[joints]),
            gravity_model_effort=floats(acting * weight[joints]),
            gravity_only=floats(weight[joints]),
            hysteresis_model_effort=floats(-acting * springs[joints]),
            crosstalk_model_effort=floats(zeros),
            hyst_state=0.0,
        )

    def endpoint(self, limb: Limb, stamp: int) -> messages.EndpointState:
        """Pose, twist and wrench of the gripper's tip; wrench F from J^T F = effort - weight + springs."""
        robot, kinematics = self._robot, self._robot.kinematics
        hand = kinematics.pose(limb.hand)
        arm = hand.rotation @ np.array([0.0, 0.0, GRIPPER_TIP])
        jacobian = carry(arm) @ kinematics.jacobian_of(limb.hand)[:, limb.joints]
        twist = jacobian @ robot.state.velocity[limb.joints]
        weight, springs = robot.plant.compensation(robot.state.position)
        load = robot.state.effort - weight - springs
        wrench = np.linalg.lstsq(jacobian.T, load[limb.joints], rcond=1e-3)[0]
        return messages.EndpointState(
            self.header(stamp, "base"),
            pose_message(hand.translation + arm, hand.rotation),
            messages.Twist(_vector(twist[:3]), _vector(twist[3:])),
            messages.Wrench(_vector(wrench[:3]), _vector(wrench[3:])),
        )

    def detection(self, limb: Limb, stamp: int) -> messages.CollisionDetectionState:
        """Whether the arm pauses after an impact or a squeeze."""
        colliding = bool(self._robot.colliding[limb.name])
        return messages.CollisionDetectionState(self.header(stamp, ""), colliding)

    def avoidance(self, limb: Limb, stamp: int) -> messages.CollisionAvoidanceState:
        """What the force field pushes the arm away from."""
        robot = self._robot
        near = (
            () if robot.suppressed(limb.name, "suppress_collision_avoidance") else robot.field.near[limb.name]
        )
        arms = tuple(name for name in near if name in robot.limbs)
        return messages.CollisionAvoidanceState(self.header(stamp, ""), bool(arms), near)

    def gripper(self, limb: str) -> ElectricGripper | None:
        """A limb's electric gripper; None where it has none."""
        return self._robot.grippers.get(limb)

    def cuff(self, limb: Limb) -> messages.DigitalIOState:
        """Whether the cuff is squeezed."""
        return messages.DigitalIOState(int(self._robot.cuffs[limb.name]), is_input_only=True)


@dataclass
class Publication:
    """One topic of one node.

    Attributes:
        topic, kind: What is published.
        make: Builds the message.
        rate: How often [Hz].
        node: Who publishes it.
        faulty: Whether faults of the state topics apply to it.
        on_change: A message unlike the last one is sent at once.
    """

    topic: str
    kind: type[Message]
    make: Make
    rate: float
    node: str = topics.REALTIME_NODE
    faulty: bool = True
    on_change: bool = False
    _phase: float = 1.0

    @property
    def key(self) -> tuple[str, str]:
        """Node and topic."""
        return self.node, self.topic

    def due(self) -> bool:
        """Counts one tick; says whether the topic is due."""
        self._phase += self.rate * TICK
        if self._phase < 1.0 - 1e-9:
            return False
        self._phase -= 1.0
        return True


def publications(builder: MessageBuilder, limbs: tuple[Limb, ...]) -> list[Publication]:
    """Lists every topic, the most urgent first."""
    joints, kind = topics.JOINT_STATES, messages.JointState
    found = [
        Publication(joints, kind, builder.joint_states, DEFAULT_RATE),
        Publication(topics.ROBOT_STATE, messages.AssemblyState, builder.assembly, STATE_RATE),
        # Another node: the gripper goes on when the first one fails.
        Publication(joints, kind, builder.gripper_states, GRIPPER_RATE, GRIPPER_NODE, faulty=False),
        Publication("/robot/ref_joint_states", kind, builder.reference_states, DEFAULT_RATE),
    ]
    for limb in limbs:
        found += _of_limb(builder, limb)
        found += _of_gripper(builder, limb.name)
    return found


def _of_gripper(builder: MessageBuilder, limb: str) -> list[Publication]:
    """Lists the topics of a limb's gripper, by the node of the fingers."""
    gripper = builder.gripper(limb)
    if gripper is None:
        return []
    state, what = messages.EndEffectorState, messages.EndEffectorProperties
    return [
        Publication(
            topics.gripper_state(limb), state, gripper.state, GRIPPER_RATE, GRIPPER_NODE, faulty=False
        ),
        Publication(
            topics.gripper_properties(limb),
            what,
            lambda _: properties(),
            SLOW_RATE,
            GRIPPER_NODE,
            faulty=False,
        ),
    ]


def bounded_rate(requested: float) -> float:
    """Clips a requested rate of the joint states to what the robot can [Hz]; 0 requests the default."""
    return min(max(requested, SLOWEST_RATE), FASTEST_RATE) if requested else DEFAULT_RATE


def floats(array: Array) -> messages.Floats:
    """Turns an array into a tuple of floats."""
    return tuple(array.tolist())


def pose_message(translation: Array, rotation: Array) -> messages.PoseMessage:
    """Puts a pose into a message."""
    vector = log3(rotation)
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 0.0 else vector
    x, y, z = (np.sin(0.5 * angle) * axis).tolist()
    turn = messages.Quaternion(x, y, z, float(np.cos(0.5 * angle)))
    return messages.PoseMessage(messages.Point(*translation.tolist()), turn)


def _vector(numbers: NDArray[np.floating[Any]]) -> messages.Vector3:
    return messages.Vector3(*numbers.tolist())


def _of_limb(builder: MessageBuilder, limb: Limb) -> list[Publication]:
    place, name = f"/robot/limb/{limb.name}", limb.name
    fast: list[tuple[str, type[Message], Make]] = [
        (topics.sea_state(name), messages.SEAJointState, partial(builder.sea_joints, limb)),
        (topics.endpoint_state(name), messages.EndpointState, partial(builder.endpoint, limb)),
        (f"{place}/state", messages.AssemblyState, builder.assembly),
    ]
    avoidance = f"{place}/collision_avoidance_state"
    slow: list[tuple[str, type[Message], Make]] = [
        (topics.collision_state(name), messages.CollisionDetectionState, partial(builder.detection, limb)),
        (avoidance, messages.CollisionAvoidanceState, partial(builder.avoidance, limb)),
        (topics.cuff(name), messages.DigitalIOState, lambda _: builder.cuff(limb)),
    ]
    return [Publication(*one, STATE_RATE) for one in fast] + [
        Publication(*one, SLOW_RATE, faulty=False, on_change=True) for one in slow
    ]
