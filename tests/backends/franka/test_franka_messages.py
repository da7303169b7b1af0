# SPDX-License-Identifier: BSD-3-Clause
"""Messages of an arm's process arrive as they were sent; errors of the maker's software become the house's events."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from impedance_modules.backends.franka.arm_messages import (
    ArmOrder,
    ArmReport,
    ArmText,
    OrderKind,
    TextKind,
    event_of,
    pack_order,
    pack_report,
    pack_text,
    unpack,
    unpack_order,
)
from impedance_modules.safety.stop_levels import Event

numbers = st.floats(allow_nan=False)
joints = st.tuples(*(numbers for _ in range(7)))


@given(st.sampled_from(OrderKind), joints, numbers)
def test_orders(kind, values, state) -> None:
    assert unpack_order(pack_order(ArmOrder(kind, values, state))) == ArmOrder(kind, values, state)


@given(numbers, st.integers(0, 6), numbers, numbers, st.tuples(joints, joints, joints, joints, joints))
def test_reports(time, mode, success, answered, rows) -> None:
    sent = ArmReport(time, mode, success, answered, 1.0, 0.0, *rows)
    assert unpack(pack_report((time, mode, success, answered, 1.0, 0.0), rows)) == sent


@given(st.sampled_from(TextKind), st.text(st.characters(exclude_categories=("Cs",)), max_size=300))
def test_texts(kind, text) -> None:
    assert unpack(pack_text(ArmText(kind, text, "collision"))) == ArmText(kind, text, "collision")


@pytest.mark.parametrize(
    ("error", "words", "event"),
    [
        ("NetworkException", "libfranka: UDP receive: Timeout", Event.BACKEND_LOST),
        ("ControlException", 'motion aborted by reflex! ["joint_reflex"]', Event.COLLISION),
        ("ControlException", '["communication_constraints_violation"]', Event.CONTROLLER_SILENT),
        ("ControlException", "libfranka: Move command aborted: User Stop pressed!", Event.ROBOT_DISABLED),
        ("ControlException", '["joint_velocity_violation"]', Event.ROBOT_REFLEX),
    ],
)
def test_errors_in_the_makers_words_are_events_of_ours(error, words, event) -> None:
    assert event_of(error, words) is event
