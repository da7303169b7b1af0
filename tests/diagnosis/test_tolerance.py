# SPDX-License-Identifier: BSD-3-Clause
"""A gap within the tolerance raises no alarm and is listed; one that changes the simulated motion is a gap."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from impedance_modules.cli.diagnose_verb import print_diagnosis
from impedance_modules.cli.terminal import Terminal
from impedance_modules.diagnosis.data.log import DataReport
from impedance_modules.diagnosis.model_selection.push_forces import PushPlace
from impedance_modules.diagnosis.model_selection.tolerance import (
    CHANGED,
    DRIFT,
    ranges,
    set_small_aside,
    stays_near,
)
from impedance_modules.diagnosis.report.diagnosis_files import diagnosis_object
from impedance_modules.diagnosis.report.html_causes import small_section
from impedance_modules.diagnosis.result import Cause, Diagnosis, Estimate, Remainder
from impedance_modules.diagnosis.rollout_result import CauseRollout, RolloutError, no_rollout
from tests.diagnosis.test_diagnosis import answer, record

RANGE = 8.0
"""Of the joint's torque [N.m]: one per cent is 0.08 N.m."""


def test_friction_that_stops_the_motion_is_a_cause_however_small_its_torque(tmp_path: Path) -> None:
    """0.012 N.m of a joint that carries some 3 N.m; sensors of a few mN.m see it, and so does the simulated motion."""
    paths = record(tmp_path, "little friction", noise=0.003, jitter=3e-5)
    code, found = answer(tmp_path, paths)
    assert (code, found["verdict"], found["small"], found["tolerance"]) == (0, "explained", [], 0.01)
    (cause,) = found["causes"]
    assert (cause["effect"], cause["joints"]) == ("coulomb_friction", ["elbow"])
    assert cause["rollout"]["ratio"] > CHANGED


def recording(torque: float, speed: float = 1.0) -> SimpleNamespace:
    one = np.array([[-0.5], [0.5]])
    tree = SimpleNamespace(joints=("hinge",))
    return SimpleNamespace(load=torque * one, position=one, velocity=speed * one, tree=tree)


def cause(ratio: float | None, verdict: str = "helps", error: float = 0.01) -> Cause:
    shown = None if ratio is None else CauseRollout(ratio, 1.0, ratio, error, verdict)
    numbers = {"hinge": {"fc": Estimate(0.05, 0.001, "N.m")}}
    nothing: dict[str, tuple[float, float]] = {}
    return Cause("coulomb_friction", ("hinge",), "link", numbers, 1.0, 0.9, (), (), nothing, nothing, shown)


def diagnosis(*causes: Cause, verdict: str = "explained", explained: bool = True) -> Diagnosis:
    report = DataReport({"run": 100.0}, {"run": 0.0}, (), (), "", None, ())
    remainder = Remainder(1.0, explained, "small")
    motion = {"purpose": "none needed", "joints": [], "excitation": ""}
    return Diagnosis(
        *(
            verdict,
            "arm",
            ("run",),
            (),
            report,
            "",
            (),
            0.9,
            no_rollout(),
            (),
            causes,
            0.0,
            remainder,
            motion,
            (),
        ),
    )


def unexplained_at(*places: tuple[str, str]) -> Diagnosis:
    """Nothing is named, and more than noise is left in comparisons (residual, joint)."""
    found = diagnosis(verdict="unexplained", explained=False)
    return replace(found, remainder=replace(found.remainder, failing=frozenset(places)))


def evidence(torque: float, left: float, noise: float = 0.0) -> SimpleNamespace:
    """One cause with a torque of this rms where the joint carries most, and what remains beside noise [N.m]."""
    key = ("coulomb_friction", "hinge", "link")
    term = SimpleNamespace(key=key, groups=(0,))
    return SimpleNamespace(
        prepared=(recording(2.0), recording(RANGE)),
        design=SimpleNamespace(groups=(("link", 0),), rate=20.0),
        model_fit=SimpleNamespace(model=(term,)),
        plain=SimpleNamespace(
            torque=lambda _fit, _term, r: {0: (0.25, 1.0)[r] * np.array([torque, -torque])},
            left=lambda *_: [np.full(100, np.hypot(left, noise))],
        ),
        counted=lambda *_: np.ones(100, dtype=bool),
        disturbed_rows=lambda *_: np.zeros(100, dtype=bool),
        rms=lambda *_: np.array([np.hypot(left, noise)]),
        selector=SimpleNamespace(model_fit=lambda model: SimpleNamespace(model=tuple(model))),
        excess_torque=lambda fit: 1.0 if fit is None or not fit.model else 0.1,
        floor=SimpleNamespace(rms=np.full((2, 1), noise)),
    )


@pytest.mark.parametrize(
    ("torque", "tolerance", "ratio", "small"),
    [
        (0.079, 0.01, 1.1, True),
        (0.081, 0.01, 1.1, False),
        (0.079, 0.0, 1.1, False),
        (0.079, 0.01, 1.3, False),
        (0.039, 0.005, None, True),
        (0.041, 0.005, None, False),
    ],
)
def test_a_cause_is_small_by_its_torque_and_by_its_motion(
    torque: float, tolerance: float, ratio: float | None, small: bool
) -> None:
    one = cause(ratio)
    found = set_small_aside(diagnosis(one), evidence(torque, 0.0), tolerance)
    assert (found.small == (one,), found.causes == (one,)) == (small, not small)
    assert (found.verdict, found.tolerance) == ("no_gap" if small else "explained", tolerance)
    assert ("within the tolerance" in found.remainder.structure) is small


@pytest.mark.parametrize(("torque", "small"), [(0.019, True), (0.021, False)])
def test_a_cause_has_to_be_small_in_every_recording_by_itself(torque: float, small: bool) -> None:
    """The same friction in two recordings: one per cent of 2 N.m in the one is a quarter of that in the other."""
    seen = evidence(0.0, 0.0)
    seen.plain.torque = lambda *_: {0: np.array([torque, -torque])}
    found = set_small_aside(diagnosis(cause(1.1)), seen, 0.01)
    assert found.verdict == ("no_gap" if small else "explained")


@pytest.mark.parametrize(("error", "small"), [(0.1, False), (0.23, False), (0.3, True)])
def test_what_probably_changes_the_motion_is_not_small(error: float, small: bool) -> None:
    """Error power 1.7 times as large without it: a logarithm of 0.53, which is 2.3 standard errors of 0.23."""
    one = cause(1.7, "no difference", error)
    found = set_small_aside(diagnosis(one), evidence(0.02, 0.0), 0.01)
    assert (found.small == (one,)) is small


def test_one_large_cause_keeps_the_others() -> None:
    other = replace(cause(None), effect="viscous_friction", joints=("elbow",))
    found = set_small_aside(diagnosis(cause(1.3), other), evidence(0.01, 0.0), 0.01)
    assert len(found.causes) == 2 and not found.small and found.verdict == "explained"


@pytest.mark.parametrize(("little", "minor"), [(4.0, True), (4.9, True), (5.1, False), (40.0, False)])
def test_beside_a_large_cause_one_is_minor_if_it_explains_little_of_the_torque(
    little: float, minor: bool
) -> None:
    """Of a hundred that are there; what each explains of the noise's power says nothing."""
    large = replace(cause(1.3), weight=0.001)
    other = replace(cause(None), effect="viscous_friction", joints=("elbow",), weight=0.9)
    terms = [
        SimpleNamespace(key=key, groups=(0,))
        for key in (("coulomb_friction", "hinge", "link"), ("viscous_friction", "elbow", "link"))
    ]
    sizes = {"coulomb_friction": 100.0 - little, "viscous_friction": little}
    seen = evidence(0.05, 0.0)
    seen.model_fit = SimpleNamespace(model=tuple(terms))
    seen.selector = SimpleNamespace(model_fit=lambda model: SimpleNamespace(model=tuple(model)))
    seen.excess_torque = lambda fit: 100.0 - sum(sizes[term.key[0]] for term in (fit.model if fit else ()))
    found = set_small_aside(diagnosis(large, other), seen, 0.01)
    assert (found.small == (other,), len(found.causes)) == (minor, 1 if minor else 2)
    # What is set aside is explained, too: it does not count as left beside a remainder within the tolerance.
    gap = diagnosis(
        replace(large, weight=0.9), replace(other, weight=0.08), verdict="partly", explained=False
    )
    for left, verdict in ((0.02, "explained"), (0.06, "partly")):
        found = set_small_aside(replace(gap, unexplained_weight=left), seen, 0.01)
        assert found.verdict == verdict


@pytest.mark.parametrize(("force", "small"), [(0.15, True), (0.17, False)])
@pytest.mark.parametrize("start", [0.0, 100.0])
def test_a_push_is_small_by_its_torque_while_it_lasts(force: float, small: bool, start: float) -> None:
    """On a lever of half a metre, for a hundredth of the recording: 0.08 N.m is a hundredth of the range."""
    push = replace(cause(None), effect="external_contact", port="contact")
    jacobian = np.zeros((3, 1))
    jacobian[1, 0] = 0.5
    seen = evidence(0.0, 0.0)
    item = SimpleNamespace(
        **vars(recording(RANGE)),
        log=SimpleNamespace(start=start),
        signals=SimpleNamespace(
            time=start + np.arange(1000) / 10.0,
            position=np.zeros((1000, 1)),
            model=SimpleNamespace(
                point_jacobian=lambda body, point, q: np.repeat(jacobian[None], len(q), axis=0)
            ),
        ),
    )
    seen.prepared = (item,)
    seen.pushes = (
        SimpleNamespace(
            recording=0, place=PushPlace("hand"), start=3.0, end=4.0, force=np.array([9.0, force, 0.0])
        ),
    )
    found = set_small_aside(diagnosis(push), seen, 0.01)
    assert (found.small == (push,), found.verdict) == (small, "no_gap" if small else "explained")


@pytest.mark.parametrize(("left", "noise", "verdict"), [(0.07, 0.02, "no_gap"), (0.09, 0.02, "unexplained")])
def test_what_remains_may_be_small_as_well(left: float, noise: float, verdict: str) -> None:
    found = diagnosis(verdict="unexplained", explained=False)
    near = {"hinge": RolloutError(0.03, 0.028, 0.025, noise, "rad")}
    found = replace(found, rollout=replace(found.rollout, position=near))
    assert set_small_aside(found, evidence(0.0, left), 0.01).verdict == verdict
    # Noise is no gap, however large it is beside the range.
    assert set_small_aside(found, evidence(0.0, left, noise=0.5), 0.01).verdict == verdict
    far = replace(
        found, rollout=replace(found.rollout, position={"hinge": RolloutError(0.2, 0.2, 0.2, noise, "rad")})
    )
    assert set_small_aside(far, evidence(0.0, left), 0.01).verdict == "unexplained"


@pytest.mark.parametrize(
    ("residuals", "left", "verdict"),
    [
        ({"velocity"}, 0.07, "no_gap"),
        ({"velocity"}, 0.09, "unexplained"),
        ({"velocity", "link"}, 0.07, "unexplained"),
    ],
)
def test_small_remainders_of_velocities_alone_change_no_simulated_motion(
    residuals: set[str], left: float, verdict: str
) -> None:
    """A logger's own filter of the velocities was an alarm wherever the simulated motion was not perfect."""
    found = unexplained_at(*((residual, "hinge") for residual in residuals))
    far = replace(found.rollout, position={"hinge": RolloutError(0.2, 0.2, 0.2, 0.02, "rad")})
    found = replace(found, rollout=far)
    seen = evidence(0.0, left)
    seen.design.groups = (("velocity", 0),)
    seen.prepared = (recording(2.0, 2.0), recording(2.0, RANGE))
    assert set_small_aside(found, seen, 0.01).verdict == verdict


def test_what_passes_as_noise_does_not_make_a_remainder_large() -> None:
    """A joint with hardly any torque, whose noise is a little more than its floor's, beside reported velocities."""
    seen = evidence(0.0, 0.0)
    seen.design.groups = (("link", 0), ("velocity", 0))
    seen.plain.left = lambda *_: [np.full(100, 1.1), np.full(100, 0.9)]
    seen.prepared = (recording(2.0, RANGE),)
    seen.floor.rms = np.array([[1.0, 1.0]])
    seen.rms = lambda *_: np.array([1.1, 0.9])
    velocity, link = ("velocity", "hinge"), ("link", "hinge")
    assert set_small_aside(unexplained_at(velocity), seen, 0.01).verdict == "no_gap"
    assert set_small_aside(unexplained_at(velocity, link), seen, 0.01).verdict == "unexplained"


def test_ranges_are_over_all_recordings_and_of_the_residual_s_own_quantity() -> None:
    items = [recording(2.0, 5.0), recording(8.0, 3.0)]
    np.testing.assert_allclose(ranges(items, [("link", 0), ("velocity", 0)]), [8.0, 5.0])


@pytest.mark.parametrize(("refitted", "near"), [(0.99 * DRIFT, True), (1.01 * DRIFT, False)])
def test_motion_stays_near_within_its_noise(refitted: float, near: bool) -> None:
    rollout = SimpleNamespace(position={"hinge": RolloutError(9.0, 8.0, refitted, 1.0, "rad")})
    assert stays_near(rollout, {"hinge": 0.0}) is near
    # As near as a stated share of its own motion is near enough, whatever the noise; other joints are not judged.
    assert stays_near(rollout, {"hinge": 1.02 * DRIFT}) and stays_near(rollout, {})


@pytest.mark.parametrize(
    ("moment", "counts", "disturbed", "verdict"),
    [
        (1.0, True, False, "no_gap"),
        (4.0, True, False, "unexplained"),
        (4.0, False, False, "no_gap"),
        (4.0, False, True, "unexplained"),
    ],
)
def test_what_lasts_for_a_moment_is_judged_while_it_lasts(
    moment: float, counts: bool, disturbed: bool, verdict: str
) -> None:
    """A cable that snags for half a second of a long recording: little by its mean, and not by itself.

    What is left out as contact does not count; what is left out because no law has it does.
    """
    found = diagnosis(verdict="unexplained", explained=False)
    seen = evidence(0.0, 0.05, noise=0.05)
    left, rows = 0.05 * np.random.default_rng(3).normal(size=1000), np.ones(1000, dtype=bool)
    left[500:510] *= moment
    rows[500:510] = counts
    seen.plain.left = lambda *_: [left]
    seen.counted = lambda *_: rows
    seen.disturbed_rows = lambda *_: ~rows & disturbed
    assert set_small_aside(found, seen, 0.01).verdict == verdict


@pytest.mark.parametrize(("refitted", "near"), [(0.0099, True), (0.0101, False)])
@pytest.mark.parametrize("remains", ["hinge", "", "elsewhere"])
def test_a_share_of_the_motion_is_near_at_the_joints_where_something_remains(refitted, near, remains) -> None:
    """The joint moves by 1 rad; where nothing is known to remain, all joints count."""
    position = {"hinge": RolloutError(0.02, 0.015, refitted, 0.001, "rad")}
    failing = frozenset({("link", remains)} if remains else ())

    def judged(found: Diagnosis, seen: SimpleNamespace) -> str:
        rollout = replace(found.rollout, position=position)
        remainder = replace(found.remainder, failing=failing)
        return set_small_aside(replace(found, rollout=rollout, remainder=remainder), seen, 0.01).verdict

    alone = diagnosis(verdict="unexplained", explained=False)
    passes = near or remains == "elsewhere"
    assert judged(alone, evidence(0.0, 0.05)) == ("no_gap" if passes else "unexplained")
    beside = diagnosis(cause(1.3), verdict="partly_explained", explained=False)
    assert judged(beside, evidence(0.2, 0.05)) == ("explained" if passes else "partly_explained")


def test_another_joint_whose_noise_is_large_does_not_make_a_remainder_large() -> None:
    """A flange that carries hardly any torque, beside a shoulder at which a little is left."""
    seen = evidence(0.0, 0.0)
    seen.design.groups = (("link", 0), ("link", 1))
    seen.plain.left = lambda *_: [np.full(100, 1.001), np.full(100, 1.1)]
    tree = SimpleNamespace(joints=("hinge", "flange"))
    load = np.array([[-4.0, -0.1], [4.0, 0.1]])
    seen.prepared = (SimpleNamespace(load=load, position=load, velocity=load, tree=tree),)
    seen.floor.rms = np.array([[1.0, 1.0]])
    seen.rms = lambda *_: np.array([1.001, 1.1])
    hinge, flange = ("link", "hinge"), ("link", "flange")
    assert set_small_aside(unexplained_at(hinge), seen, 0.01).verdict == "no_gap"
    assert set_small_aside(unexplained_at(hinge, flange), seen, 0.01).verdict == "unexplained"


def test_what_is_small_is_printed_in_the_json_and_in_no_patch(capsys: pytest.CaptureFixture[str]) -> None:
    found = set_small_aside(diagnosis(cause(1.0)), evidence(0.05, 0.0), 0.01)
    print_diagnosis(found, Terminal())
    shown = capsys.readouterr().out
    assert (
        "coulomb_friction on hinge" in shown[shown.index("small, within 1 % of the joints' torque ranges:") :]
    )
    made = diagnosis_object(found)
    assert (made["causes"], len(made["small"]), made["patch"]) == ([], 1, None)
    section = small_section(made["small"], made["tolerance"])
    assert (
        "<h2>Too small to matter</h2>" in section
        and "coulomb_friction on hinge" in section
        and "1 %" in section
    )
    assert small_section([], 0.01) == ""


def test_other_places_of_a_cause_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    one = replace(cause(1.3), effect="torque_gain", port="actuator", elsewhere=("sensor",))
    print_diagnosis(diagnosis(one), Terminal())
    assert "as well at: torque sensor" in capsys.readouterr().out
    (made,) = diagnosis_object(diagnosis(one))["causes"]
    assert (made["place"], made["other_places"]) == ("drive", ["torque_sensor"])
