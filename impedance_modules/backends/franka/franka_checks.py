# SPDX-License-Identifier: BSD-3-Clause
r"""Preflight checks of Franka arms: what must be true of each before a run may command it. Nothing is sent.

The maker's software does not tell a robot's description, so that it is the right robot is judged by what it measures:
joints within their range, and at rest the torque that our model needs to carry the arm,

    |\tau_J - g(q)| < 3 N.m        (a tool that only one side knows, a base that is not upright, another robot)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.franka.arm_link import ArmLink
from impedance_modules.backends.franka.arm_messages import ARM_JOINTS, IDLE, REFLEX, ROBOT_MODES, ArmReport
from impedance_modules.backends.preflight import PreflightResult
from impedance_modules.errors import BadInput
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.spec.robot_spec import RobotSpec

SAME_WEIGHT = 3.0
"""Largest difference between a joint's torque at rest and our model's [N.m]: a hand of 0.7 kg at a bent arm shows."""

STILL = 0.02
"""A joint faster than this is not at rest [rad/s]."""

NEAR = 0.1
"""If every joint is this close to the start, the task's springs may pull it the rest of the way [rad]."""

RANGE_MARGIN = 0.01
"""Every joint at least this far inside its range [rad]."""

MODE_REMEDIES = {
    0: "a robot whose brakes are open and that is ready in Desk",
    2: "end the other program that moves it, or whose connection is still open",
    3: "let go of the enabling device and switch to execution in Desk",
    4: "look why it stopped, then 'run --recover'",
    5: "release the stop, with nobody within the arm's reach",
    6: "wait until it has recovered",
}
"""Mode of a robot that may not be commanded -> what would help."""


@dataclass(frozen=True)
class CheckedArm:
    """One arm as it stands.

    Attributes:
        link: To its process.
        report: Its newest state.
        rate: States of its robot per second of our clock [Hz].
        least_rate: Fewest that are accepted [Hz].
    """

    link: ArmLink
    report: ArmReport
    rate: float
    least_rate: float


def refuse_unfit_robot(spec: RobotSpec, addresses: Mapping[str, str]) -> None:
    """Refuses a robot file that is no Franka robot's, or addresses that are not its limbs'; before any connection.

    Raises:
        BadInput: With every reason.
    """
    problems = []
    if spec.gravity_compensation != "robot":
        problems.append(
            f"robot '{spec.name}' has gravity_compensation: {spec.gravity_compensation}; a Franka robot carries its own"
            " weight, and would carry it twice (valid: robot)"
        )
    for name, limb in spec.limbs.items():
        if len(limb.joints) != ARM_JOINTS:
            problems.append(
                f"limb '{name}' of robot '{spec.name}' has {len(limb.joints)} joints; a Franka arm has {ARM_JOINTS}"
                " (valid: another --robot, or another --backend)"
            )
        if name not in addresses:
            problems.append(
                f"no address for limb '{name}' (valid: --address {name}=172.16.0.2, or franka: addresses: in a"
                " connection file; the arm that a task leaves out is watched, too)"
            )
    problems += [
        f"address for '{name}', which is no limb of robot '{spec.name}' (valid: {', '.join(spec.limbs)})"
        for name in addresses
        if name not in spec.limbs
    ]
    named = [addresses[name] for name in spec.limbs if name in addresses]
    if len(set(named)) < len(named):
        problems.append(f"two limbs have one address, {', '.join(named)} (valid: a robot for each limb)")
    if problems:
        raise BadInput("\n".join(problems))


def check_arms(
    arms: Mapping[str, CheckedArm], model: RobotModel, commanded: Mapping[str, Limb], start: Array | None
) -> tuple[PreflightResult, ...]:
    """Makes every check.

    Args:
        arms: Limb -> its arm; those that are not commanded must only be there.
        model: Of the robot.
        commanded: Limbs that the task commands.
        start: (n,) where the task begins [rad]; None where the robot will be brought there.
    """
    state = arms_position(arms, model)
    return tuple(
        result
        for name, arm in arms.items()
        for result in (
            _check_rate(name, arm),
            *(
                (
                    _check_mode(name, arm),
                    _check_errors(name, arm),
                    _check_rest(name, arm),
                    _check_range(name, arm, model.limbs[name], model),
                    _check_weight(name, arm, model.limbs[name], model.gravity(state)),
                    *(() if start is None else (_check_start(name, arm, model.limbs[name], start),)),
                )
                if name in commanded
                else ()
            ),
        )
    )


def arms_position(arms: Mapping[str, CheckedArm], model: RobotModel) -> Array:
    """Position (n,) of all joints [rad]."""
    position = np.zeros(model.n)
    for name, arm in arms.items():
        position[model.limbs[name].joints] = arm.report.position
    return position


def _check_rate(name: str, arm: CheckedArm) -> PreflightResult:
    found = f"{arm.rate:.0f} states per second"
    remedy = (
        f"{arm.least_rate:.0f} or more: a wired network straight to the robot, an idle computer; or least_rate in the"
        " connection file"
    )
    return PreflightResult(f"rate {name}", arm.rate >= arm.least_rate, found, remedy, for_motion=True)


def _check_mode(name: str, arm: CheckedArm) -> PreflightResult:
    mode = arm.report.mode
    remedy = MODE_REMEDIES.get(mode, "an idle robot")
    return PreflightResult(f"mode {name}", mode == IDLE, ROBOT_MODES.get(mode, f"mode {mode}"), remedy)


def _check_errors(name: str, arm: CheckedArm) -> PreflightResult:
    errors = arm.link.errors
    recoverable = arm.report.mode == REFLEX
    remedy = "'run --recover' once the cause is gone" if recoverable else "what Desk says of them"
    return PreflightResult(f"errors {name}", not errors, errors or "none", remedy)


def _check_rest(name: str, arm: CheckedArm) -> PreflightResult:
    fastest = max(abs(value) for value in arm.report.velocity)
    return PreflightResult(
        f"rest {name}", fastest < STILL, f"fastest joint at {fastest:.3f} rad/s", f"below {STILL:g} rad/s"
    )


def _check_range(name: str, arm: CheckedArm, limb: Limb, model: RobotModel) -> PreflightResult:
    low = model.column("position_min")[limb.joints] + RANGE_MARGIN
    high = model.column("position_max")[limb.joints] - RANGE_MARGIN
    outside = [
        f"{joint} at {q:.3f} rad (range {a:.3f} to {b:.3f})"
        for joint, q, a, b in zip(limb.joint_names, arm.report.position, low, high, strict=True)
        if not a <= q <= b
    ]
    found = "; ".join(outside) or "every joint inside"
    return PreflightResult(f"range {name}", not outside, found, "a pose inside, led there by hand in Desk")


def _check_weight(name: str, arm: CheckedArm, limb: Limb, weight: Array) -> PreflightResult:
    off = np.abs(np.array(arm.report.effort) - weight[limb.joints])
    worst = int(np.argmax(np.where(np.isfinite(off), off, np.inf)))
    found = f"at rest, torques differ from our model's weight by up to {off[worst]:.2f} N.m ({limb.joint_names[worst]})"
    remedy = (
        f"below {SAME_WEIGHT:g} N.m: the robot of this robot file, upright, nothing touching it, and its tool in both"
        " the robot file (or a patch) and Desk"
    )
    return PreflightResult(f"weight {name}", bool(off[worst] < SAME_WEIGHT), found, remedy)


def _check_start(name: str, arm: CheckedArm, limb: Limb, start: Array) -> PreflightResult:
    off = np.abs(np.array(arm.report.position) - start[limb.joints])
    worst = int(np.argmax(off))
    found = f"{limb.joint_names[worst]} is {off[worst]:.3f} rad away from where the task begins"
    return PreflightResult(
        f"start {name}", bool(off[worst] <= NEAR), found, f"within {NEAR:g} rad, or run --approach"
    )
