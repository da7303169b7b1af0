# SPDX-License-Identifier: BSD-3-Clause
"""Contact judged from what the hands feel: made, lost, reported, and by how much it was missed."""

from __future__ import annotations

import numpy as np
import pytest

from impedance_modules.control.assembly import assemble
from impedance_modules.control.contact_detection import ContactJudge, ContactLoss
from impedance_modules.control.controller import Controller
from impedance_modules.control.supervisor import Supervisor
from impedance_modules.spec.task import ContactCondition
from tests.support.paths import TESTS

TASK = TESTS / "data" / "press-box.yaml"
PRESS, GRAVITY = 12.0, 9.81


@pytest.fixture(scope="module")
def supervisor() -> Supervisor:
    return Supervisor(assemble(str(TASK), effects=None, rate=None, scale=1.0, arm=None))


def _feel(supervisor: Supervisor, mass: float, table: float, squeeze: float) -> None:
    """Two hands share an object's weight and a table's push, and feel the squeeze."""
    wrench = np.zeros_like(supervisor.hand_wrenches.wrench)
    wrench[:, 2] = 0.5 * (table - mass * GRAVITY)
    wrench[:, 1] = [-squeeze, squeeze]
    supervisor.hand_wrenches.wrench[:] = wrench


def test_an_object_pressed_on_a_table_is_in_contact_until_it_is_lifted(supervisor: Supervisor) -> None:
    controller: Controller = supervisor.controller
    held = controller.modules.held
    assert held is not None
    lost = ContactLoss(controller, supervisor.hand_wrenches)
    # Share by share the weight of 1.2 kg hides 5.9 of the 12 N: that is no loss of contact.
    for table in (0.0, 2.0 * PRESS, 1.1 * PRESS, 2.0 * PRESS):
        _feel(supervisor, held.spec.mass, table, 15.0)
        assert lost.look() == []
    _feel(supervisor, held.spec.mass, 0.0, 15.0)
    assert sorted(lost.look()) == [
        "force axis z of left.hand lost contact",
        "force axis z of right.hand lost contact",
    ]
    assert lost.look() == []


def test_the_force_on_an_object_is_shared_by_its_hands(supervisor: Supervisor) -> None:
    held = supervisor.controller.modules.held
    assert held is not None
    random = np.random.default_rng(0)
    for _ in range(20):
        supervisor.hand_wrenches.wrench[:] = random.normal(size=supervisor.hand_wrenches.wrench.shape) * 10.0
        total = supervisor.hand_wrenches.wrench[:, :3].sum(axis=0) + np.array(
            [0.0, 0.0, held.spec.mass * GRAVITY]
        )
        for limb in held.limbs:
            assert np.allclose(supervisor.hand_wrenches.felt_by(limb), 0.5 * total)
        assert supervisor.hand_wrenches.force_on(None) == pytest.approx(float(np.linalg.norm(total)))


@pytest.mark.parametrize("present", [True, False])
def test_contact_counts_once_it_has_lasted(supervisor: Supervisor, present: bool) -> None:
    held = supervisor.controller.modules.held
    assert held is not None
    period = supervisor.hand_wrenches.period
    condition = ContactCondition(present=present, force=8.0, time=2.5 * period, target="object")
    judge = ContactJudge(condition, supervisor.hand_wrenches, supervisor.assembly.model)
    met = []
    # Force of the table on the object, look by look: a gap in between starts the count anew.
    for force in (0.0, 9.0, 9.0, 0.0, 9.0, 9.0, 9.0, 0.0, 0.0, 0.0):
        _feel(supervisor, held.spec.mass, force, 15.0)
        met.append(judge.met())
    assert met == [k == (6 if present else 9) for k in range(10)]


def test_contact_that_did_not_come_says_what_was_felt_and_what_is_asked_for(supervisor: Supervisor) -> None:
    held = supervisor.controller.modules.held
    assert held is not None
    condition = ContactCondition(present=True, force=8.0, time=0.05, target="object")
    judge = ContactJudge(condition, supervisor.hand_wrenches, supervisor.assembly.model)
    for force in (1.0, 5.0, 3.0):
        _feel(supervisor, held.spec.mass, force, 15.0)
        assert not judge.met()
    told = judge.account()
    assert "object feels 3.0 N" in told
    assert "at least 8 N for 0.05 s is asked for" in told
    assert f"most 5.0 N, {2 * supervisor.hand_wrenches.period:.2f} s into the phase" in told
