# SPDX-License-Identifier: BSD-3-Clause
"""Which message the double sends where and how often."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from impedance_modules.backends.baxter.ros import messages
from impedance_modules.backends.baxter.ros.messages import Message
from impedance_modules.backends.baxter.simulator.parameters import (
    DEFAULT_RATE,
    FASTEST_RATE,
    GRIPPER_RATE,
    SLOW_RATE,
    SLOWEST_RATE,
    STATE_RATE,
    TICK,
)
from impedance_modules.backends.baxter.simulator.publishers import Readout
from impedance_modules.robot.model import Limb

Make = Callable[[int], Message]
"""Builds a message from a stamp [ns]."""

REALTIME_NODE, GRIPPER_NODE = "/realtime_loop", "/end_effector_publisher"
"""The two nodes of a real robot that publish joint states."""

STATE = "/robot/state"
JOINT_STATES = "/robot/joint_states"


@dataclass
class Outlet:
    """One topic of one node.

    Attributes:
        node, topic, kind: Who sends what where.
        rate: How often [Hz].
        make: Builds the message.
        mishap: Whether faults of the state topics concern it.
        on_change: A message unlike the last one is sent at once.
    """

    node: str
    topic: str
    kind: type[Message]
    rate: float
    make: Make
    mishap: bool = True
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


def outlets(readout: Readout, limbs: tuple[Limb, ...]) -> list[Outlet]:
    """Lists every topic, the most urgent first."""
    found = [
        Outlet(REALTIME_NODE, JOINT_STATES, messages.JointState, DEFAULT_RATE, readout.joint_states),
        Outlet(REALTIME_NODE, STATE, messages.AssemblyState, STATE_RATE, lambda _: readout.assembly()),
        # Another node: whatever befalls the first, the gripper goes on.
        Outlet(
            GRIPPER_NODE,
            JOINT_STATES,
            messages.JointState,
            GRIPPER_RATE,
            readout.gripper_states,
            mishap=False,
        ),
        Outlet(
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


def _of_limb(readout: Readout, limb: Limb) -> list[Outlet]:
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
    found = [Outlet(REALTIME_NODE, f"{place}/{name}", kind, STATE_RATE, make) for name, kind, make in fast]
    found += [
        Outlet(REALTIME_NODE, topic, kind, SLOW_RATE, make, mishap=False, on_change=True)
        for topic, kind, make in slow
    ]
    return found
