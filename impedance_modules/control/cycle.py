# SPDX-License-Identifier: BSD-3-Clause
"""One control cycle: from a measured state to the torque that may leave.

The order is that of docs/passivity.md:

1. measure what the last interval cost (``safety.tank``);
2. advance the equilibria as far as the tank can pay (``control.set_points``), rescale the springs;
3. sum the modules (``modules.sum``), whose dampers act on the motors' velocity (``modules.motor_velocity``);
4. build the filter's problem (``safety.metric``, ``safety.rows``) and solve it (``safety.active_set``);
5. limit what leaves to the energy budget (``safety.tank``).

Where the active-set solver proves nothing, ``tick`` stops before step 5: the robot's solver works on the problem, and
``limit_effort`` follows.
"""

from __future__ import annotations

import math

from impedance_modules.arrays import Array
from impedance_modules.compiled import compiled
from impedance_modules.control.set_points import SetPoints, advance
from impedance_modules.modules.motor_velocity import MotorVelocity, estimate_motor_velocity
from impedance_modules.modules.sum import Modules, potential_energy, sum_modules
from impedance_modules.modules.target_motion import measure_target_motion
from impedance_modules.records import Integer, Record, Scalar, Vector
from impedance_modules.robot.kinematics import ArmGeometry
from impedance_modules.safety.active_set import UNDECIDED, ActiveSet, solve
from impedance_modules.safety.brake import Brake, brake_effort, slip_to
from impedance_modules.safety.expected_motion import ExpectedMotion, expect_motion
from impedance_modules.safety.filter_problem import FilterProblem, FilterState
from impedance_modules.safety.limits import FilterLimits
from impedance_modules.safety.metric import write_metric
from impedance_modules.safety.overspeed import TravelWatch, too_fast_joint
from impedance_modules.safety.rows import write_rows
from impedance_modules.safety.tank import Tank, available, limit_to_budget, measure, rescale_springs

FINE, STATE_NOT_FINITE, EFFORT_NOT_FINITE, UNSOLVED = range(4)
"""How far a cycle came: a torque may leave; there is none; there is none; the robot's solver is asked for one."""


class Cycle(Record):
    """All numbers of a control cycle, by name.

    Attributes:
        arms: Geometry and inertia at the state.
        motor: Velocity of the motors, as late as the robot reports that of the links: dampers act on it.
        expected: Motion when the next torque begins to act; the filter's rows bound it.
        intervals: Periods since the state before.
        travel: Of motors and links: is one too fast?
        modules: What is in force, and what it asks for.
        tank: The energy ledger.
        brake: Of a stop.
        limits, state, problem, active: Of the torque filter; ``state`` holds the positions and velocities.
        effort: (n,) torque that may leave [N.m].
        previous: (n,) torque of the last cycle [N.m]; the filter's ``state`` looks at it.
        clock: Of the phase [s]; slower than time where the tank is short.
        admitted: Part in [0, 1] of the last period of the phase's motion that the tank could pay, or of the step
            towards set-points where that is less.
        energy: Of the relaxed springs [J].
        effort_scale: Part in [0, 1] of the filtered torque that the energy budget lets leave.
        status: One of the above.
        too_fast: First joint beyond its speed bound in the last interval, or n.
        found, tried: What the active-set solver found, and after how many trials.
    """

    arms: ArmGeometry
    motor: MotorVelocity
    expected: ExpectedMotion
    intervals: Integer = 1
    travel: TravelWatch
    modules: Modules
    tank: Tank
    brake: Brake
    limits: FilterLimits
    state: FilterState
    problem: FilterProblem
    active: ActiveSet
    effort: Vector
    previous: Vector
    clock: Scalar = 0.0
    admitted: Scalar = 1.0
    energy: Scalar = 0.0
    effort_scale: Scalar = 1.0
    status: Integer = FINE
    too_fast: Integer
    found: Integer = UNDECIDED
    tried: Integer = 0


@compiled
def all_finite(vector: Array) -> bool:
    """Tells whether no entry is infinite or not a number."""
    finite = True
    for value in vector:
        finite = finite and math.isfinite(value)
    return finite


@compiled
def tick(
    cycle: Cycle, points: SetPoints, q: Array, velocity: Array, effort: Array, use_active_set: bool
) -> int:
    """From a measured state to the torque that may leave, in ``cycle.effort``.

    Args:
        cycle: ``arms`` and the distances of ``state`` are up to date.
        points: Of the phase.
        q: (n,) measured link positions [rad].
        velocity: (n,) of the links, as the robot reports them [rad/s].
        effort: (n,) measured torques between gearbox and link [N.m].
        use_active_set: False leaves every problem to the robot's solver.

    Returns:
        FINE, STATE_NOT_FINITE, EFFORT_NOT_FINITE, or UNSOLVED where the filter's problem is left to a solver.
    """
    cycle.found, cycle.tried = UNDECIDED, 0
    cycle.status = desire(cycle, points, q, velocity, effort)
    if cycle.status != FINE:
        return cycle.status
    expected = cycle.expected
    expected.measured[0], expected.measured[1], expected.measured[2] = q, velocity, effort
    expect_motion(expected, cycle.intervals, cycle.tank.applied, cycle.tank.pending)
    cycle.state.available = available(cycle.tank)
    cycle.problem.desired[:] = cycle.modules.desired
    write_metric(cycle.problem, cycle.state)
    write_rows(cycle.problem, cycle.limits, cycle.state)
    if use_active_set:
        cycle.found, cycle.tried = solve(cycle.problem, cycle.active)
    if cycle.found == UNDECIDED:
        cycle.status = UNSOLVED
        return UNSOLVED
    cycle.effort[:] = cycle.active.effort
    return limit_effort(cycle, False)


@compiled
def desire(cycle: Cycle, points: SetPoints, q: Array, velocity: Array, effort: Array) -> int:
    """Books the last interval, advances the equilibria and sums what the modules ask for; returns a status."""
    if not (all_finite(q) and all_finite(velocity) and all_finite(effort)):
        return STATE_NOT_FINITE
    modules, tank = cycle.modules, cycle.tank
    cycle.intervals = 1 + tank.missed_cycles
    cycle.too_fast = measure(tank, q, effort, potential_energy(modules, cycle.arms, q))
    if cycle.intervals > 1:
        cycle.travel.known = -1
    cycle.too_fast = min(cycle.too_fast, too_fast_joint(cycle.travel, q, effort))
    cycle.admitted = advance(points, modules, cycle.arms, tank, q, cycle.clock)
    cycle.clock += cycle.admitted * tank.period
    cycle.admitted = min(cycle.admitted, points.following.granted)
    measure_target_motion(modules.targets, modules.springs, modules.bias)
    rescale_springs(tank)
    estimate_motor_velocity(cycle.motor, velocity, effort)
    cycle.energy = sum_modules(modules, cycle.arms, q, cycle.motor.velocity, tank.spring_scale)
    return FINE if all_finite(modules.desired) else EFFORT_NOT_FINITE


@compiled
def limit_effort(cycle: Cycle, stopping: bool) -> int:
    """Scales ``cycle.effort`` to what the tank can answer for; returns the status.

    Args:
        cycle: ``effort`` is scaled in place.
        stopping: In a stop the tank's floor may be spent too.
    """
    if not all_finite(cycle.effort):
        cycle.status = EFFORT_NOT_FINITE
        return EFFORT_NOT_FINITE
    cycle.effort_scale = limit_to_budget(cycle.tank, cycle.effort, stopping)
    cycle.previous[:] = cycle.effort
    cycle.status = FINE
    return FINE


@compiled
def brake(cycle: Cycle) -> int:
    """The torque of a stop at the motors' last measured position, in ``cycle.effort``; returns the status."""
    brake_effort(cycle.brake, cycle.tank.motor_position, cycle.effort)
    status = limit_effort(cycle, True)
    slip_to(cycle.brake, cycle.effort)
    return status
