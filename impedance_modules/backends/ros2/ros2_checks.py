# SPDX-License-Identifier: BSD-3-Clause
"""Preflight checks of a robot on ROS 2: what its network and its states must be like before torques are published."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.preflight import PreflightResult
from impedance_modules.backends.ros2.ros2_node import DROPPED
from impedance_modules.errors import BadInput
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.connection_file import Ros2Connection
from impedance_modules.spec.robot_spec import RobotSpec

LISTENING = 1.0
"""Time in which the rate of the states is measured [s]."""

FINDING = 6.0
"""Longest wait for a first complete state [s]: nodes take a moment to find each other."""

STILL = 0.05
"""A joint faster than this is not at rest [rad/s]."""

LEAST_WEIGHT = 2.0
"""Norm of an arm's torques of weight below which no word can be told from the other [N.m]."""

GEAR_FRICTION = 0.3
"""How far the efforts of an arm at rest may be from what their word says, as a share of its weight: gears hold some."""

PROPORTIONAL = 0.9
"""Cosine between efforts and weight from which on the ones are taken for a multiple of the others."""

LEFT_OVER = 0.05
"""Largest share of the weight that efforts without it may hold all the same: models are not exact."""

RANGE_MARGIN = 0.01
"""Every joint at least this far inside its range [rad]."""


@dataclass(frozen=True)
class Heard:
    """What the node heard.

    Attributes:
        graph: Who publishes and subscribes, which joints and quantities are missing.
        dropped: Numbers of dropped states, by the order of ``DROPPED``.
        rate: Complete states per second [Hz].
        state: The newest one, or None.
        effort: (n,) mean of the efforts as they were reported [N.m].
    """

    graph: Mapping[str, Any]
    dropped: tuple[float, ...]
    rate: float
    state: RobotState | None
    effort: Array


def refuse_unfit_connection(
    spec: RobotSpec, connection: Ros2Connection, commanded: Mapping[str, Limb]
) -> None:
    """Refuses a connection file that does not fit the robot file or the task; before anything is started.

    Raises:
        BadInput: With every reason.
    """
    problems = []
    if spec.gravity_compensation != "robot":
        problems.append(
            f"robot '{spec.name}' has gravity_compensation: {spec.gravity_compensation}; who carries the weight is said"
            " in the connection file, and this backend carries it where the robot does not (valid: robot)"
        )
    named = [joint for each in connection.controllers for joint in each.joints]
    known = ", ".join(spec.joints)
    problems += [
        f"ros2: joint '{joint}' is none of robot '{spec.name}' (valid: {known})"
        for joint in dict.fromkeys([*named, *connection.names])
        if joint not in spec.joints
    ]
    problems += [
        f"ros2: joint '{joint}' is in two controllers (valid: one)"
        for joint in dict.fromkeys(named)
        if named.count(joint) > 1
    ]
    missing = [joint for limb in commanded.values() for joint in limb.joint_names if joint not in named]
    if missing:
        problems.append(
            f"ros2: no controller takes {', '.join(missing)} (valid: each commanded joint in one)"
        )
    topics = [each.topic for each in connection.controllers]
    if len(set(topics)) < len(topics):
        problems.append(f"ros2: two controllers have one topic: {', '.join(topics)} (valid: one each)")
    if problems:
        raise BadInput("\n".join(problems))


def check_robot(
    heard: Heard, model: RobotModel, commanded: Mapping[str, Limb], connection: Ros2Connection, rate: float
) -> tuple[PreflightResult, ...]:
    """Makes every check of what was heard.

    Args:
        heard: By the node.
        model: Of the robot.
        commanded: Limbs of the task.
        connection: Where it was heard.
        rate: Of control [Hz].
    """
    return (
        _check_states(heard, connection),
        *(_check_controller(heard, each.topic) for each in connection.controllers),
        _check_rate(heard, connection, rate),
        _check_finite(heard),
        *(_check_rest(heard.state, name, limb) for name, limb in commanded.items()),
        *(_check_range(heard.state, model, name, limb) for name, limb in commanded.items()),
        *(_check_effort(heard, model, connection.effort, name, limb) for name, limb in commanded.items()),
    )


def _check_states(heard: Heard, connection: Ros2Connection) -> PreflightResult:
    graph, remedy = heard.graph, "a joint_state_broadcaster with position, velocity and effort of every joint"
    if graph["state_publishers"] == 0:
        found = f"nobody publishes {connection.joint_states}"
    elif graph["empty"]:
        found = f"{connection.joint_states} leaves {' and '.join(graph['empty'])} empty"
    elif graph["missing"]:
        found = f"never reported on {connection.joint_states}: {', '.join(graph['missing'])}"
        remedy += ", or their other names under 'names' in the connection file"
    elif heard.state is None:
        found = f"no complete state on {connection.joint_states}"
        remedy += "; reliability: best_effort"
    else:
        return PreflightResult("states", True, "every joint is reported", "", for_motion=False)
    return PreflightResult("states", False, found, remedy, for_motion=False)


def _check_controller(heard: Heard, topic: str) -> PreflightResult:
    listeners, others = heard.graph["controllers"].get(topic, (0, 0))
    name = f"controller {topic}"
    if listeners == 0:
        remedy = "an effort controller that is loaded and active ('ros2 control list_controllers')"
        return PreflightResult(name, False, "nobody listens", remedy)
    if others > 0:
        remedy = "end the programs that command it; one that was killed is forgotten after 20 s"
        return PreflightResult(name, False, f"{others} other publishers", remedy)
    return PreflightResult(name, True, f"{listeners} listen", "")


def _check_rate(heard: Heard, connection: Ros2Connection, rate: float) -> PreflightResult:
    found = f"{heard.rate:.0f} states per second at a control rate of {rate:.0f} Hz"
    remedy = "--rate at which the states come, or a broadcaster and a network that keep it"
    return PreflightResult("rate", heard.rate >= connection.watch.least_share * rate, found, remedy)


def _check_finite(heard: Heard) -> PreflightResult:
    bad = [
        f"{count:.0f} {why}" for why, count in zip(DROPPED[:2], heard.dropped[:2], strict=True) if count > 0
    ]
    return PreflightResult("finite", not bad, f"dropped: {', '.join(bad)}", "a robot whose sensors work")


def _check_rest(state: RobotState | None, name: str, limb: Limb) -> PreflightResult:
    if state is None:
        return PreflightResult(f"rest {name}", None, "no state", "")
    fastest = float(np.abs(state.velocity[limb.joints]).max())
    found = f"fastest joint at {fastest:.3f} rad/s"
    return PreflightResult(f"rest {name}", fastest < STILL, found, f"below {STILL:g} rad/s")


def _check_range(state: RobotState | None, model: RobotModel, name: str, limb: Limb) -> PreflightResult:
    if state is None:
        return PreflightResult(f"range {name}", None, "no state", "")
    low = model.column("position_min")[limb.joints] + RANGE_MARGIN
    high = model.column("position_max")[limb.joints] - RANGE_MARGIN
    at = state.position[limb.joints]
    outside = [
        f"{joint} at {q:.3f} rad"
        for joint, q, a, b in zip(limb.joint_names, at, low, high, strict=True)
        if not a <= q <= b
    ]
    found = "; ".join(outside) or "every joint inside"
    return PreflightResult(f"range {name}", not outside, found, "a pose inside the robot file's range")


def effort_word(effort: Array, weight: Array) -> str:
    r"""Says what the efforts of an arm at rest hold: ``with_weight``, ``without_weight``, or neither: ``unknown``.

    With s = tau . g / g . g and the cosine c between both,

        with weight      |tau - g| <= 0.3 |g|
        without weight   |tau| <= 0.3 |g|, and s <= 0.05 or c < 0.9

    Motor currents are proportional to the weight, with c near 1: those of Universal Robots have s near 0.1.

    Args:
        effort: tau (m,) as reported.
        weight: g (m,) of the model [N.m], not zero.
    """
    size, tau = float(np.linalg.norm(weight)), float(np.linalg.norm(effort))
    if float(np.linalg.norm(effort - weight)) <= GEAR_FRICTION * size:
        return "with_weight"
    along = float(effort @ weight)
    proportional = along > LEFT_OVER * size * size and along >= PROPORTIONAL * tau * size
    return "unknown" if tau > GEAR_FRICTION * size or proportional else "without_weight"


def _check_effort(heard: Heard, model: RobotModel, word: str, name: str, limb: Limb) -> PreflightResult:
    """Compares the efforts of an arm at rest with its weight by the model."""
    if heard.state is None:
        return PreflightResult(f"effort {name}", None, "no state", "")
    effort = heard.effort[limb.joints]
    weight = model.gravity(heard.state.position)[limb.joints]
    if np.linalg.norm(weight) < LEAST_WEIGHT:
        return PreflightResult(f"effort {name}", None, "no weight to compare with in this posture", "")
    seen = effort_word(effort, weight)
    joint = int(np.argmax(np.abs(weight)))
    found = (
        f"effort: {word}, but {limb.joint_names[joint]} reports {effort[joint]:.2f} at rest where the model's weight is"
        f" {weight[joint]:.2f} N.m"
    )
    remedy = (
        "efforts in N.m, not motor currents in A; a tool in the robot file; nothing that touches the arm; see the table"
        " in docs/ros2.md"
        if seen == "unknown"
        else f"effort: {seen}, after a look at docs/ros2.md"
    )
    return PreflightResult(f"effort {name}", seen == word, found, remedy, for_motion=False)
