# SPDX-License-Identifier: BSD-3-Clause
"""Where the gap is: shares of joints, ports, regimes of motion and frequencies, and held-out residuals over time."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.gap_result import GapLocation, ResidualSeries
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.residuals.preparation import Prepared

Mask = NDArray[np.bool_]

SLOW, FAST = 0.05, 0.5
"""Speeds below the first are slow, above the second fast [rad/s]."""

HOLD_SPEED = 0.01
"""Speed below which a joint holds its position [rad/s]."""

LIMIT_DISTANCE = 0.05
"""Distance from a position limit that is near it [rad]."""

SHARE_MIN = 0.01
"""Smaller shares are not listed."""

PORT_OF_RESIDUAL = {
    "actuator": "actuator",
    "drive": "actuator",
    "link": "link",
    "motor": "actuator",
    "whole": "actuator",
    "velocity": "sensor",
}
"""Residual -> port at which it is measured."""

MOST_RECORDINGS = 4
"""Held-out recordings that are kept for report and viewer."""


def locate_gap(evidence: Evidence, model: NominalModel) -> tuple[GapLocation, ...]:
    """Shares of joints, ports and regimes in the excess residual power, the largest first."""
    places: list[tuple[float, GapLocation]] = []
    prepared, floor, noise = evidence.prepared, evidence.floor, evidence.heldout_noise
    left = [evidence.plain.left(evidence.calibrated, r) for r in range(len(prepared))]
    for group, (residual, joint) in enumerate(evidence.design.groups):
        excess: dict[str, float] = {}
        series = [found[group] for found in left]
        for r, (item, values) in enumerate(zip(prepared, series, strict=True)):
            power = (values**2 - floor.rms[r, group] ** 2) / noise[group] ** 2
            counted = evidence.counted(r, group)
            sorted_out = {name: mask & counted for name, mask in regimes(item, model, joint).items()}
            for name, mask in (sorted_out | {"contact": evidence.touched(r, group)}).items():
                excess[name] = excess.get(name, 0.0) + float(power[mask].sum())
        band = _band(series, prepared[0])
        for name, value in excess.items():
            if value > 0.0:
                port = "contact" if name == "contact" else PORT_OF_RESIDUAL[residual]
                places.append((value, GapLocation(model.joints[joint], port, name, band, value)))
    total = sum(value for value, _ in places)
    found = [
        GapLocation(place.joint, place.port, place.regime, place.band, value / total)
        for value, place in sorted(places, key=lambda pair: -pair[0])
        if value >= SHARE_MIN * total
    ]
    return tuple(found)


def regimes(item: Prepared, model: NominalModel, joint: int) -> dict[str, Mask]:
    """Regime of motion of one joint -> (M,) mask of a recording's samples; a sample belongs to the first that fits."""
    q, v, a = item.position[:, joint], item.velocity[:, joint], item.acceleration[:, joint]
    limits = model.tree.bodies[joint].limits
    near = np.zeros(len(q), dtype=bool)
    if limits is not None and limits.upper > limits.lower:
        near = (q < limits.lower + LIMIT_DISTANCE) | (q > limits.upper - LIMIT_DISTANCE)
    turning = np.abs(np.sign(v) - np.sign(np.roll(v, 3))) > 1.0
    reversal = (np.abs(v) < SLOW) & (turning | np.roll(turning, -3) | (np.abs(a) > SLOW))
    tests = {
        "saturated": np.abs(item.load[:, joint]) >= 0.99 * model.effort_max[joint],
        "near_limit": near,
        "reversal": reversal,
        "hold": np.abs(v) < HOLD_SPEED,
        "accelerating": np.abs(a) > 2.0 * np.abs(v) + FAST,
        "fast": np.abs(v) >= FAST,
        "slow": np.ones(len(q), dtype=bool),
    }
    out, left = {}, np.ones(len(q), dtype=bool)
    for name, mask in tests.items():
        out[name] = mask & left
        left = left & ~mask
    return out


def held_out_series(
    evidence: Evidence, model: NominalModel, named: Collection[tuple[str, str]]
) -> tuple[ResidualSeries, ...]:
    """Collects every residual of the first held-out recordings: nominal, with named causes alone, and refitted."""
    units = model.tree.units()
    out = []
    for index in evidence.heldout[:MOST_RECORDINGS]:
        item = evidence.prepared[index]
        refitted = evidence.plain.left(evidence.model_fit, index)
        left = evidence.left_with(named, index)
        regime_names = [_regime_names(item, model, joint) for joint in range(model.n)]
        for group, (residual, joint) in enumerate(evidence.design.groups):
            out.append(
                ResidualSeries(
                    joint=model.joints[joint],
                    residual=residual,
                    unit="rad/s" if residual == "velocity" else units[joint],
                    episode=item.log.name,
                    time=item.time,
                    measured=_measured(item, residual)[:, joint],
                    before=evidence.design.raw[index][group],
                    after=left[group],
                    refitted=refitted[group],
                    regimes=regime_names[joint],
                )
            )
    return tuple(out)


def _measured(item: Prepared, residual: str) -> Array:
    """Measured quantity of a residual, in the band, (M, n)."""
    s, log = item.signals, item.log
    if residual == "velocity" and log.velocity is not None:
        return item.band.condense(log.velocity)
    if residual in {"link", "motor"} and s.effort is not None:
        return item.band.condense(s.effort)
    return item.band.condense(s.drive if s.drive is not None else np.zeros_like(s.position))


def _regime_names(item: Prepared, model: NominalModel, joint: int) -> tuple[str, ...]:
    """Name of the regime at every sample."""
    out = np.full(item.samples, "", dtype=object)
    for name, mask in regimes(item, model, joint).items():
        out[mask] = name
    return tuple(out.tolist())


def _band(series: Sequence[Array], item: Prepared) -> tuple[float, float]:
    """Frequencies between which the middle four fifths of the power lie [Hz]."""
    longest = max(series, key=len)
    power = np.abs(np.fft.rfft(np.hanning(len(longest)) * longest)) ** 2
    frequency = np.fft.rfftfreq(len(longest), item.band.step / item.band.rate)
    part = np.cumsum(power) / max(float(power.sum()), 1e-30)
    return float(frequency[np.searchsorted(part, 0.1)]), float(frequency[np.searchsorted(part, 0.9)])
