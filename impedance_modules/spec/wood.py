# SPDX-License-Identifier: BSD-3-Clause
"""What a task file says about wood on top of a box: a texture that wears off, and splinters that hold and break."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from impedance_modules.errors import Problem
from impedance_modules.spec.task_draft import Draft

LARGEST = 1.0
"""Area of wood that the plant keeps account of [m^2]."""


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


def build_wood(raw: Mapping[str, Any]) -> WoodSpec:
    """Makes the wood of one surface from clean plain data."""
    roughness, splinters = raw.get("roughness"), raw.get("splinters")
    return WoodSpec(
        seed=int(raw["seed"]),
        roughness=None
        if roughness is None
        else RoughnessSpec(
            **{name: float(roughness[name]) for name in ("height", "wavelength", "friction", "wear")}
        ),
        splinters=None
        if splinters is None
        else SplintersSpec(
            density=float(splinters["density"]),
            force=(float(splinters["force"][0]), float(splinters["force"][1])),
            endurance=float(splinters["endurance"]),
            reach=float(splinters["reach"]),
        ),
    )


def wood_problems(draft: Draft) -> Iterator[Problem]:
    """Checks that every piece of wood is small enough to keep account of, and its forces are in order."""
    for i in draft.count("environment"):
        at = ("environment", i, "wood")
        if not (draft.clean(*at) and draft.clean("environment", i, "size")):
            continue
        size, wood = draft.value("environment", i, "size"), build_wood(draft.value(*at))
        if size[0] * size[1] > LARGEST:
            message = (
                f"wood of {size[0]:g} m x {size[1]:g} m is more than the plant keeps account of; valid: a top "
                f"face of at most {LARGEST:g} m^2"
            )
            yield draft.problem(at, message, at="key")
        if wood.splinters is not None and wood.splinters.force[0] > wood.splinters.force[1]:
            low, high = wood.splinters.force
            message = f"the least breaking force, {low:g} N, is above the largest, {high:g} N"
            yield draft.problem((*at, "splinters", "force"), message)
