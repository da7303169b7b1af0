# SPDX-License-Identifier: BSD-3-Clause
"""The memory of a task's cycles, taken once before the first: every number that a cycle reads or writes."""

from __future__ import annotations

import numpy as np

from impedance_modules.backends.protocol import FirstState
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.compensator import Compensator, compensator_of
from impedance_modules.control.cycle import Cycle
from impedance_modules.modules.motor_velocity import motor_velocity
from impedance_modules.modules.sum import lay_out
from impedance_modules.robot.distances import Distances
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.state import RobotState
from impedance_modules.safety.active_set import make_active_set
from impedance_modules.safety.brake import make_brake
from impedance_modules.safety.expected_motion import expected_motion
from impedance_modules.safety.filter_problem import FilterLayout, FilterState, make_problem
from impedance_modules.safety.overspeed import travel_watch
from impedance_modules.safety.tank import make_tank


def state_at_rest(assembly: Assembly) -> FirstState:
    """A robot at rest at the task's start posture, on which nothing acts."""
    n = assembly.model.n
    parts = assembly.modules.posture.copy(), np.zeros(n), np.zeros(n)
    # As a robot's states are: machine code for arrays that may be written is other machine code.
    for part in parts:
        part.flags.writeable = False
    return FirstState(RobotState(0.0, *parts), np.zeros(n))


def task_compensator(assembly: Assembly) -> Compensator | None:
    """Makes what takes diagnosed effects back; None where nothing is compensated."""
    if assembly.compensation is None:
        return None
    return compensator_of(assembly.compensation, assembly.modules, assembly.period)


def make_cycle(
    assembly: Assembly,
    layout: FilterLayout,
    kinematics: Kinematics,
    distances: Distances,
    compensator: Compensator | None,
) -> Cycle:
    """Takes the memory of a task's cycles once."""
    n, arms = layout.n, kinematics.arms
    motor = motor_velocity(assembly.tank.compliance, assembly.period, assembly.robot.sensors.velocity_filter)
    previous = np.zeros(n)
    expected = expected_motion(
        compliance=assembly.tank.compliance,
        reflected_inertia=assembly.limits.reflected_inertia,
        motor_damping=assembly.model.motor_damping,
        arms=(arms.inverse_inertia, arms.bias, arms.weight),
        slow=motor.rate,
        period=assembly.period,
        lag=assembly.robot.sensors.velocity_filter,
        delay=assembly.tank.delay,
    )
    state = FilterState(
        q=expected.position,
        v=expected.velocity,
        link_velocity=expected.link_velocity,
        push=expected.push,
        swing=expected.swing,
        load=expected.load,
        motor_velocity=motor.velocity,
        inverse_inertia=arms.inverse_inertia,
        bias=arms.bias,
        jacobian=arms.jacobian[: len(assembly.modules.arms)],
        previous=previous,
        distance=distances.distance,
        gradient=distances.gradient,
        drift=distances.drift,
    )
    return Cycle(
        arms=arms,
        motor=motor,
        expected=expected,
        travel=travel_watch(
            assembly.period, assembly.tank.speed_bound, assembly.tank.compliance, assembly.tank.sensing_error
        ),
        modules=lay_out(
            assembly.modules,
            n,
            None if compensator is None else compensator.record,
            period=assembly.period,
            own=len(assembly.own),
        ),
        tank=make_tank(assembly.tank),
        brake=make_brake(assembly.brake, assembly.period, assembly.limits.effort_max),
        limits=assembly.limits,
        state=state,
        problem=make_problem(layout, assembly.limits.effort_max, arms.coupled, arms.moved_by),
        active=make_active_set(n, layout.m),
        effort=np.zeros(n),
        previous=previous,
        too_fast=n,
    )
