# SPDX-License-Identifier: BSD-3-Clause
"""Every shipped task does what its first lines say, on a plant with noise."""

import re
from pathlib import Path

import numpy as np
import pytest

from impedance_modules.control.assembly import assemble
from impedance_modules.control.supervisor import Ending
from impedance_modules.episode.reader import read_episode
from impedance_modules.prediction.energy_need import forecast_tank
from impedance_modules.prediction.mechanism import Mechanism
from impedance_modules.prediction.quasi_static import predict_motion
from impedance_modules.spec.task_reader import read_task
from tests.support.paths import TESTS
from tests.support.shipped_runs import OBJECT, SHIPPED, TASKS, Watched, shipped, watch

LEVEL = np.deg2rad(2.0)
RIGHT, LEFT = "right_hand", "left_hand"
EVERY_TASK = pytest.mark.parametrize("name", SHIPPED)


def good_run(name: str, folder: Path = TASKS, **options: float) -> Watched:
    """A run that ended as planned, was never slowed by the tank, and stayed far from every limit."""
    watched = watch(folder / f"{name}.yaml", **options)
    whole = "duration" not in options
    supervisor = watched.supervisor
    assert supervisor.ending is (Ending.DONE if whole else Ending.INTERRUPTED), supervisor.reason
    assert all(name == "phase" or np.isfinite(watched.seen(name)).all() for name in watched.names)
    assert watched.slowed == 0 and watched.headroom > 0.0
    assert np.max(watched.effort_share) < 0.7
    assert watched.limit_margin() > 0.25
    assert not [text for _, text in supervisor.messages if "lost contact" in text]
    return watched


def _travel(path: np.ndarray) -> float:
    """Largest distance from the first point [m]."""
    return float(np.max(np.linalg.norm(path - path[0], axis=1)))


def test_there_are_enough_of_them() -> None:
    assert len(SHIPPED) >= 12


@EVERY_TASK
def test_says_what_to_feel_and_see(name: str) -> None:
    text = shipped(name).read_text(encoding="utf-8")
    lines = text.splitlines()
    assert len(lines) <= 60
    assert lines[0] == "# yaml-language-server: $schema=../schemas/task.schema.json"
    comment = lines[1 : lines.index("format: 1")]
    assert re.match(r"# Feel: [\s\S]*\n# See: ", "\n".join(comment))
    assert all(line.startswith("#") for line in comment)
    task, robot = read_task(str(shipped(name)))
    assert (task.name, robot.name) == (name, "baxter") and task.description


@EVERY_TASK
def test_holds_at_most_half_again_the_energy_it_needs(name: str) -> None:
    assembly = assemble(str(shipped(name)), effects=None, rate=None, scale=1.0, arm=None)
    need = forecast_tank(assembly, Mechanism(assembly), predict_motion(assembly)).need
    # What a sender of set-points may spend is no need that could be foretold.
    assert need <= assembly.tank.initial and (assembly.task.set_points or assembly.tank.initial <= 1.5 * need)


def _pressing(watched: Watched) -> float:
    """Sum of the forces that the hands' z axes exert downwards in phase 'press' [N]."""
    press = next(phase for phase in watched.assembly.task.phases if phase.name == "press")
    return -sum(axes["z"].force for axes in press.axes.values())


def test_press_and_slide() -> None:
    run = good_run("press-and-slide")
    force, path = run.seen(f"surface on {OBJECT}", "slide"), run.seen(f"at {OBJECT}", "slide")
    # Two hands press with 8 N each; the force on the table is the sum, less what the soft joint springs take up.
    assert _pressing(run) == 16.0
    assert np.mean(force[:, 2]) == pytest.approx(_pressing(run), rel=0.2)
    assert np.min(force[:, 2]) > 0.5 * _pressing(run)
    assert np.max(np.abs(force[:, 1])) < 0.35 * np.max(force[:, 2])
    assert np.ptp(path[:, 1]) > 0.15 and np.max(np.abs(path[:, 2])) < 0.002
    assert np.max(run.seen("tilt")) < LEVEL
    # The hands squeeze with 15 N: equal and opposite, whatever they do together.
    squeeze = 0.5 * (run.seen(f"object on {LEFT}") - run.seen(f"object on {RIGHT}"))[:, 1]
    assert np.mean(squeeze) == pytest.approx(15.0, rel=0.05)
    assert run.seen(f"at {OBJECT}")[-1, 2] > 0.02
    assert np.all(run.seen(f"surface on {OBJECT}", "lift")[-20:] == 0.0)


def test_press_and_slide_at_half_the_rate() -> None:
    run = good_run("press-and-slide", rate=500.0, seed=1, duration=7.0)
    force = run.seen(f"surface on {OBJECT}", "slide")
    assert np.mean(force[:, 2]) == pytest.approx(_pressing(run), rel=0.2)


def test_press_box_of_the_design() -> None:
    run = good_run("press-box", duration=5.0)
    force = run.seen(f"surface on {OBJECT}", "slide")
    assert 12.0 < np.mean(force[:, 2]) < 24.0 and np.min(force[50:, 2]) > 6.0
    assert np.ptp(run.seen(f"at {OBJECT}", "slide")[:, 1]) > 0.12
    assert np.max(run.seen("tilt", "slide")) < LEVEL


def test_box_hold() -> None:
    run = good_run("box-hold")
    assert _travel(run.seen(f"at {OBJECT}", "hold")) < 0.002
    assert run.seen(f"at {OBJECT}")[-1, 2] == pytest.approx(0.15, abs=0.01)
    assert np.max(run.seen("tilt")) < LEVEL
    assert np.mean(run.seen(f"object on {LEFT}")[:, 1]) == pytest.approx(20.0, rel=0.05)


def test_wipe_table_presses_with_its_force() -> None:
    run = good_run("wipe-table", duration=6.0)
    force = run.seen(f"surface on {RIGHT}", "wipe")
    assert np.mean(force[50:, 2]) == pytest.approx(10.0, rel=0.15) and np.min(force[50:, 2]) > 7.0
    assert np.ptp(run.seen(f"at {RIGHT}", "wipe")[:, 1]) > 0.18


def test_wipe_table_depth_presses_with_its_spring() -> None:
    run = good_run("wipe-table-depth", duration=6.5)
    force = run.seen(f"surface on {RIGHT}", "wipe")
    # 100 N/m, pressed in by 10 cm.
    assert np.mean(force[:, 2]) == pytest.approx(10.0, rel=0.15)
    assert np.ptp(run.seen(f"at {RIGHT}", "wipe")[:, 1]) > 0.18


def test_touch_and_stop() -> None:
    run = good_run("touch-and-stop")
    name, _, why = run.supervisor.sequence.ended[0]
    assert name == "feel" and why.startswith("contact")
    height = run.seen(f"at {RIGHT}")[:, 2]
    assert -0.005 < np.min(height) < 0.0 and height[-1] > 0.08
    assert 6.0 < np.max(np.linalg.norm(run.seen(f"surface on {RIGHT}"), axis=1)) < 20.0


def test_peg_compliance_gives_way_on_one_axis_only() -> None:
    run = good_run("peg-compliance", duration=6.0)
    moved = run.seen(f"at {RIGHT}") - run.seen(f"at {RIGHT}")[0]
    assert np.min(moved[:, 1]) < -0.025
    assert np.max(np.abs(moved[:, 0])) < 0.006
    assert 3.0 < np.max(np.linalg.norm(run.seen(f"surface on {RIGHT}"), axis=1)) < 20.0


def test_elbow_swing_leaves_the_hand_where_it_is() -> None:
    run = good_run("elbow-swing", duration=5.0)
    model = run.assembly.model
    elbow = np.array([model.pose(q, "right_lower_elbow").translation for q in run.seen("q")[::10]])
    assert _travel(elbow) > 0.12
    assert _travel(run.seen(f"at {RIGHT}")) < 0.003


def test_mirrored_arms_move_as_mirror_images() -> None:
    run = good_run("mirrored-arms", duration=4.5)
    right, left = run.seen(f"at {RIGHT}"), run.seen(f"at {LEFT}")
    assert np.max(np.abs(left - right * [1.0, -1.0, 1.0])) < 0.003
    assert _travel(right) > 0.1


def test_hands_take_turns() -> None:
    run = good_run("hand-over-hand", duration=4.0)
    first = "right-reaches"
    assert _travel(run.seen(f"at {LEFT}", first)) < 0.002 < 0.1 < _travel(run.seen(f"at {RIGHT}", first))
    assert np.ptp(run.seen(f"at {LEFT}", "right-pulls")[:, 0]) > 0.08


def test_joint_springs_need_no_hand_springs() -> None:
    run = good_run("joint-springs", duration=5.0)
    assert not [spring for arm in run.assembly.modules.arms for spring in arm.springs]
    right, left = run.seen(f"at {RIGHT}"), run.seen(f"at {LEFT}")
    assert left[-1, 1] - right[-1, 1] > left[0, 1] - right[0, 1] + 0.4


def test_soft_hold_stands_still() -> None:
    run = good_run("soft-hold", duration=2.0)
    assert max(_travel(run.seen(f"at {hand}")) for hand in (RIGHT, LEFT)) < 0.001


def test_reach_and_return_turns_when_it_has_arrived() -> None:
    run = good_run("reach-and-return", duration=4.2)
    name, seconds, why = run.supervisor.sequence.ended[0]
    assert name == "reach" and why.startswith("arrival") and seconds < 4.0
    at_arrival = run.seen(f"at {RIGHT}", "reach")[-1]
    assert np.linalg.norm(at_arrival - [0.8, -0.35, 0.2]) < 0.012


def test_retrace_path_draws_what_was_recorded() -> None:
    """Every recorded place is passed by the hand, in the order of the recording and at 0.8 times its speed."""
    run = good_run("retrace-path", duration=14.2)
    recorded = read_episode(TASKS / "figure-of-eight.parquet", kinds=("pose",))
    at, time = run.seen(f"at {RIGHT}", "retrace"), run.seen("time", "retrace")
    half = 0.25  # of the ramp, in which the path goes by as much as in half of the time at full speed
    for t in np.arange(1.0, 7.5, 0.5):
        place = recorded.pose[RIGHT][int(np.argmin(np.abs(recorded.time - t))), :3]
        there = int(np.argmin(np.abs(time - time[0] - 1.5 - half - t / 0.8)))
        assert np.linalg.norm(at[there] - place) < 0.008


def test_a_starved_tank_slows_the_task(tmp_path: Path) -> None:
    """Less energy than it needs: the phase clock lags, the hand stays with its spring, nothing is violated."""
    text = shipped("reach-and-return").read_text(encoding="utf-8")
    task = tmp_path / "starved.yaml"
    task.write_text(re.sub(r"initial: [\d.]+", "initial: 0.8", text), encoding="utf-8")
    run = watch(task)
    assert run.done and run.slowed > 500
    # With enough energy 'return' takes 3.7 s and its clock is the time.
    time, clock = run.seen("time", "return"), run.seen("clock", "return")
    assert time[-1] - time[0] > 4.5
    assert clock[-1] < 0.85 * (time[-1] - time[0]) and np.all(np.diff(clock) >= 0.0)
    # Slow, not limp: the springs keep their stiffness and the hand keeps to its (slower) equilibrium.
    assert run.softest == 1.0
    assert np.max(run.seen(f"error {RIGHT}")) < 0.03
    assert run.lowest >= run.assembly.tank.floor
    assert np.max(run.effort_share) < 0.7 and run.limit_margin() > 0.25


DATA = TESTS / "data"
PORT, STARBOARD = "port_palm", "starboard_palm"


def test_another_robot_holds_still() -> None:
    run = good_run("pair-hold", DATA)
    assert max(_travel(run.seen(f"at {palm}")) for palm in (PORT, STARBOARD)) < 0.001


def test_another_robot_wipes() -> None:
    run = good_run("pair-wipe", DATA)
    assert np.mean(run.seen(f"surface on {PORT}", "wipe")[:, 2]) == pytest.approx(10.0, rel=0.15)
    assert np.ptp(run.seen(f"at {PORT}", "wipe")[:, 1]) > 0.1


def test_another_robot_presses_a_box_with_two_hands() -> None:
    run = good_run("pair-box", DATA)
    assert np.mean(run.seen(f"surface on {OBJECT}", "slide")[:, 2]) == pytest.approx(16.0, rel=0.15)
    assert np.ptp(run.seen(f"at {OBJECT}", "slide")[:, 1]) > 0.06
    assert np.max(run.seen("tilt")) < LEVEL
