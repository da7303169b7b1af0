# SPDX-License-Identifier: BSD-3-Clause
r"""Fits numbers of surfaces to samples in contact, beside the links' and the encoders' zeros within their priors.

    \min_{p, \nu, \delta} \sum_t |\Sigma_t^{-1/2} (y_t - T_t(p) - Z_t \nu - D_t \delta)|^2 + |\nu|^2 + |\delta|^2

T the torque that the surfaces' contacts consume, p their numbers, \nu links, \delta zeros. The noise \Sigma follows
from p (`contact_rows`). Two models are compared with the noise of either, and the smaller difference counts: a model
must not win by assuming more noise, nor by an imagined knowledge of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.regression.contact_rows import ContactRecording, Mask, SurfaceNumbers

STEPS, HALVINGS, NOISE_ROUNDS = 12, 6, 2
"""Gauss-Newton steps of one fit, halvings of each, and how often the noise is computed anew."""

SLOPE: Mapping[str, float] = {"dh": 1e-6, "k": 1.0, "mu": 1e-4}
"""Steps of the numerical derivatives, in each number's unit."""

LEAST: Mapping[str, float] = {"dh": -np.inf, "k": 1.0, "mu": 0.0}
"""Least physical values."""

FLAT = 1e-12
"""Precision, over each number's own, that keeps a number finite that the data do not see."""

CLOSE = 1e-4
"""Fall of the deviance below which a fit has arrived."""

Number = tuple[int, str]
"""A surface's place in the task, and the symbol of one of its numbers."""

Surfaces = Mapping[int, SurfaceNumbers]


@dataclass(frozen=True, eq=False)
class ContactFit:
    """Numbers of surfaces, fitted.

    Attributes:
        free: Those that were fitted.
        surfaces: All numbers, the others as the task has them.
        deviance: chi^2 with the priors.
        inverse: (K + p, K + p) covariance of links, zeros and numbers, the numbers last, for noise of unit size.
        nuisance: (K,) links and zeros, in deviations of their priors.
        left: Recording -> (rows, n) whitened, in the order of its rows in use.
    """

    free: tuple[Number, ...]
    surfaces: Surfaces
    deviance: float
    inverse: Array
    nuisance: Array
    left: tuple[Array, ...]

    def std(self, number: Number) -> float:
        """Standard deviation of a fitted number, for noise of unit size."""
        place = self.inverse.shape[0] - len(self.free) + self.free.index(number)
        return float(np.sqrt(self.inverse[place, place]))


@dataclass(frozen=True, eq=False)
class _Whitened:
    r"""One recording's rows in use, with the noise of some numbers of the surfaces.

    Attributes:
        data: The recording.
        used: (M,) rows.
        roots: (rows, n, n) \\Sigma^{-1/2}.
    """

    data: ContactRecording
    used: Mask
    roots: Array

    def white(self, values: Array) -> Array:
        """Whitens (M, n) or (M, n, p) to (rows, n) or (rows, n, p)."""
        chosen = values[self.used]
        if values.ndim == 2:
            return np.asarray(np.einsum("mij,mj->mi", self.roots, chosen))
        return np.asarray(self.roots @ chosen)


def fit_contact(
    recordings: Sequence[ContactRecording],
    free: Sequence[Number],
    start: Surfaces,
    noise: Surfaces | None = None,
) -> ContactFit:
    """Fits some numbers of the surfaces, the others stay.

    Args:
        recordings: With rows in contact.
        free: Which.
        start: Where to begin.
        noise: Surfaces whose noise counts; None: those of the fit itself.
    """
    surfaces = start
    for _ in range(NOISE_ROUNDS if noise is None else 1):
        rows = [_whitened(data, noise or surfaces) for data in recordings]
        found = _gauss_newton(rows, tuple(free), surfaces)
        surfaces = found.surfaces
    return found


def gained(recordings: Sequence[ContactRecording], plain: ContactFit, richer: ContactFit) -> float:
    """Fall of the deviance from a fit to one with more free numbers, with the noise of either: the smaller one."""
    as_plain = fit_contact(recordings, richer.free, richer.surfaces, plain.surfaces)
    as_richer = fit_contact(recordings, plain.free, plain.surfaces, richer.surfaces)
    return min(plain.deviance - as_plain.deviance, as_richer.deviance - richer.deviance)


def evaluated(recordings: Sequence[ContactRecording], fit: ContactFit) -> list[Array]:
    """What a fit leaves of other recordings: each (rows, n), whitened."""
    out = []
    for data in recordings:
        rows = _whitened(data, fit.surfaces)
        columns = _nuisance(rows, fit.surfaces)
        out.append(rows.white(data.target - data.torque(fit.surfaces)) - columns @ fit.nuisance)
    return out


def in_use(data: ContactRecording) -> Mask:
    """Rows (M,) that are fitted: in contact, or free of it."""
    return np.asarray(data.touching | data.free)


def _whitened(data: ContactRecording, surfaces: Surfaces) -> _Whitened:
    used = in_use(data)
    covariance = data.covariance(surfaces)[used]
    covariance[data.free[used]] = np.diag(data.torque_noise**2)
    return _Whitened(data, used, np.linalg.inv(np.linalg.cholesky(covariance)))


def _nuisance(rows: _Whitened, surfaces: Surfaces) -> Array:
    """Whitened columns (rows, n, K) of links and zeros."""
    data = rows.data
    zeros = data.zero_columns(surfaces)
    return rows.white(np.concatenate([data.nuisance, zeros], axis=2))


def _gauss_newton(rows: Sequence[_Whitened], free: tuple[Number, ...], surfaces: Surfaces) -> ContactFit:
    best = _solved(rows, free, surfaces)
    for _ in range(STEPS if free else 0):
        step = _step(rows, best)
        for _ in range(HALVINGS):
            trial = _solved(rows, free, _moved(best.surfaces, free, step))
            if trial.deviance < best.deviance:
                break
            step = 0.5 * step
        else:
            return best
        gained, best = best.deviance - trial.deviance, trial
        if gained < CLOSE:
            break
    return best


def _solved(rows: Sequence[_Whitened], free: tuple[Number, ...], surfaces: Surfaces) -> ContactFit:
    """Fits links and zeros with the surfaces' numbers given; the covariance is that of all together."""
    columns = [_nuisance(one, surfaces) for one in rows]
    targets = [one.white(one.data.target - one.data.torque(surfaces)) for one in rows]
    size = columns[0].shape[2]
    gram, right = np.eye(size), np.zeros(size)
    for X, y in zip(columns, targets, strict=True):
        flat = X.reshape(-1, size)
        gram += flat.T @ flat
        right += flat.T @ y.reshape(-1)
    nuisance = np.linalg.solve(gram, right)
    left = tuple(y - X @ nuisance for X, y in zip(columns, targets, strict=True))
    squares = sum(float(np.sum(x**2)) for x in left) + float(nuisance @ nuisance)
    inverse = _covariance(rows, free, surfaces, columns, gram)
    return ContactFit(free, surfaces, squares, inverse, np.asarray(nuisance), left)


def _covariance(
    rows: Sequence[_Whitened],
    free: tuple[Number, ...],
    surfaces: Surfaces,
    columns: Sequence[Array],
    gram: Array,
) -> Array:
    """Inverse (K + p, K + p) of the normal matrix of links, zeros and free numbers."""
    size = len(gram)
    whole = np.zeros((size + len(free), size + len(free)))
    whole[:size, :size] = gram
    for one, X in zip(rows, columns, strict=True):
        G = _slopes(one, free, surfaces).reshape(one.used.sum() * one.data.item.signals.n, len(free))
        cross = X.reshape(-1, size).T @ G
        whole[:size, size:] += cross
        whole[size:, :size] += cross.T
        whole[size:, size:] += G.T @ G
    # Numbers in metres and newtons per metre differ by many orders: scaled, none of them falls below the rounding.
    scale = 1.0 / np.sqrt(np.maximum(np.diag(whole), FLAT))
    return np.asarray(
        np.linalg.inv(whole * np.outer(scale, scale) + FLAT * np.eye(len(whole))) * np.outer(scale, scale)
    )


def _step(rows: Sequence[_Whitened], fit: ContactFit) -> Array:
    """Gauss-Newton step (p,) of the free numbers."""
    right = np.zeros(len(fit.inverse))
    size = len(fit.nuisance)
    for one, left in zip(rows, fit.left, strict=True):
        G = _slopes(one, fit.free, fit.surfaces).reshape(left.size, len(fit.free))
        right[size:] += G.T @ left.reshape(-1)
    # Links and zeros are at their optimum: their part of the gradient is zero.
    return np.asarray((fit.inverse @ right)[size:])


def _slopes(one: _Whitened, free: Sequence[Number], surfaces: Surfaces) -> Array:
    """Whitened derivatives (rows, n, p) of the contacts' torque by the free numbers."""
    used, n = int(one.used.sum()), one.data.item.signals.n
    out = np.zeros((used, n, len(free)))
    for place, (index, symbol) in enumerate(free):
        if all(contact.surface != index for contact in one.data.contacts):
            continue
        step = SLOPE[symbol]
        ahead, behind = (
            one.data.torque(_moved(surfaces, [(index, symbol)], np.array([change])))
            for change in (step, -step)
        )
        out[:, :, place] = one.white((ahead - behind) / (2.0 * step))
    return out


def _moved(surfaces: Surfaces, free: Sequence[Number], step: Array) -> Surfaces:
    """The surfaces with numbers moved, none below what is physical."""
    out = dict(surfaces)
    for (index, symbol), change in zip(free, step, strict=True):
        value = max(LEAST[symbol], float(getattr(out[index], symbol) + change))
        out[index] = replace(out[index], **{symbol: value})
    return out
