# SPDX-License-Identifier: BSD-3-Clause
"""Reads a robot folder: ``robot.yaml`` and its URDF, into a frozen ``RobotSpec``.

First the shape of the file is checked against ``schemas/robot.schema.json``, then its meaning against the
URDF: joints, hands and links exist, limits fit. Each stage reports everything it finds at once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from impedance_modules.errors import BadFile, Problem, nearest
from impedance_modules.input_files import is_file
from impedance_modules.spec.document import Document, scan_document
from impedance_modules.spec.gripper_spec import build_gripper
from impedance_modules.spec.locate import ROBOT_FILE, find_robot
from impedance_modules.spec.mesh_files import folders_looked_in
from impedance_modules.spec.robot_postures import assumed_numbers, posture_problems
from impedance_modules.spec.robot_spec import (
    CollisionSpec,
    ContactDetectionSpec,
    InnerTorqueLoopSpec,
    JointSpec,
    LimbSpec,
    MirrorSpec,
    PlaybackSpec,
    RobotSpec,
    SensorSpec,
    TimingSpec,
)
from impedance_modules.spec.schema import schema_problems
from impedance_modules.spec.urdf import UrdfFacts, UrdfJoint, read_urdf

RIGID = "rigid"
"""The word for a joint without a series spring."""


def read_robot(name_or_folder: str | Path, beside: Path | None = None) -> RobotSpec:
    """Reads a robot: what its joints can do, what its sensors show, which links must stay apart.

    Args:
        name_or_folder: A name (``robots/<name>``), or a folder that holds ``robot.yaml``.
        beside: The task file that names the robot, for names relative to it; None when nothing does.

    Raises:
        BadInput: There is no such robot, or a file of it cannot be read.
        BadFile: ``robot.yaml`` or the URDF says something wrong; all problems, each with its position.
    """
    folder = find_robot(name_or_folder, beside)
    document = scan_document(folder / ROBOT_FILE)
    problems = [*document.yaml_problems, *schema_problems(document, "robot")]
    if problems:
        raise BadFile(problems)
    if not is_file(folder / document.data["urdf"]):
        present = sorted(file.name for file in folder.glob("*.urdf"))
        raise BadFile(
            [document.problem(("urdf",), f"{folder} has no file '{document.data['urdf']}'", present)]
        )
    problems = robot_problems(document, read_urdf(folder / document.data["urdf"]))
    if problems:
        raise BadFile(problems)
    return replace(_build(document.data, folder), assumed=assumed_numbers(document))


def robot_problems(document: Document, urdf: UrdfFacts) -> list[Problem]:
    """Returns everything wrong with a robot file whose shape is right.

    Args:
        document: ``robot.yaml``, free of schema problems.
        urdf: The URDF it names.
    """
    return [
        *_limb_problems(document, urdf),
        *_locked_problems(document, urdf),
        *_ownership_problems(document, urdf),
        *_table_problems(document),
        *_limit_problems(document, urdf),
        *_inertia_problems(document, urdf),
        *_mirror_problems(document),
        *_timing_problems(document),
        *_collision_problems(document, urdf),
        *_playback_problems(document),
        *_inner_torque_loop_problems(document),
        *posture_problems(document),
        *_gripper_problems(document),
    ]


def _build(data: Mapping[str, Any], folder: Path) -> RobotSpec:
    """Turns checked data into the frozen spec."""
    collision = data["collision"]
    return RobotSpec(
        name=data["name"],
        # Resolved: a task may reach the folder through a link that does not last.
        urdf=(folder / data["urdf"]).resolve(),
        limbs={name: _limb(name, limb) for name, limb in data["limbs"].items()},
        joints=_joints(data),
        locked={name: float(angle) for name, angle in data.get("locked", {}).items()},
        mirror=_mirror(data["mirror"]) if "mirror" in data else None,
        timing=TimingSpec(**_numbers(data["timing"])),
        sensors=SensorSpec(**_numbers(data["sensors"])),
        contact_detection=ContactDetectionSpec(**_numbers(data["contact_detection"])),
        collision=CollisionSpec(tuple((a, b) for a, b in collision["pairs"]), float(collision["margin"])),
        gravity_compensation=data["gravity_compensation"],
        control_modes=tuple(data["control_modes"]),
        solver=data["solver"],
        folder=folder,
        playback=_playback(data["playback"]) if "playback" in data else None,
        inner_torque_loop=_inner_torque_loop(data["inner_torque_loop"])
        if "inner_torque_loop" in data
        else None,
        postures={
            name: {limb: _numbers(angles) for limb, angles in limbs.items()}
            for name, limbs in data.get("postures", {}).items()
        },
    )


def _limb(name: str, data: Mapping[str, Any]) -> LimbSpec:
    gripper = build_gripper(data["gripper"]) if "gripper" in data else None
    return LimbSpec(name, data["hand"], dict(data["joints"]), gripper)


def _numbers(table: Mapping[str, float]) -> dict[str, float]:
    return {key: float(value) for key, value in table.items()}


def _playback(data: Mapping[str, Any]) -> PlaybackSpec:
    found: dict[str, Any] = {
        key: _numbers(value) if isinstance(value, Mapping) else float(value) for key, value in data.items()
    }
    return PlaybackSpec(**found)


def _inner_torque_loop(data: Mapping[str, Any]) -> InnerTorqueLoopSpec:
    return InnerTorqueLoopSpec(float(data["gain"]), float(data.get("delay", 0.0)))


def _mirror(data: Mapping[str, Any]) -> MirrorSpec:
    signs = {short: int(sign) for short, sign in data.get("joint_sign", {}).items()}
    return MirrorSpec(data["plane"], signs, _numbers(data.get("joint_offset", {})))


def _joints(data: Mapping[str, Any]) -> dict[str, JointSpec]:
    """Collects each joint's numbers from the tables; its URDF name wins over its short name."""
    return {name: _joint(name, row) for name, row in _rows(data)}


def _rows(data: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Gives each joint's URDF name and its numbers by quantity, None where a table lacks it."""
    for limb in data["limbs"].values():
        for short, name in limb["joints"].items():
            yield (
                name,
                {quantity: table.get(name, table.get(short)) for quantity, table in data["joints"].items()},
            )


def _joint(name: str, row: Mapping[str, Any]) -> JointSpec:
    stiffness = row["spring_stiffness"]
    return JointSpec(
        name=name,
        position_min=float(row["position"][0]),
        position_max=float(row["position"][1]),
        velocity_max=float(row["velocity"]),
        effort_max=float(row["effort"]),
        effort_rate_max=float(row["effort_rate"]),
        spring_stiffness=None if stiffness == RIGID else float(stiffness),
        reflected_inertia=float(row["reflected_inertia"]),
        motor_damping=float(row["motor_damping"]),
        spring_damping=float(row["spring_damping"]),
        encoder=row.get("encoder"),
    )


def _playback_problems(document: Document) -> Iterator[Problem]:
    """Joints that are watched for collisions are joints of a limb."""
    known = sorted({short for limb in document.data["limbs"].values() for short in limb["joints"]})
    for table in ("impact", "squish"):
        for short in document.data.get("playback", {}).get(table, {}):
            if short not in known:
                message = f"no limb has a joint '{short}'{nearest(short, known)}"
                yield document.problem(("playback", table, short), message, known)


def _inner_torque_loop_problems(document: Document) -> Iterator[Problem]:
    """A loop around torque has a spring that measures it and a rotor that it moves, in every joint."""
    if "inner_torque_loop" not in document.data:
        return
    for name, row in _rows(document.data):
        if row["spring_stiffness"] in (None, RIGID) or not row["reflected_inertia"]:
            message = (
                f"the joint '{name}' has no spring or no rotor (spring_stiffness {row['spring_stiffness']},"
                f" reflected_inertia {row['reflected_inertia']}), which this loop needs"
            )
            yield document.problem(
                ("inner_torque_loop",), message, ("numbers above 0 for every joint",), at="key"
            )
            return


def _gripper_problems(document: Document) -> Iterator[Problem]:
    """A gripper's narrowest opening is below its widest."""
    for name, limb in document.data["limbs"].items():
        if "gripper" in limb and not limb["gripper"]["opening"][0] < limb["gripper"]["opening"][1]:
            narrowest, widest = limb["gripper"]["opening"]
            message = f"the narrowest opening {narrowest} m must be below the widest, {widest} m"
            yield document.problem(("limbs", name, "gripper", "opening"), message)


def _limb_problems(document: Document, urdf: UrdfFacts) -> Iterator[Problem]:
    """A limb's joints exist, turn, and are exactly those that move its hand, from the base outwards."""
    movable = [name for name, joint in urdf.joints.items() if joint.moves]
    for limb_name, limb in document.data["limbs"].items():
        place = ("limbs", limb_name)
        for short, name in limb["joints"].items():
            here = (*place, "joints", short)
            if name not in urdf.joints:
                message = f"{urdf.path.name} has no joint '{name}'{nearest(name, movable)}"
                yield document.problem(here, message, movable)
            elif urdf.joints[name].type != "revolute":
                yield document.problem(here, _not_revolute(name, urdf.joints[name]))
        if limb["hand"] not in urdf.links:
            message = f"{urdf.path.name} has no link '{limb['hand']}'{nearest(limb['hand'], urdf.links)}"
            yield document.problem((*place, "hand"), message, urdf.links)
        elif all(name in urdf.joints for name in limb["joints"].values()):
            yield from _chain_problems(document, urdf, limb_name)


def _not_revolute(name: str, joint: UrdfJoint) -> str:
    if joint.type == "continuous":
        return f"the joint '{name}' is continuous; describe it as revolute, with limits"
    return f"the joint '{name}' is {joint.type}; a limb's joints are revolute"


def _chain_problems(document: Document, urdf: UrdfFacts, limb_name: str) -> Iterator[Problem]:
    limb = document.data["limbs"][limb_name]
    locked = document.data.get("locked", {})
    chain = [name for name in urdf.moving_joints(limb["hand"]) if name not in locked]
    if list(limb["joints"].values()) != chain:
        message = (
            f"the hand '{limb['hand']}' is moved by {', '.join(chain) or 'no joint'}, from the base outwards;"
            f" the limb must list exactly these"
        )
        yield document.problem(("limbs", limb_name, "joints"), message)


def _locked_problems(document: Document, urdf: UrdfFacts) -> Iterator[Problem]:
    """A locked joint exists, moves along one axis and stays inside the URDF's limits."""
    movable = [name for name, joint in urdf.joints.items() if joint.moves]
    for name, angle in document.data.get("locked", {}).items():
        joint = urdf.joints.get(name)
        if joint is None or not joint.moves:
            message = f"{urdf.path.name} has no movable joint '{name}'{nearest(name, movable)}"
            yield document.problem(("locked", name), message, movable, at="key")
        elif joint.type not in ("revolute", "prismatic"):
            message = f"the joint '{name}' is {joint.type}; only revolute and prismatic joints can be locked"
            yield document.problem(("locked", name), message, at="key")
        elif joint.limits is not None and not joint.limits.lower <= angle <= joint.limits.upper:
            valid = f"{joint.limits.lower} to {joint.limits.upper} rad"
            yield document.problem(("locked", name), f"{angle} rad is outside the URDF's limits", (valid,))


def _ownership_problems(document: Document, urdf: UrdfFacts) -> Iterator[Problem]:
    """Every movable joint belongs to one limb or is locked, and no name means two joints."""
    locked = document.data.get("locked", {})
    owned = [
        (limb, short, name)
        for limb, data in document.data["limbs"].items()
        for short, name in data["joints"].items()
    ]
    counts = Counter(name for *_, name in owned)
    for limb, short, name in owned:
        here = ("limbs", limb, "joints", short)
        if counts[name] > 1:
            yield document.problem(here, f"the joint '{name}' is listed {counts[name]} times")
        if name in locked:
            yield document.problem(("locked", name), f"'{name}' is a joint of the limb '{limb}'", at="key")
        if short in counts and short != name:
            yield document.problem(here, f"'{short}' is also the URDF name of another joint", at="key")
    for name, joint in urdf.joints.items():
        if joint.moves and name not in counts and name not in locked:
            message = (
                f"the joint '{name}' of {urdf.path.name} moves but is in no limb; list it in one, or here"
            )
            yield document.problem(("locked",), message, at="key")


def _table_problems(document: Document) -> Iterator[Problem]:
    """Each quantity is given for every joint, and for no other."""
    limbs = document.data["limbs"].values()
    pairs = list(dict.fromkeys((short, name) for limb in limbs for short, name in limb["joints"].items()))
    valid = list(dict.fromkeys([short for short, _ in pairs] + [name for _, name in pairs]))
    for quantity, table in document.data["joints"].items():
        for key in table:
            if key not in valid:
                message = f"no limb has a joint '{key}'{nearest(key, valid)}"
                yield document.problem(("joints", quantity, key), message, valid, at="key")
        missing = [f"'{short}' ({name})" for short, name in pairs if short not in table and name not in table]
        if missing:
            message = f"no {quantity} is given for {', '.join(missing)}"
            yield document.problem(("joints", quantity), message, at="key")


def _limit_problems(document: Document, urdf: UrdfFacts) -> Iterator[Problem]:
    """Limits are ordered and not wider than the URDF's."""
    for limb in document.data["limbs"].values():
        for short, name in limb["joints"].items():
            joint = urdf.joints.get(name)
            if joint is None or joint.type != "revolute":
                continue
            if joint.limits is None:
                yield urdf.problem(joint.line, f"the joint '{name}' has no <limit>")
            else:
                yield from _one_joint_limits(document, short, name, joint)


def _one_joint_limits(document: Document, short: str, name: str, joint: UrdfJoint) -> Iterator[Problem]:
    tables: dict[str, dict[str, Any]] = document.data["joints"]
    limits = joint.limits
    if limits is None:
        return
    for quantity, highest, unit in (("velocity", limits.velocity, "rad/s"), ("effort", limits.effort, "N.m")):
        key = _key_in(tables[quantity], short, name)
        if key is not None and tables[quantity][key] > highest:
            message = f"{tables[quantity][key]} {unit} is above the URDF's limit of '{name}'"
            yield document.problem(("joints", quantity, key), message, (f"at most {highest} {unit}",))
    key = _key_in(tables["position"], short, name)
    if key is None:
        return
    lower, upper = tables["position"][key]
    here = ("joints", "position", key)
    if not lower < upper:
        yield document.problem(here, f"the lowest angle {lower} must be below the highest, {upper}")
    if lower < limits.lower or upper > limits.upper:
        message = f"[{lower}, {upper}] rad is wider than the URDF's limits of '{name}'"
        yield document.problem(here, message, (f"within {limits.lower} to {limits.upper} rad",))


def _key_in(table: dict[str, Any], short: str, name: str) -> str | None:
    """The key under which a table gives a joint's number; its URDF name wins."""
    return next((key for key in (name, short) if key in table), None)


def _inertia_problems(document: Document, urdf: UrdfFacts) -> Iterator[Problem]:
    """Whatever a limb's joint moves has mass: without it there is no dynamics to control."""
    for limb in document.data["limbs"].values():
        for name in limb["joints"].values():
            joint = urdf.joints.get(name)
            if joint is not None and urdf.welded_to(joint.child) <= urdf.links_without_inertia:
                message = (
                    f"the link '{joint.child}', moved by the joint '{name}', has no inertia;"
                    f" give it an <inertial> with a positive mass and positive ixx, iyy, izz"
                )
                yield urdf.problem(urdf.link_lines[joint.child], message)


def _mirror_problems(document: Document) -> Iterator[Problem]:
    """The mirror's signs cover the short joint names, which all limbs share; offsets have a sign."""
    signs = document.data.get("mirror", {}).get("joint_sign")
    if signs is None:
        return
    for short in document.data["mirror"].get("joint_offset", {}):
        if short not in signs:
            message = f"'{short}' has an offset and no sign{nearest(short, list(signs))}"
            yield document.problem(("mirror", "joint_offset", short), message, list(signs), at="key")
    for limb_name, limb in document.data["limbs"].items():
        missing = [short for short in limb["joints"] if short not in signs]
        if missing:
            message = f"no sign is given for {', '.join(missing)} of the limb '{limb_name}'"
            yield document.problem(("mirror", "joint_sign"), message, at="key")
        for short in signs:
            if short not in limb["joints"]:
                message = (
                    f"the limb '{limb_name}' has no joint '{short}'{nearest(short, list(limb['joints']))}"
                )
                yield document.problem(
                    ("mirror", "joint_sign", short), message, list(limb["joints"]), at="key"
                )


def _timing_problems(document: Document) -> Iterator[Problem]:
    """rate_min <= rate <= rate_max, and the robot does not time out between two commands."""
    timing = document.data["timing"]
    if timing["rate_min"] > timing["rate_max"]:
        message = f"{timing['rate_min']} Hz is above rate_max, {timing['rate_max']} Hz"
        yield document.problem(("timing", "rate_min"), message)
    elif not timing["rate_min"] <= timing["rate"] <= timing["rate_max"]:
        valid = f"{timing['rate_min']} to {timing['rate_max']} Hz"
        message = f"{timing['rate']} Hz is not between rate_min and rate_max"
        yield document.problem(("timing", "rate"), message, (valid,))
    shortest = 1.0 / timing["rate_min"] + timing["command_delay"]
    if timing["command_timeout"] <= shortest:
        message = f"{timing['command_timeout']} s would run out between two commands at rate_min"
        valid = f"more than {shortest:.6g} s, a period at rate_min plus command_delay"
        yield document.problem(("timing", "command_timeout"), message, (valid,))


def _collision_problems(document: Document, urdf: UrdfFacts) -> Iterator[Problem]:
    """Both links of a pair exist, have a shape, and can move against each other."""
    shaped = [link for link in urdf.links if link in urdf.links_with_collision]
    seen: set[frozenset[str]] = set()
    for index, pair in enumerate(document.data["collision"]["pairs"]):
        here = ("collision", "pairs", index)
        for side, link in enumerate(pair):
            if link not in urdf.links:
                message = f"{urdf.path.name} has no link '{link}'{nearest(link, shaped)}"
                yield document.problem((*here, side), message, shaped)
            elif link not in urdf.links_with_collision:
                message = f"the link '{link}' has no <collision> shape"
                yield document.problem((*here, side), message, shaped)
            elif link in urdf.missing_meshes:
                yield document.problem((*here, side), *_missing_mesh(urdf, link))
        if frozenset(pair) in seen:
            yield document.problem(here, f"the pair {pair[0]}, {pair[1]} is listed twice")
        seen.add(frozenset(pair))
        if set(pair) <= set(urdf.links) and _rigid_together(document, urdf, pair):
            yield document.problem(here, f"no limb's joint moves '{pair[0]}' against '{pair[1]}'")


def _missing_mesh(urdf: UrdfFacts, link: str) -> tuple[str, tuple[str, ...]]:
    """What is wrong with a link whose distance is asked for and whose mesh is not there, and what would be right."""
    mesh = urdf.missing_meshes[link]
    looked = ", ".join(folders_looked_in(urdf.path, mesh))
    message = f"the mesh '{mesh}' of link '{link}' is not there; it was looked for in {looked}"
    return message, ("a file in one of these folders", "no pair of this link")


def _rigid_together(document: Document, urdf: UrdfFacts, pair: list[str]) -> bool:
    locked = document.data.get("locked", {})
    chains = [[name for name in urdf.moving_joints(link) if name not in locked] for link in pair]
    return chains[0] == chains[1]
