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
from impedance_modules.plant.grasp import GRASP_DAMPING_TIME
from impedance_modules.plant.hinge_start import hinge_mode
from impedance_modules.plant.integrator import Integrator
from impedance_modules.plant.joints import ELASTIC
from impedance_modules.plant.plant_state import WORK_SIZE, PlantState, state_vector
from impedance_modules.plant.rigid_object import CYLINDER, SPHERE, ObjectState
from impedance_modules.records import Matrix, Vector
from impedance_modules.robot.pose import carry

Complex = NDArray[np.complex128]

DIFFERENCE = 1e-7
"""Of the finite differences, in the state's units."""


def stable_step(integrator: Integrator, shortest: float) -> float:
    """Finds an integration step for all modes of the plant at its start, and of a grasp anywhere on its object.

    Returns:
        The integrator's own step [s] where that is stable, else the longest one of its whole divisions that is.

    Raises:
        BadInput: Even ``shortest`` [s] is too long for the lightest part on the stiffest spring.
    """
    modes = np.concatenate(
        [
            plant_modes(integrator),
            contact_modes(integrator),
            palm_modes(integrator),
            hinge_modes(integrator.plant),
        ]
    )
    step, parts = integrator.step, 1
    while not stable(modes, step / parts) and step / parts >= shortest:
        parts += 1
    if step / parts >= shortest * (1.0 - 1e-9):
        return step / parts
    while not stable(modes, step / parts):
        parts += 1
    fastest = float(np.abs(modes).max())
    raise BadInput(
        f"an integration step of {max(shortest, step / parts):.3g} s is too long for a mode at {fastest:.4g} rad/s"
        f" of the joints, the held object or a surface (valid: at most {step / parts:.3g} s; or a heavier, larger"
        " object, a softer surface)"
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
    """Bounds the modes [1/s] of every hand, as one mass, and of the object on one of its faces, on every surface."""
    mobility, plant = integrator.link_mobility(), integrator.plant
    modes: list[complex] = []
    for body, stiffness, damping in {
        (int(row["body"]), float(row["stiffness"]), float(row["damping"])) for row in plant.contacts
    }:
        if body < plant.hands.size:
            linear = plant.jacobian[body, :3]
            lightness = float(np.linalg.eigvalsh(linear @ mobility @ linear.T)[-1])
        else:
            points = plant.contacts["centre"][plant.contacts["body"] == body]
            lightness = _lightness_on_a_face(plant.body, np.unique(points, axis=0))
        modes.extend(np.roots([1.0, damping * lightness, stiffness * lightness]))
    return np.array(modes, dtype=complex)


def _lightness_on_a_face(body: ObjectState, points: Matrix) -> float:
    """Gives the factor from stiffness to squared frequency [1/kg] where one face's points, of (k, 3), touch at once."""
    root, found = np.sqrt(_object_mobility(body)), 0.0
    for direction in np.vstack([np.eye(3), -np.eye(3)]):
        reach = points @ direction
        maps = [carry(point)[:3] for point in points[reach > reach.max() - 1e-9]]
        together = sum((X.T @ X for X in maps), np.zeros((6, 6)))
        found = max(found, float(np.linalg.eigvalsh(root @ together @ root)[-1]))
    return found


def palm_modes(integrator: Integrator) -> Complex:
    """Bounds the modes [1/s] of palms that stick anywhere on the object, whatever the posture; none of welds.

    Constraints only make a body heavier: a hand is at least as heavy as its link alone. An object is nowhere lighter
    than at its farthest corner, and several palms on it add up.
    """
    plant, shares = integrator.plant, [0.0]
    squared = 0.0
    for hand in plant.hands[(plant.hands["holds"] == 1) & (plant.hands["slips"] == 1)]:
        link = integrator.links.inertias[int(hand["link"])]
        alone = np.linalg.inv(link.matrix())
        stiffness = np.repeat([hand["linear_stiffness"], hand["angular_stiffness"]], 3)
        corner = _farthest(plant.body, max(0.0, float(hand["palm_offset"])))
        squared += _fastest(stiffness, carry(corner) @ _object_mobility(plant.body) @ carry(corner).T)
        at_hand = carry(hand["mount_translation"])
        shares.append(_fastest(stiffness, at_hand @ alone @ at_hand.T))
    squared += max(shares)
    return np.roots([1.0, GRASP_DAMPING_TIME * squared, squared]).astype(complex)


def hinge_modes(plant: PlantState) -> Complex:
    """Bounds the modes [1/s] of the object at a stop of its hinge; none without a hinge."""
    if not plant.hinge.present:
        return np.zeros(0, dtype=complex)
    return np.array([hinge_mode(plant.hinge, _object_mobility(plant.body))])


def _fastest(stiffness: Vector, mobility: Matrix) -> float:
    """Gives the largest squared frequency [1/s^2] of a mobility (6, 6) on springs (6,)."""
    root = np.sqrt(stiffness)
    return float(np.linalg.eigvalsh(root[:, None] * mobility * root)[-1])


def _object_mobility(body: ObjectState) -> Matrix:
    """Gives the inverse inertia (6, 6) of the object at its origin, its own axes, linear then angular."""
    return np.diag(np.concatenate([np.full(3, 1.0 / body.mass), 1.0 / body.inertia]))


def _farthest(body: ObjectState, margin: float) -> Vector:
    """Gives the point (3,) of the object, grown by ``margin`` [m], where it is lightest to push, own axes [m]."""
    corner = body.half + margin
    if body.shape == CYLINDER:
        corner[1] = 0.0
    if body.shape == SPHERE:
        corner[1:] = 0.0
    return np.asarray(corner)
