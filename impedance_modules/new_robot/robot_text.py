# SPDX-License-Identifier: BSD-3-Clause
"""The text of ``robot.yaml``, with a source beside each group of numbers, and a mark where a person must look."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from impedance_modules.export.edited_xml import number
from impedance_modules.new_robot.chains import Chain
from impedance_modules.new_robot.copy_names import CopyNames
from impedance_modules.new_robot.drive_numbers import DriveNumbers, Value
from impedance_modules.new_robot.first_postures import NamedPosture
from impedance_modules.spec.robot_postures import CONSEQUENCES

UNITS = {
    "position": "rad",
    "velocity": "rad/s",
    "effort": "N.m",
    "effort_rate": "N.m/s",
    "spring_stiffness": "N.m/rad",
    "spring_damping": "N.m.s/rad",
    "reflected_inertia": "kg.m^2",
    "motor_damping": "N.m.s/rad",
}

TIMING = "{rate: 1000, rate_min: 200, rate_max: 1000, command_delay: 0.002, command_timeout: 0.05} # Hz, s"
SENSORS = (
    "position_resolution: 0.0001 # rad",
    "effort_resolution: 0.02 # N.m",
    "position_noise: 0.00005",
    "effort_noise: 0.05",
    "velocity_filter: 0.005 # s",
)

WIDTH = 116

SWITCHES = ("true", "false", "yes", "no", "on", "off", "null", "y", "n")
"""Words that are no text to some readers of YAML."""


@dataclass(frozen=True)
class RobotText:
    """What goes into a robot file.

    Attributes:
        name: The robot's.
        source: Where the description comes from, in words.
        file: Its name.
        arms: Names of a copy and arm in it.
        numbers: Of the joints, as the description names them.
        held: Joint, as the folder's URDF names it -> where it stays.
        mirror: Short name -> sign, and short name -> offset [rad]; None where no signs are known.
        mirrored: Whether the arms are, or stand as, mirror images of each other.
        pairs: Links that are kept apart.
        postures: Each with its source.
        gravity: What carries the weight, and whether somebody said so.
        modes: Control modes, and whether somebody said so.
        notes: Sentences about the description.
    """

    name: str
    source: str
    file: str
    arms: Sequence[tuple[CopyNames, Chain]]
    numbers: DriveNumbers
    held: Mapping[str, float]
    mirror: tuple[Mapping[str, int], Mapping[str, float]] | None
    mirrored: bool
    pairs: Sequence[tuple[str, str]]
    postures: Sequence[NamedPosture]
    gravity: tuple[str, bool]
    modes: tuple[Sequence[str], bool]
    notes: Sequence[str]

    @property
    def assumed(self) -> tuple[str, ...]:
        """Keys of the list ``assumed``."""
        own = [quantity for quantity in UNITS if quantity in self.numbers.assumed]
        own += ["timing", "sensors", "contact_detection"]
        own += [] if self.gravity[1] else ["gravity_compensation"]
        return (*own, *([] if self.modes[1] else ["control_modes"]))


def robot_yaml(robot: RobotText) -> str:
    """Writes the file."""
    parts = [_head(robot), _limbs(robot), _held(robot), _tables(robot), _mirror(robot), _postures(robot)]
    return "\n\n".join(part for part in (*parts, _rest(robot), _assumed(robot)) if part) + "\n"


def _head(robot: RobotText) -> str:
    lines = [
        "# yaml-language-server: $schema=../../schemas/robot.schema.json",
        *_comment(f"{robot.name}, made of {robot.file} by: impedance robot new. Where numbers come from:"),
        *_comment(f"  [file] {robot.source}"),
        *_comment(
            "  [assumed] not stated there; a cautious value, to be replaced by a published or measured one"
        ),
        *(line for note in robot.notes for line in _comment(note)),
        "format: 1",
        f"name: {robot.name}",
        f"urdf: {robot.name}.urdf",
    ]
    return "\n".join(lines)


def _comment(text: str) -> list[str]:
    indent = " " * (len(text) - len(text.lstrip()))
    return [f"# {line}" for line in textwrap.wrap(text.strip(), WIDTH - 4, initial_indent=indent)] or ["#"]


def _limbs(robot: RobotText) -> str:
    lines = ["limbs: # short name, as tasks write it: joint of the URDF; from the base outwards"]
    for naming, chain in robot.arms:
        joints = {short: naming(name) for short, name in chain.joints.items()}
        lines += [f"  {chain.limb}:", f"    hand: {_plain(naming(chain.hand))}"]
        lines += _wrapped("    joints: ", joints)
    return "\n".join(lines)


def _wrapped(head: str, table: Mapping[str, object]) -> list[str]:
    """Writes a flow mapping, over several lines where one is too short."""
    words = [f"{_plain(key)}: {_word(value)}" for key, value in table.items()]
    if len(head) + len(", ".join(words)) + 2 <= WIDTH:
        return [f"{head}{{{', '.join(words)}}}"]
    indent = " " * (len(head) - len(head.lstrip()) + 2)
    lines = [f"{indent}{{{words[0]}"]
    for word in words[1:]:
        if len(lines[-1]) + len(word) + 3 > WIDTH:
            lines[-1] += ","
            lines.append(f"{indent} {word}")
        else:
            lines[-1] += f", {word}"
    return [head.rstrip(), *lines[:-1], f"{lines[-1]}}}"]


def _word(value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(_word(one) for one in value)}]"
    if isinstance(value, float):
        return _number(value)
    return str(value) if isinstance(value, int) else _plain(str(value))


def _plain(name: str) -> str:
    """Writes a name, in quotes where a reader of YAML could take it for something else."""
    simple = re.fullmatch(r"[A-Za-z_][A-Za-z0-9_.-]*", name) and name.lower() not in SWITCHES
    return name if simple else json.dumps(name)


def _number(value: float) -> str:
    """Writes a number so that every reader of YAML takes it for one: a point before an exponent, and its sign."""
    text = number(value)
    mantissa, mark, exponent = text.partition("e")
    if not mark:
        return text
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}e{exponent}"


def _held(robot: RobotText) -> str:
    if not robot.held:
        return ""
    return "\n".join(["# rad, m for joints that slide", *_wrapped("locked: ", robot.held)])


def _tables(robot: RobotText) -> str:
    lines = ["joints: # a short name counts for all arms; a name of the URDF overrides it for one joint"]
    for quantity, unit in UNITS.items():
        assumed = robot.numbers.assumed.get(quantity, ())
        joints = {name for _, chain in robot.arms for name in chain.joints.values()}
        if quantity == "spring_damping":
            source = "rigid joints have none"
        elif not assumed:
            source = "[file]"
        elif set(assumed) == joints:
            source = "[assumed]"
        else:
            source = f"[file], but [assumed] for {', '.join(sorted(assumed))}"
        lines.append(f"  # {unit} {source}")
        lines += _wrapped(f"  {quantity}: ", _by_short_name(robot, robot.numbers.tables[quantity]))
    return "\n".join(lines)


def _by_short_name(robot: RobotText, values: Mapping[str, Value]) -> dict[str, Value]:
    """Gives numbers under short names where all arms share them, else under the joints' own."""
    found: dict[str, set[Value]] = {}
    for _, chain in robot.arms:
        for short, name in chain.joints.items():
            found.setdefault(short, set()).add(values[name])
    out: dict[str, Value] = {}
    for naming, chain in robot.arms:
        for short, name in chain.joints.items():
            shared = len(found[short]) == 1
            out[short if shared else naming(name)] = values[name]
    return out


def _mirror(robot: RobotText) -> str:
    if not robot.mirrored:
        return ""
    lines = ["mirror: # the arms are mirror images of each other in this plane", "  plane: xz"]
    if robot.mirror is None:
        lines.append(
            "  # No joint signs make one of these arms the image of the other: tasks mirror poses and springs only."
        )
        return "\n".join(lines)
    signs, offsets = robot.mirror
    lines += _wrapped("  joint_sign: ", signs)
    if offsets:
        lines += _wrapped("  joint_offset: ", offsets)
        lines[-1] += " # rad"
    return "\n".join(lines)


def _postures(robot: RobotText) -> str:
    if not robot.postures:
        return ""
    lines = ["postures: # rad"]
    for posture in robot.postures:
        lines.append(f"  {posture.name}: # {posture.source}")
        for limb, angles in posture.limbs.items():
            lines += _wrapped(f"    {limb}: ", angles)
    return "\n".join(lines)


def _rest(robot: RobotText) -> str:
    pairs = [f"    - [{_plain(first)}, {_plain(second)}]" for first, second in robot.pairs]
    said = "" if robot.gravity[1] else f" # [assumed]; {CONSEQUENCES['gravity_compensation']}"
    modes = "" if robot.modes[1] else f" # [assumed]; {CONSEQUENCES['control_modes']}"
    return "\n".join(
        [
            f"timing: {TIMING} [assumed]",
            "",
            "sensors: # [assumed]",
            *(f"  {line}" for line in SENSORS),
            "",
            "contact_detection: {force: 5, time: 0.05} # N, s [assumed]",
            "",
            "collision:",
            "  margin: 0.03 # m [assumed]",
            *(["  pairs:", *pairs] if pairs else ["  pairs: [] # links that must stay apart; none is known"]),
            "",
            f"gravity_compensation: {robot.gravity[0]}{said}",
            f"control_modes: [{', '.join(robot.modes[0])}]{modes}",
            "solver: daqp",
        ]
    )


def _assumed(robot: RobotText) -> str:
    lines = [
        "# What a person must fill in or confirm. Take a name off this list once its numbers above are known;",
        "# until then `impedance check` says what follows from each.",
        "assumed:",
        *(f"  - {key} # {CONSEQUENCES[key]}" for key in robot.assumed),
    ]
    return "\n".join(lines)
