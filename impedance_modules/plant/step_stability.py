# SPDX-License-Identifier: BSD-3-Clause
r"""Refuses a step that the plant's own stiff parts would make unstable.

The rate is linearised at the start by finite differences; the Runge-Kutta method multiplies each mode
\lambda by R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24, z = h \lambda, which must not outgrow exp(Re z).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from impedance_modules.errors import BadInput
from impedance_modules.plant.equations_of_motion import evaluate_rate
from impedance_modules.plant.integrator import Integrator
from impedance_modules.plant.joints import ELASTIC
from impedance_modules.plant.plant_state import WORK_SIZE, PlantState, state_vector
from impedance_modules.records import Vector

Complex = NDArray[np.complex128]

DIFFERENCE = 1e-7
"""Of the finite differences, in the state's units."""

TOUCHING_POINTS = 4
"""How many points of the object are taken to lie on one surface at once."""


def check_step(integrator: Integrator) -> None:
    """Checks the integration step against all modes of the plant at its start.

    Raises:
        BadInput: The step is too long for the lightest part on the stiffest spring.
    """
    modes = np.concatenate([plant_modes(integrator), contact_modes(integrator)])
    if stable(modes, integrator.step):
        return
    step = integrator.step
    while not stable(modes, step):
        step *= 0.8
    fastest = float(np.abs(modes).max())
    raise BadInput(
        f"an integration step of {integrator.step:.3g} s is too long for a mode at {fastest:.4g} rad/s"
        f" of the joints, the held object or a surface (valid: at most {step:.3g} s)"
    )


def stable(modes: Complex, step: float) -> bool:
    """Says whether the Runge-Kutta method damps what the plant damps, for every mode [1/s]."""
    z = step * modes
    gain = np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0))))
    return bool(np.all(gain <= np.exp(np.maximum(z.real, 0.0)) * (1.0 + 1e-6)))


def plant_modes(integrator: Integrator) -> Complex:
    """Computes the eigenvalues [1/s] of the plant linearised where it stands."""
    plant, stage = integrator.plant, integrator.plant.stage.whole
    integrator.refresh()
    size = stage.size - WORK_SIZE
    used = _free_coordinates(plant, size)
    at_rest = stage.copy()
    columns = np.empty((size, size))
    for k in used:
        rates = []
        for side in (DIFFERENCE, -DIFFERENCE):
            stage[:] = at_rest
            stage[k] += side
            rates.append(_full_rate(integrator)[:size])
        columns[:, k] = (rates[0] - rates[1]) / (2.0 * DIFFERENCE)
    stage[:] = at_rest
    evaluate_rate(plant)
    return np.asarray(np.linalg.eigvals(columns[np.ix_(used, used)]), dtype=complex)


def _free_coordinates(plant: PlantState, size: int) -> NDArray[np.intp]:
    """Lists the coordinates that move by themselves: not the rotors that are fixed to links."""
    n = plant.n
    free = np.ones(size, dtype=bool)
    tied = plant.joints["kind"] != ELASTIC
    free[2 * n : 3 * n][tied] = free[3 * n : 4 * n][tied] = False
    free[4 * n :] = plant.body.present
    return np.flatnonzero(free)


def _full_rate(integrator: Integrator) -> Vector:
    """Gives the rate of the stage, the links' acceleration included."""
    acceleration = integrator.rate()
    rate = state_vector(integrator.plant.n)
    rate.whole[:] = integrator.plant.rate.whole
    rate.velocity[:] = acceleration
    return rate.whole


def contact_modes(integrator: Integrator) -> Complex:
    """Bounds the modes [1/s] of every hand and of the object on every surface, as one mass each."""
    mobility, plant = integrator.link_mobility(), integrator.plant
    modes: list[complex] = []
    for body, stiffness, damping in {
        (int(row["body"]), float(row["stiffness"]), float(row["damping"])) for row in plant.contacts
    }:
        if body < plant.hands.size:
            linear = plant.jacobian[body, :3]
            lightness = float(np.linalg.eigvalsh(linear @ mobility @ linear.T)[-1])
        else:
            lightness = TOUCHING_POINTS / plant.body.mass
        modes.extend(np.roots([1.0, damping * lightness, stiffness * lightness]))
    return np.array(modes, dtype=complex)
