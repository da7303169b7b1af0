# SPDX-License-Identifier: BSD-3-Clause
r"""The force at one place of a link that best explains what a model leaves of a recording, over time.

    r = -J^T(q) f(t),      f(t) = \sum_k f_k h_k(t)

with h_k hat functions half a second wide, fitted to the links' whitened residual. J is of a link's origin or centre of
mass: a force on its origin does not turn the link's own joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.regression.model_fit import ModelFit
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.effects.residual_kinds import uses_motion
from impedance_modules.effects.rigid_model import RigidModel

SPACING = 0.25
"""Between the tips of two hat functions [s]."""


APART = 0.02
"""Distance of two places beyond which a force on one differs from the same force on the other [m]."""

UNFELT = 10.0
"""Ratio of a force's deviation along a direction to that along the surest one, beyond which it may be unfelt."""

ROUNDS = 6
"""How often sizes and direction of a force are fitted in turn."""


@dataclass(frozen=True)
class PushPlace:
    """Where a link is pushed.

    Attributes:
        body: Link.
        point: In its frame [m].
    """

    body: str
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __str__(self) -> str:
        """The link, and the point where it is not the link's origin."""
        x, y, z = self.point
        return f"{self.body} at ({x:g}, {y:g}, {z:g}) m in its frame" if any(self.point) else self.body

    def jacobian(self, model: RigidModel, position: Array) -> Array:
        """J (N, 3, n) of the point in base axes."""
        return model.point_jacobian(self.body, np.array(self.point), position)


@dataclass(frozen=True, eq=False)
class Forces:
    """Hat functions at one place in one recording: (k, 3) forces [N], their covariance, gain of each joint."""

    place: PushPlace
    force: Array
    covariance: Array
    joints: Array
    gain: float


def fit_forces(
    model_fit: ModelFit, item: Prepared, r: int, left: Sequence[Array], place: PushPlace
) -> Forces:
    """Fits the force at one place."""
    J = place.jacobian(item.signals.model, item.position)
    _, hats = hat_functions(item, item.samples)
    count = hats.shape[1]
    gram, right = 1e-6 * np.eye(3 * count), np.zeros(3 * count)
    blocks = {}
    for g, (residual, joint) in enumerate(model_fit.design.groups):
        if not uses_motion(residual):
            continue
        columns = -(hats[:, :, None] * J[:, None, :, joint]).reshape(len(hats), -1)
        X = np.asarray(model_fit.design.whitening.apply(columns, r, g))
        gram += X.T @ X
        right += X.T @ left[g]
        blocks[g] = X
    covariance = np.linalg.inv(gram)
    force = np.asarray(covariance @ right)
    joints = np.array(
        [float(np.sum(left[g] ** 2) - np.sum((left[g] - X @ force) ** 2)) for g, X in blocks.items()]
    )
    return Forces(place, force.reshape(-1, 3), np.asarray(covariance), joints, float(force @ right))


def hat_functions(item: Prepared, rows: int) -> tuple[Array, Array]:
    """Tips (k,) [s] and hat functions (rows, k) at the recording's last rows."""
    time = item.time[-rows:] - item.log.start
    tips = np.arange(time[0], time[-1] + SPACING, SPACING)
    return tips, np.clip(1.0 - np.abs(time[:, None] - tips) / SPACING, 0.0, None)


def free_torques(model_fit: ModelFit, item: Prepared, r: int, left: Sequence[Array], g: int) -> Array:
    """Chi-square (k,) of a free torque of one joint at each hat."""
    _, hats = hat_functions(item, item.samples)
    X = np.asarray(model_fit.design.whitening.apply(hats, r, g))
    gram = X.T @ X + 1e-6 * np.eye(X.shape[1])
    covariance = np.linalg.inv(gram)
    torque = covariance @ (X.T @ left[g])
    return np.asarray(torque**2 / np.diag(covariance))


def chi_square_of(forces: Forces, part: slice) -> float:
    """Chi-square of some hats together."""
    force = forces.force.reshape(-1)[part]
    return float(force @ np.linalg.solve(forces.covariance[part, part], force))


def steady_gain(forces: Forces, first: int, last: int) -> float:
    r"""Chi-square beyond its degrees of freedom of a force that keeps its direction d, f_k = s_k d, over some hats.

    Noise, and an arm that swings, push in every direction; three numbers at each time follow them, one does not. s and
    d are fitted in turn, from the direction of most power.

    Args:
        forces: Of the recording.
        first: Index of the first hat.
        last: One after that of the last.
    """
    size, chosen = last - first, slice(3 * first, 3 * last)
    precision = np.linalg.inv(forces.covariance[chosen, chosen])
    force = forces.force[first:last]
    right = precision @ force.reshape(-1)
    direction = np.linalg.svd(force, full_matrices=False)[2][0]
    explained = 0.0
    for _ in range(ROUNDS):
        along = np.kron(np.eye(size), direction[:, None])
        sizes = np.linalg.solve(along.T @ precision @ along, along.T @ right)
        explained = float(right @ along @ sizes)
        across = np.kron(sizes[:, None], np.eye(3))
        direction = np.linalg.lstsq(across.T @ precision @ across, across.T @ right, rcond=None)[0]
        direction = direction / np.linalg.norm(direction)
    return explained - size - 2.0


def felt_directions(force: Array, covariance: Array) -> Array:
    """Directions (k, 3) in which a force shows on the joints, orthonormal, the surest first.

    Joints with parallel axes feel nothing along them. A direction is not felt if the force along it may be none and is
    far less certain than in the surest direction.

    Args:
        force: (3,) [N].
        covariance: (3, 3) of it.
    """
    variances, axes = np.linalg.eigh(covariance)
    deviations = np.sqrt(variances)
    unknown = (np.abs(axes.T @ force) < deviations) & (deviations > UNFELT * deviations[0])
    return np.asarray(axes.T[~unknown])


def touched_places(item: Prepared) -> tuple[PushPlace, ...]:
    """Places at which a force is tried: origins and centres of mass of the moving links, and origins fixed to them.

    Those that are some way off each other: a force on a hand turns the joints of its wrist, one at the last link's
    origin does not, and one on a link's origin does not turn the link's own joint.
    """
    model, posture = item.signals.model, item.signals.position[:1]
    moving = [body.link for body in item.tree.bodies]
    fixed = [link for link in model.bodies if link not in moving]
    candidates = [PushPlace(link) for link in (*moving, *fixed)]
    candidates += [PushPlace(link, _rounded(model.centre(link))) for link in moving]
    out: list[PushPlace] = []
    points: list[Array] = []
    for place in candidates:
        rotated = (model.rotation(place.body, posture) @ np.array(place.point))[0]
        point = model.place(place.body, posture)[0] + rotated
        if (place.body in moving and not any(place.point)) or min(_distances(point, points)) > APART:
            out.append(place)
            points.append(point)
    return tuple(out)


def _rounded(point: Array) -> tuple[float, float, float]:
    """A point to a millimetre, for reading."""
    x, y, z = (round(float(value), 3) + 0.0 for value in point)
    return x, y, z


def _distances(point: Array, others: Sequence[Array]) -> list[float]:
    return [float(np.linalg.norm(point - other)) for other in others]
