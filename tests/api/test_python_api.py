# SPDX-License-Identifier: BSD-3-Clause
"""The names that stay: light to import, the same as the command line, and a controller for a loop of one's own."""

import re

import numpy as np
import pytest

import impedance_modules as im
from impedance_modules import api
from impedance_modules.runs.task_plant import sim_backend
from tests.support.commands import invoke, python
from tests.support.paths import CHECKOUT


def test_the_package_alone_imports_nothing_heavy() -> None:
    code = "import sys, impedance_modules; print([m for m in ('numpy', 'pinocchio', 'numba') if m in sys.modules])"
    assert python("-c", code).stdout.strip() == "[]"


def test_every_name_is_there_and_documented() -> None:
    page = (CHECKOUT / "docs" / "python.md").read_text(encoding="utf-8")
    for name in api.__all__:
        assert getattr(im, name) is getattr(api, name)
        assert re.search(rf"\b{name}\b", page), name
    with pytest.raises(AttributeError, match="no attribute 'simulate'"):
        im.simulate  # noqa: B018 - it is the name that is asked for


def test_a_run_is_that_of_the_command_line(tmp_path):
    task = im.load_task("soft-hold")
    assert im.check(task).tank.need < task.tank.initial
    assert set(im.analyze(task).arms) == {"left", "right"}
    result = im.run(task, tmp_path / "here", seed=3, duration=0.3)
    assert result.ending is im.Ending.INTERRUPTED
    invoke("run", "soft-hold", "--out", tmp_path / "there", "--seed", 3, "--duration", 0.3)
    here, there = (im.read_episode(tmp_path / name) for name in ("here", "there"))
    for joint in task.model.joint_names:
        np.testing.assert_array_equal(here.effort_command[joint], there.effort_command[joint])


def own_loop(controller, backend, cycles):
    """A loop as somebody else would write it; the torques."""
    first = backend.start()
    controller.start(first.state, first.acting)
    state, sent = first.state, []
    for _ in range(cycles):
        effort = controller.tick(state)
        if effort is None:
            break
        sent.append(effort.copy())
        backend.write(effort)
        state = backend.read()
    backend.finish("hold")
    return np.array(sent)


def test_a_loop_of_ones_own_sends_what_a_run_sends(tmp_path):
    task = im.load_task("soft-hold")
    sent = own_loop(im.TaskController(task), sim_backend(task, 3), 300)
    im.run(im.load_task("soft-hold"), tmp_path / "run", seed=3, duration=0.3)
    recorded = im.read_episode(tmp_path / "run").matrix("effort_command", task.model.joint_names)
    np.testing.assert_array_equal(sent[:250], recorded[:250])


def test_a_loop_of_ones_own_can_be_stopped_and_brakes_first():
    task = im.load_task("mirrored-arms")
    controller, backend = im.TaskController(task), sim_backend(task, 0)
    first = backend.start()
    controller.start(first.state)
    state, efforts = first.state, 0
    for k in range(3000):
        if k == 800:
            controller.stop("the door was opened")
        effort = controller.tick(state)
        if effort is None:
            break
        efforts += 1
        backend.write(effort)
        state = backend.read()
    assert 801 < efforts < 1400 and controller.ending is im.Ending.INTERRUPTED
    assert "the door was opened" in controller.reason and np.abs(state.velocity).max() < 0.3
    assert controller.tick(state) is None and controller.phase == "part" and controller.tank > 0.0
    assert controller.messages[-1][1] == controller.reason


def test_a_robot_of_ones_own_is_run_by_its_four_methods(tmp_path):
    class Another:
        """Not known to the package."""

        def __init__(self, backend):
            self.start, self.read, self.write, self.finish = (
                *(backend.start, backend.read),
                *(backend.write, backend.finish),
            )

    task = im.load_task("soft-hold")
    result = im.run(task, tmp_path / "run", backend=Another(sim_backend(task, 0)), duration=0.2)
    assert im.read_episode(result.directory).metadata["backend"] == "Another"


class Well:
    """A spring to a place for one hand, and what a test wants to be wrong with it."""

    name = "well"

    def __init__(self, stiffness=200.0, wrong=None):
        self.stiffness, self.wrong, self.rest = stiffness, wrong, None

    def torque(self, q, velocity, kinematics):
        pose, jacobian = kinematics.pose("right_hand"), kinematics.jacobian_of("right_hand")[:3]
        if self.rest is None:
            self.rest = pose.translation + np.array([0.03, 0.0, 0.0])
        away = pose.translation - self.rest
        found = {
            "energy": 0.5 * self.stiffness * float(away @ away),
            "spring": -self.stiffness * jacobian.T @ away,
            "damper": np.zeros(q.size),
        }
        return im.OwnTorque(**{**found, **(self.wrong or {})})


def test_a_module_of_ones_own_is_summed_counted_and_recorded(tmp_path):
    """As a spring of the task: k (x_0 - x) of both springs balances where their stiffnesses say."""
    task = im.load_task("soft-hold", modules=[Well()])
    result = im.run(task, tmp_path / "run", duration=3.0)
    episode = im.read_episode(result.directory)
    moved = episode.pose["right_hand"][-1, 0] - episode.pose["right_hand"][0, 0]
    assert 0.4 * 0.03 * 0.7 < moved < 0.4 * 0.03 * 1.1  # 200 of 500 N/m, and the joint springs
    assert episode.metadata["own_modules"] == ["well"]
    assert np.abs(episode.extra["module.own.well.right_s1"][0]) > 0.0
    assert not episode.extra["module.own.well.left_s1"].any()
    with pytest.raises(im.ImpedanceError, match="modules of one's own"):
        invoke("replay", result.directory, "--verify")


def test_its_energy_is_part_of_the_claim():
    task = im.load_task("soft-hold", modules=[Well(2000.0)])
    controller, backend = im.TaskController(task), sim_backend(task, 0)
    first = backend.start()
    controller.start(first.state)
    tank = controller._supervisor.controller.tank
    assert tank.potential == pytest.approx(0.5 * 2000.0 * 0.03**2, rel=0.05)
    state = first.state
    for _ in range(1500):
        backend.write(controller.tick(state))
        state = backend.read()
        assert backend.plant.motor_work <= tank.work_bound + 1e-6


@pytest.mark.parametrize(
    "wrong",
    [
        {"energy": np.nan},
        {"energy": -1.0},
        {"spring": np.full(14, np.inf)},
        {"damper": np.zeros(7)},
    ],
)
def test_a_module_that_gives_no_torque_stops_the_run(wrong):
    module = Well()
    task = im.load_task("soft-hold", modules=[module])
    controller, backend = im.TaskController(task), sim_backend(task, 0)
    first = backend.start()
    controller.start(first.state)
    state = first.state
    for k in range(400):
        module.wrong = wrong if k >= 100 else None
        effort = controller.tick(state)
        if effort is None:
            break
        assert np.isfinite(effort).all()
        backend.write(effort)
        state = backend.read()
    assert controller.ending is im.Ending.STOPPED and "not finite" in controller.reason


def test_names_of_modules_are_checked():
    with pytest.raises(im.ImpedanceError, match="different names"):
        im.load_task("soft-hold", modules=[Well(), Well()])


PACKAGE = """
from impedance_modules.effects.effect import JointLaw
from impedance_modules.effects.effect_description import Description, Parameter
from impedance_modules.runs.task_plant import sim_backend


class Cubic(JointLaw):
    description = Description(
        id="cubic_friction", sentence="Grows with the cube of the speed.", equation="tau = c v^3",
        parameters=(Parameter("c", "N.m.s^3/rad^3", "friction", lower=0.0),), ports=("link",), keys=("joint",),
        signature="s", confusable_with=(), excitation="e", reference="r", applied="a",
    )

    def basis(self, sample, shape):
        return (sample.velocity**3)[..., None]


def another(assembly, seed):
    return sim_backend(assembly, seed)
"""


def test_another_installed_package_adds_effects_and_robots(tmp_path):
    (tmp_path / "their_package.py").write_text(PACKAGE)
    info = tmp_path / "their_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: their-package\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[impedance_modules.effects]\ncubic_friction = their_package:Cubic\n"
        "[impedance_modules.backends]\nanother = their_package:another\n"
    )
    there = {"PYTHONPATH": f"{tmp_path}:{CHECKOUT}"}
    shown = python("-m", "impedance_modules", "effects", "cubic_friction", **there)
    assert "cube of the speed" in shown.stdout
    words = ("soft-hold", "--backend", "another", "--duration", "0.1", "--out", str(tmp_path / "run"))
    assert (
        python("-m", "impedance_modules", "run", *words, **there).returncode == 130
        or (tmp_path / "run").exists()
    )
    refused = python("-m", "impedance_modules", "run", "soft-hold", "--backend", "other", **there)
    assert refused.returncode == 2 and "franka" in refused.stderr and "another" in refused.stderr
