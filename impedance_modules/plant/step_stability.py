# SPDX-License-Identifier: BSD-3-Clause
r"""Finds a step that the plant's own stiff parts leave stable; refuses parts that no step could follow.

The rate is linearised at the start by finite differences; the Runge-Kutta method multiplies each mode
\lambda by R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24, z = h \lambda, which must not outgrow exp(Re z).

Whether even the shortest step is stable is first asked of a bound, for it costs far less than the modes. Of masses M,
springs K and dampers C no mode is faster than

    |\lambda|  <=  c / 2 + sqrt(c^2 / 4 + k),      k = tr(K M^-1),      c = tr(C M^-1)

because a trace of eigenvalues that are not negative is at least the largest of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

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


SHORTEST_STEP = 1e-6
"""Down to which a plant divides its steps for light and stiff parts [s]; a run then takes a thousand per ms."""

STABLE = 2.78
"""Of h |lambda|: up to here the Runge-Kutta method damps what is damped."""

CLEARLY_STABLE = 0.1
"""Of h |lambda|: up to here the Runge-Kutta method follows any mode to 1e-7."""


@dataclass(frozen=True)
class StiffPart:
    """A part of the plant and its modes.

    Attributes:
        kind: ``joint``, ``surface``, ``object`` or ``hinge``.
        index: Of the joint or the surface; 0 for the others.
        name: In words.
        modes: [1/s].
    """

    kind: str
    index: int
    name: str
    modes: Complex

    @property
    def fastest(self) -> float:
        """Largest magnitude of its modes [rad/s]."""
        return float(np.abs(self.modes).max(initial=0.0))


class StepTooShort(BadInput):
    """A part of the plant is so light or so stiff that no step is short enough for it; ``part`` says which."""

    def __init__(self, part: StiffPart, shortest: float) -> None:
        self.part = part
        super().__init__(
            f"{part.name} has a mode at {part.fastest:.3g} rad/s, which no integration step down to {shortest:.3g} s"
            f" follows (valid: at most {STABLE / shortest:.3g} rad/s, that is a larger inertia or a softer, less"
            " damped spring)"
        )


def stable_step(integrator: Integrator, shortest: float) -> float:
    """Finds an integration step for all modes of the plant at its start, and of a grasp anywhere on its object.

    Returns:
        The integrator's own step [s] where that is stable, else the longest one of its whole divisions that is.

    Raises:
        StepTooShort: It would be shorter than ``shortest`` [s]; names the fastest part.
    """
    modes = np.concatenate([plant_modes(integrator), *(part.modes for part in _surroundings(integrator))])
    step, parts = integrator.step, 1
    while not stable(modes, step / parts):
        parts += 1
        if step / parts < shortest * (1.0 - 1e-9):
            raise StepTooShort(_fastest_part(integrator), shortest)
    return step / parts


def refuse_step(integrator: Integrator, shortest: float) -> None:
    """Refuses a plant for which ``stable_step`` finds no step, at a fraction of its cost.

    Raises:
        StepTooShort: As there.
    """
    fastest = mode_bound(integrator) + sum(part.fastest for part in _surroundings(integrator))
    if integrator.has_effects or fastest * shortest > CLEARLY_STABLE:
        stable_step(integrator, shortest)


def mode_bound(integrator: Integrator) -> float:
    """Bounds the modes of joints and grasps where the plant stands, without effects [rad/s]."""
    plant, mobility = integrator.plant, integrator.link_mobility()
    squared, damped = _joint_traces(integrator)
    for hand, J in zip(plant.hands, plant.jacobian, strict=True):
        if hand["holds"]:
            at_object = carry(hand["rest_point"])
            lightness = np.diag(J @ mobility @ J.T + at_object @ _object_mobility(plant.body) @ at_object.T)
            held = np.repeat([hand["linear_stiffness"], hand["angular_stiffness"]], 3) @ lightness
            squared += float(held)
            damped += GRASP_DAMPING_TIME * float(held)
    return _bound(squared, damped)


def _joint_traces(integrator: Integrator) -> tuple[float, float]:
    """Gives tr(K M^-1) [1/s^2] and tr(C M^-1) [1/s] of the joints alone."""
    joints, links = integrator.plant.joints, np.diag(integrator.link_mobility())
    elastic = joints["kind"] == ELASTIC
    rotors = np.where(elastic, 1.0 / np.where(elastic, joints["reflected_inertia"], 1.0), 0.0)
    squared = float(joints["stiffness"][elastic] @ (links + rotors)[elastic])
    damped = float(joints["spring_damping"][elastic] @ (links + rotors)[elastic])
    return squared, damped + float(joints["motor_damping"] @ np.where(elastic, rotors, links))


def _bound(squared: float, damped: float) -> float:
    """The module's bound of all modes [rad/s]."""
    return 0.5 * damped + math.sqrt(0.25 * damped**2 + squared)


def _surroundings(integrator: Integrator) -> Iterator[StiffPart]:
    """Lists what hands and object may come to press on, with modes that the start posture need not show."""
    surfaces = np.unique(integrator.plant.contacts["surface"])
    for index in map(int, surfaces):
        hands, held = contact_modes(integrator, index)
        yield StiffPart("surface", index, "a hand on this surface", hands)
        yield StiffPart("object", 0, f"the held object on environment[{index}]", held)
    yield StiffPart("object", 0, "the object between palms", palm_modes(integrator))
    yield StiffPart("hinge", 0, "the object on its hinge", hinge_modes(integrator.plant))


def _fastest_part(integrator: Integrator) -> StiffPart:
    """Finds what the fastest mode of all belongs to."""
    parts = [*_joint_parts(integrator), *_surroundings(integrator)]
    return max(parts, key=lambda part: part.fastest)


def _joint_parts(integrator: Integrator) -> Iterator[StiffPart]:
    """Gives the fastest mode of the plant where it stands to the joint that moves most in it, or to the object.

    To the object where that moves most, or where the joints alone have no mode half as fast: then it is the grasp's.
    """
    plant, n = integrator.plant, integrator.plant.n
    used, matrix = _linearised(integrator)
    modes, shapes = np.linalg.eig(matrix)
    fastest = int(np.argmax(np.abs(modes)))
    place = int(used[np.argmax(np.abs(shapes[:, fastest]))])
    mode = np.array([modes[fastest]], dtype=complex)
    of_grasp = bool(plant.body.present) and _bound(*_joint_traces(integrator)) < 0.5 * abs(modes[fastest])
    if place >= 4 * n or of_grasp:
        yield StiffPart("object", 0, "the held object", mode)
        return
    joint, name = place % n, str(integrator.links.names[1 + place % n])
    own = plant.joints[joint]
    rotor = f", rotor {own['reflected_inertia']:g} kg.m^2" if own["kind"] == ELASTIC else ""
    yield StiffPart("joint", joint, f"joint '{name}' (spring {own['stiffness']:g} N.m/rad{rotor})", mode)


def stable(modes: Complex, step: float) -> bool:
    """Says whether the Runge-Kutta method damps what the plant damps, for every mode [1/s]."""
    z = step * modes
    gain = np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0))))
    return bool(np.all(gain <= np.exp(np.maximum(z.real, 0.0)) * (1.0 + 1e-6)))


def plant_modes(integrator: Integrator) -> Complex:
    """Computes the eigenvalues [1/s] of the plant linearised where it stands."""
    _, matrix = _linearised(integrator)
    return np.asarray(np.linalg.eigvals(matrix), dtype=complex)


def _linearised(integrator: Integrator) -> tuple[NDArray[np.intp], Matrix]:
    """Gives the coordinates that move by themselves and the derivative of their rates by them [1/s]."""
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
    return used, columns[np.ix_(used, used)]


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


def contact_modes(integrator: Integrator, surface: int) -> tuple[Complex, Complex]:
    """Bounds the modes [1/s] on a surface of every hand, as one mass, and of the object on one of its faces."""
    mobility, plant = integrator.link_mobility(), integrator.plant
    hands: list[complex] = []
    held: list[complex] = []
    for body, stiffness, damping in {
        (int(row["body"]), float(row["stiffness"]), float(row["damping"]))
        for row in plant.contacts[plant.contacts["surface"] == surface]
    }:
        if body < plant.hands.size:
            linear = plant.jacobian[body, :3]
            lightness = float(np.linalg.eigvalsh(linear @ mobility @ linear.T)[-1])
        else:
            points = plant.contacts["centre"][plant.contacts["body"] == body]
            lightness = _lightness_on_a_face(plant.body, np.unique(points, axis=0))
        modes = np.roots([1.0, damping * lightness, stiffness * lightness])
        (hands if body < plant.hands.size else held).extend(modes)
    return np.array(hands, dtype=complex), np.array(held, dtype=complex)


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
