# SPDX-License-Identifier: BSD-3-Clause
"""A cause's parameters laid beside the true ones: how far off, and whether the stated interval covers the truth.

An error is measured against what differs from the robot file, not against the whole number: a rotor of 0.66 kg.m^2
that is believed to have 0.60 is off by 0.06. Components of one vector share the vector's length; places of a payload
are measured against 0.1 m, about a hand, and a spring's rest and preload against one radian of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.blind.arm_model import hand_of, read_arm, read_drive, turned

HAND = 0.1
"""Size [m] against which the place of a payload is measured."""


@dataclass(frozen=True)
class Comparison:
    """One parameter: its relative error, and whether value +- 1.96 std covers the truth (None without a std)."""

    symbol: str
    error: float
    covered: bool | None


def compare(cause: Mapping[str, Any], truth: Mapping[str, Any], side: str) -> list[Comparison]:
    """Returns every parameter that a cause and the truth both state under the same key.

    Args:
        cause: As in design 3.3.
        truth: Sealed record of one effect.
        side: Of the arm.
    """
    found = []
    for key, symbols in _all_keys(truth, side).items():
        said = cause.get("parameters", {}).get(key, {})
        for symbol, true in symbols.items():
            quantity = said.get(symbol)
            if quantity is None or quantity.get("value") is None:
                continue
            off = abs(float(quantity["value"]) - true)
            spread = quantity.get("std")
            scale = _scale(symbol, symbols, key, side)
            covered = None if spread is None else off <= 1.96 * float(spread)
            if scale > 0.0:
                found.append(Comparison(symbol, off / scale, covered))
    return found


def _all_keys(truth: Mapping[str, Any], side: str) -> dict[str, dict[str, float]]:
    """Adds the other names of the same thing: a coupling both ways, a payload on the moving link of the hand."""
    keys: dict[str, dict[str, float]] = {key: dict(symbols) for key, symbols in truth["parameters"].items()}
    if truth["effect"] == "transmission_coupling":
        keys |= {"<-".join(reversed(key.split("<-"))): symbols for key, symbols in keys.items()}
    hand = hand_of(side)
    if truth["effect"] == "payload" and hand in keys:
        link = next(link for link in read_arm(side) if link.name == hand)
        if link.joint is None:
            place = np.array([keys[hand][axis] for axis in ("cx", "cy", "cz")])
            moved = link.position + turned(link.rpy) @ place
            keys[link.parent] = {"m": keys[hand]["m"], **dict(zip(("cx", "cy", "cz"), moved, strict=True))}
    return keys


def _scale(symbol: str, truth: Mapping[str, float], key: str, side: str) -> float:
    drive = read_drive(side)
    nominal = {"Ia": drive.rotor_inertia, "K": drive.spring_stiffness}
    if symbol in nominal:
        return abs(truth[symbol] - float(nominal[symbol][drive.joints.index(key)]))
    if symbol == "s":
        return abs(truth["s"] - 1.0)
    if symbol in ("rx", "ry"):
        return math.hypot(truth["rx"], truth["ry"])
    if symbol in ("cx", "cy", "cz"):
        return HAND
    if symbol == "q0":
        return 1.0
    if symbol == "preload":
        return abs(truth["k"])
    return abs(truth[symbol])
