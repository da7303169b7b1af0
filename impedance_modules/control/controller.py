# SPDX-License-Identifier: BSD-3-Clause
r"""The control law in the loop: from one state to one torque that limits and tank have agreed to.

    \tau = filter( \sum_modules J^T w - K_j (q - q_0) - D \dot\theta )        (design 4)

Dampers act on the motor-side velocity \dot\theta, the port at which energy is counted: fed with the link's velocity
they would make Baxter's elastic joints unstable from 50 N/m on (docs/control-law.md). The cycle's
arithmetic is compiled; this class owns the memory and the order.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.backend import FirstState
from impedance_modules.compiled import use_machine_code
from impedance_modules.control import compiled_cycle
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.compiled_place import place_start
from impedance_modules.control.constants import filter_workspace, module_names, write_constants
from impedance_modules.control.gains import cycle_sizes, write_phase
from impedance_modules.control.memory import (
    AVAILABLE,
    EFFORT_NOT_FINITE,
    FINE,
    FOUND,
    GRIP,
    PAID,
    STATE_NOT_FINITE,
    STATUS,
    UNSOLVED,
    CycleMemory,
)
from impedance_modules.control.readings import CycleReadings
from impedance_modules.errors import SafetyStop
from impedance_modules.modules.arms import TaskModules, with_phase_gains
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import PhaseMotion, phase_motion, start_equilibrium
from impedance_modules.robot.distances import Distances
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.state import RobotState
from impedance_modules.safety import compiled_ledger
from impedance_modules.safety.clear_tank import Tank, filled_tank
from impedance_modules.safety.compiled_lane import UNDECIDED
from impedance_modules.safety.compiled_ledger import LEVEL, POTENTIAL, SCALE
from impedance_modules.safety.problem import FilterLayout
from impedance_modules.safety.solvers.solution import make_solver
from impedance_modules.spec.task import PhaseSpec

Array = NDArray[np.float64]

__all__ = ["EFFORT_NOT_FINITE", "STATE_NOT_FINITE", "Controller"]

FAST_LANE_FOR = "daqp"
"""The exact solver whose answers the fast lane may anticipate: both give the optimum to 1e-8 N.m."""


class Controller(CycleReadings):
    """One task's law with its memory; everything a tick needs is taken once.

    Attributes:
        assembly: What is run.
        kinematics: Of the last state.
        modules: With the gains of the current phase.
        motion: Of the current phase.
        module_names: Of the rows of ``memory["efforts"]``.
        workspace: The last filter problem.
        solver: Asked where the compiled cycle cannot prove an optimum by itself.
    """

    def __init__(self, assembly: Assembly) -> None:
        use_machine_code()
        self.assembly = assembly
        model, modules = assembly.model, assembly.modules
        self.modules: TaskModules = modules
        self.kinematics = Kinematics(model, modules.frames)
        pairs = assembly.robot.collision.pairs
        limits = assembly.limits
        self.distances = Distances(
            self.kinematics,
            pairs,
            margin=limits.margin,
            approach_time=limits.approach_time,
            horizon=limits.horizon,
            period=assembly.period,
        )
        layout = FilterLayout(model.joint_names, tuple(f"{first}-{second}" for first, second in pairs))
        self.solver = make_solver(assembly.robot.solver)
        size = cycle_sizes(modules, model.n, len(pairs), assembly.tank.delay)
        super().__init__(CycleMemory(size))
        self.workspace = filter_workspace(layout, self.memory, limits.effort_max)
        self.module_names = module_names(modules)
        self._booked: RobotState | None = None
        self._before_gap: tuple[Array, Array] | None = None
        self._in_force: Array = np.zeros(model.n)
        write_constants(self.memory, assembly, self.kinematics, layout)
        self._blocks = self.memory.floats, self.memory.float_at, self.memory.integers, self.memory.integer_at
        self.motion: PhaseMotion

    @property
    def tank(self) -> Tank:
        """Copies the ledger's record."""
        return compiled_ledger.record(self._book)

    def start(self, first: FirstState, phase: PhaseSpec) -> None:
        """Begins a run at its first state, with a full tank and relaxed springs.

        A robot seldom stands exactly where the task begins. What its springs would hold there is not given: r = 0, and
        ``settle`` tightens them from the tank; at the start posture itself that is the first cycle. Likewise hands on
        which nothing acts yet begin to squeeze and to carry an object gently; hands that hold it go on.

        Raises:
            SafetyStop: The first state is not finite.
        """
        state = first.state
        if not np.isfinite(np.concatenate([state.position, state.velocity, state.effort])).all():
            raise SafetyStop("the robot's first state is not finite; nothing was sent")
        memory = self.memory
        self.kinematics.update(state.position, state.velocity)
        self.distances.update(state.position, state.velocity)
        memory["wind"][:] = state.effort * self.assembly.tank.compliance
        memory["motor_velocity"][:] = state.velocity
        memory["clock"][GRIP] = float(np.any(first.acting))
        self._begin(phase, self.assembly.modules, None)
        potential = self._place(state.position)
        tank = filled_tank(self.assembly.tank, state.position, state.effort, potential)
        in_flight = np.tile(first.acting, (self.assembly.tank.delay + 1, 1))
        relaxed = replace(tank, spring_scale=0.0, initial_energy=tank.level)
        self._fill_tank(replace(relaxed, applied=first.acting, pending=in_flight))
        memory["previous"][:] = first.acting

    def next_phase(self, phase: PhaseSpec) -> None:
        """Begins another phase at the last state; equilibria and gains go on from where they are."""
        self._begin(phase, self.modules, self.motion)
        # Clock 0 of the new phase is the place where the old one stopped: no energy changes hands here.
        self._place(self._position)

    def tick(self, state: RobotState) -> int:
        """Computes the torque for a state; ``effort`` holds it. Returns 0, or why there is none.

        Returns:
            0, STATE_NOT_FINITE, or EFFORT_NOT_FINITE. ``solved`` tells whether the filter found one.
        """
        kinematics, distances = self.kinematics, self.distances
        self._position = state.position
        self._in_force[:] = self.memory["pending"][-1]
        self._before_gap = None
        kinematics.update(state.position, state.velocity)
        distances.update(state.position, state.velocity)
        self._solution = None
        status = compiled_cycle.tick(
            *self._blocks,
            state.position,
            state.velocity,
            state.effort,
            kinematics.rotation,
            kinematics.translation,
            kinematics.jacobian,
            kinematics.bias,
            kinematics.inverse_inertia,
            distances.distance,
            distances.gradient,
            self.solver.name == FAST_LANE_FOR,
        )
        if status != STATE_NOT_FINITE:
            self._booked = state
        return self._ask_solver() if status == UNSOLVED else int(status)

    def _ask_solver(self) -> int:
        """Lets the robot's solver have the problem that the compiled cycle left; returns a status."""
        self._solution = self.solver.solve(self.workspace.problem)
        if self._solution.effort is None:
            return FINE
        np.copyto(self._effort, self._solution.effort)
        return self.pay(stopping=False)

    def pay(self, *, stopping: bool) -> int:
        """Scales ``effort`` to what the tank can answer for; returns 0 or EFFORT_NOT_FINITE."""
        memory = self.memory
        return int(compiled_cycle.after(memory.floats, memory.float_at, self._effort.size, stopping))

    def relax(self) -> None:
        """Lets go of all springs, for a stop: what they hold goes back to the tank."""
        scalars = self.memory["book_scalars"]
        scalars[LEVEL] += scalars[SCALE] * scalars[POTENTIAL]
        scalars[SCALE], scalars[POTENTIAL] = 0.0, 0.0

    def brake(self, state: RobotState | None, effort: Array) -> int:
        """Books a stop's interval, unless that is done, and pays a braking torque; springs are relaxed by then.

        Args:
            state: Of this cycle; None where ``miss`` has booked a cycle without one.
            effort: (n,) braking torque [N.m].

        Returns:
            0; the torque that may leave is ``effort``.
        """
        self._forget_answer()
        if state is not None and state is not self._booked:
            compiled_ledger.measure(*self._book, state.position, state.effort, 0.0)
            self._booked = state
        np.copyto(self._effort, effort)
        return self.pay(stopping=True)

    def miss(self) -> None:
        """Books a cycle without a usable state."""
        self._forget_answer()
        self.distances.skip()
        if self._before_gap is None:
            self._before_gap = self.memory["book_scalars"].copy(), self.memory["pending"].copy()
        compiled_cycle.missed(self.memory.floats, self.memory.float_at, self._effort.size)

    def reckon(self, intervals: int, *, anew: bool) -> None:
        """Books a gap as long as the state that ends it says it was; call it before the ``tick`` for that state.

        Args:
            intervals: Periods since the last state, or since the last cycle that was booked.
            anew: Since the last state: what ``miss`` has booked since was provisional (docs/passivity.md).
        """
        memory = self.memory
        if anew and self._before_gap is not None:
            memory["book_scalars"][:], memory["pending"][:] = self._before_gap
        for _ in range(intervals - 1):
            compiled_cycle.missed(memory.floats, memory.float_at, self._effort.size)

    def repeat(self) -> None:
        """Puts the command before the last one back in force; ``effort`` is that."""
        for name in ("pending", "previous", "effort"):
            block = self.memory[name]
            block[-1 if name == "pending" else slice(None)] = self._in_force

    def withdraw(self) -> None:
        """Takes back the last torque, which was ready too late and never left: the one before goes on acting."""
        pending = self.memory["pending"]
        pending[-1] = pending[-2] if len(pending) > 1 else self.memory["applied"]
        self.memory["previous"][:] = pending[-1]

    def warm(self) -> None:
        """Compiles and runs every path once, at the start posture, without any effect on the run."""
        n = self.assembly.model.n
        parts = self.assembly.modules.posture.copy(), np.zeros(n), np.zeros(n)
        # As a robot's states are: machine code for arrays that may be written is other machine code.
        for part in parts:
            part.flags.writeable = False
        state = RobotState(0.0, *parts)
        twin = Controller(self.assembly)
        twin.start(FirstState(state, np.zeros(n)), self.assembly.task.phases[0])
        for _ in range(3):
            twin.tick(state)
        twin.next_phase(self.assembly.task.phases[-1])
        twin.tick(state)
        twin.miss()
        twin.tick(state)
        twin.relax()
        twin.brake(state, np.zeros(n))

    def _begin(self, phase: PhaseSpec, modules: TaskModules, last: PhaseMotion | None) -> None:
        start = start_equilibrium(modules) if last is None else last.at(self.clock)
        self.modules = with_phase_gains(modules, phase)
        self.motion = phase_motion(self.modules, phase, start)
        damping = phase_damping(self.modules, self.kinematics)
        write_phase(self.memory, self.modules, damping, self.motion, blend=last is not None)

    def _place(self, q: Array) -> float:
        kinematics = self.kinematics
        return float(place_start(*self._blocks, q, kinematics.rotation, kinematics.translation))

    def _fill_tank(self, tank: Tank) -> None:
        """Opens the ledger in the cycle's memory."""
        memory = self.memory
        book = compiled_ledger.open_book(tank, self.assembly.tank)
        names = (
            "book_scalars",
            "book_constants",
            "speed_bound",
            "compliance",
            "sensing_error",
            "sensing_deviation",
            "motor_position",
            "applied",
            "pending",
        )
        for name, value in zip(names, book, strict=True):
            memory[name][:] = value
        self._book = compiled_ledger.Book(*(memory[name] for name in names))
        memory["result"][:] = 0.0
        memory["result"][[STATUS, AVAILABLE, PAID, FOUND]] = 0.0, tank.level, 1.0, UNDECIDED
