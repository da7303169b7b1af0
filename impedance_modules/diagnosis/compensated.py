# SPDX-License-Identifier: BSD-3-Clause
r"""A warning where a robot that carries its own weight may carry a spring of its own by numbers of its own.

A robot that knows a spring beside a joint adds what winds it to the command. The spring then shows at the link,
\tau_{sensor} - \tau_{model}, and once more at the motor, \tau_{sensor} - \tau_{command} - g, with the opposite sign:
that is searched (`effects.springs`). Where it adds something else than the spring takes, no single effect fits both
and what imitates it best is named. Without the commands only the link is left.
"""

from __future__ import annotations

from collections.abc import Sequence

from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.result import Cause

SPRING, IMITATION = "parallel_spring", "crosstalk"
"""What such a spring is named, among those that do as well or by a sensor that hears another joint."""


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
    known = {joint for cause in causes if cause.effect == SPRING for joint in cause.joints}
    found = [
        cause
        for cause in causes
        if cause.effect != SPRING
        and not set(cause.joints) <= known
        and {cause.effect, *(rival.effect for rival in cause.equivalent)} & {SPRING, IMITATION}
    ]
    if not found:
        return ()
    names = "; ".join(f"{cause.effect} on {', '.join(cause.joints)}" for cause in found)
    return (
        f"{names}: the robot adds torques of its own, and a spring beside a joint that it compensates shows both at the"
        " link and at the motor, where one effect in one place does not explain it (valid: the same motions without"
        " effort_command, as `impedance baxter record` writes them)",
    )
