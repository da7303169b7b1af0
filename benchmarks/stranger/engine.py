# SPDX-License-Identifier: BSD-3-Clause
"""DART as a calculator of mass matrix, weight and Jacobians; the integration is this package's own."""

from __future__ import annotations

import copy
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY = 9.81


class Arm:
    """An arm that DART knows; q [rad], v [rad/s], a [rad/s^2], torques [N.m]."""

    def __init__(self, root: ET.Element) -> None:
        """Parses a description, on a base that stands still."""
        import dartpy

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "arm.urdf"
            ET.ElementTree(_on_the_world(root)).write(path)
            self.skeleton: Any = dartpy.utils.DartLoader().parseSkeleton(str(path))
        self.names = [self.skeleton.getDof(i).getName() for i in range(self.skeleton.getNumDofs())]
        self.n = len(self.names)
        self.skeleton.setGravity([0.0, 0.0, -GRAVITY])

    def lean(self, rx: float, ry: float) -> None:
        """Tilts the base by rx about its x axis, then ry about y [rad]: gravity as the base sees it."""
        cx, sx, cy, sy = np.cos(rx), np.sin(rx), np.cos(ry), np.sin(ry)
        turn = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]]) @ np.array(
            [[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]
        )
        self.skeleton.setGravity(turn.T @ np.array([0.0, 0.0, -GRAVITY]))

    def at(self, q: Array, v: Array) -> None:
        """Puts the arm to a state."""
        self.skeleton.setPositions(q)
        self.skeleton.setVelocities(v)

    def mass_and_bias(self) -> tuple[Array, Array]:
        """M(q), and weight plus what comes of speed, where the arm was put."""
        return self.skeleton.getMassMatrix(), self.skeleton.getCoriolisAndGravityForces()

    def weight(self, q: Array) -> Array:
        """Torques that hold the arm's weight."""
        self.skeleton.setPositions(q)
        held: Array = self.skeleton.getGravityForces()
        return held

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Inverse dynamics of many rows."""
        out = np.empty_like(q)
        for k in range(len(q)):
            self.at(q[k], v[k])
            mass, bias = self.mass_and_bias()
            out[k] = mass @ a[k] + bias
        return out

    def place(self, link: str, point: Array) -> tuple[Array, Array, Array]:
        """Of a point fixed to a link: where it is [m], its linear and its angular Jacobian (base axes)."""
        body = self.skeleton.getBodyNode(link)
        where = body.getWorldTransform().multiply(point)
        return where, self.skeleton.getLinearJacobian(body, point), self.skeleton.getAngularJacobian(body)


def _on_the_world(root: ET.Element) -> ET.Element:
    """DART lets an arm float unless it hangs on a world, and gives links without a body one of 1 kg."""
    root = copy.deepcopy(root)
    for link in root.findall("link"):
        if link.find("inertial") is None and link.get("name") != "world":
            inertial = ET.SubElement(link, "inertial")
            ET.SubElement(inertial, "mass", {"value": "1e-9"})
            ET.SubElement(
                inertial,
                "inertia",
                {"ixx": "1e-12", "iyy": "1e-12", "izz": "1e-12", "ixy": "0", "ixz": "0", "iyz": "0"},
            )
    children = {c.get("link") for c in root.iter("child")}
    base = next(link.get("name", "") for link in root.findall("link") if link.get("name") not in children)
    if base != "world":
        ET.SubElement(root, "link", {"name": "world"})
        joint = ET.SubElement(root, "joint", {"name": "stranger_floor", "type": "fixed"})
        ET.SubElement(joint, "parent", {"link": "world"})
        ET.SubElement(joint, "child", {"link": base})
        ET.SubElement(joint, "origin", {"xyz": "0 0 0", "rpy": "0 0 0"})
    return root
