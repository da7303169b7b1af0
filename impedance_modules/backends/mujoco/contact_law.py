# SPDX-License-Identifier: BSD-3-Clause
r"""A spring-damper of a task as MuJoCo's soft constraint: stiffness k [N/m] and damping c [N.s/m] become ``solref``.

MuJoCo's constraint at depth r < 0, with speed v and acceleration a along it, exerts

    f = (-b v - k_r d r - a) / R,      R = (1 - d) / d \ell,     k_r = -solref_0 / d^2,   b = -solref_1 / d

d is the constraint's impedance (``solimp``, here the same at every depth), \ell the inverse mass that it sees
(``body_invweight0`` of its two bodies). With

    solref = (-k (1 - d) \ell, -c (1 - d) \ell)

f = -k r - c v - a d / ((1 - d) \ell): at rest the task's spring exactly, whatever the mass. The last term is an inertia
that only exists during contact; a small d makes it small.
"""

from __future__ import annotations

from dataclasses import dataclass

CONTACT_IMPEDANCE = 0.1
"""d of contacts: their own inertia is a ninth of the mass that touches."""

GRASP_IMPEDANCE = 0.9
"""d of welds, which are stiffer than anything that happens within a step: nine times the mass, between two bodies
that do not move against each other."""

FRICTION_RATIO = 1000.0
"""MuJoCo's ``impratio``: by how much friction gives way less than the normal force. A hand that sticks creeps by
tenths of a millimetre per second."""

FRICTION_RATE = 800.0
"""Rate at which friction takes the sliding speed away within its cone [1/s]."""


@dataclass(frozen=True)
class Softness:
    """MuJoCo's two lists for one constraint.

    Attributes:
        solref: Stiffness and damping over the constraint's mass, negative: [1/s^2], [1/s].
        solimp: The impedance d at no depth and at full depth, and a width and form that then do not matter.
    """

    solref: tuple[float, float]
    solimp: tuple[float, float, float, float, float]


def softness(stiffness: float, damping: float, lightness: float, impedance: float) -> Softness:
    """Turns a spring-damper into MuJoCo's numbers.

    Args:
        stiffness: k [N/m] or [N.m/rad].
        damping: c [N.s/m] or [N.m.s/rad].
        lightness: The inverse mass that the constraint sees, l [1/kg] or [1/(kg.m^2)].
        impedance: d, between 0 and 1.
    """
    scale = (1.0 - impedance) * lightness
    return Softness((-stiffness * scale, -damping * scale), (impedance, impedance, 1.0, 0.5, 2.0))
