# SPDX-License-Identifier: BSD-3-Clause
"""Draws the solids of a body in rerun: capsules, boxes, cylinders, spheres."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import rerun as rr

from impedance_modules.episode.palette import BODY
from impedance_modules.episode.view_scene import Body, BodyShape


def solid(shape: BodyShape, body: Body) -> Any:
    """Returns a shape as rerun draws it, in its body's frame and colour."""
    # What the hands touch is see-through, so that springs and ellipsoids inside it stay visible.
    fill = "solid" if body.role == "robot" else "transparentfillmajorwireframe"
    return _SOLIDS[shape.kind](shape, {"colors": [BODY[body.role]], "fill_mode": fill})


def _capsule(shape: BodyShape, look: dict[str, Any]) -> Any:
    radius, length = shape.size
    x, y, z, w = shape.pose[3:]
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    # rerun measures a capsule from the centre of its lower cap.
    start = np.array(shape.pose[:3]) - axis * length / 2
    return rr.Capsules3D(
        lengths=[length],
        radii=[radius],
        translations=[start],
        quaternions=[shape.pose[3:]],
        **look,
    )


def _box(shape: BodyShape, look: dict[str, Any]) -> Any:
    return rr.Boxes3D(sizes=[shape.size], **_placed(shape), **look)


def _cylinder(shape: BodyShape, look: dict[str, Any]) -> Any:
    radius, length = shape.size
    return rr.Cylinders3D(radii=[radius], lengths=[length], **_placed(shape), **look)


def _sphere(shape: BodyShape, look: dict[str, Any]) -> Any:
    return rr.Ellipsoids3D(radii=[shape.size[0]], **_placed(shape), **look)


def _placed(shape: BodyShape) -> dict[str, Any]:
    return {"centers": [shape.pose[:3]], "quaternions": [shape.pose[3:]]}


_SOLIDS: dict[str, Callable[[BodyShape, dict[str, Any]], Any]] = {
    "capsule": _capsule,
    "box": _box,
    "cylinder": _cylinder,
    "sphere": _sphere,
}
