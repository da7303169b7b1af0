# SPDX-License-Identifier: BSD-3-Clause
"""Pushes from outside as a cause: it happened, it is no property of the robot, and no patch wears it."""

from __future__ import annotations

from collections.abc import Sequence

from impedance_modules.diagnosis.contact_forces import SPACING
from impedance_modules.diagnosis.model_selection.external_pushes import Push
from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.result import Cause, Estimate, Rival
from impedance_modules.effects.external_contact import FORCE


def contact_cause(pushes: Sequence[Push], prepared: Sequence[Prepared], share: float) -> Cause:
    """Describes the strongest push on every link that was pushed.

    Args:
        pushes: One or more.
        prepared: The recordings that their indices refer to.
        share: Part of the gap that they make.
    """
    strongest = {push.body: push for push in sorted(pushes, key=lambda push: push.gain)}
    parameters = {}
    for body, push in strongest.items():
        named = zip(FORCE, push.force, push.std, strict=True)
        forces = {symbol: Estimate(float(value), float(std), "N") for symbol, value, std in named}
        times = {"start": Estimate(push.start, SPACING, "s"), "end": Estimate(push.end, SPACING, "s")}
        parameters[body] = {**forces, **times}
    names = [prepared[push.recording].log.name for push in pushes]
    told = ", ".join(f"{name} ({names.count(name)})" for name in dict.fromkeys(names))
    return Cause(
        effect="external_contact",
        joints=(),
        port="contact",
        parameters=parameters,
        weight=share,
        shrink=None,
        equivalent=(),
        rivals=(
            Rival("free torques", (), f"one force explains the joints together; pushes in {told}, set aside"),
        ),
        position_range={},
        velocity_range={},
    )
