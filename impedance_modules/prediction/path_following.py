# SPDX-License-Identifier: BSD-3-Clause
r"""Can an arm follow the path that a target takes from a recording? Where it begins, and how fast it goes.

From the posture in which its phase begins the arm follows the target's equilibrium, of twist V, in the directions in
which the spring is stiff, with the least joint speeds in parts of their limits:

    y = (P J diag(v_max))^+ P V,       |y_j| <= 1

P takes the stiff directions. If a joint must be faster than its limit the path is refused, with the speed at which it
would not be.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import Problem
from impedance_modules.modules.recorded_path import PathMotion
from impedance_modules.modules.spring import Spring, displacement_of
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import MotionPrediction, PredictedPhase
from impedance_modules.spec.path_spec import PATH
from impedance_modules.spec.task import PhaseSpec

NEAR, NEARLY_TURNED = 0.02, 0.2
"""A path without a stated approach begins at most this far from the target [m], [rad]."""

APPROACH_INSTANTS, INSTANTS, ITERATIONS = 12, 80, 3
"""At which the way onto a path, and the path, are looked at; and Newton steps to the posture there."""

MARGIN = 0.95
"""Part of the fastest possible speed that is named as valid."""

STIFF, UNREACHED = 1e-6, 1e-2
"""Parts of the largest stiffness, and of the largest singular value, below which a direction does not count."""


def path_problems_of(assembly: Assembly, motion: MotionPrediction) -> Iterator[Problem]:
    """Refuses paths that begin too far from their target, and paths that are too fast, at the line of each."""
    for index, (spec, phase) in enumerate(zip(assembly.task.phases, motion.phases, strict=True)):
        for target, path in spec.paths.items():
            at = ("phases", index, "equilibrium", target, PATH)
            moved = phase.motion.moved[target]
            if path.approach is None and moved.path is not None:
                away = displacement_of(moved.path.pose(0.0), moved.reference @ moved.start)
                far, turned = float(np.linalg.norm(away[:3])), float(np.linalg.norm(away[3:]))
                if far > NEAR or turned > NEARLY_TURNED:
                    yield assembly.task.document.problem(
                        (*at, "approach"),
                        f"phase '{spec.name}': the path begins {1e3 * far:.0f} mm and {turned:.2f} rad from where"
                        f" '{target}' is then",
                        ("approach: the time of the way there in s", f"up to {1e3 * NEAR:g} mm without one"),
                    )
                    continue
            if (fault := _too_fast(assembly, spec, phase, target, motion)) is not None:
                key, message, valid = fault
                yield assembly.task.document.problem((*at, key), message, valid)


def _too_fast(
    assembly: Assembly, spec: PhaseSpec, phase: PredictedPhase, target: str, motion: MotionPrediction
) -> tuple[str, str, tuple[str, ...]] | None:
    """Finds the moment at which a joint would have to be fastest; key, message and what is valid if too fast."""
    path = phase.motion.moved[target].path
    if path is None:
        return None
    worst, joint, clock, in_ramps_too = 1.0, -1, 0.0, 1.0
    for instant, shares in _joint_shares_along(assembly, phase, target, path, motion):
        if shares.max() > worst:
            worst, clock, joint = float(shares.max()), instant, int(np.argmax(shares))
        if (rate := path.rate(instant)) > 0.0:
            # At another speed the ramps are elsewhere, so any part of the path may be taken at full speed.
            in_ramps_too = max(in_ramps_too, float(shares.max()) * path.speed / rate)
    if joint < 0:
        return None
    limit = assembly.model.column("velocity_max")[joint]
    told = (
        f"phase '{spec.name}': {clock:.2f} s into it the hand would need {worst * limit:.2f} rad/s of"
        f" {assembly.model.joint_names[joint]}, whose limit is {limit:g} rad/s"
    )
    if clock <= path.approach:
        valid = f"approach: {worst * path.approach / MARGIN + 0.005:.2f} or more"
        return "approach", f"{told}, on the way onto the path", (valid,)
    return "speed", told, (f"speed: {math.floor(1e2 * MARGIN * path.speed / in_ramps_too) / 1e2:g} or less",)


def _joint_shares_along(
    assembly: Assembly, phase: PredictedPhase, target: str, path: PathMotion, motion: MotionPrediction
) -> Iterator[tuple[float, Array]]:
    """Gives clocks of the phase [s] and the speeds of all joints (n,) over their limits, arms following the path."""
    mechanism = Mechanism(assembly)
    limits, q = assembly.model.column("velocity_max"), motion.samples[phase.samples][0].q.copy()
    instants = (
        np.linspace(0.0, path.approach, APPROACH_INSTANTS),
        np.linspace(path.approach, path.end, INSTANTS),
    )
    for instant in np.concatenate(instants):
        equilibria, twists = phase.motion.at(float(instant)).springs, phase.motion.velocities(float(instant))
        for spring in _led(phase, target):
            for _ in range(ITERATIONS):
                mechanism.update(q, np.zeros_like(q))
                away = displacement_of(equilibria[spring.name], mechanism.kinematics.pose(spring.frame))
                q += limits * _least_shares(mechanism, spring, away)
            mechanism.update(q, np.zeros_like(q))
            yield float(instant), np.abs(_least_shares(mechanism, spring, twists[spring.name]))


def _led(phase: PredictedPhase, target: str) -> Iterator[Spring]:
    """Lists the springs whose equilibria go along with a target."""
    for arm in phase.modules.arms:
        for spring in arm.springs:
            carried = target == phase.motion.mover and spring.name in phase.motion.carried
            if spring.name == target or carried:
                yield spring


def _least_shares(mechanism: Mechanism, spring: Spring, twist: Array) -> Array:
    """Gives y (n,), with which a spring's frame follows a twist (6,) or a small displacement."""
    found, limits = np.zeros(mechanism.model.n), mechanism.model.column("velocity_max")[mechanism.joints]
    directions = _stiff_directions(spring)
    rows = directions @ mechanism.jacobian(spring.frame) * limits
    if len(rows):
        found[mechanism.joints], *_ = np.linalg.lstsq(rows, directions @ twist, rcond=UNREACHED)
    return found


def _stiff_directions(spring: Spring) -> Array:
    """Gives the directions (m, 6) in which a spring is stiff, in places and in turns."""
    found = np.zeros((0, 6))
    for first in (0, 3):
        part = slice(first, first + 3)
        sizes, directions = np.linalg.eigh(spring.world_stiffness[part, part])
        rows = np.zeros((int(np.count_nonzero(sizes > STIFF * max(sizes[-1], 1e-12))), 6))
        rows[:, part] = directions[:, len(sizes) - len(rows) :].T
        found = np.concatenate([found, rows])
    return found
