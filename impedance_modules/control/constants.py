# SPDX-License-Identifier: BSD-3-Clause
"""Writes into the cycle's memory what no cycle changes, and lays the filter's problem there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.control.assembly import Assembly
from impedance_modules.control.gains import write_fixed
from impedance_modules.control.memory import CycleMemory
from impedance_modules.modules.arms import TaskModules
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.safety.metric import HEAVIEST_HAND, POSTURE_WEIGHT, relative_penalty
from impedance_modules.safety.problem import FilterLayout, FilterProblem, FilterWorkspace, RowKind

Array = NDArray[np.float64]


def write_constants(
    memory: CycleMemory, assembly: Assembly, kinematics: Kinematics, layout: FilterLayout
) -> None:
    """Writes limits, weights and the structure of the arms."""
    limits = assembly.limits
    write_fixed(memory, assembly.modules, assembly.period, assembly.robot.sensors.velocity_filter)
    memory["joint_limits"][:] = (
        limits.effort_max,
        limits.effort_rate_max,
        limits.position_min,
        limits.position_max,
        limits.velocity_max,
        limits.deceleration,
        limits.return_speed,
    )
    memory["scalar_limits"][:] = (
        limits.power_horizon,
        limits.horizon,
        limits.period,
        limits.margin,
        limits.approach_time,
        limits.separation_speed,
        limits.separation_acceleration,
    )
    soft = (RowKind.RATE, RowKind.DISTANCE, RowKind.POSITION, RowKind.VELOCITY)
    memory["kappa"][:] = [relative_penalty(kind) for kind in soft]
    memory["kappa_of_row"][:] = [1.0 if kind.hard else relative_penalty(kind) for kind in layout.kinds]
    mass, inertia = HEAVIEST_HAND
    memory["metric_constants"][:] = POSTURE_WEIGHT, 1.0 / mass, 1.0 / inertia
    _write_structure(memory, kinematics, layout)


def _write_structure(memory: CycleMemory, kinematics: Kinematics, layout: FilterLayout) -> None:
    """Writes which entries can be other than zero: arms do not feel each other's inertia."""
    memory.index("moved_by")[:], memory.index("coupled")[:] = kinematics.moved_by, kinematics.coupled
    reach = memory.index("reach")
    reach[0], reach[1] = 0, layout.n
    reach[:, layout.rate] = np.arange(layout.n), np.arange(1, layout.n + 1)
    reach[:, layout.position] = reach[:, layout.velocity] = kinematics.coupled


def filter_workspace(layout: FilterLayout, memory: CycleMemory, effort_max: Array) -> FilterWorkspace:
    """Makes a filter problem whose arrays lie in the cycle's memory."""
    workspace = FilterWorkspace(layout)
    names = ("desired", "metric", "matrix", "lower", "upper", "penalty")
    blank = workspace.problem
    for name in names:
        memory[name][:] = getattr(blank, name)
    arrays = {name: memory[name] for name in names}
    workspace.problem = FilterProblem(layout=layout, effort_max=effort_max.copy(), **arrays)
    return workspace


def module_names(modules: TaskModules) -> tuple[str, ...]:
    """Names the rows of ``memory["efforts"]``: every spring, every limb's joint bias, squeeze, weight."""
    springs = [spring.name for arm in modules.arms for spring in arm.springs]
    biases = [f"{arm.limb.name}.joint_bias" for arm in modules.arms]
    return (*springs, *biases, "squeeze", "weight")
