# SPDX-License-Identifier: BSD-3-Clause
"""A cause as an entry of a patch: what, applied to the robot, does what was found.

That is the cause itself but for one: a spring that the recordings show only at the links of a robot that carries its
own weight. Told of as the robot's, it would be carried, too, and change nothing; it is stated as one outside.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from impedance_modules.diagnosis.result import Cause, Estimate
from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.effect_description import Port

LONG = 1e-6
"""Stiffness over torque [1/rad] of a spring whose torque is constant."""


@dataclass(frozen=True)
class PatchEntry:
    """An effect with its numbers.

    Attributes:
        effect: Id.
        joints: On which it acts.
        port: At which.
        parameters: Carrier -> symbol -> estimate.
    """

    effect: str
    joints: tuple[str, ...]
    port: Port
    parameters: Mapping[str, Mapping[str, Estimate]]


def patch_entry(cause: Cause) -> PatchEntry:
    """States a cause so that it can be applied."""
    outside = CATALOGUE[cause.effect].stated_outside
    if not cause.outside or outside is None:
        return PatchEntry(cause.effect, cause.joints, cause.port, cause.parameters)
    parameters = {key: _relaxed(symbols) for key, symbols in cause.parameters.items()}
    return PatchEntry(outside, cause.joints, CATALOGUE[outside].description.ports[0], parameters)


def _relaxed(spring: Mapping[str, Estimate]) -> dict[str, Estimate]:
    r"""Gives k and q_0 = \tau_0 / k, with its error to first order, of a spring with a preload \tau_0.

    One without stiffness is so long that its torque is the same wherever the joint is.
    """
    k, preload = spring["k"], spring["preload"]
    if k.value == 0.0:
        k = Estimate(LONG * abs(preload.value), 0.0, k.unit)
    angle = preload.value / k.value
    return {"k": k, "q0": Estimate(angle, math.hypot(preload.std, angle * k.std) / k.value, "rad")}
