# SPDX-License-Identifier: BSD-3-Clause
"""Stage 3: every effect of the catalogue at every place where it could be, on equal terms.

A candidate is one effect at one port on one carrier (joint, pair of joints, body, base, log). Where a parameter
enters nonlinearly it comes in several shapes, one regression each. Nothing is preferred here.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.prepare import Prepared
from impedance_modules.effects.description import KeyKind, Port
from impedance_modules.effects.effect import PAIR, Effect
from impedance_modules.effects.residuals import Residual
from impedance_modules.effects.signals import Signals

Array = NDArray[np.float64]
Group = tuple[Residual, int]
"""One residual of one joint: the rows that share a noise level."""

SENSOR_SHARE_MAX = 0.5
"""Largest share of a torque by which a sensor is believed to be wrong."""

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
    """A candidate with its nonlinear parameters fixed, evaluated on all recordings.

    Attributes:
        candidate: Which; None for a generic stand-in.
        shape: Values of what enters nonlinearly.
        columns: Recording -> group -> (M, p), in the band.
        fixed: Recording -> group -> (M,) part without a coefficient; a group is missing where it is zero.
        lower, upper: (p,) physical bounds of the coefficients.
        key: Effect, carrier and port; stand-ins are told apart by the last two.
    """

    candidate: Candidate | None
    shape: Mapping[str, float]
    columns: tuple[Mapping[Group, Array], ...]
    fixed: tuple[Mapping[Group, Array], ...]
    lower: Array
    upper: Array
    key: tuple[str, str, str]

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.lower)


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
            for key, carried in _keys(kind, joints, bodies):
                found.extend(Candidate(effect, port, key, carried) for port in effect.description.ports)
    return tuple(found)


def _keys(
    kind: KeyKind, joints: Sequence[str], bodies: Sequence[tuple[str, str]]
) -> Iterator[tuple[str, tuple[str, ...]]]:
    if kind == "joint":
        yield from ((joint, (joint,)) for joint in joints)
    elif kind == "pair":
        for joint in joints:
            yield from ((f"{joint}{PAIR}{other}", (joint,)) for other in joints if other != joint)
    elif kind == "body":
        yield from ((link, (joint,)) for link, joint in bodies)
    else:
        yield kind, ()


@dataclass(eq=False)
class _Draft:
    """A shape while the recordings are gone through one by one."""

    candidate: Candidate
    shape: Mapping[str, float]
    columns: list[Mapping[Group, Array]]
    fixed: list[Mapping[Group, Array]]
    bounds: tuple[Array, Array] | None = None


def shape_candidates(
    candidates: Sequence[Candidate], prepared: Sequence[Prepared], residuals: Sequence[Residual]
) -> list[Shaped]:
    """Evaluates all shapes of all candidates on all recordings; what cannot show in any residual is left out."""
    first = prepared[0].signals
    drafts = [
        _Draft(candidate, shape, [], [])
        for candidate in candidates
        for shape in candidate.effect.shapes(first, candidate.key, candidate.port)
        if _seen(candidate, shape, first)
    ]
    for item in prepared:
        instrumented = instrument(item.signals)
        with item.remembered():
            for draft in drafts:
                _evaluate(draft, item, instrumented, residuals)
    found: dict[tuple[object, ...], Shaped] = {}
    for draft in drafts:
        if draft.bounds is not None:
            key = (draft.candidate.effect.id, draft.candidate.key, draft.candidate.port)
            shaped = Shaped(
                draft.candidate, draft.shape, tuple(draft.columns), tuple(draft.fixed), *draft.bounds, key=key
            )
            # At a motor's torque, friction before and behind the gear are one column: the first port stands.
            found.setdefault(_likeness(shaped), shaped)
    return list(found.values())


def _evaluate(draft: _Draft, item: Prepared, signals: Signals, residuals: Sequence[Residual]) -> None:
    here: dict[Group, Array] = {}
    steady: dict[Group, Array] = {}
    effect, candidate = draft.candidate.effect, draft.candidate
    for residual in residuals:
        found = effect.regressor(signals, candidate.key, candidate.port, residual, draft.shape)
        if found is None:
            continue
        draft.bounds = _plausible(draft.candidate, found.lower, found.upper)
        thinned = item.band.condense(found.columns)
        for place, row in enumerate(found.rows):
            here[residual, row] = thinned[:, place]
            if np.any(found.fixed[:, place]):
                steady[residual, row] = item.band.condense(found.fixed[:, place])
    draft.columns.append(here)
    draft.fixed.append(steady)


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


def _likeness(shaped: Shaped) -> tuple[object, ...]:
    """What two shapes of one effect on one carrier share if they are the same regression."""
    first = shaped.columns[0]
    marks = tuple((group, tuple(np.round(np.sum(values[:50], axis=0), 9))) for group, values in first.items())
    return (shaped.key[0], shaped.key[1], tuple(shaped.shape.values()), marks)


def instrument(signals: Signals) -> Signals:
    """Replaces the measured effort by its regression on the model's torque and the motion.

    A column that is computed from the reading carries the reading's noise, and so does the residual: the two
    would agree where nothing is. A gain could then explain anything by scaling all away, an elasticity clean data.
    """
    if signals.effort is None:
        return signals
    out = np.empty_like(signals.effort)
    for joint in range(signals.n):
        q, v, a = (x[:, joint] for x in (signals.position, signals.velocity, signals.acceleration))
        basis = np.column_stack([signals.rigid[:, joint], np.ones_like(q), q, v, a, np.tanh(v / 0.05)])
        solution = np.linalg.lstsq(basis, signals.effort[:, joint], rcond=None)[0]
        out[:, joint] = basis @ solution
    return replace(signals, effort=out)
