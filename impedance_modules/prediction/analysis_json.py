# SPDX-License-Identifier: BSD-3-Clause
"""An analysis as JSON: everything that ``analyze`` prints, in full precision (docs/check-and-analyze.md has the keys).

``ELLIPSOIDS`` and ``in_hertz`` are shared with the printed tables, so that both tell the same numbers.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput
from impedance_modules.prediction.analysis import Analysis, CouplingOfHands, FrameImpedance, SpringState
from impedance_modules.robot.rotation import write_quaternion
from impedance_modules.superposition.hinge_impedance import HingeImpedance
from impedance_modules.superposition.modes import VibrationMode
from impedance_modules.superposition.object_sum import Coupling, ObjectSum, Summands
from impedance_modules.superposition.operational_inertia import (
    Ellipsoid,
    angular_ellipsoid,
    linear_ellipsoid,
)

MATRICES = (
    "inertia",
    "inertia_without_reflected",
    "mobility",
    "damping",
    "stiffness",
    "compliance",
    "stiffness_without_preload",
)

ELLIPSOIDS = ("inertia", "mobility", "stiffness")
"""Matrices of which principal values are told."""


def analysis_json(analysis: Analysis) -> dict[str, Any]:
    """Gives ``{"format": 1, "arms": {SIDE: X}, "object": X and the sum, or null}``, and springs between arms."""
    impedance, parts = analysis.object, analysis.sum
    at_object = None if impedance is None else _frame(impedance, analysis.phase)
    if at_object is not None and parts is not None:
        at_object.update(_sum(parts))
        if analysis.hinge is not None:
            at_object["hinge"] = _hinge(analysis.hinge)
    return {
        "format": 1,
        "arms": {limb: _frame(found, analysis.phase) for limb, found in analysis.arms.items()},
        "object": at_object,
        **({"between": [_between(spring) for spring in analysis.between]} if analysis.between else {}),
        **({"coupled": [_coupled(group) for group in analysis.coupled]} if analysis.coupled else {}),
    }


def write_analysis(analysis: Analysis, path: Path) -> None:
    """Writes the JSON file.

    Raises:
        BadInput: The file cannot be written.
    """
    text = json.dumps(analysis_json(analysis), indent=1, allow_nan=False)
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise BadInput(f"--json {path}: cannot be written: {error.strerror}") from None


def quaternion_of(rotation: Array) -> Array:
    """Gives the unit quaternion (x, y, z, w), w >= 0, of a rotation (3, 3)."""
    found = np.empty(4)
    write_quaternion(rotation, found)
    return found


def in_hertz(mode: VibrationMode) -> float:
    """Gives a mode's natural frequency |s| / 2 pi [Hz]."""
    return mode.frequency / (2.0 * math.pi)


def _frame(impedance: FrameImpedance, phase: str | None) -> dict[str, Any]:
    found: dict[str, Any] = {
        "frame": impedance.frame,
        "position": impedance.position.tolist(),
        "orientation": quaternion_of(impedance.rotation).tolist(),
        "q": dict(impedance.q),
        "until_rest": None if impedance.until_rest is None else dict(impedance.until_rest),
    }
    found.update({name: _numbers(getattr(impedance, name)) for name in MATRICES})
    found.update({name: _numbers(getattr(impedance, name)) for name in ("preload", "wrench", "pressure")})
    hold = impedance.friction
    found["friction"] = None if hold is None else {"force": hold.force, "position": hold.position.tolist()}
    found["ellipsoids"] = {name: _ellipsoids(getattr(impedance, name)) for name in ELLIPSOIDS}
    found["modes"] = [
        {"frequency": in_hertz(mode), "damping_ratio": mode.damping_ratio} for mode in impedance.modes
    ]
    found.update({"folds": impedance.folds, "phase": phase})
    return found


def _between(spring: SpringState) -> dict[str, Any]:
    return {
        "name": spring.name,
        "frames": list(spring.frames),
        "stretch": spring.stretch.tolist(),
        "energy": spring.energy,
        "wrench": spring.wrench.tolist(),
        "stiffness": spring.stiffness.tolist(),
        "damping": spring.damping.tolist(),
    }


def _coupled(group: CouplingOfHands) -> dict[str, Any]:
    """Blocks by the limb that feels and the limb that moves."""

    def blocks(matrix: Array | None) -> dict[str, dict[str, Any]] | None:
        if matrix is None:
            return None
        return {
            first: {second: matrix[i, k].tolist() for k, second in enumerate(group.limbs)}
            for i, first in enumerate(group.limbs)
        }

    return {
        "arms": list(group.limbs),
        "stiffness": blocks(group.stiffness),
        "damping": blocks(group.damping),
        "folds": group.folds,
        "modes": [{"frequency": in_hertz(mode), "damping_ratio": mode.damping_ratio} for mode in group.modes],
    }


def _sum(parts: ObjectSum) -> dict[str, Any]:
    return {
        "summands": {name: _summands(found) for name, found in parts.summands.items()},
        "squeeze": parts.squeeze,
        "internal": {limb: wrench.tolist() for limb, wrench in parts.internal.items()},
        "coupling": None
        if parts.plane is None
        else {"plane": parts.plane, **{name: _coupling(found) for name, found in parts.coupling.items()}},
    }


def _hinge(found: HingeImpedance) -> dict[str, Any]:
    parts = {
        name: {"sum": part.sum, "arms": dict(part.arms), **part.more}
        for name, part in (
            ("inertia", found.inertia),
            ("damping", found.damping),
            ("stiffness", found.stiffness),
        )
    }
    own = {name: getattr(found.own, name) for name in ("friction", "damping", "stiffness")}
    return {
        "angle": found.angle,
        **parts,
        "torque": found.torque,
        "bearing": found.bearing.tolist(),
        "own": own,
    }


def _summands(parts: Summands) -> dict[str, Any]:
    more = {name: _numbers(part) for name, part in parts.more.items()}
    return {"arms": {limb: _numbers(part) for limb, part in parts.arms.items()}, **more}


def _coupling(found: Coupling) -> dict[str, Any]:
    return {"arms": dict(found.arms), "sum": found.sum}


def _ellipsoids(matrix: Array | None) -> dict[str, Any] | None:
    if matrix is None:
        return None
    return {"linear": _axes(linear_ellipsoid(matrix)), "angular": _axes(angular_ellipsoid(matrix))}


def _axes(found: Ellipsoid) -> dict[str, Any]:
    """One row of ``directions`` per value."""
    return {"values": found.half_axes.tolist(), "directions": found.directions.T.tolist()}


def _numbers(values: Array | None) -> Any:
    return None if values is None else values.tolist()
