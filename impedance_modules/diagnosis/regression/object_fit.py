# SPDX-License-Identifier: BSD-3-Clause
r"""Fits an object's mass and centre of mass, beside the links' inertias and the joints' zeros within their priors.

    \min_{\theta, \nu} |y - X \theta - Z \nu|^2 + |\nu|^2,      \theta = (m - m_0, h - h_0),  h = m c

X is linear in \theta for a guess of c; the fit is repeated with the guess that it found (Gauss-Newton).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.regression.object_rows import ObjectRows
from impedance_modules.effects.carried_object import CarriedObject

Free = Literal["nothing", "mass", "centre", "both", "always", "hand"]
"""What is free: numbers of the object; or, as rivals, those of a point mass or of any change fixed to the hand."""

SIZE: dict[Free, int] = {"nothing": 0, "mass": 1, "centre": 3, "both": 4, "always": 4, "hand": 10}
"""How many numbers that are."""

ROUNDS = 4
"""Rounds of Gauss-Newton."""


@dataclass(frozen=True, eq=False)
class ObjectFit:
    """One fit.

    Attributes:
        free: What was free.
        mass: Of the object [kg].
        centre: (3,) in its own axes [m].
        covariance: (4, 4) of mass and centre for noise of unit size; zero of what was not free.
        deviance: chi^2 with the priors.
        nuisance: (K,) links and zeros, in deviations of their priors.
        left: Recording -> (R,) whitened.
    """

    free: Free
    mass: float
    centre: Array
    covariance: Array
    deviance: float
    nuisance: Array
    left: tuple[Array, ...]


def fit_object(recordings: Sequence[ObjectRows], free: Free, mass: float, centre: Array) -> ObjectFit:
    """Fits the object, or a rival of it, to all recordings together.

    Args:
        recordings: At least one of them holds it.
        free: What.
        mass: Of the task's object [kg].
        centre: (3,) of the task's object [m].
    """
    nominal, guess = mass * np.array([1.0, *centre]), centre
    place = next(rows.carried for rows in recordings if rows.carried is not None)
    for _ in range(ROUNDS if free in ("centre", "both") else 1):
        blocks = [_columns(rows, free, place, nominal, guess) for rows in recordings]
        theta, inverse, nuisance, deviance, left = _solved(recordings, blocks)
        moments = nominal + _onto(free, centre) @ theta
        if moments[0] <= 0.0:
            break
        guess = moments[1:] / moments[0]
    slope = _centre_slope(moments) @ _onto(free, centre)
    found = moments[1:] / moments[0] if moments[0] > 0.0 else centre
    return ObjectFit(
        free, float(moments[0]), found, slope @ inverse @ slope.T, deviance, nuisance, tuple(left)
    )


def evaluated(recordings: Sequence[ObjectRows], fit: ObjectFit) -> list[Array]:
    """What a fit of the object leaves of other recordings: each (R,), whitened."""
    return [rows.target - _object(rows, fit) - rows.nuisance @ fit.nuisance for rows in recordings]


def _object(rows: ObjectRows, fit: ObjectFit) -> Array:
    """What the object consumes (R,) beyond the task's, whitened."""
    if rows.carried is None:
        return np.zeros(len(rows.target))
    return (rows.hand * rows.held[:, None]) @ parameter_change(rows.carried, fit)


def parameter_change(carried: CarriedObject, fit: ObjectFit) -> Array:
    """Inertial parameters (10,) of the fitted object beyond the task's, about the hand's origin."""
    return carried.columns(fit.centre) @ (fit.mass * np.array([1.0, *fit.centre])) - carried.nominal()


def _onto(free: Free, centre: Array) -> Array:
    """Map (4, p) from what is free to changes of m and h; a mass alone stays where the task's centre is."""
    if free == "mass":
        return np.array([[1.0], *([c] for c in centre)])
    if free == "centre":
        return np.eye(4)[:, 1:]
    return np.eye(4) if free == "both" else np.zeros((4, SIZE[free]))


def _columns(
    rows: ObjectRows, free: Free, place: CarriedObject, nominal: Array, guess: Array
) -> tuple[Array, Array]:
    """What has no coefficient (R,), and columns (R, p) of what is free; a payload is where the object is, always."""
    fixed = np.zeros(len(rows.target))
    if free == "hand":
        return fixed, rows.hand
    if free == "always":
        return fixed, rows.hand @ place.columns(guess)
    if rows.carried is None:
        return fixed, np.zeros((len(fixed), SIZE[free]))
    shown = rows.hand * rows.held[:, None]
    columns = rows.carried.columns(guess)
    fixed = shown @ (columns @ nominal - rows.carried.nominal())
    return fixed, shown @ columns @ _onto(free, nominal[1:] / nominal[0])


def _solved(
    recordings: Sequence[ObjectRows], blocks: Sequence[tuple[Array, Array]]
) -> tuple[Array, Array, Array, float, list[Array]]:
    """Least squares: free numbers, their covariance, nuisance, deviance, and what is left of each recording."""
    size, count = recordings[0].nuisance.shape[1], blocks[0][1].shape[1]
    whole = [
        np.concatenate([rows.nuisance, X], axis=1) for rows, (_, X) in zip(recordings, blocks, strict=True)
    ]
    targets = [rows.target - fixed for rows, (fixed, _) in zip(recordings, blocks, strict=True)]
    gram = np.diag(np.concatenate([np.ones(size), np.zeros(count)]))
    right = np.zeros(size + count)
    for X, y in zip(whole, targets, strict=True):
        gram += X.T @ X
        right += X.T @ y
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    inverse = np.linalg.pinv(gram * np.outer(scale, scale), rcond=1e-12, hermitian=True) * np.outer(
        scale, scale
    )
    found = inverse @ right
    left = [y - X @ found for X, y in zip(whole, targets, strict=True)]
    deviance = sum(float(x @ x) for x in left) + float(found[:size] @ found[:size])
    return found[size:], inverse[size:, size:], found[:size], deviance, left


def _centre_slope(moments: Array) -> Array:
    """Derivatives (4, 4) of mass and centre by m and h = m c; of a mass alone where there is none."""
    out = np.zeros((4, 4))
    out[0, 0] = 1.0
    if moments[0] > 0.0:
        out[1:, 1:] = np.eye(3) / moments[0]
        out[1:, 0] = -moments[1:] / moments[0] ** 2
    return out
