# SPDX-License-Identifier: BSD-3-Clause
"""What ROS derives from a message's list of fields: its parts, its checksum, its full text."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cache

from impedance_modules.backends.baxter.message_texts import FIELD_LISTS
from impedance_modules.errors import BadInput, nearest

PRIMITIVES: frozenset[str] = frozenset(
    {"bool", "int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64", "string", "time"}
)


@dataclass(frozen=True)
class Field:
    """One field of a message.

    Attributes:
        kind: Full name of its type, without brackets, e.g. ``float64`` or ``std_msgs/Header``.
        name: As in the definition.
        written: Its type as the definition writes it, e.g. ``float64[]``; the checksum sees this.
        repeated: An array of any length.
    """

    kind: str
    name: str
    written: str
    repeated: bool


@dataclass(frozen=True)
class Definition:
    """A message's fields and constants, each in order.

    Attributes:
        ros_type: Package and name, e.g. ``std_msgs/Bool``.
        fields: What goes over the wire.
        constants: (type, name, value as written).
        text: The definition itself.
    """

    ros_type: str
    fields: tuple[Field, ...]
    constants: tuple[tuple[str, str, str], ...]
    text: str


@cache
def definition(ros_type: str) -> Definition:
    """Returns the definition of a message type.

    Raises:
        BadInput: The type is not one of ``message_texts.FIELD_LISTS``.
    """
    if ros_type not in FIELD_LISTS:
        valid = tuple(FIELD_LISTS)
        raise BadInput(f"no message type '{ros_type}'{nearest(ros_type, valid)} (valid: {', '.join(valid)})")
    text = FIELD_LISTS[ros_type]
    fields, constants = [], []
    for line in text.splitlines():
        written, _, rest = line.partition(" ")
        name, is_constant, value = rest.partition("=")
        if is_constant:
            constants.append((written, name, value))
        else:
            plain = written.removesuffix("[]")
            fields.append(Field(_full_type(plain, ros_type), name, written, plain != written))
    return Definition(ros_type, tuple(fields), tuple(constants), text)


@cache
def checksum(ros_type: str) -> str:
    """Computes the MD5 by which two ROS nodes know that they mean the same message.

    It is taken over the constants, then the fields, one per line, with the type of a message field replaced by
    that message's own MD5 (the rule of ROS's ``genmsg``).
    """
    parts = definition(ros_type)
    lines = [f"{kind} {name}={value}" for kind, name, value in parts.constants]
    for field in parts.fields:
        kind = field.written if field.kind in PRIMITIVES else checksum(field.kind)
        lines.append(f"{kind} {field.name}")
    return hashlib.md5("\n".join(lines).encode(), usedforsecurity=False).hexdigest()


@cache
def full_text(ros_type: str) -> str:
    """Returns a definition followed by those of all messages in it, as ROS sends it when nodes connect."""
    parts = [definition(ros_type).text]
    for kind in _contained(ros_type):
        parts.append(f"{'=' * 80}\nMSG: {kind}\n{definition(kind).text}")
    return "\n\n".join(parts) + "\n"


def _contained(ros_type: str) -> list[str]:
    """Lists the message types inside a message, at any depth, each once."""
    found: list[str] = []
    for field in definition(ros_type).fields:
        if field.kind in PRIMITIVES:
            continue
        for kind in (field.kind, *_contained(field.kind)):
            if kind not in found:
                found.append(kind)
    return found


def _full_type(plain: str, within: str) -> str:
    """Completes a short type: ``Header`` is everybody's, other short names are of the same package."""
    if plain in PRIMITIVES or "/" in plain:
        return plain
    return "std_msgs/Header" if plain == "Header" else f"{within.partition('/')[0]}/{plain}"
