# SPDX-License-Identifier: BSD-3-Clause
r"""Whether what a candidate explains belongs to the motion, or is noise that its column and the residual share.

Positions' noise, differentiated, is in the residual and in every column of accelerations; a command holds the
controller's answer to it. Least squares find a coefficient then, without any cause (errors in variables: a rotor that
looks lighter, a joint that looks elastic, each with a small error). An instrument is a signal that the motion makes,
and in which that noise is not (Reiersol 1941; Janot, Vandanjon & Gautier 2014 for robots):

    \beta_z = \sum z \cdot y / \sum z \cdot x

y what the model leaves of white rows, x the candidate's part that the model cannot make by itself. Three are at hand: x
of a repeat, for the other recording of the same motion, whose noise differs; the slow half of x, as the motion is
slow, and noise that is differentiated is fast; and of a command the torque that the motion needs. Each must confirm
half of the coefficient at least.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.model_selection.candidate_trial import CandidateTrial
from impedance_modules.diagnosis.regression.model_fit import ModelFit, ModelTerm

CONFIRMED_MIN = 0.5
"""Least part of its coefficient that an instrument confirms: more than half belongs to the motion."""

RESOLVED = 3.5
"""Standard deviations by which an instrument must differ from what the whole says."""

SLOW = 0.5
"""End of the slow part, over the band's."""

Parts = dict[int, tuple[Array, Array]]
"""Group -> x and y, (M,) each."""


def comes_back(trial: CandidateTrial, pairs: Sequence[tuple[int, int]]) -> bool:
    """Whether what a candidate explains in one recording, it explains in a repeat of it, or need not.

    It need not where none was repeated. A command is known exactly as it was sent: its noise is a part of what a cause
    makes of it, and no repeat has the same. So only what both commands share must come back, where that tells.

    Args:
        trial: The candidate.
        pairs: Recordings that repeat each other.
    """
    candidate = trial.term.candidate
    across, within, common, power = 0.0, 0.0, 0.0, 0.0
    for pair in pairs:
        one, other = (beyond_model(trial, recording) for recording in pair)
        for group in one.keys() & other.keys():
            size = min(len(part[group][0]) for part in (one, other))
            (x_i, y_i), (x_j, y_j) = ([values[:size] for values in part[group]] for part in (one, other))
            weight = trial.model_fit.weights[group]
            across += weight * float(x_i @ y_j + x_j @ y_i)
            within += weight * float(x_i @ y_i + x_j @ y_j)
            common += weight * float(2.0 * x_i @ x_j)
            power += weight * float(x_i @ x_i + x_j @ x_j)
    if within <= 0.0:
        return True
    if candidate.effect.computed_from_command(candidate.port):
        return bool(common <= 0.0) or _confirmed(across / common, float(np.sqrt(power)) / common)
    return bool(across >= CONFIRMED_MIN * within)


def holds_when_slow(trial: CandidateTrial, end: float) -> bool:
    """Whether the slow part of a candidate's torque has about the coefficient that the whole has, or cannot tell.

    Args:
        trial: The candidate.
        end: Of the slow part [cycles per row].
    """
    whole, slow, power = 0.0, 0.0, np.zeros(2)
    for recording in trial.model_fit.fitted:
        for group, (x, y) in beyond_model(trial, recording).items():
            weight = trial.model_fit.weights[group]
            x_slow = below(x, end)
            whole, slow = whole + weight * float(x @ y), slow + weight * float(x_slow @ y)
            power += weight * np.array([float(x @ x), float(x_slow @ x)])
    if not np.all(power > 0.0) or whole <= 0.0:
        return True
    # In units of the whole's coefficient.
    return _confirmed(slow / power[1] * power[0] / whole, power[0] / whole / np.sqrt(power[1]))


def follows_load(trial: CandidateTrial, load: ModelTerm) -> bool:
    """Whether a candidate has about its coefficient where the motion needs torque; true where nothing of it is needed.

    A command that hardly carries a load is mostly the controller's answer to noise, which the residual has, too; and
    what a drive does with that noise between two samples of a recording no model here says.

    Args:
        trial: The candidate, made of a command.
        load: The same, made of the torque that the motion needs; scaled like the candidate.
    """
    whole, needed, own, common = np.zeros(4)
    instrument = beyond_fit(trial.model_fit, load, trial.in_sample.own)
    for recording, parts in instrument.items():
        for group, (x, y) in beyond_model(trial, recording).items():
            if group not in parts:
                continue
            weight, z = trial.model_fit.weights[group], parts[group]
            whole, own = whole + weight * float(x @ y), own + weight * float(x @ x)
            needed, common = needed + weight * float(z @ y), common + weight * float(z @ x)
    # In units of the whole's coefficient.
    return bool(common == 0.0 or whole <= 0.0 or needed / common * own / whole >= CONFIRMED_MIN)


def beyond_fit(model_fit: ModelFit, term: ModelTerm, coefficients: Array) -> dict[int, dict[int, Array]]:
    """What a term with some coefficients adds that a model cannot make; recording -> group -> (M,)."""
    made = {
        r: {g: block @ coefficients + term.fixed[r].get(g, 0.0) for g, block in term.columns[r].items()}
        for r in model_fit.fitted
    }
    cross = np.zeros(model_fit.size)
    for r, parts in made.items():
        for g, values in parts.items():
            cross[model_fit.ids[g]] += model_fit.weights[g] * (model_fit.rows[r][g].T @ values)
    same = model_fit.whole.inverse @ cross
    return {
        r: {g: values - model_fit.rows[r][g] @ same[model_fit.ids[g]] for g, values in parts.items()}
        for r, parts in made.items()
    }


def _confirmed(found: float, spread: float) -> bool:
    """Whether an instrument's coefficient, in units of the whole's, is about one, or too uncertain to deny it."""
    return bool(found >= CONFIRMED_MIN or 1.0 - found <= RESOLVED * spread)


def beyond_model(trial: CandidateTrial, recording: int) -> Parts:
    """What a candidate makes of a recording that the model cannot make, and what the model leaves; group -> (M,)."""
    term, model_fit = trial.term, trial.model_fit
    moved = model_fit.whole.coefficients - trial.in_sample.beside
    left = model_fit.residuals(model_fit.whole.coefficients, recording)
    fixed = term.fixed[recording]
    out = {}
    for group, block in term.columns[recording].items():
        made = block @ trial.in_sample.own + fixed.get(group, 0.0)
        out[group] = (made - model_fit.rows[recording][group] @ moved[model_fit.ids[group]], left[group])
    return out


def below(values: Array, end: float) -> Array:
    """Leaves of samples (M,) what is below a frequency [cycles per sample]."""
    spectrum = np.fft.rfft(values)
    spectrum[np.fft.rfftfreq(len(values)) > end] = 0.0
    return np.asarray(np.fft.irfft(spectrum, len(values)))
