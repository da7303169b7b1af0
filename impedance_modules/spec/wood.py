# SPDX-License-Identifier: BSD-3-Clause
"""What a task file says about wood on top of a box: a texture that wears off, and splinters that hold and break."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RoughnessSpec:
    """The texture of fresh wood; all of it wears off in proportion to one share that goes from 1 to 0.

    Attributes:
        height: Of its highest hills above smooth wood [m].
        wavelength: From hill to hill [m].
        friction: Coefficient that fresh wood adds to the surface's own.
        wear: Friction work that leaves 1/e of it [J/m^2].
    """

    height: float
    wavelength: float
    friction: float
    wear: float


@dataclass(frozen=True)
class SplintersSpec:
    """Splinters strewn evenly; each catches what comes near, holds it, and is gone once broken.

    Attributes:
        density: How many there are [1/m^2].
        force: Least and largest breaking force; each splinter has its own [N].
        endurance: For how long a splinter bears its breaking force [s].
        reach: How near the touching point must come [m].
    """

    density: float
    force: tuple[float, float]
    endurance: float
    reach: float


@dataclass(frozen=True)
class WoodSpec:
    """Wood on the top face of a box.

    Attributes:
        seed: Of where splinters stand, how strong they are, and how the texture runs.
        roughness: None for smooth wood.
        splinters: None for wood without.
    """

    seed: int
    roughness: RoughnessSpec | None
    splinters: SplintersSpec | None
