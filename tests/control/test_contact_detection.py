# SPDX-License-Identifier: BSD-3-Clause
"""Contact judged from the measured wrenches of the hands: made, lost, reported, and by how much it was missed."""

import numpy as np
import pytest

from impedance_modules.control.assembly import assemble
from impedance_modules.control.contact_detection import ContactJudge, ContactLoss
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.spec.task import ContactCondition
from tests.support.paths import TESTS

TASK = TESTS / "data" / "press-box.yaml"
PRESS = 12.0


@pytest.fixture(scope="module")
def supervisor() -> Supervisor:
    return Supervisor(assemble(str(TASK), effects=None, rate=None, scale=1.0, arm=None))


def weight(supervisor: Supervisor) -> float:
    return 9.81 * supervisor.controller.modules.held.spec.mass


def set_wrenches(supervisor: Supervisor, table: float) -> None:
    """Two hands share an object's weight, a table's push and the squeeze of 15 N."""
    wrench = supervisor.hand_wrenches.wrench
    wrench[:] = 0.0
    wrench[:, 2] = 0.5 * (table - weight(supervisor))
    wrench[:, 1] = [-15.0, 15.0]


def judge_of(supervisor: Supervisor, time: float, *, present: bool = True) -> ContactJudge:
    condition = ContactCondition(present=present, force=8.0, time=time, target="object")
    return ContactJudge(condition, supervisor.hand_wrenches, supervisor.assembly.model)


def test_an_object_pressed_on_a_table_is_in_contact_until_it_is_lifted(supervisor: Supervisor) -> None:
    lost = ContactLoss(supervisor.controller, supervisor.hand_wrenches)
    # Share by share the weight of 1.2 kg hides 5.9 of the 12 N: that is no loss of contact.
    for table in (0.0, 2.0 * PRESS, 1.1 * PRESS, 2.0 * PRESS):
        set_wrenches(supervisor, table)
        assert lost.look() == []
    set_wrenches(supervisor, 0.0)
    hands = ("left.hand", "right.hand")
    assert sorted(lost.look()) == [f"force axis z of {hand} lost contact" for hand in hands]
    assert lost.look() == []


def test_the_force_on_an_object_is_shared_by_its_hands(supervisor: Supervisor) -> None:
    random, felt = np.random.default_rng(0), supervisor.hand_wrenches
    for _ in range(20):
        felt.wrench[:] = random.normal(size=felt.wrench.shape) * 10.0
        total = felt.wrench[:, :3].sum(axis=0) + np.array([0.0, 0.0, weight(supervisor)])
        for limb in supervisor.controller.modules.held.limbs:
            assert np.allclose(felt.force_on_hand(limb), 0.5 * total)
        assert felt.force_on(None) == pytest.approx(float(np.linalg.norm(total)))


@pytest.mark.parametrize("present", [True, False])
def test_contact_counts_once_it_has_lasted(supervisor: Supervisor, present: bool) -> None:
    judge, met = judge_of(supervisor, 2.5 * supervisor.hand_wrenches.period, present=present), []
    # Force of the table on the object, look by look: a gap in between starts the count anew.
    for force in (0.0, 9.0, 9.0, 0.0, 9.0, 9.0, 9.0, 0.0, 0.0, 0.0):
        set_wrenches(supervisor, force)
        met.append(judge.met())
    assert met == [k == (6 if present else 9) for k in range(10)]


def test_contact_that_did_not_come_says_what_was_felt_and_what_is_asked_for(supervisor: Supervisor) -> None:
    judge = judge_of(supervisor, 0.05)
    for force in (1.0, 5.0, 3.0):
        set_wrenches(supervisor, force)
        assert not judge.met()
    told = judge.account()
    assert "3.0 N on object" in told
    assert "at least 8 N for 0.05 s is asked for" in told
    assert f"most 5.0 N, {2 * supervisor.hand_wrenches.period:.2f} s into the phase" in told
