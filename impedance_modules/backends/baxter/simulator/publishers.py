# SPDX-License-Identifier: BSD-3-Clause
"""What the simulator tells the world: its state as the robot's own messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter.ros import messages
from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.backends.baxter.simulator.assembly_state import PowerState
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

Array = NDArray[np.float64]
Floats = tuple[float, ...]

HEAD_NOD = "head_nod"
GRIPPER_TIP = 0.025
"""From the hand's frame to the tip that endpoint states speak of, along its z axis [m]."""

FINGERS = ("l_finger_joint", "r_finger_joint")
FINGER_OPENING = 0.01
"""Of the motionless gripper [m]."""

Make = Callable[[int], Message]
"""Builds a message from a stamp [ns]."""

REALTIME_NODE, GRIPPER_NODE = "/realtime_loop", "/end_effector_publisher"
"""The two nodes of a real robot that publish joint states."""

STATE = "/robot/state"

JOINT_STATES = "/robot/joint_states"


def floats(array: Array) -> Floats:
    """Turns an array into plain numbers."""
    return tuple(array.tolist())


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
        """Numbers and stamps a message; ``stamp`` in ns on the robot's clock."""
        self._seq += 1
        return messages.Header(self._seq, stamp, frame)

    def joint_states(self, stamp: int) -> messages.JointState:
        """Head first, then both arms, alphabetically."""
        state, order = self._robot.state, self._sorted
        still = (0.0,) * len(self._head_angles)
        return messages.JointState(
            self.header(stamp, ""),
            self._names,
            self._head_angles + floats(state.position[order]),
            still + floats(state.velocity[order]),
            still + floats(state.effort[order]),
        )

    def reference_states(self, stamp: int) -> messages.JointState:
        """Where the arms' servos are led, in the joint states' order."""
        robot, order = self._robot, self._sorted
        position, velocity = robot.state.position.copy(), np.zeros(robot.model.n)
        for drive in robot.limbs.values():
            if drive.served:
                position[drive.limb.joints] = drive.reference.position
                velocity[drive.limb.joints] = drive.reference.velocity
        still = (0.0,) * len(self._head_angles)
        return messages.JointState(
            self.header(stamp, ""),
            self._names,
            self._head_angles + floats(position[order]),
            still + floats(velocity[order]),
            (0.0,) * len(self._names),
        )

    def gripper_states(self, stamp: int) -> messages.JointState:
        """The fingers alone, which stand still."""
        still = (0.0,) * len(self._fingers)
        opening = (FINGER_OPENING,) * len(self._fingers)
        return messages.JointState(self.header(stamp, ""), self._fingers, opening, still, still)

    def assembly(self) -> messages.AssemblyState:
        """Power and stops."""
        return assembly_message(self._robot.machine.power)

    def sea_joints(self, limb: Limb, stamp: int) -> messages.SEAJointState:
        """One arm's joints in full, from the shoulder outwards.

        Spring efforts are the springs' own torque on the joints (docs/baxter.md), the robot adds their negative.
        """
        robot, joints = self._robot, limb.joints
        drive = robot.limbs[limb.name]
        weight, springs = robot.plant.compensation(robot.state.position)
        powered = float(robot.machine.power.enabled)
        acting = powered * (not robot.suppressed(limb.name, "suppress_gravity_compensation"))
        reference = drive.reference
        torque = drive.activity is LimbActivity.OBEYS and drive.mode is CommandMode.TORQUE
        measured = robot.state.position[joints]
        still = np.zeros(joints.size)
        return messages.SEAJointState(
            header=self.header(stamp, "base"),
            name=limb.joint_names,
            commanded_position=floats(reference.position if drive.served and powered else measured),
            commanded_velocity=floats(reference.velocity if drive.served and powered else still),
            commanded_acceleration=floats(still),
            commanded_effort=floats(drive.command if torque else robot.integral_effort(drive)),
            actual_position=floats(measured),
            actual_velocity=floats(robot.state.velocity[joints]),
            actual_effort=floats(robot.state.effort[joints]),
            gravity_model_effort=floats(acting * weight[joints]),
            gravity_only=floats(weight[joints]),
            hysteresis_model_effort=floats(-acting * springs[joints]),
            crosstalk_model_effort=floats(still),
            hyst_state=0.0,
        )

    def endpoint(self, limb: Limb, stamp: int) -> messages.EndpointState:
        """Where the gripper's tip is, how it moves, what it presses with: F with J^T F = effort - weight + springs."""
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

    def cuff(self, limb: Limb) -> messages.DigitalIOState:
        """Whether somebody squeezes the cuff."""
        return messages.DigitalIOState(int(self._robot.cuffs[limb.name]), is_input_only=True)


def assembly_message(standing: PowerState) -> messages.AssemblyState:
    """Puts power and stops into a message."""
    return messages.AssemblyState(
        standing.ready,
        standing.enabled,
        standing.stopped,
        standing.error,
        int(standing.button),
        int(standing.source),
    )


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


@dataclass
class TopicPublisher:
    """One topic of one node.

    Attributes:
        node, topic, kind: Who sends what where.
        rate: How often [Hz].
        make: Builds the message.
        faulty: Whether faults of the state topics concern it.
        on_change: A message unlike the last one is sent at once.
    """

    node: str
    topic: str
    kind: type[Message]
    rate: float
    make: Make
    faulty: bool = True
    on_change: bool = False
    _phase: float = 1.0

    def due(self) -> bool:
        """Counts one tick; says whether the topic is due."""
        self._phase += self.rate * TICK
        if self._phase < 1.0 - 1e-9:
            return False
        self._phase -= 1.0
        return True


def bounded_rate(wish: float) -> float:
    """Cuts a wished rate of the joint states to what the robot can [Hz]; 0 asks for the default."""
    return min(max(wish, SLOWEST_RATE), FASTEST_RATE) if wish else DEFAULT_RATE


def topic_publishers(readout: MessageBuilder, limbs: tuple[Limb, ...]) -> list[TopicPublisher]:
    """Lists every topic, the most urgent first."""
    found = [
        TopicPublisher(REALTIME_NODE, JOINT_STATES, messages.JointState, DEFAULT_RATE, readout.joint_states),
        TopicPublisher(
            REALTIME_NODE, STATE, messages.AssemblyState, STATE_RATE, lambda _: readout.assembly()
        ),
        # Another node: whatever befalls the first, the gripper goes on.
        TopicPublisher(
            GRIPPER_NODE,
            JOINT_STATES,
            messages.JointState,
            GRIPPER_RATE,
            readout.gripper_states,
            faulty=False,
        ),
        TopicPublisher(
            REALTIME_NODE,
            "/robot/ref_joint_states",
            messages.JointState,
            DEFAULT_RATE,
            readout.reference_states,
        ),
    ]
    for limb in limbs:
        found += _of_limb(readout, limb)
    return found


def _of_limb(readout: MessageBuilder, limb: Limb) -> list[TopicPublisher]:
    place = f"/robot/limb/{limb.name}"
    fast: list[tuple[str, type[Message], Make]] = [
        ("gravity_compensation_torques", messages.SEAJointState, partial(readout.sea_joints, limb)),
        ("endpoint_state", messages.EndpointState, partial(readout.endpoint, limb)),
        ("state", messages.AssemblyState, lambda _: readout.assembly()),
    ]
    slow: list[tuple[str, type[Message], Make]] = [
        (
            f"{place}/collision_detection_state",
            messages.CollisionDetectionState,
            partial(readout.detection, limb),
        ),
        (
            f"{place}/collision_avoidance_state",
            messages.CollisionAvoidanceState,
            partial(readout.avoidance, limb),
        ),
        (
            f"/robot/digital_io/{limb.name}_lower_cuff/state",
            messages.DigitalIOState,
            lambda _: readout.cuff(limb),
        ),
    ]
    found = [
        TopicPublisher(REALTIME_NODE, f"{place}/{name}", kind, STATE_RATE, make) for name, kind, make in fast
    ]
    found += [
        TopicPublisher(REALTIME_NODE, topic, kind, SLOW_RATE, make, faulty=False, on_change=True)
        for topic, kind, make in slow
    ]
    return found
