# SPDX-License-Identifier: BSD-3-Clause
"""What ``check`` predicts and what it refuses."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import BadFile
from impedance_modules.modules.held_object import OBJECT
from impedance_modules.modules.spring import displacement_of
from impedance_modules.prediction.contact_geometry import place_surface, surface_distance
from impedance_modules.prediction.feasibility import refuse_infeasible
from impedance_modules.prediction.forecast import Forecast, forecast_task
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.robot.rotation import exp3
from impedance_modules.spec.task import SurfaceSpec
from tests.support.commands import python, refusal
from tests.support.forecast_tasks import BOX, HOLD_AND_LIFT, assembled, predicted, wipe, write_task
from tests.support.paths import CHECKOUT

SLOW = ("numba", "rerun", "pyarrow", "matplotlib", "scipy.signal", "daqp", "proxsuite")


def forecast(path: Path) -> tuple[Assembly, Forecast]:
    assembly, prediction = predicted(path)
    return assembly, forecast_task(assembly, prediction)


@pytest.mark.parametrize("seed", [0, 2, 7, 10])
def test_rest_is_where_the_potential_energy_is_stationary(tmp_path: Path, seed: int) -> None:
    """Sum of springs, biases, forces, weight and surfaces, differentiated along motions that keep the grasps."""
    random = np.random.default_rng(seed)
    height, turn = -0.02 - 0.04 * random.random(), 0.1 * random.normal()
    place = f"{{z: {height:.4f}, ry: {turn:.4f}, x: {0.62 + 0.05 * random.random():.4f}}}"
    assembly, prediction = predicted(write_task(tmp_path, BOX, ("{z: -0.05}", place)))
    phase, rest = prediction.motion.phases[1], prediction.rests[1]
    assert rest is not None
    mechanism = Mechanism(assembly)

    def potential(q: np.ndarray) -> float:
        """Weight and its carrying cancel here; the squeeze does no work on the welded box."""
        mechanism.update(q, np.zeros_like(q))
        total = 0.0
        for arm in phase.modules.arms:
            turned = q[arm.bias.joints] - phase.equilibrium.rests[arm.limb.name]
            total += 0.5 * float(turned @ (arm.bias.stiffness * turned))
            for spring in arm.springs:
                target = phase.equilibrium.springs[spring.name]
                moved = displacement_of(mechanism.kinematics.pose(spring.frame), target)
                total += 0.5 * float(moved @ (spring.world_stiffness @ moved))
        for contact, _ in mechanism.contacts(0.0):
            total += 0.5 * contact.surface.stiffness * contact.depth**2
        return total

    mechanism.update(rest.q, np.zeros_like(rest.q))
    rows, gap = mechanism.grasp_rows()
    assert np.max(np.abs(gap)) < 1e-10
    assert rest.pressure[OBJECT][2] > 0.1
    _, values, right = np.linalg.svd(rows)
    for direction in right[np.sum(values > 1e-9 * values[0]) :]:
        step = np.zeros(assembly.model.n)
        step[mechanism.joints] = 1e-5 * direction
        assert abs(potential(rest.q + step) - potential(rest.q - step)) / 2e-5 < 2e-5


def test_the_hand_is_deflected_by_force_over_stiffness(tmp_path: Path) -> None:
    """One stiff axis against a table: the table's force is K times the stretch, less what the joints take."""
    _, found = forecast(wipe(tmp_path))
    press = next(phase for phase in found.phases if phase.predicted.name == "press")
    arm = press.arms[0]
    assert arm.contact_force == pytest.approx(200.0 * arm.deflection.distance, rel=0.15)
    assert arm.commanded.torque < arm.total.torque
    assert press.predicted.met is None and found.phases[0].predicted.met is True


def shaky(folder: Path) -> Path:
    """Two hands damped at 0.9 from the box's inertia shake Baxter's elastic joints (seen on the plant)."""
    return write_task(folder, BOX, ("damping_ratio: 0.3", "damping_ratio: 0.9"))


def test_an_unstable_loop_is_refused_with_its_line_and_what_would_be_stable(tmp_path: Path) -> None:
    """The named rate is accepted; an experiment that allows it gets the forecast with a note."""
    _, calm = forecast(write_task(tmp_path, BOX))
    assert all(loop.stable and loop.growth < 1.0 for loop in calm.phases[0].loops) and not calm.notes
    path = shaky(tmp_path)
    text = refusal("check", path)
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if "- name: hand" in text)
    assert re.match(rf"{re.escape(str(path))}:{line}:\d+: arms\.right\.springs: the loop of 'object'", text)
    assert "at 1000 Hz" in text and "--allow-unstable" in text
    assembly = replace(assembled(path), allow_unstable=True)
    found = forecast_task(assembly, refuse_infeasible(assembly))
    (loop,) = found.phases[0].loops
    assert not loop.stable and loop.damping_ratio < 0.0 and loop.scale < 1.0
    assert any("unstable" in note for note in found.notes)


@pytest.mark.parametrize("rate", [200, 300])
def test_a_rate_that_is_too_low_is_refused_and_the_one_that_is_named_is_not(rate: int) -> None:
    text = refusal("check", "box-hold", "--rate", rate)
    found = re.search(r"--rate (\d+) or more", text)
    assert found is not None and "at most" in text
    higher = float(found[1])
    assert rate < higher < 500
    refuse_infeasible(assembled("box-hold", rate=higher))
    with pytest.raises(BadFile, match="unstable"):
        refuse_infeasible(assembled("box-hold", rate=0.95 * higher))


def test_a_softer_hand_as_named_is_stable(tmp_path: Path) -> None:
    """All axes softer by the factor that the refusal names; a fifth stiffer than that is refused."""
    found = re.search(r"at most (\d+) N/m instead of 200", refusal("check", "box-hold", "--rate", 300))
    assert found is not None
    text = (CHECKOUT / "tasks" / "box-hold.yaml").read_text()
    for share, stable in ((0.99, True), (1.2, False)):
        linear, angular = share * int(found[1]), share * int(found[1]) / 40.0
        softer = f"x: {linear}, y: {linear}, z: {linear}, rx: {angular}, ry: {angular}, rz: {angular}"
        (tmp_path / "soft.yaml").write_text(
            text.replace("x: 200, y: 200, z: 200, rx: 5, ry: 5, rz: 5", softer)
        )
        soft = replace(assembled(tmp_path / "soft.yaml", rate=300), allow_unstable=True)
        assert all(loop.stable for phase in refuse_infeasible(soft).loops for loop in phase.loops) == stable


def test_a_condition_that_will_not_come_is_announced(tmp_path: Path) -> None:
    path = write_task(tmp_path, HOLD_AND_LIFT, ("duration: 1.5}", "duration: 1.5, until: {contact: true}}"))
    assert any("has not come" in note for note in forecast(path)[1].notes)


def test_a_tank_below_the_need_is_refused_with_need_and_costs(tmp_path: Path) -> None:
    path = write_task(tmp_path, HOLD_AND_LIFT, ("initial: 5", "initial: 0.8"))
    text = refusal("check", path)
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if "tank" in text)
    told = rf"{re.escape(str(path))}:{line}:\d+: safety\.tank\.initial: the task needs \d\.\d\d J"
    assert re.match(told, text)
    assert "springs deflected" in text and "phase 'lift'" in text
    with pytest.raises(BadFile):
        predicted(path)


def test_a_torque_beyond_a_limit_is_refused_with_joint_and_phase(tmp_path: Path) -> None:
    changes = ("z: 200", "z: 5000"), ("initial: 8, max: 12", "initial: 900, max: 1000")
    told = r"phases\[1\]: phase 'press' asks \d+\.\d N\.m of \w+, whose limit is (15|50) N\.m"
    assert re.search(told, refusal("check", wipe(tmp_path, *changes)))


def test_a_sine_beyond_half_the_used_rate_is_refused(tmp_path: Path) -> None:
    sine = "right.hand: {z: {sine: {amplitude: 0.001, frequency: 60}}}"
    path = write_task(tmp_path, HOLD_AND_LIFT, ("right.hand: {z: 0.15}", sine))
    text = refusal("check", path, "--rate", 100)
    where = "phases[1].equilibrium.right.hand.z.sine.frequency"
    assert f"{where}: 60 Hz is not below half the control rate, 50 Hz" in text
    assert re.match(rf"{re.escape(str(path))}:\d+:\d+: ", text)


def test_the_command_prints_and_exits(tmp_path: Path) -> None:
    verb = ("-m", "impedance_modules", "check")
    good = python(*verb, str(write_task(tmp_path, HOLD_AND_LIFT)))
    assert good.returncode == 0 and not good.stderr
    words = "torque, yields at rest, least damped, highest stable, energy the tank must cover, sensing"
    assert all(word in good.stdout for word in words.split(", "))
    bad = python(*verb, str(write_task(tmp_path, HOLD_AND_LIFT, ("initial: 5", "initial: 0.8"))))
    assert bad.returncode == 2 and not bad.stdout
    assert bad.stderr.startswith(f"{tmp_path / 'task.yaml'}:")


@pytest.mark.parametrize("verb", ["check", "analyze"])
def test_nothing_slow_is_imported(tmp_path: Path, verb: str) -> None:
    path = write_task(tmp_path, BOX)
    code = (
        "import sys\nfrom impedance_modules.cli.main import main\n"
        f"sys.argv = ['impedance', '{verb}', {str(path)!r}]\n"
        "try:\n    main()\nexcept SystemExit as end:\n    print('exit', end.code)\n"
        f"print('slow', [m for m in {SLOW} if m in sys.modules])"
    )
    found = python("-c", code)
    assert found.stdout.rstrip().endswith("exit 0\nslow []")


def test_distances_from_a_box_turn_with_it() -> None:
    """A tilted box, seen from its own axes, is at the same distance; the normal is the distance's gradient."""
    random = np.random.default_rng(0)
    for _ in range(200):
        size, turn, centre = 0.1 + random.random(3), random.normal(size=3), random.normal(size=3)
        straight = SurfaceSpec("box", None, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), tuple(size), 1e4, 0.0, 0.0)
        tilted = SurfaceSpec("box", None, tuple(centre), tuple(turn), tuple(size), 1e4, 0.0, 0.0)
        point = random.normal(size=3)
        distance, normal = surface_distance(place_surface(straight), point)
        moved, turned = surface_distance(place_surface(tilted), exp3(turn) @ point + centre)
        assert moved == pytest.approx(distance, abs=1e-12)
        np.testing.assert_allclose(turned, exp3(turn) @ normal, atol=1e-12)
        beyond = surface_distance(place_surface(straight), point + 1e-6 * normal)[0]
        assert beyond == pytest.approx(distance + 1e-6, abs=1e-9)
