# SPDX-License-Identifier: BSD-3-Clause
"""An independent opinion on a URDF: read with ElementTree into PyKDL chains, sharing nothing with pinocchio.

PyKDL is a Debian package (python3-pykdl) and not on every machine; ``load_pykdl`` skips the test without it.
"""

import importlib.util
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

DEBIAN_PACKAGES = Path("/usr/lib/python3/dist-packages")


def load_pykdl() -> ModuleType:
    """Imports PyKDL alone, from here or from Debian's Python of the same version."""
    if importlib.util.find_spec("PyKDL") is None:
        version = f"cpython-{sys.version_info.major}{sys.version_info.minor}"
        found = sorted(DEBIAN_PACKAGES.glob(f"PyKDL.{version}*.so"))
        if not found:
            pytest.skip("PyKDL is not installed (Debian: python3-pykdl)")
        spec = importlib.util.spec_from_file_location("PyKDL", found[0])
        module = importlib.util.module_from_spec(spec)
        sys.modules["PyKDL"] = module
        spec.loader.exec_module(module)
    return importlib.import_module("PyKDL")


def _numbers(element: ET.Element | None, key: str, default: str = "0 0 0") -> list[float]:
    return [float(x) for x in (default if element is None else element.get(key, default)).split()]


class KdlArm:
    """The chain from the root to one link, with its dynamics."""

    def __init__(self, urdf: Path, tip: str) -> None:
        self.kdl = load_pykdl()
        root = ET.parse(urdf).getroot()
        links = {link.get("name"): link for link in root.findall("link")}
        above = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
        steps = []
        while tip in above:
            steps.append((above[tip], links[tip]))
            tip = above[tip].find("parent").get("link")
        self.chain = self.kdl.Chain()
        self.joint_names: list[str] = []
        for joint, link in reversed(steps):
            self._add(joint, link)
        self.n = len(self.joint_names)
        self._pose = self.kdl.ChainFkSolverPos_recursive(self.chain)
        self._jacobian = self.kdl.ChainJntToJacSolver(self.chain)
        self._dynamics = self.kdl.ChainDynParam(self.chain, self.kdl.Vector(0, 0, -9.81))

    def _frame(self, origin: ET.Element | None) -> Any:
        kdl = self.kdl
        return kdl.Frame(kdl.Rotation.RPY(*_numbers(origin, "rpy")), kdl.Vector(*_numbers(origin, "xyz")))

    def _add(self, joint: ET.Element, link: ET.Element) -> None:
        kdl, frame = self.kdl, self._frame(joint.find("origin"))
        if joint.get("type") == "fixed":
            kdl_joint = kdl.Joint(joint.get("name"), kdl.Joint.Fixed)
        else:
            axis = frame.M * kdl.Vector(*_numbers(joint.find("axis"), "xyz", "1 0 0"))
            kdl_joint = kdl.Joint(joint.get("name"), frame.p, axis, kdl.Joint.RotAxis)
            self.joint_names.append(joint.get("name"))
        self.chain.addSegment(kdl.Segment(link.get("name"), kdl_joint, frame, self._inertia(link)))

    def _inertia(self, link: ET.Element) -> Any:
        kdl, inertial = self.kdl, link.find("inertial")
        if inertial is None:
            return kdl.RigidBodyInertia(0.0, kdl.Vector(0, 0, 0), kdl.RotationalInertia(0, 0, 0, 0, 0, 0))
        about = inertial.find("inertia")
        moments = [float(about.get(key)) for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")]
        mass = float(inertial.find("mass").get("value"))
        at_com = kdl.RigidBodyInertia(mass, kdl.Vector(0, 0, 0), kdl.RotationalInertia(*moments))
        return self._frame(inertial.find("origin")) * at_com

    def _array(self, q: np.ndarray) -> Any:
        array = self.kdl.JntArray(self.n)
        for i, value in enumerate(q):
            array[i] = float(value)
        return array

    def pose(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) and origin (3,) of the tip in the root."""
        frame = self.kdl.Frame()
        self._pose.JntToCart(self._array(q), frame)
        rotation = np.array([[frame.M[i, j] for j in range(3)] for i in range(3)])
        return rotation, np.array([frame.p[i] for i in range(3)])

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """(6, n) linear then angular, root axes at the tip."""
        jacobian = self.kdl.Jacobian(self.n)
        self._jacobian.JntToJac(self._array(q), jacobian)
        return np.array([[jacobian[i, j] for j in range(self.n)] for i in range(6)])

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """(n, n) joint-space inertia of the links [kg.m^2]."""
        matrix = self.kdl.JntSpaceInertiaMatrix(self.n)
        self._dynamics.JntToMass(self._array(q), matrix)
        return np.array([[matrix[i, j] for j in range(self.n)] for i in range(self.n)])

    def gravity(self, q: np.ndarray) -> np.ndarray:
        """(n,) torque that holds the weight [N.m]."""
        torque = self.kdl.JntArray(self.n)
        self._dynamics.JntToGravity(self._array(q), torque)
        return np.array([torque[i] for i in range(self.n)])
