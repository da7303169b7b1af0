# SPDX-License-Identifier: BSD-3-Clause
"""Messages: the checksums of real robots, the same bytes as ROS, every message back as it went."""

import dataclasses
import re
import struct
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.backends.baxter.ros.message_definitions import (
    FIELD_LISTS,
    MessageField,
    checksum,
    definition,
)
from impedance_modules.backends.baxter.ros.messages import (
    MESSAGE_TYPES,
    Header,
    JointCommand,
    JointState,
    Message,
    String,
    UInt16,
)
from impedance_modules.backends.baxter.ros.wire import MessageError, decode, encode

# Of the robot's own headers and of ROS 1's std_msgs.
CHECKSUMS = {
    "baxter_core_msgs/JointCommand": "19bfec8434dd568ab3c633d187c36f2e",
    "baxter_core_msgs/AssemblyState": "356d9dd237ce73b2667da9235f541933",
    "baxter_core_msgs/SEAJointState": "d36406dcbb6d860b1b39c4e28f81352b",
    "baxter_core_msgs/EndpointState": "44bea01d596ff699fa1447bec34167ac",
    "baxter_core_msgs/DigitalIOState": "29d0be3859dae81a66b28f167ecec98c",
    "baxter_core_msgs/CollisionAvoidanceState": "30f5cb8ae019f1ffe8b599e6d2e589c7",
    "baxter_core_msgs/CollisionDetectionState": "7bde38c182b4d08fdc0635b116f65d04",
    "baxter_core_msgs/HeadState": "71c43b264307205358e7e49be5601348",
    "baxter_core_msgs/EndEffectorState": "ade777f069d738595bc19e246b8ec7a0",
    "baxter_core_msgs/EndEffectorCommand": "c003234e90416f2ca02ac7837c42cbb7",
    "baxter_core_msgs/EndEffectorProperties": "21b83773ab9a35216d11e427573c76cc",
    "baxter_core_msgs/URDFConfiguration": "0c7028d878027820eed2aa0cbf1f5e4a",
    "sensor_msgs/JointState": "3066dcd76a6cfaef579bd0f34173e9fd",
    "std_msgs/Bool": "8b94c1b53db61fb6aed406028ad6332a",
    "std_msgs/Empty": "d41d8cd98f00b204e9800998ecf8427e",
    "std_msgs/Float64": "fdb28210bfa9d7c91146260178d9a584",
    "std_msgs/UInt16": "1df79edf208b629fe6b81923a544552d",
    "std_msgs/Header": "2176decaecbce78abc3b96ef049fabed",
    "std_msgs/String": "992ce8a1687cec8c8bd883ec73ca41d1",
}

LIMITS = {"int8": 7, "int32": 31, "uint8": 8, "uint16": 16, "uint32": 32}


@pytest.mark.parametrize(("ros_type", "expected"), CHECKSUMS.items())
def test_checksums_are_those_of_real_robots(ros_type: str, expected: str) -> None:
    assert checksum(ros_type) == expected


def snake(name: str) -> str:
    return re.sub(r"(?<=[a-z])([A-Z])", lambda m: "_" + m.group(1).lower(), name)


@pytest.mark.parametrize("ros_type", sorted(FIELD_LISTS))
def test_plain_types_have_the_fields_and_constants_of_their_messages(ros_type: str) -> None:
    parts, kind = definition(ros_type), MESSAGE_TYPES[ros_type]
    assert [f.name for f in dataclasses.fields(kind)] == [snake(f.name) for f in parts.fields]
    for _, name, value in parts.constants:
        own = name.removeprefix("ESTOP_")
        if hasattr(kind, own):
            assert getattr(kind, own) == int(value)


def random_value(kind: str, random: Random) -> object:
    """Any value of a ROS type."""
    if kind == "bool":
        return random.random() < 0.5
    if kind in ("float32", "float64"):
        value = random.choice([0.0, -0.0, float("inf"), random.gauss(0.0, 1e3)])
        return struct.unpack("<f", struct.pack("<f", value))[0] if kind == "float32" else value
    if kind == "string":
        return "".join(random.choice("aé€ \0_9") for _ in range(random.randrange(9)))
    if kind == "time":
        return random.randrange(2**32) * 10**9 + random.randrange(10**9)
    if kind in LIMITS:
        top = 2 ** LIMITS[kind]
        return random.randrange(-top if kind.startswith("int") else 0, top)
    return MESSAGE_TYPES[kind](*(random_field(field, random) for field in definition(kind).fields))


def random_field(field: MessageField, random: Random) -> object:
    if not field.repeated:
        return random_value(field.kind, random)
    return tuple(random_value(field.kind, random) for _ in range(random.randrange(9)))


@given(st.sampled_from(sorted(FIELD_LISTS)), st.integers(0))
def test_every_message_comes_back_as_it_went(ros_type: str, seed: int) -> None:
    message = random_value(ros_type, Random(seed))
    assert decode(type(message), encode(message)) == message


@given(st.sampled_from(sorted(FIELD_LISTS)), st.integers(0), st.binary(max_size=8))
def test_damaged_bytes_are_another_message_or_refused_by_name(ros_type: str, seed: int, tail: bytes) -> None:
    random = Random(seed)
    good = encode(random_value(ros_type, random))
    damaged = good[: random.randrange(len(good) + 1)] + tail
    try:
        assert len(encode(decode(MESSAGE_TYPES[ros_type], damaged))) == len(damaged)
    except MessageError as refusal:
        assert ros_type in str(refusal)


@pytest.mark.parametrize(
    "message",
    [UInt16(70000), UInt16(-1), String(None), JointCommand(3, ("a",), ("x",))],
    ids=["too big", "negative", "no text", "no number"],
)
def test_a_value_that_does_not_fit_is_refused_by_name(message: Message) -> None:
    with pytest.raises(MessageError, match=message.ros_type):
        encode(message)


def test_a_length_beyond_the_bytes_asks_for_no_memory() -> None:
    huge = encode(Header(0, 0, ""))[:-4] + struct.pack("<I", 2**32 - 1)
    with pytest.raises(MessageError):
        decode(Header, huge)
    with pytest.raises(MessageError):
        decode(JointState, encode(Header(0, 0, "")) + struct.pack("<I", 2**32 - 1))


def test_one_command_has_the_size_that_was_measured_on_the_wire() -> None:
    names = tuple(f"left_{short}" for short in ("s0", "s1", "e0", "e1", "w0", "w1", "w2"))
    assert len(encode(JointCommand(3, (0.0,) * 7, names))) == 145
