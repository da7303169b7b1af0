# SPDX-License-Identifier: BSD-3-Clause
r"""The inertia that MuJoCo makes of a body's geoms, where the body has no <inertial>: solids of even density.

About the centre, in the geom's axes, z along its length, with radius r, half length l, half sides or axes a, b, c:

    sphere     2/5 m r^2                      box        m/3 (b^2 + c^2), ...
    ellipsoid  m/5 (b^2 + c^2), ...           cylinder   m (3 r^2 + 4 l^2) / 12,  m r^2 / 2
    capsule    a cylinder and two half spheres, of one density
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.export.body_inertia import BodyInertia, steiner
from impedance_modules.export.mujoco_bodies import ORIENTATIONS, orientation_of, rotation_between, sized
from impedance_modules.export.mujoco_model import MujocoDescription

DENSITY = 1000.0
"""Of a geom that states none [kg/m^3]."""

GROUPS = (0.0, 5.0)
"""Groups of geoms that count, where <compiler inertiagrouprange> does not say."""

SIZES = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
"""Types of geoms that are solids -> how many numbers their size has."""

_LENGTHS = ("capsule", "cylinder", "ellipsoid", "box")
"""Types that <fromto> may place."""


def inertia_of_geoms(
    model: MujocoDescription, geoms: Sequence[tuple[ET.Element, Array, Array]]
) -> BodyInertia:
    """Adds up the inertia of geoms.

    Args:
        model: Whose; what cannot be computed is noted in its faults.
        geoms: Element, and rotation (3, 3) and place (3,) [m] of what it stands in, in the body.

    Returns:
        Mass, centre of mass and the inertia about it, in the body's axes; no mass without geoms.
    """
    parts = [found for geom in geoms if (found := _inertia(model, *geom)) is not None]
    mass = sum(part.mass for part in parts)
    if mass <= 0.0:
        return BodyInertia(0.0, np.zeros(3), np.zeros((3, 3)))
    centre = np.asarray(sum(part.mass * part.centre for part in parts)) / mass
    about = sum(part.about_centre + steiner(part.mass, part.centre - centre) for part in parts)
    return BodyInertia(mass, centre, np.asarray(about))


def _inertia(model: MujocoDescription, geom: ET.Element, turn: Array, place: Array) -> BodyInertia | None:
    """One geom's inertia in the body's axes; None where it counts for nothing, or a fault."""
    kind = model.value(geom, "type") or "sphere"
    lowest, highest = _counted_groups(model)
    weightless = any(_one(model, geom, key, 1.0) == 0.0 for key in ("mass", "density"))
    if weightless or kind == "plane" or not lowest <= _one(model, geom, "group", 0.0) <= highest:
        return None
    if kind not in SIZES or model.value(geom, "shellinertia") == "true":
        model.faults.add(
            geom,
            f"the mass of the body follows from a geom of the type '{kind}', which is not computed here (valid:"
            " <inertial> in the body, as mujoco.mj_saveLastXML writes it)",
        )
        return None
    inherited = [key for key in ("pos", *ORIENTATIONS) if model.holder(geom, key) not in (None, geom)]
    if inherited:
        model.faults.add(
            geom, f"<geom> takes '{inherited[0]}' from a default class (valid: in the geom itself)"
        )
        return None
    R, p, size = placed_geom(model, geom, kind)
    volume, moments = _solid(kind, size)
    mass = _one(model, geom, "mass", _one(model, geom, "density", DENSITY) * volume)
    R = turn @ R
    return BodyInertia(mass, place + turn @ p, R @ np.diag(mass * moments) @ R.T)


def _one(model: MujocoDescription, geom: ET.Element, key: str, default: float) -> float:
    return float(model.numbers(geom, key, (default,))[0])


def _counted_groups(model: MujocoDescription) -> Array:
    section = model.section("compiler", "inertiagrouprange")
    return np.array(GROUPS) if section is None else sized(model, section, "inertiagrouprange", GROUPS)


def placed_geom(model: MujocoDescription, geom: ET.Element, kind: str) -> tuple[Array, Array, Array]:
    """Rotation (3, 3), centre (3,) [m] and size [m] of a solid geom, by its pos and orientation or by its ends."""
    size = model.numbers(geom, "size", (0.0,))
    if model.value(geom, "fromto") is not None and kind in _LENGTHS:
        ends = model.numbers(geom, "fromto", (0.0,) * 6)
        if ends.size == 6:
            along = ends[:3] - ends[3:]  # z points from the second end to the first, which shows in a box
            half = 0.5 * float(np.linalg.norm(along))
            width = [float(size[0])] * (SIZES[kind] - 1)
            return (
                rotation_between(np.eye(3)[2], along),
                0.5 * (ends[:3] + ends[3:]),
                np.array([*width, half]),
            )
    if size.size < SIZES[kind]:
        model.faults.add(geom, f"a {kind} needs {SIZES[kind]} numbers as 'size'; found {size.size}")
        size = np.ones(3)
    return orientation_of(model, geom), sized(model, geom, "pos", (0.0, 0.0, 0.0)), size


def _solid(kind: str, size: Array) -> tuple[float, Array]:
    """Volume [m^3], and the moments of inertia (3,) of a unit of mass [m^2]."""
    if kind == "sphere":
        r = float(size[0])
        return 4.0 / 3.0 * math.pi * r**3, np.full(3, 0.4 * r * r)
    if kind in ("box", "ellipsoid"):
        a, b, c = size[:3] ** 2
        whole = np.array([b + c, a + c, a + b])
        volume = float(np.prod(size[:3]))
        return (8.0 * volume, whole / 3.0) if kind == "box" else (4.0 / 3.0 * math.pi * volume, whole / 5.0)
    r, half = float(size[0]), float(size[1])
    rod = math.pi * r * r * 2.0 * half
    ends = 4.0 / 3.0 * math.pi * r**3 if kind == "capsule" else 0.0
    across = rod * (3.0 * r * r + 4.0 * half * half) / 12.0
    # Two half spheres, each with its centre of mass 3/8 r beyond the end of the rod.
    across += ends * (0.4 * r * r + half * half + 0.75 * r * half)
    along = rod * 0.5 * r * r + ends * 0.4 * r * r
    volume = rod + ends
    return volume, np.array([across, across, along]) / max(volume, 1e-300)
