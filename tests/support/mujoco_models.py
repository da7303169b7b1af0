# SPDX-License-Identifier: BSD-3-Clause
"""MuJoCo's models of our robots, and motions of both from rest under the same torques."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from impedance_modules.effects.apply import apply_patch, apply_to_plant
from impedance_modules.plant.plant import Plant, PlantOptions
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_spec import RobotSpec
from tests.support.commands import invoke
from tests.support.effect_recordings import AppliedEffect, patch_of, write_patch
from tests.support.plant_parts import exact, spec_of, with_every

RATE, STEP = 1000.0, 0.25e-3
"""Of the commands [Hz]; of both integrators [s]."""


def rigid(folder: Path) -> RobotSpec:
    """A robot without springs in its joints, whose weight nobody carries; far stops, perfect sensors, no delay."""
    far = with_every(exact(spec_of(folder)), spring_stiffness=None, spring_damping=0.0)
    far = with_every(far, position_min=-1e3, position_max=1e3)
    return replace(far, gravity_compensation="none")


def mujoco_text(robot: RobotSpec, kind: str = "general") -> str:
    """MJCF of a robot to all digits, with its rotors and its motors' damping, an actuator on each joint."""
    root = ElementTree.parse(robot.urdf).getroot()
    motors = "".join(f'    <{kind} name="{name}" joint="{name}"/>\n' for name in robot.joints)
    children = {joint.find("child").get("link") for joint in root.findall("joint")}
    base = next(link for link in root.findall("link") if link.get("name") not in children)
    return (
        f'<mujoco model="{robot.name}">\n  <compiler angle="radian" eulerseq="XYZ"/>\n'
        f'  <option timestep="{STEP}" integrator="RK4"/>\n  <worldbody>\n'
        f"{_body(robot, root, base, None)}  </worldbody>\n  <actuator>\n{motors}  </actuator>\n</mujoco>\n"
    )


def _body(robot: RobotSpec, root: Element, link: Element, joint: Element | None) -> str:
    """A link with all that hangs on it."""
    own = robot.joints.get("" if joint is None else joint.get("name"))
    origin = None if joint is None else joint.find("origin")
    lines = [f'<body name="{link.get("name")}"{_placed(origin)}>']
    if own is not None:
        axis, rotor = joint.find("axis").get("xyz"), f'armature="{own.reflected_inertia}"'
        lines.append(f'<joint name="{own.name}" axis="{axis}" {rotor} damping="{own.motor_damping}"/>')
    if (inertial := link.find("inertial")) is not None:
        place = inertial.find("origin")
        pos = "0 0 0" if place is None else place.get("xyz")
        full = " ".join(inertial.find("inertia").get(f"i{k}") for k in ("xx", "yy", "zz", "xy", "xz", "yz"))
        lines.append(
            f'<inertial pos="{pos}" mass="{inertial.find("mass").get("value")}" fullinertia="{full}"/>'
        )
    further = [j for j in root.findall("joint") if j.find("parent").get("link") == link.get("name")]
    links = {each.get("name"): each for each in root.findall("link")}
    inside = "".join(_body(robot, root, links[j.find("child").get("link")], j) for j in further)
    return "\n".join(lines) + f"\n{inside}</body>\n"


def _placed(origin: Element | None) -> str:
    found = {} if origin is None else dict(origin.attrib)
    return "".join(
        f' {key}="{found[old]}"' for key, old in (("pos", "xyz"), ("euler", "rpy")) if old in found
    )


@dataclass(frozen=True)
class Motions:
    """Positions (N, n) and velocities (N, n) of plant and MuJoCo, at the ends of the periods."""

    plant: np.ndarray
    plant_velocity: np.ndarray
    mujoco: np.ndarray
    mujoco_velocity: np.ndarray


def both_motions(
    folder: Path,
    robot: RobotSpec,
    entries: list[AppliedEffect],
    *,
    start: np.ndarray,
    pull: Callable[[float], np.ndarray],
    seconds: float = 0.4,
    kind: str = "general",
    nominal: bool = False,
) -> Motions:
    """Moves the plant with a patch, and MuJoCo with the exported one (or without it), from rest."""
    plant = patched_plant(robot, entries)
    plant.reset(start)
    (folder / "nominal.xml").write_text(mujoco_text(robot, kind))
    patch = write_patch(folder, *(entry.entry() for entry in entries), robot=robot.name)
    invoke("patch", "export", patch, "--mujoco", folder / "nominal.xml", "--out", folder / "out.xml")
    other = OtherPlant(folder / ("nominal.xml" if nominal else "out.xml"), plant, start)
    rows = []
    for k in range(round(seconds * RATE)):
        command = plant.start_command + pull(k / RATE)
        plant.advance(command)
        other.advance(command)
        rows.append((plant.position.copy(), plant.velocity.copy(), other.position, other.velocity))
    return Motions(*(np.array(column) for column in zip(*rows, strict=True)))


def patched_plant(robot: RobotSpec, entries: list[AppliedEffect]) -> Plant:
    options = PlantOptions(rate=RATE, seed=0, noise=False, step=STEP)
    patch = patch_of(robot.name, entries)
    model = RobotModel(apply_patch(robot, patch))
    return Plant(model, [], None, options, apply_to_plant(model, patch))


class OtherPlant:
    """A MuJoCo model, whose joints may report angles beside the true ones (``ref``)."""

    def __init__(self, path: Path, plant: Plant, start: np.ndarray) -> None:
        """Stands at the start posture (n,) for a second, so that nothing of before is late."""
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)
        ids = [self.model.joint(name).id for name in plant.model.joint_names]
        self._at, self._dof = self.model.jnt_qposadr[ids], self.model.jnt_dofadr[ids]
        self._motors = [self.model.actuator(name).id for name in plant.model.joint_names]
        for _ in range(round(1.0 / STEP)):
            self._stand(start)
            self.data.ctrl[self._motors] = plant.start_command
            mujoco.mj_step(self.model, self.data)
        self._stand(start)

    def _stand(self, start: np.ndarray) -> None:
        self.data.qpos[:] = self.model.qpos0
        self.data.qpos[self._at] += start
        self.data.qvel[:] = 0.0

    def advance(self, command: np.ndarray) -> None:
        """One period under a command (n,) [N.m]."""
        self.data.ctrl[self._motors] = command
        for _ in range(round(1.0 / RATE / STEP)):
            mujoco.mj_step(self.model, self.data)

    @property
    def position(self) -> np.ndarray:
        """True angles (n,): what the joints report, less what they report beside it."""
        return (self.data.qpos - self.model.qpos0)[self._at]

    @property
    def velocity(self) -> np.ndarray:
        return self.data.qvel[self._dof].copy()
