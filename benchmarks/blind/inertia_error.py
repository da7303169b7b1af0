# SPDX-License-Identifier: BSD-3-Clause
"""Links that are not quite what the URDF says: 0 to 3 % in mass, centre of mass and inertia."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.blind.arm_model import Inertial, Link


def wrong_by(links: tuple[Link, ...], level: float, rng: np.random.Generator) -> tuple[Link, ...]:
    """Returns links whose inertial numbers are off by a relative standard deviation ``level``."""
    return tuple(
        link if link.inertial is None else replace(link, inertial=_vary(link.inertial, level, rng))
        for link in links
    )


def _vary(inertial: Inertial, level: float, rng: np.random.Generator) -> Inertial:
    mass, size = np.exp(level * rng.standard_normal(2))
    shift = level * float(np.linalg.norm(inertial.com)) / np.sqrt(3) * rng.standard_normal(3)
    return Inertial(inertial.mass * mass, inertial.com + shift, inertial.inertia * mass * size)
