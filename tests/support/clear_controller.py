# SPDX-License-Identifier: BSD-3-Clause
"""The whole control law once more, from the clear modules alone: what the compiled cycle must equal."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from impedance_modules.modules.total import Terms, desired_effort

from impedance_modules.backends.backend import FirstState
from impedance_modules.control.assembly import Assembly
from impedance_modules.control.gains import BLENDING
from impedance_modules.modules.arms import TaskModules, with_phase_gains
from impedance_modules.modules.damping import Damping, phase_damping
from impedance_modules.modules.equilibrium import Equilibrium, phase_motion, start_equilibrium
from impedance_modules.modules.motor_velocity import MotorVelocity
from impedance_modules.modules.pose_motion import minimum_jerk
from impedance_modules.robot.distances import Distances
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.state import RobotState
from impedance_modules.safety import ledger
from impedance_modules.safety.build import FilterState, build
from impedance_modules.safety.clear_tank import Tank, filled_tank
from impedance_modules.safety.problem import FilterLayout, FilterWorkspace
from impedance_modules.safety.solvers import make_solver
from impedance_modules.spec.task import PhaseSpec


@dataclass(frozen=True)
class Gains:
    """One phase's gains and how much of them is in force."""

    modules: TaskModules
    damping: Damping
    elastic: float
    pushing: float


class ClearController:
    """Measure, grant, settle, sum, filter, pay: docs/passivity.md line by line."""

    def __init__(self, assembly: Assembly) -> None:
        self.assembly = assembly
        model, limits = assembly.model, assembly.limits
        self.kinematics = Kinematics(model, assembly.modules.frames)
        pairs = assembly.robot.collision.pairs
        self.distances = Distances(
            self.kinematics,
            pairs,
            margin=limits.margin,
            approach_time=limits.approach_time,
            horizon=limits.horizon,
            period=assembly.period,
        )
        names = tuple(f"{first}-{second}" for first, second in pairs)
        self.workspace = FilterWorkspace(FilterLayout(model.joint_names, names))
        self.solver = make_solver("daqp")
        lag = assembly.robot.sensors.velocity_filter
        self.rotors = MotorVelocity(assembly.tank.compliance, assembly.period, lag)
        self.clock, self.granted = 0.0, 1.0
        self.first: tuple[Gains, ...] = ()
        self.tank: Tank
        self.terms: Terms

    def start(self, first: FirstState, phase: PhaseSpec) -> None:
        state = first.state
        self.kinematics.update(state.position, state.velocity)
        self.distances.update(state.position, state.velocity)
        self.rotors.update(state.velocity, state.effort)
        self._begin(phase, self.assembly.modules, start_equilibrium(self.assembly.modules))
        s = self.assembly.tank
        tank = filled_tank(s, state.position, state.effort, self._potential(state.position, 0.0))
        in_flight = np.tile(first.acting, (s.delay + 1, 1))
        relaxed = replace(tank, spring_scale=0.0, initial_energy=tank.level)
        self.tank = replace(relaxed, applied=first.acting, pending=in_flight)
        self.previous = first.acting

    def next_phase(self, phase: PhaseSpec) -> None:
        self.first = self._gains(self.clock)
        self._begin(phase, self.modules, self.motion.at(self.clock))

    def _begin(self, phase: PhaseSpec, modules: TaskModules, start: Equilibrium) -> None:
        self.modules = with_phase_gains(modules, phase)
        self.motion = phase_motion(self.modules, phase, start)
        self.damping = phase_damping(self.modules, self.kinematics)
        self.blending = min(BLENDING, phase.duration) if self.first else BLENDING
        self.clock = 0.0

    def _gains(self, clock: float) -> tuple[Gains, ...]:
        """A phase's gains come in by minimum jerk over those of before; in the first phase only its forces do."""
        part = minimum_jerk(clock / self.blending)
        begun = not self.first
        mine = Gains(self.modules, self.damping, 1.0 if begun else part, part)
        before = (
            Gains(gains.modules, gains.damping, (1.0 - part) * gains.elastic, (1.0 - part) * gains.pushing)
            for gains in self.first
        )
        return (mine, *before)

    def _sum(self, q: np.ndarray, v: np.ndarray, clock: float, scale: float) -> tuple[np.ndarray, float]:
        """Torque with springs relaxed to ``scale``, and the unscaled potential."""
        effort, potential = np.zeros_like(q), 0.0
        held = 1.0
        for gains in self._gains(clock):
            terms = desired_effort(gains.modules, self.kinematics, self.motion.at(clock), q, v, gains.damping)
            for part in terms.parts:
                if part.kind == "spring":
                    # A joint bias's stiffness is the same in all phases, and so are all weights' sums.
                    effort = effort + gains.elastic * scale * part.effort
                    potential += gains.elastic * part.energy
                elif part.kind == "damping":
                    effort = effort + gains.elastic * part.effort
                elif part.kind == "force":
                    effort = effort + gains.pushing * part.effort
                else:
                    effort = effort + held * part.effort
            held = 0.0
        return effort, potential

    def _potential(self, q: np.ndarray, clock: float) -> float:
        return self._sum(q, np.zeros_like(q), clock, 1.0)[1]

    def miss(self) -> None:
        self.distances.skip()
        self.tank = ledger.missed(self.tank, self.assembly.tank)

    def tick(self, state: RobotState) -> np.ndarray:
        s, q, v = self.assembly.tank, state.position, state.velocity
        self.kinematics.update(q, v)
        self.distances.update(q, v)
        self.tank = ledger.measure(self.tank, s, q, state.effort, self._potential(q, self.clock))
        before, self.position = self.clock, q
        self.tank, self.granted = ledger.grant(
            self.tank, s, lambda part: self._potential(q, before + part * s.period)
        )
        self.clock = before + self.granted * s.period
        self.tank = ledger.settle(self.tank, s)
        motors = self.rotors.update(v, state.effort)
        self.desired, _ = self._sum(q, motors, self.clock, self.tank.spring_scale)
        self.filtered = self._filter(q, v, motors)
        self.tank, effort = ledger.pay(self.tank, s, self.filtered, stopping=False)
        self.previous = effort
        return effort

    def _filter(self, q: np.ndarray, v: np.ndarray, motors: np.ndarray) -> np.ndarray:
        kinematics, distances = self.kinematics, self.distances
        hands = [arm.limb.hand for arm in self.assembly.modules.arms]
        state = FilterState(
            position=q,
            velocity=v,
            motor_velocity=motors,
            inverse_inertia=kinematics.inverse_inertia,
            bias=kinematics.bias,
            jacobians=[kinematics.jacobian_of(hand) for hand in hands],
            previous=self.previous,
            available=max(0.0, self.tank.level - self.assembly.tank.floor),
            distances=distances.distance,
            distance_jacobians=distances.gradient,
            distance_drift=np.zeros(len(distances.distance)),
        )
        solution = self.solver.solve(build(self.workspace, self.assembly.limits, state, self.desired))
        assert solution.effort is not None, solution.status
        return solution.effort
