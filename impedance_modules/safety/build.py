# SPDX-License-Identifier: BSD-3-Clause
"""First of the filter's three steps: one cycle's numbers become a quadratic program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.safety import rows
from impedance_modules.safety.limits import FilterLimits
from impedance_modules.safety.metric import metric, penalty
from impedance_modules.safety.problem import FilterProblem, FilterWorkspace, Matrix, RowKind, Vector


@dataclass(frozen=True)
class FilterState:
    """What the filter must know of one cycle.

    Attributes:
        position: q (n,) [rad].
        velocity: v (n,) [rad/s].
        motor_velocity: thetadot (n,), speed at the port where energy is counted [rad/s].
        inverse_inertia: (n, n) (M + I_r)^-1 [1/(kg.m^2)].
        bias: (n,) torque that keeps v constant, (M + I_r) vdot = tau - bias [N.m]; without gravity where
            the robot compensates it.
        jacobians: J_WE (6, n) of each hand.
        previous: (n,) torque of the last cycle [N.m].
        available: Tank level above its floor [J].
        distances: (pairs,) smallest distance of each pair [m].
        distance_jacobians: (pairs, n), rate of the distance = row . v [m/rad].
        distance_drift: (pairs,) acceleration of the distance at vdot = 0 [m/s^2].
    """

    position: Vector
    velocity: Vector
    motor_velocity: Vector
    inverse_inertia: Matrix
    bias: Vector
    jacobians: Sequence[Matrix]
    previous: Vector
    available: float
    distances: Vector
    distance_jacobians: Matrix
    distance_drift: Vector


def build(
    workspace: FilterWorkspace, limits: FilterLimits, state: FilterState, desired: Vector
) -> FilterProblem:
    """Writes the rows of this cycle into the workspace.

    Accelerations are torques seen through the inertia: vdot_i = Minv_i . (tau - bias), so a row
    a_min <= vdot_i <= a_max is Minv_i . tau in [a_min, a_max] + Minv_i . bias.

    Args:
        workspace: Its arrays are overwritten.
        limits: Constants of the run.
        state: This cycle.
        desired: (n,) torque of the modules [N.m].

    Returns:
        ``workspace.problem``; valid until the next call (`FilterProblem.snapshot` keeps it).

    Raises:
        ValueError: If ``state.available`` is negative.
    """
    problem = workspace.problem
    problem.desired[:] = desired
    problem.metric[:] = metric(state.inverse_inertia, state.jacobians)
    problem.effort_max[:] = limits.effort_max
    _write_power_and_rate(problem, limits, state)
    _write_distance(problem, limits, state)
    _write_position_and_velocity(problem, limits, state)
    return problem


def _write_power_and_rate(problem: FilterProblem, limits: FilterLimits, state: FilterState) -> None:
    layout = problem.layout
    row, upper = rows.power_row(state.motor_velocity, state.available, limits.power_horizon)
    problem.matrix[layout.power] = row
    problem.upper[layout.power] = upper
    problem.lower[layout.rate], problem.upper[layout.rate] = rows.rate_interval(
        state.previous, limits.effort_rate_max, limits.effort_max, limits.period
    )
    mobility = np.diagonal(state.inverse_inertia)
    problem.penalty[layout.rate] = penalty(RowKind.RATE, 1.0 / mobility)


def _write_distance(problem: FilterProblem, limits: FilterLimits, state: FilterState) -> None:
    where = problem.layout.distance
    rates = state.distance_jacobians @ state.velocity
    smallest = rows.separation_acceleration(
        state.distances,
        rates,
        margin=limits.margin,
        approach_time=limits.approach_time,
        separation_speed=limits.separation_speed,
        limit=limits.separation_acceleration,
        horizon=limits.horizon,
    )
    matrix = state.distance_jacobians @ state.inverse_inertia
    mobility = np.einsum("pn,pn->p", matrix, state.distance_jacobians)
    problem.matrix[where] = matrix
    problem.lower[where] = smallest - state.distance_drift + matrix @ state.bias
    problem.lower[where][mobility == 0.0] = -np.inf
    problem.penalty[where] = penalty(RowKind.DISTANCE, mobility)


def _write_position_and_velocity(problem: FilterProblem, limits: FilterLimits, state: FilterState) -> None:
    free = state.inverse_inertia @ state.bias
    mobility = np.diagonal(state.inverse_inertia)
    position = rows.position_interval(
        state.position,
        state.velocity,
        limits.position_min,
        limits.position_max,
        deceleration=limits.deceleration,
        return_speed=limits.return_speed,
        horizon=limits.horizon,
    )
    velocity = rows.velocity_interval(
        state.velocity, limits.velocity_max, limits.deceleration, limits.horizon
    )
    layout = problem.layout
    for where, kind, (low, high) in (
        (layout.position, RowKind.POSITION, position),
        (layout.velocity, RowKind.VELOCITY, velocity),
    ):
        problem.matrix[where] = state.inverse_inertia
        problem.lower[where] = low + free
        problem.upper[where] = high + free
        problem.penalty[where] = penalty(kind, mobility)
