# SPDX-License-Identifier: BSD-3-Clause
"""Pieces of wood for the sanding experiment (thesis 5.2): ranges, and one drawn by seed.

The ranges were fixed and committed before any rule that judges roughness was set on them. They are assumptions; the
thesis describes its wood in words only ("a splintered wood block", "a smooth piece of wood"):

- friction of sandpaper on planed wood 0.35 to 0.55, and 0.2 to 0.5 more on rough wood;
- hills of sawn wood 0.3 to 0.8 mm, of planed wood at most 0.08 mm, 8 to 14 mm apart (saw marks);
- sandpaper on hook-and-loop tape gives way like a spring of 4 to 10 kN/m;
- splinters as numerous as one to six per 200 cm^2, which bear 8 to 25 N;
- wear such that a minute of sanding does what took 15 in the thesis (about 20 times softer than real wood).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from impedance_modules.spec.task import SurfaceSpec
from impedance_modules.spec.wood import RoughnessSpec, SplintersSpec, WoodSpec

Range = tuple[float, float]


class WoodKind(Enum):
    """Which wood."""

    ROUGH = "rough"
    SMOOTH = "smooth"


@dataclass(frozen=True)
class Ranges:
    """Between which numbers the pieces of one kind lie, evenly.

    Attributes:
        height: Of the highest hills [m].
        rough_friction: Coefficient that fresh wood adds.
        density: Of splinters [1/m^2]; both 0 for none.
    """

    height: Range
    rough_friction: Range
    density: Range


KINDS: dict[WoodKind, Ranges] = {
    WoodKind.ROUGH: Ranges(height=(3e-4, 8e-4), rough_friction=(0.2, 0.5), density=(50.0, 300.0)),
    WoodKind.SMOOTH: Ranges(height=(1e-5, 8e-5), rough_friction=(0.0, 0.08), density=(0.0, 0.0)),
}
BASE_FRICTION: Range = (0.35, 0.55)
WAVELENGTH: Range = (0.008, 0.014)
BACKING_STIFFNESS: Range = (4e3, 1e4)
WEAR: Range = (4e3, 1.2e4)
LEAST_FORCE: Range = (8.0, 12.0)
MOST_FORCE: Range = (15.0, 25.0)
ENDURANCE: Range = (0.1, 0.4)
REACH = 0.004
"""How near the tool must come to a splinter [m]."""


def draw_wood(board: SurfaceSpec, kind: WoodKind, seed: int) -> SurfaceSpec:
    """Draws a piece of wood of the same shape and place as a task's board.

    Args:
        board: A box of the task's environment.
        kind: Rough or smooth.
        seed: Of this piece; the same for both kinds gives what they share the same values.
    """
    source = np.random.default_rng([seed, 2])
    ranges = KINDS[kind]

    def between(low_high: Range) -> float:
        return float(source.uniform(*low_high))

    friction, stiffness = between(BASE_FRICTION), between(BACKING_STIFFNESS)
    wavelength, wear = between(WAVELENGTH), between(WEAR)
    force, endurance = (between(LEAST_FORCE), between(MOST_FORCE)), between(ENDURANCE)
    height, rough_friction, density = (
        between(ranges.height),
        between(ranges.rough_friction),
        between(ranges.density),
    )
    splinters = SplintersSpec(density, force, endurance, REACH) if density > 0.0 else None
    wood = WoodSpec(seed, RoughnessSpec(height, wavelength, rough_friction, wear), splinters)
    return replace(board, friction=friction, stiffness=stiffness, wood=wood)
