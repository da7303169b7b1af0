# SPDX-License-Identifier: BSD-3-Clause
"""How differently the same hands react with an object free in them, and on its hinge (thesis 1.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly, assemble
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.modules.hinge import Hinge
from impedance_modules.prediction.loop_stability import STIFFEST, StabilityForecast, forecast_stability
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.statics import Analysed, analyse_state


@dataclass(frozen=True)
class Reaction:
    """What a push on the object meets at the start posture.

    Attributes:
        inertia: About the axis [kg.m^2].
        stiffness: About the axis [N.m/rad].
        motions: How many independent motions the object has.
        loop: Of the arms that hold it.
    """

    inertia: float
    stiffness: float
    motions: int
    loop: StabilityForecast

    @property
    def margin(self) -> float:
        """Times the endpoint stiffness up to which the loop is stable; ``STIFFEST`` stands for more."""
        return STIFFEST if self.loop.scale is None else self.loop.scale


def reactions(task: str) -> tuple[Reaction, Reaction]:
    """Gives the reaction of a task's object free in the same hands, and on its hinge."""
    assembly = assemble(task, effects=None, rate=None, scale=1.0, arm=None)
    held = assembly.modules.held
    if held is None or held.hinge is None:
        raise ValueError(f"task '{task}' has no hinge")
    loose = replace(assembly, modules=replace(assembly.modules, held=replace(held, hinge=None)))
    return _reaction(loose, held.hinge), _reaction(assembly, held.hinge)


def _reaction(assembly: Assembly, hinge: Hinge) -> Reaction:
    state = _state(assembly)
    if state.held is None or assembly.modules.held is None:
        raise ValueError(f"task '{assembly.task.name}' holds no object")
    sums, S = state.held.impedance, hinge.motion(state.held.pose.translation)
    if sums.inertia.inertia is None or sums.stiffness is None:
        raise ValueError(f"task '{assembly.task.name}' begins at a singular posture")
    free = assembly.modules.held.hinge is None
    (loop,) = forecast_stability(assembly, assembly.modules, state.arms, state.held)
    return Reaction(
        inertia=_felt(sums.inertia.inertia, S, free=free),
        stiffness=_felt(sums.stiffness, S, free=free),
        motions=6 if free else 1,
        loop=loop,
    )


def _felt(matrix: Array, S: Array, *, free: bool) -> float:
    """Gives what a pure torque about the axis meets: on the hinge S^T A S; free 1 / (a^T (A^-1)_ww a)."""
    if not free:
        return float(S @ matrix @ S)
    axis = np.concatenate([np.zeros(3), S[3:]])
    return 1.0 / float(axis @ np.linalg.solve(matrix, axis))


def _state(assembly: Assembly) -> Analysed:
    mechanism, modules = Mechanism(assembly), assembly.modules
    mechanism.update(modules.posture, np.zeros_like(modules.posture))
    setting = Setting(modules, start_equilibrium(modules), phase_damping(modules, mechanism.kinematics))
    return analyse_state(mechanism, setting, modules.posture)
