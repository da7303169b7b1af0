# SPDX-License-Identifier: BSD-3-Clause
r"""Joints: series spring, rotor, play, stop, and the robot's own position hold.

elastic  I_r w' + D w = tau_m - tau_s,  tau_s = K (theta - q) + B (w - v)      (thesis eq. 3.2, 3.3)
         with play b: K acts on the deflection theta - q less what the play takes, nothing within |theta - q| <= b/2;
         teeth push and never pull
rigid    the rotor moves with the link: tau_s = tau_m - D v - I_r v'
ideal    I_r = 0: tau_s = tau_m and theta = q + tau_m / K; motor damping does not act

tau_m = command + what the robot adds + hold + effects; q, v are the link's [rad], [rad/s], theta, w the rotor's as seen
at the joint. Torques in N.m, stiffness K in N.m/rad, damping B and D in N.m.s/rad, inertia I_r in kg.m^2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from impedance_modules.compiled import compiled
from impedance_modules.records import Matrix, Row, Table, Vector, new_table
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import JointSpec

if TYPE_CHECKING:
    from impedance_modules.plant.plant_state import PlantState

ELASTIC, RIGID, IDEAL = 0, 1, 2
"""Kinds of joint: spring and rotor; rotor fixed to the link; torque source without a rotor."""

STOP_TIME = 5e-4
"""Damping of a joint stop over its stiffness [s]."""

STOP_STIFFENING = 10.0
"""Stiffness of a stop over that of the joint's spring."""

RIGID_DEFLECTION = 0.05
"""A joint without a spring is held and stopped as if full effort deflected it this far [rad]."""

JOINT = np.dtype(
    [
        ("kind", np.int64),
        ("stiffness", np.float64),
        ("half_gap", np.float64),
        ("spring_damping", np.float64),
        ("motor_damping", np.float64),
        ("reflected_inertia", np.float64),
        ("effort_max", np.float64),
        ("lower", np.float64),
        ("upper", np.float64),
        ("stop_stiffness", np.float64),
        ("stop_damping", np.float64),
        ("command", np.float64),
        ("assist", np.float64),
        ("effect_motor", np.float64),
        ("effect_link", np.float64),
        ("hold_stiffness", np.float64),
        ("hold_damping", np.float64),
        ("hold_position", np.float64),
        ("motor", np.float64),
        ("load", np.float64),
    ],
    align=True,
)
"""One joint: its constants and limits, the torques that act now [N.m], and ``load``, the torque through its gear."""


@compiled
def joint_torque(plant: PlantState, i: int) -> float:
    """Writes one joint's rates and powers; returns the torque of spring, stop and effects on its link [N.m]."""
    joint, stage, rate, work = plant.joints[i], plant.stage, plant.rate, plant.rate.work[0]
    q, v, theta, w = stage.position[i], stage.velocity[i], stage.motor_position[i], stage.motor_velocity[i]
    hold = joint.hold_stiffness * (joint.hold_position - theta) - joint.hold_damping * w
    hold = min(max(hold, -joint.effort_max), joint.effort_max)
    motor = joint.command + joint.assist + hold + joint.effect_motor
    loss = joint.motor_damping * w
    rate.position[i], rate.motor_position[i] = v, w
    if joint.kind == ELASTIC:
        load = spring_torque(joint, theta - q, w - v)
        rate.motor_velocity[i] = (motor - load - loss) / joint.reflected_inertia
        work.spring_loss += (load - joint.stiffness * spring_deflection(joint, theta - q)) * (w - v)
    elif joint.kind == RIGID:
        load = motor - loss
    else:
        load, loss = motor, 0.0
    stop = stop_torque(joint, q, v)
    work.command_work += joint.command * w
    work.robot_work += (joint.assist + hold) * w
    work.effect_work += joint.effect_motor * w + joint.effect_link * v
    work.motor_loss += loss * w
    work.stop_work += stop * v
    joint.motor, joint.load = motor, load
    return float(load + stop + joint.effect_link)


@compiled
def spring_deflection(joint: Row, lead: float) -> float:
    """Gives the deflection of a joint's spring [rad] when its motor leads the link by theta - q: lead less play."""
    if lead > joint.half_gap:
        return float(lead - joint.half_gap)
    if lead < -joint.half_gap:
        return float(lead + joint.half_gap)
    return 0.0


@compiled
def spring_torque(joint: Row, lead: float, speed: float) -> float:
    """Gives the torque through an elastic gear [N.m] at theta - q and w - v; with play, teeth push and never pull."""
    deflection = spring_deflection(joint, lead)
    load = joint.stiffness * deflection + joint.spring_damping * speed
    if joint.half_gap > 0.0:
        return float(max(load, 0.0) if deflection > 0.0 else min(load, 0.0) if deflection < 0.0 else 0.0)
    return float(load)


@compiled
def stop_torque(joint: Row, q: float, v: float) -> float:
    """Gives the torque of a joint stop [N.m]: a spring-damper beyond the limit that never pulls back."""
    if q > joint.upper:
        return float(min(0.0, joint.stop_stiffness * (joint.upper - q) - joint.stop_damping * v))
    if q < joint.lower:
        return float(max(0.0, joint.stop_stiffness * (joint.lower - q) - joint.stop_damping * v))
    return 0.0


@compiled
def update_loads(plant: PlantState) -> None:
    """Writes the torque between each joint's gear and link at the step's end [N.m]."""
    start = plant.start
    for i in range(plant.joints.size):
        joint = plant.joints[i]
        if joint.kind == ELASTIC:
            lead = start.motor_position[i] - start.position[i]
            joint.load = spring_torque(joint, lead, start.motor_velocity[i] - start.velocity[i])
        elif joint.kind == RIGID:
            joint.load -= joint.reflected_inertia * plant.rate.velocity[i]
        elif joint.kind == IDEAL:
            joint.load = joint.motor


@compiled
def measurable_torques(plant: PlantState, out: Vector) -> None:
    """Writes what a perfect effort sensor says at the step's start (n,) [N.m]: K (theta - q), or the gear's load."""
    for i in range(plant.joints.size):
        joint, lead = plant.joints[i], plant.start.motor_position[i] - plant.start.position[i]
        out[i] = joint.stiffness * spring_deflection(joint, lead) if joint.kind == ELASTIC else joint.load


@compiled
def spring_deflections(plant: PlantState, out: Vector) -> None:
    """Writes the deflection of every elastic joint's spring at the step's start (n,) [rad]; 0 of other joints."""
    for i in range(plant.joints.size):
        lead = plant.start.motor_position[i] - plant.start.position[i]
        out[i] = spring_deflection(plant.joints[i], lead) if plant.joints[i].kind == ELASTIC else 0.0


@compiled
def motor_positions(plant: PlantState, out: Vector) -> None:
    """Writes the true theta (n,) [rad]: the rotor's, or q + tau_m / K of an ideal torque source."""
    for i in range(plant.joints.size):
        joint = plant.joints[i]
        out[i] = plant.start.motor_position[i]
        if joint.kind == IDEAL and joint.stiffness > 0.0:
            out[i] = plant.start.position[i] + joint.motor / joint.stiffness


def joint_kind(joint: JointSpec) -> int:
    """Says which of the three kinds a joint is."""
    if joint.reflected_inertia == 0.0:
        return IDEAL
    return RIGID if joint.spring_stiffness is None else ELASTIC


def joint_table(model: RobotModel) -> Table:
    """Tabulates the constants and limits of all joints; torques and hold are zero."""
    table = new_table(model.n, JOINT)
    for row, joint in zip(table, model.joints, strict=True):
        row["kind"] = joint_kind(joint)
        for name in ("spring_damping", "motor_damping", "reflected_inertia", "effort_max"):
            row[name] = getattr(joint, name)
        row["stiffness"] = 0.0 if joint.spring_stiffness is None else joint.spring_stiffness
        row["lower"], row["upper"] = joint.position_min, joint.position_max
        row["stop_stiffness"] = STOP_STIFFENING * structural_stiffness(joint)
        row["stop_damping"] = STOP_TIME * row["stop_stiffness"]
    return table


def structural_stiffness(joint: JointSpec) -> float:
    """Gives the joint's spring stiffness, or that of a rigid joint's assumed deflection [N.m/rad]."""
    if joint.spring_stiffness is not None:
        return joint.spring_stiffness
    return joint.effort_max / RIGID_DEFLECTION


def hold_gains(model: RobotModel, mobility: Matrix) -> tuple[Vector, Vector]:
    """Gives the position hold's stiffness and damping, (n,) each, on the motor side.

    As stiff as the joint's own spring, critically damped for I_r + 1 / (M^-1)_ii.

    Args:
        model: The robot.
        mobility: (n, n) inverse mass matrix of the links at the pose to hold.
    """
    stiffness = np.array([structural_stiffness(joint) for joint in model.joints])
    inertia = model.rotor_inertia + 1.0 / np.diag(mobility)
    return stiffness, 2.0 * np.sqrt(stiffness * inertia)
