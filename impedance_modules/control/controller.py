# SPDX-License-Identifier: BSD-3-Clause
r"""The control law in the loop: from one state to one torque that limits and tank have agreed to.

    \tau = filter( \sum_modules J^T w - K_j (q - q_0) - D \dot\theta )        (design 4)

Dampers act on the motor-side velocity \dot\theta, the port at which energy is counted: fed with the link's velocity
they would make Baxter's elastic joints unstable from 50 N/m on (docs/control-law.md). The arithmetic of a cycle is
``control.cycle``; this class owns its memory, the geometry library and the robot's solver, and knows the phases.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.protocol import FirstState
from impedance_modules.compiled import want_machine_code
from impedance_modules.control import cycle as laws
from impedance_modules.control.assembly import Assembly, make_distances
from impedance_modules.control.cycle import EFFORT_NOT_FINITE, FINE, STATE_NOT_FINITE, UNSOLVED
from impedance_modules.control.cycle_memory import make_cycle, state_at_rest, task_compensator
from impedance_modules.control.equilibrium_following import (
    Following,
    follow_set_points,
    followed_equilibrium,
    following_nothing,
)
from impedance_modules.control.set_points import SetPoints, phase_set_points, place
from impedance_modules.errors import SafetyStop
from impedance_modules.modules.arms import TaskModules, with_phase_gains
from impedance_modules.modules.compensation import compensation_energy
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import (
    EquilibriumMotion,
    PhaseMotion,
    phase_motion,
    start_equilibrium,
)
from impedance_modules.modules.motor_velocity import begin_at
from impedance_modules.modules.own_module import evaluate
from impedance_modules.modules.sum import module_names, potential_energy
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.state import RobotState
from impedance_modules.safety.active_set import CERTIFIED, INSIDE, UNDECIDED
from impedance_modules.safety.brake import apply_brake
from impedance_modules.safety.expected_motion import begin_steady
from impedance_modules.safety.filter_problem import FilterLayout
from impedance_modules.safety.overspeed import forget_travel
from impedance_modules.safety.solvers import FilterSolution, make_solver
from impedance_modules.safety.tank import Tank, fill, measure, missed, release_springs
from impedance_modules.spec.task import PhaseSpec

EXACT_SOLVER = "daqp"
"""The exact solver whose answers the active-set solver may anticipate: both give the optimum to 1e-8 N.m."""


class Controller:
    """One task's law with its memory; everything a tick needs is taken once.

    Attributes:
        assembly: What is run.
        kinematics, distances: Of the last state.
        modules: With the gains of the current phase.
        motion: Of the current phase.
        module_names: Of the rows of ``cycle.modules.efforts``.
        layout: Rows of the filter.
        cycle: Every number of the last cycle, by name.
        following: What follows set-points in the current phase, live; inactive where the phase does not listen.
        solver: Asked where the active-set solver cannot prove an optimum.
    """

    motion: PhaseMotion

    def __init__(self, assembly: Assembly) -> None:
        want_machine_code()
        self.assembly = assembly
        model, modules = assembly.model, assembly.modules
        self.modules: TaskModules = modules
        self.kinematics = Kinematics(model, modules.frames)
        pairs = assembly.robot.collision.pairs
        self.distances = make_distances(assembly, self.kinematics)
        self.layout = FilterLayout(model.joint_names, tuple(f"{first}-{second}" for first, second in pairs))
        self.solver = make_solver(assembly.robot.solver)
        self.module_names = module_names(modules, assembly.own, compensated=assembly.compensation is not None)
        self._compensator = task_compensator(assembly)
        self.cycle = make_cycle(assembly, self.layout, self.kinematics, self.distances, self._compensator)
        self._points: SetPoints
        self.following: Following = following_nothing()
        self._solution: FilterSolution | None = None
        self._booked: RobotState | None = None
        self._before_gap: dict[str, Any] | None = None
        self._in_force: Array = np.zeros(model.n)
        self._position: Array = modules.posture

    @property
    def tank(self) -> Tank:
        """The energy ledger, live."""
        return self.cycle.tank

    @property
    def effort(self) -> Array:
        """(n,) torque that may leave [N.m]; only after ``tick`` or ``brake`` returned 0."""
        return self.cycle.effort

    @property
    def clock(self) -> float:
        """Phase clock [s]; slower than time when the tank is short."""
        return self.cycle.clock

    @property
    def solved(self) -> bool:
        """Whether the last tick found a filtered torque."""
        return self.cycle.found != UNDECIDED if self._solution is None else self._solution.solved

    @property
    def changed(self) -> bool:
        """Whether the filter gave another torque than the modules desired; not where there was no torque to filter."""
        if self._solution is not None:
            return self._solution.solved and self._solution.iterations > 0
        return self.cycle.found == CERTIFIED

    @property
    def active_rows(self) -> int:
        """Number of filter rows that changed the last torque; costs less than asking ``solution``."""
        if self._solution is not None:
            active = self._solution.active
            return 0 if active is None else int(np.count_nonzero(active))
        if self.cycle.found != CERTIFIED:
            return 0
        return int(np.count_nonzero(self.cycle.active.duals[self.layout.n :]))

    @property
    def solution(self) -> FilterSolution | None:
        """Of the last filter problem; None when it was not reached."""
        if self._solution is None and self.cycle.found != UNDECIDED:
            self._solution = self._active_set_solution()
        return self._solution

    def start(self, first: FirstState, phase: PhaseSpec) -> None:
        """Begins a run at its first state, with a full tank and relaxed springs.

        A robot seldom stands exactly where the task begins. What its springs would hold there is not given: r = 0, and
        ``rescale_springs`` tightens them from the tank; at the start posture itself that is the first cycle. Likewise
        hands on which nothing acts yet begin to squeeze and to carry an object gently; hands that hold it go on.

        What is compensated acts at once: its energy at the first state is part of the claim. One scale holds for all
        energies, so it starts where springs and compensation together hold no more than that.

        Raises:
            SafetyStop: The first state is not finite.
        """
        state, cycle, tank = first.state, self.cycle, self.cycle.tank
        if not np.isfinite(np.concatenate([state.position, state.velocity, state.effort])).all():
            raise SafetyStop("the robot's first state is not finite; nothing was sent")
        self.kinematics.update(state.position, state.velocity)
        self.distances.update(state.position, state.velocity)
        if self._compensator is not None:
            self._compensator.forget()
            self._compensator.update(state.position)
        if not self._evaluate_own(state):
            raise SafetyStop(
                "a module of one's own gives no torque at the robot's first state; nothing was sent"
            )
        begin_at(cycle.motor, state.velocity, state.effort)
        begin_steady(cycle.expected, state.velocity, state.effort, first.acting)
        forget_travel(cycle.travel)
        cycle.modules.loads.grip = float(np.any(first.acting))
        cycle.modules.targets.known = False
        self._begin(phase, self.assembly.modules, None)
        fill(tank, state.position, state.effort, self._place(state.position))
        given = 0.0
        if self._compensator is not None:
            given = float(compensation_energy(self._compensator.record, state.position))
        tank.spring_scale = given / tank.potential if given > 0.0 else 0.0
        tank.initial_energy = tank.level + given
        tank.applied[:] = first.acting
        tank.pending[:] = first.acting
        cycle.previous[:] = first.acting
        cycle.effort_scale = 1.0
        self._forget_answer()

    def next_phase(self, phase: PhaseSpec) -> None:
        """Begins another phase at the last state; equilibria and gains go on from where they are."""
        self._begin(phase, self.modules, self.motion)
        # Clock 0 of the new phase is the place where the old one stopped: no energy changes hands here.
        self._place(self._position)

    def tick(self, state: RobotState) -> int:
        """Computes the torque for a state; ``effort`` holds it. Returns 0, or why there is none.

        Returns:
            0, STATE_NOT_FINITE, or EFFORT_NOT_FINITE, also where a module of one's own gives no torque. ``solved``
            tells whether the filter found one.
        """
        cycle = self.cycle
        self._position = state.position
        self._in_force[:] = cycle.tank.pending[-1]
        self._before_gap = None
        self.kinematics.update(state.position, state.velocity)
        self.distances.update(state.position, state.velocity)
        if self._compensator is not None:
            self._compensator.update(state.position)
        self._solution = None
        if not self._evaluate_own(state):
            return EFFORT_NOT_FINITE
        exact = self.solver.name == EXACT_SOLVER
        status = laws.tick(cycle, self._points, state.position, state.velocity, state.effort, exact)
        if status != STATE_NOT_FINITE:
            self._booked = state
        return self._ask_solver() if status == UNSOLVED else int(status)

    def _evaluate_own(self, state: RobotState) -> bool:
        """Asks the modules that somebody wrote in Python; returns whether their torques can be used."""
        own = self.assembly.own
        return not own or evaluate(
            own, self.cycle.modules.own, state.position, state.velocity, self.kinematics
        )

    def _ask_solver(self) -> int:
        """Lets the robot's solver have the problem that the cycle left; returns a status."""
        self._solution = self.solver.solve(self.cycle.problem)
        if self._solution.effort is None:
            return FINE
        self.cycle.effort[:] = self._solution.effort
        return int(laws.limit_effort(self.cycle, False))

    def relax(self) -> None:
        """Begins a stop: lets go of all springs, what they hold goes back to the tank, and applies the brake."""
        release_springs(self.cycle.tank)
        apply_brake(self.cycle.brake, self.cycle.tank.motor_position)

    def brake(self, state: RobotState | None) -> int:
        """Books a stop's interval, unless that is done, and a braking torque; springs are relaxed by then.

        Args:
            state: Of this cycle; None where ``miss`` has booked a cycle without one.

        Returns:
            0; the torque that may leave is ``effort``.
        """
        self._forget_answer()
        if state is not None and state is not self._booked:
            measure(self.cycle.tank, state.position, state.effort, 0.0)
            self._booked = state
        return int(laws.brake(self.cycle))

    def miss(self) -> None:
        """Books a cycle without a usable state."""
        self._forget_answer()
        self.distances.skip()
        if self._before_gap is None:
            self._before_gap = self.cycle.tank.snapshot()
        missed(self.cycle.tank)

    def reckon(self, intervals: int, *, anew: bool) -> None:
        """Books a gap as long as the state that ends it says it was; call it before the ``tick`` for that state.

        Args:
            intervals: Periods since the last state, or since the last cycle that was booked.
            anew: Since the last state: what ``miss`` has booked since was provisional (docs/passivity.md).
        """
        if anew and self._before_gap is not None:
            self.cycle.tank.restore(self._before_gap)
        for _ in range(intervals - 1):
            missed(self.cycle.tank)

    def repeat(self) -> None:
        """Puts the command before the last one back in force; ``effort`` is that."""
        self.cycle.tank.pending[-1] = self._in_force
        self.cycle.previous[:] = self._in_force
        self.cycle.effort[:] = self._in_force

    def withdraw(self) -> None:
        """Takes back the last torque, which was ready too late and never left: the one before goes on acting."""
        tank = self.cycle.tank
        tank.pending[-1] = tank.pending[-2] if len(tank.pending) > 1 else tank.applied
        self.cycle.previous[:] = tank.pending[-1]

    def warm(self) -> None:
        """Compiles and runs every path once, at the start posture, without any effect on the run."""
        first, phases = state_at_rest(self.assembly), self.assembly.task.phases
        twin = Controller(self.assembly)
        twin.start(first, phases[0])
        for _ in range(3):
            twin.tick(first.state)
        twin.next_phase(phases[-1])
        twin.tick(first.state)
        twin.miss()
        twin.tick(first.state)
        twin.relax()
        twin.brake(first.state)

    def _begin(self, phase: PhaseSpec, modules: TaskModules, last: PhaseMotion | None) -> None:
        start = start_equilibrium(modules) if last is None else last.at(self.clock)
        if last is not None and self.following.active:
            start = followed_equilibrium(start, self.following, self.cycle.modules)
        self.modules = with_phase_gains(modules, phase)
        self.motion = phase_motion(self.modules, phase, start)
        damping = phase_damping(self.modules, self.kinematics)
        self._points = phase_set_points(
            self.modules,
            damping,
            self.motion,
            self.cycle.modules,
            first=last is None,
            blend=phase.blend,
            follow=self._follow(phase),
        )
        self.following = self._points.following
        self.cycle.clock = 0.0

    def _follow(self, phase: PhaseSpec) -> Callable[[EquilibriumMotion], Following] | None:
        """What makes the targets of a phase that listens; None for one that does not."""
        limits, period = self.assembly.task.set_points, self.assembly.period
        if limits is None or not phase.listen:
            return None
        modules, motion = self.modules, self.motion
        return lambda laid_out: follow_set_points(limits, modules, motion, laid_out, period)

    def _place(self, q: Array) -> float:
        """Puts the phase's gains and equilibria in force at its clock; returns their energy at q [J]."""
        cycle = self.cycle
        place(self._points, cycle.modules, cycle.clock)
        return float(potential_energy(cycle.modules, cycle.arms, q))

    def _forget_answer(self) -> None:
        """Drops the filter's last answer, in a cycle that asks it nothing."""
        self._solution = None
        self.cycle.found, self.cycle.tried = UNDECIDED, 0

    def _active_set_solution(self) -> FilterSolution:
        """Puts what the active-set solver found into the words that every solver uses."""
        duals, n = self.cycle.active.duals.copy(), self.layout.n
        inside = self.cycle.found == INSIDE
        return FilterSolution(
            effort=self.cycle.active.effort.copy(),
            row_duals=duals[n:],
            box_duals=duals[:n],
            active=duals[n:] != 0.0,
            iterations=self.cycle.tried,
            solved=True,
            status="inside all limits" if inside else "optimal, certified",
        )


class WarmUp:
    """Goes through a cycle for nothing, so that the processor has code and data at hand when the real one is due.

    At 100 Hz, a processor has forgotten everything within the 10 ms between two states: the first cycle after such a
    pause takes twice as long as one right after another (docs/baxter.md, "Latency"). A twin of the controller stands
    at the task's start for ever; nothing of it reaches a robot.
    """

    def __init__(self, assembly: Assembly) -> None:
        self._first = state_at_rest(assembly)
        self._twin = Controller(assembly)
        self._twin.start(self._first, assembly.task.phases[0])
        self._before = self._twin.cycle.snapshot()

    def __call__(self) -> None:
        """Computes the torque of the first cycle once more, on the memory as it was then."""
        self._twin.cycle.restore(self._before)
        self._twin.tick(self._first.state)
