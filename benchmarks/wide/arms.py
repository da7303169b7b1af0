# SPDX-License-Identifier: BSD-3-Clause
"""One arm as it really is, with drives, sensors and a controller that fit its size; and the files that describe it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.blind.arm_model import Drive, Joints, Link
from benchmarks.blind.bodies import wrong_by
from benchmarks.blind.plant import Arm
from benchmarks.blind.records import Faults
from benchmarks.wide.mujoco_engine import Rigid
from benchmarks.wide.plan import Control, Plan, Sensing
from benchmarks.wide.robots import ROBOTS, Machine, mounted

Array = NDArray[np.float64]

DOWN = np.array([0.0, 0.0, -9.81])
GRIDS = {"so100": 12, "baxter": 14, "planar_1": 14, "planar_2": 15, "planar_3": 16}
"""Bits of the encoders of a turn; 17 for the other arms."""
SPRING = 12.0
"""Frequency [Hz] of a joint's spring between rotor and link."""
VELOCITY_FILTERS = {"filtered": 0.006, "observer": 0.0037}
"""What the robot file states of the reported velocity [s]; an observer's is the lag of its two poles."""
COMMAND_DELAY = 0.002
"""Stated by the robot file [s]; a bare URDF states none, and none is there."""


@dataclass(frozen=True)
class WideArm(Arm):
    """An arm of the blind benchmark with what varies here.

    Attributes:
        machine: Links and limits as they are known.
        values: Dimension -> value of the case.
        control: Its controller.
        sensing: Its sensors.
    """

    machine: Machine = field(default_factory=ROBOTS["planar_1"])
    values: Mapping[str, str] = field(default_factory=dict)
    control: Control | None = None
    sensing: Sensing | None = None

    def plan(self, reference: Array, seed: int | None, engine: str | None = None) -> Plan:
        """Returns what is to be simulated for a motion (samples, n) at the control rate."""
        if self.control is None or self.sensing is None:
            raise ValueError("this arm has no controller or no sensors yet")
        pushes = [[push.start, push.end, *push.force] for push in self.pushes]
        return Plan(
            self.links, self.believed, self.machine.hand, self.joints, Joints.nominal(self.drive), self.faults,
            self.gravity, np.array(pushes, float).reshape(-1, 5), self.values["friction"],
            engine or self.values["engine"], reference, self.control, self.sensing, seed,
        )  # fmt: skip


def draw_arm(values: Mapping[str, str], rng: np.random.Generator) -> WideArm:
    """Draws an arm with a controller from the values of a case; its links are off by 0 to 2 %."""
    machine = mounted(ROBOTS[values["robot"]](), values["mount"])
    drive = _drive(machine, values)
    links = wrong_by(machine.links, float(rng.uniform(0.0, 0.02)), rng)
    arm = WideArm(
        machine.name, drive, links, machine.links, Joints.nominal(drive), Faults.none(len(drive.joints)),
        machine=machine, values=values,
    )  # fmt: skip
    return replace(arm, control=_control(arm, rng), sensing=_sensing(machine, values))


def rigid(machine: Machine) -> Rigid:
    """Returns the arm's links as they are known."""
    return Rigid(machine.links, machine.hand, DOWN)


def mean_inertia(machine: Machine) -> Array:
    """Returns the diagonal of the mass matrix (n,), the mean over twelve postures [kg.m^2]."""
    rng, model = np.random.default_rng(0), rigid(machine)
    postures = rng.uniform(machine.position_min, machine.position_max, (12, len(machine.joints)))
    return np.asarray(np.mean([np.diag(model.inertia(q)) for q in postures], axis=0))


def _drive(machine: Machine, values: Mapping[str, str]) -> Drive:
    inertia, n = mean_inertia(machine), len(machine.joints)
    known = values["known_by"] == "robot_file"
    rotor = _rounded(0.6 * inertia) if known else np.zeros(n)
    damping = _rounded(0.5 * inertia) if known else np.zeros(n)
    stiffness, spring_damping = np.full(n, np.inf), np.zeros(n)
    if values["transmission"] == "spring":
        reduced = rotor * inertia / (rotor + inertia)
        stiffness = np.minimum(_rounded((2 * np.pi * SPRING) ** 2 * reduced), 9e5)
        spring_damping = _rounded(2 * 0.04 * np.sqrt(stiffness * reduced))
    sensing = _sensing(machine, values)
    return Drive(
        machine.joints, machine.position_min, machine.position_max, machine.velocity_max, machine.effort_max,
        stiffness, spring_damping, rotor, damping, COMMAND_DELAY if known else 0.0, sensing.position_grid,
        sensing.position_noise, float(sensing.effort_grid.min()), float(sensing.effort_noise.min()),
        VELOCITY_FILTERS.get(values["velocity"], 0.0),
    )  # fmt: skip


def _sensing(machine: Machine, values: Mapping[str, str]) -> Sensing:
    grid = 2 * np.pi / 2 ** GRIDS.get(values["robot"], 17)
    effort = 0.0012 * machine.effort_max
    source = {"motor": "motor", "command+motor": "motor", "command": None}.get(
        values["streams"], "joint_sensor"
    )
    coarse = 2.5 if values["noise"] == "quantised" else 0.3
    return Sensing(source, values["noise"], grid, coarse * effort, 0.4 * grid, effort)


def _control(arm: WideArm, rng: np.random.Generator) -> Control:
    law, weight = arm.values["controller"], arm.values["gravity"]
    inertia = mean_inertia(arm.machine) + arm.drive.rotor_inertia
    slow = 0.7 if arm.values["transmission"] == "spring" else 1.0
    low, high = {"position_loop": (2.0, 3.5), "policy": (1.5, 2.5)}.get(law, (0.8, 1.6))
    frequency = 2 * np.pi * slow * rng.uniform(low, high, inertia.size)
    stiffness, damping = inertia * frequency**2, 2 * 0.7 * inertia * frequency
    return Control(
        law, stiffness, damping, 1.5 * stiffness, inertia, weight, 0.001 * float(rng.integers(2, 7)),
        1e-4, arm.drive.effort_max, arm.drive.command_delay,
    )  # fmt: skip


def _rounded(numbers: Array) -> Array:
    """Returns numbers with two digits, as a file states them."""
    return np.array([float(f"{number:.2g}") for number in numbers])


def write_description(arm: WideArm, folder: Path) -> str:
    """Writes URDF and, where the case has one, robot file; returns which of both a tool is given."""
    folder.mkdir(parents=True, exist_ok=True)
    machine, drive = arm.machine, arm.drive
    (folder / f"{machine.name}.urdf").write_text(_urdf(machine))
    if arm.values["known_by"] == "urdf":
        return "urdf"
    names = list(drive.joints)

    def table(numbers: Array) -> dict[str, float]:
        return {name: float(number) for name, number in zip(names, numbers, strict=True)}

    rigid_drives = bool(np.all(np.isinf(drive.spring_stiffness)))
    limits = zip(names, drive.position_min, drive.position_max, strict=True)
    robot = {
        "format": 1,
        "name": machine.name,
        "urdf": f"{machine.name}.urdf",
        "limbs": {"arm": {"hand": machine.hand, "joints": {f"j{i + 1}": name for i, name in enumerate(names)}}},
        "joints": {
            "position": {name: [float(low), float(high)] for name, low, high in limits},
            "velocity": table(drive.velocity_max),
            "effort": table(drive.effort_max),
            "effort_rate": table(100.0 * drive.effort_max),
            "spring_stiffness": dict.fromkeys(names, "rigid") if rigid_drives else table(drive.spring_stiffness),
            "spring_damping": table(drive.spring_damping),
            "reflected_inertia": table(drive.rotor_inertia),
            "motor_damping": table(drive.motor_damping),
        },
        "timing": {
            "rate": 1000, "rate_min": 50, "rate_max": 1000, "command_delay": drive.command_delay,
            "command_timeout": 0.2,
        },
        "sensors": {
            "position_resolution": drive.position_resolution,
            "effort_resolution": drive.effort_resolution,
            "position_noise": drive.position_noise,
            "effort_noise": drive.effort_noise,
            "velocity_filter": drive.velocity_filter,
        },
        "contact_detection": {"force": 5, "time": 0.05},
        "collision": {"margin": 0.02, "pairs": []},
        "gravity_compensation": "robot" if arm.values["gravity"].startswith("robot") else arm.values["gravity"],
        "control_modes": ["torque"],
        "solver": "daqp",
    }  # fmt: skip
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot, sort_keys=False, width=118))
    return "robot_file"


def _urdf(machine: Machine) -> str:
    root = ET.Element("robot", name=machine.name)
    ET.SubElement(root, "link", name="world")
    limits = dict(zip(machine.joints, range(len(machine.joints)), strict=True))
    for link in machine.links:
        _add_joint(root, machine, link, limits)
        body = ET.SubElement(root, "link", name=link.name)
        if link.inertial is not None:
            _add_inertial(body, link)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _add_joint(root: ET.Element, machine: Machine, link: Link, limits: Mapping[str, int]) -> None:
    kind = "fixed" if link.joint is None else "revolute"
    joint = ET.SubElement(root, "joint", name=link.joint or f"{link.name}_fixed", type=kind)
    ET.SubElement(joint, "parent", link=link.parent)
    ET.SubElement(joint, "child", link=link.name)
    ET.SubElement(joint, "origin", xyz=_text(link.position), rpy=_text(link.rpy))
    if link.joint is None:
        return
    at = limits[link.joint]
    ET.SubElement(joint, "axis", xyz=_text(link.axis))
    ET.SubElement(
        joint, "limit", lower=repr(float(machine.position_min[at])), upper=repr(float(machine.position_max[at])),
        velocity=repr(float(machine.velocity_max[at])), effort=repr(float(machine.effort_max[at])),
    )  # fmt: skip


def _add_inertial(body: ET.Element, link: Link) -> None:
    if link.inertial is None:
        return
    part, tensor = ET.SubElement(body, "inertial"), link.inertial.inertia
    ET.SubElement(part, "origin", xyz=_text(link.inertial.com), rpy="0 0 0")
    ET.SubElement(part, "mass", value=repr(float(link.inertial.mass)))
    places = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
    ET.SubElement(part, "inertia", {key: repr(float(tensor[at])) for key, at in places.items()})


def _text(numbers: Array) -> str:
    return " ".join(repr(float(number)) for number in numbers)
