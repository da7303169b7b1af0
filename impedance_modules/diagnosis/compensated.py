# SPDX-License-Identifier: BSD-3-Clause
r"""A warning where a robot that carries its own weight may carry a spring of its own as well.

A robot that compensates a spring beside a joint adds the negative of its torque to the command. The spring then shows
at the link, \tau_{sensor} - \tau_{model}, and once more at the motor, \tau_{sensor} - \tau_{command} - g, and the
search puts one effect in one of them. Without the commands only the first is left.
"""

from __future__ import annotations

from collections.abc import Sequence

from impedance_modules.diagnosis.prepare import Prepared
from impedance_modules.diagnosis.result import Cause

TWOFOLD = ("parallel_spring", "crosstalk")
"""What such a spring is named: itself, or a sensor that hears another joint."""


def compensation_note(prepared: Sequence[Prepared], causes: Sequence[Cause]) -> tuple[str, ...]:
    """Says that a spring which the robot compensates may be behind a cause, and which recordings would tell.

    Args:
        prepared: The recordings.
        causes: What was named.

    Returns:
        One sentence, or none where commands or sensors are missing, or nothing that such a spring looks like was named.
    """
    both = all({"link", "actuator"} <= set(item.residuals) for item in prepared)
    if not both or any(item.log.gravity_compensation != "robot" for item in prepared):
        return ()
    found = [cause for cause in causes if {cause.effect, *(e.effect for e in cause.equivalent)} & {*TWOFOLD}]
    if not found:
        return ()
    names = "; ".join(f"{cause.effect} on {', '.join(cause.joints)}" for cause in found)
    return (
        f"{names}: the robot adds torques of its own, and a spring beside a joint that it compensates shows both at the"
        " link and at the motor, where one effect in one place does not explain it (valid: the same motions without"
        " effort_command, as `impedance baxter record` writes them)",
    )
