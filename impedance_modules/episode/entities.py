# SPDX-License-Identifier: BSD-3-Clause
"""Where each thing lives in a rerun recording; the writer and the layout both ask here."""

from __future__ import annotations

import rerun as rr

APPLICATION = "impedance_modules"
TIMELINE = "time"
WORLD = "/world"
TANK = "/energy/tank"
ACTIVE_ROWS = "/safety/active_rows"
PHASE = "/task/phase"
LOG = "/task/log"
POSITION_ERROR = "/tracking/position_mm"
ANGLE_ERROR = "/tracking/angle_deg"


def entity(*parts: str) -> str:
    """Returns an entity path; a slash inside a name makes a level, other signs are escaped."""
    names = [name for part in parts for name in part.split("/") if name]
    return "/" + "/".join(rr.escape_entity_path_part(name) for name in names)


def body_path(role: str, name: str) -> str:
    """Returns the path of a body; its shapes lie below it."""
    return entity("world", role, name)


def spring_path(name: str) -> str:
    """Returns the path of a spring's line."""
    return entity("world", "springs", name)


def wrench_path(name: str) -> str:
    """Returns the path of a wrench's arrows."""
    return entity("world", "wrenches", name)


def ellipsoid_path(name: str) -> str:
    """Returns the path of an ellipsoid."""
    return entity("world", "ellipsoids", name)


def torque_path(limb: str) -> str:
    """Returns the path of a limb's torque over limit."""
    return entity("torque", limb)


def force_path(name: str) -> str:
    """Returns the path of the curves of a wrench's force."""
    return entity("force", name)


def column_path(kind: str, name: str) -> str:
    """Returns the path of curves taken straight from an episode's columns."""
    return entity("episode", kind, name)
