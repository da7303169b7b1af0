# SPDX-License-Identifier: BSD-3-Clause
"""Stage 3: every effect of the catalogue at every place where it could be, on equal terms.

A candidate is one effect at one port on one carrier (joint, pair of joints, body, base, log). Where a parameter
enters nonlinearly it comes in several shapes, one regression each. Nothing is preferred here.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.prepare import Prepared
from impedance_modules.effects.description import KeyKind, Port
from impedance_modules.effects.effect import PAIR, Effect
from impedance_modules.effects.residuals import Residual
from impedance_modules.effects.sample import smoothing
from impedance_modules.effects.signals import Signals

Array = NDArray[np.float64]
Group = tuple[Residual, int]
"""One residual of one joint: the rows that share a noise level."""

SENSOR_SHARE_MAX = 0.5
"""Largest share of a torque by which a sensor is believed to be wrong."""

ALONE = 1.5
"""Times a command's noise that motion and model may leave of it, for the rest to count as noise."""

CLEAR = 4.0
"""Times its noise beyond which the sign of a measured effort is the load's."""

PERIODS_MIN = 2.0
"""Fewest periods that a periodic effect must run through in the recordings."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One possible cause.

    Attributes:
        effect: From the catalogue.
        port: Where it acts.
        key: What carries its numbers.
        joints: Names of the joints it belongs to in a report.
    """

    effect: Effect
    port: Port
    key: str
    joints: tuple[str, ...]

    @property
    def name(self) -> str:
        """For messages."""
        return f"{self.effect.id} on {self.key}"


@dataclass(frozen=True, eq=False)
class Shaped:
    """A candidate with its nonlinear parameters fixed; its columns stand in the design.

    Attributes:
        candidate: Which; None for a generic stand-in.
        shape: Values of what enters nonlinearly.
        size: Number of coefficients.
        fixed: Whether it has a part without a coefficient, which stands behind its columns.
        lower, upper: (p,) physical bounds of the coefficients.
        key: Effect, carrier and port; stand-ins are told apart by the last two.
    """

    candidate: Candidate | None
    shape: Mapping[str, float]
    size: int
    fixed: bool
    lower: Array
    upper: Array
    key: tuple[str, str, str]

    @property
    def width(self) -> int:
        """Number of columns, the one without a coefficient included."""
        return self.size + self.fixed


def list_candidates(
    catalogue: Mapping[str, Effect], prepared: Sequence[Prepared], without: Collection[str]
) -> tuple[Candidate, ...]:
    """Lists all candidates of a catalogue, less the effects left out."""
    joints = prepared[0].signals.model.joint_names
    bodies = tuple((body.link, body.joint) for body in prepared[0].tree.bodies)
    found: list[Candidate] = []
    for effect in catalogue.values():
        if effect.id in without:
            continue
        for kind in effect.description.keys:
            for key, carried in _keys(kind, joints, bodies, effect.symmetric):
                found.extend(Candidate(effect, port, key, carried) for port in effect.description.ports)
    return tuple(found)


def _keys(
    kind: KeyKind, joints: Sequence[str], bodies: Sequence[tuple[str, str]], symmetric: bool
) -> Iterator[tuple[str, tuple[str, ...]]]:
    if kind == "joint":
        yield from ((joint, (joint,)) for joint in joints)
    elif kind == "pair":
        for index, joint in enumerate(joints):
            others = joints[index + 1 :] if symmetric else [other for other in joints if other != joint]
            yield from ((f"{joint}{PAIR}{other}", (joint,)) for other in others)
    elif kind == "body":
        yield from ((link, (joint,)) for link, joint in bodies)
    else:
        yield kind, ()


def shapes_of(candidate: Candidate, recordings: Sequence[Signals]) -> list[dict[str, float]]:
    """Lists the shapes of a candidate that are worth trying on some recordings: those of the widest motion."""
    signals = recordings[0]
    if candidate.key in signals.model.joint_names:
        joint = signals.joint(candidate.key)
        signals = max(recordings, key=lambda one: float(np.ptp(one.position[:, joint])))
    shapes = candidate.effect.shapes(signals, candidate.key, candidate.port)
    return [dict(shape) for shape in shapes if _seen(candidate, shape, signals)]


@dataclass(frozen=True, eq=False)
class Columns:
    """A shaped candidate on one recording at its full rate.

    Attributes:
        blocks: Group -> (N, p), or (N, p + 1) with the part without a coefficient last.
        fixed: Whether that part is anywhere other than zero.
        lower, upper: (p,) physical bounds of the coefficients.
    """

    blocks: Mapping[Group, Array]
    fixed: bool
    lower: Array
    upper: Array


def columns_of(
    candidate: Candidate, shape: Mapping[str, float], signals: Signals, residuals: Sequence[Residual]
) -> Columns | None:
    """Evaluates a shape on a recording; None where it shows in no residual."""
    blocks: dict[Group, Array] = {}
    fixed, bounds = False, None
    for residual in residuals:
        found = candidate.effect.regressor(signals, candidate.key, candidate.port, residual, shape)
        if found is None:
            continue
        bounds = _plausible(candidate, found.lower, found.upper)
        fixed = fixed or bool(np.any(found.fixed))
        for place, row in enumerate(found.rows):
            blocks[residual, row] = np.column_stack([found.columns[:, place], found.fixed[:, place]])
    if bounds is None:
        return None
    if not fixed:
        blocks = {group: block[:, :-1] for group, block in blocks.items()}
    return Columns(blocks, fixed, *bounds)


def _plausible(candidate: Candidate, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Narrows the physical bounds of pure numbers at a sensor: nobody ships one that is wrong by half."""
    if candidate.port != "sensor" or any(
        parameter.unit != "1" for parameter in candidate.effect.description.parameters
    ):
        return lower, upper
    return np.maximum(lower, -SENSOR_SHARE_MAX), np.minimum(upper, SENSOR_SHARE_MAX)


def _seen(candidate: Candidate, shape: Mapping[str, float], signals: Signals) -> bool:
    """Whether a periodic shape runs through enough of its periods to be one, not merely a bend."""
    if "N" not in shape or candidate.key not in signals.model.joint_names:
        return True
    swept = float(np.ptp(signals.position[:, signals.joint(candidate.key)]))
    return shape["N"] * swept / (2.0 * np.pi) >= PERIODS_MIN


def instrument(signals: Signals, noise: Array | None = None, flicker: Array | None = None) -> Signals:
    """Replaces the measured effort by its regression on the model's torque and the motion, and cleans the command.

    A column that is computed from the reading carries the reading's noise, and so does the residual: the two
    would agree where nothing is. A gain could then explain anything by scaling all away, an elasticity clean data.

    Args:
        signals: One recording.
        noise: (n,) rms of the commands' noise as repeats show it; without it commands stay as they are.
        flicker: (n,) likewise of the measured effort; without it no law sees the effort's own sign.
    """
    effort = signals.effort
    reading = None
    if effort is not None and flicker is not None:
        reading = np.where(np.abs(effort) > CLEAR * flicker, effort, 0.0)
    if effort is not None:
        effort = np.column_stack(
            [
                _onto(_basis(signals, joint, signals.rigid[:, [joint]]), effort[:, joint])
                for joint in range(signals.n)
            ]
        )
    return replace(
        signals,
        effort=effort,
        reading=reading,
        clean_drive=_clean_drive(signals, noise),
        position_command=_aimed(signals),
    )


def _aimed(signals: Signals) -> Array | None:
    """The commanded positions (N, n) of a controller that meets nothing unexpected, as far as motion and model tell.

    A controller answers any disturbance with a tracking error that looks like it: the error as recorded would
    explain whatever there is. Only the part that follows from the commanded motion is evidence of wrong gains.
    """
    aim = signals.position_command
    if aim is None:
        return None
    v = signals.rate_of(aim)
    a = signals.rate_of(v)
    weight = signals.weight
    out = np.empty_like(aim)
    for joint in range(signals.n):
        basis = np.column_stack(
            [
                np.ones(len(aim)),
                aim[:, joint],
                v[:, joint],
                a[:, joint],
                np.tanh(v[:, joint] / 0.05),
                weight[:, joint],
                signals.rigid[:, joint] - weight[:, joint],
            ]
        )
        error = aim[:, joint] - signals.position[:, joint]
        out[:, joint] = signals.position[:, joint] + _onto(basis, error)
    return out


def _clean_drive(signals: Signals, noise: Array | None) -> Array | None:
    """The torque asked for, without noise on every joint where motion and model leave no more than noise of it."""
    if signals.drive is None or noise is None:
        return None
    assistance = np.zeros_like(signals.drive) if signals.assistance is None else signals.assistance
    out = signals.drive.copy()
    for joint in range(signals.n):
        asked, weight = signals.drive[:, joint] - assistance[:, joint], signals.weight[:, joint]
        q = signals.position[:, joint]
        own = np.column_stack([signals.rigid[:, joint] - weight, weight, np.cos(q), np.sin(q)])
        smooth = _onto(_basis(signals, joint, own), asked)
        if float(np.std(asked - smooth)) < ALONE * noise[joint]:
            out[:, joint] = smooth + assistance[:, joint]
    return out


def noise_of_repeats(
    prepared: Sequence[Prepared],
    pairs: Sequence[tuple[int, int]],
    channel: Callable[[Signals], Array | None],
) -> Array | None:
    """Rms (n,) of what differs in a channel of repeats; None without any."""
    found = []
    for i, j in pairs:
        first, second = channel(prepared[i].signals), channel(prepared[j].signals)
        if first is not None and second is not None:
            size = min(len(first), len(second))
            found.append(np.mean((first[:size] - second[:size]) ** 2, axis=0) / 2.0)
    return np.sqrt(np.mean(found, axis=0)) if found else None


def _basis(signals: Signals, joint: int, own: Array) -> Array:
    q, v, a = (x[:, joint] for x in (signals.position, signals.velocity, signals.acceleration))
    # With the turnover of dry friction itself: a wider one would lend the reading a friction curve of its own.
    turnover = float(smoothing(signals.model.sliding)[joint])
    return np.column_stack([own, np.ones_like(q), q, v, a, np.tanh(v / turnover)])


def _onto(basis: Array, values: Array) -> Array:
    return np.asarray(basis @ np.linalg.lstsq(basis, values, rcond=None)[0])
