# SPDX-License-Identifier: BSD-3-Clause
"""Random set-points on the plant: no unpaid energy, no jump, an empty tank that stops nothing, replays bit for bit."""

import numpy as np
import pytest

from impedance_modules.control.loop import Interrupt, run_loop
from impedance_modules.control.supervisor import Ending, Supervisor
from impedance_modules.episode.reader import read_episode
from impedance_modules.runs.execution import RunOptions, carry_out
from impedance_modules.runs.recorded_set_points import RecordedSetPoints
from impedance_modules.runs.run_backends import replay_backend
from impedance_modules.runs.task_plant import sim_backend
from impedance_modules.runs.verify import verify
from impedance_modules.streaming.policy import PolicySource
from tests.support.adversity import Books, Pushes
from tests.support.led_arms import RandomSender, led_assembly

LIMIT, LAG, H = 0.3, 0.04, 1e-3
ROUNDING = 1e-6


def led_run(folder, seed, *, rate, loss=0.2, push=0.0, duration=None, **task):
    """A run whose hands are sent about at random, perhaps pushed too; its books, its sender, its ending."""
    assembly = led_assembly(folder, **task)
    sender, backend = RandomSender(assembly, seed, rate=rate, loss=loss), sim_backend(assembly, seed)
    supervisor = Supervisor(assembly, sender)
    if push:
        backend.plant.torques.append(Pushes(np.random.default_rng(seed), assembly.model.n, push, 1.0))
    books = Books(supervisor, backend.plant)
    first = backend.start()
    supervisor.start(first)
    run_loop(
        supervisor,
        backend,
        first.state,
        books.watch,
        Interrupt(),
        duration=duration,
        paced=False,
        read_only=False,
    )
    return books, sender


@pytest.mark.parametrize(("rate", "held"), [(10, False), (50, True), (200, False), (500, True)])
def test_set_points_at_any_rate_with_losses_cause_no_jump_and_no_unpaid_energy(tmp_path, rate, held):
    books, sender = led_run(tmp_path, rate, rate=rate, held=held, force=0.0 if held else -4.0)
    supervisor = books.supervisor
    assert supervisor.ending is Ending.DONE, supervisor.reason
    assert sender.inbox.accepted > 3 and any(np.ptp(np.array(sender.places[:700]), axis=0).ravel() > 0.01)
    assert books.least_margin > -ROUNDING and books.largest_error < ROUNDING
    velocity = np.array(sender.velocities[:700])
    assert np.linalg.norm(velocity[:, :, :3], axis=2).max() <= LIMIT * (1 + 1e-12)
    change = np.linalg.norm(np.diff(velocity[:, :, :3], axis=0), axis=2).max()
    assert change <= LIMIT * H / LAG * (1 + 1e-9)
    places = np.array(sender.places[:700])
    assert np.linalg.norm(np.diff(places, axis=0), axis=2).max() <= LIMIT * H * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_claim_holds_while_the_hands_are_pushed_too(tmp_path, seed):
    books, _ = led_run(tmp_path, seed, rate=100, push=6.0, tank=0.4, force=-8.0, duration=0.7)
    assert books.least_margin > -ROUNDING


def test_a_set_point_that_the_tank_cannot_pay_is_not_followed_and_stops_nothing(tmp_path):
    books, sender = led_run(tmp_path, 1, rate=100, tank=0.32, force=0.0)
    granted = np.array(sender.granted)
    assert (granted == 0.0).any()
    assert books.supervisor.ending is Ending.DONE, books.supervisor.reason
    assert any("cannot pay" in text for _, text in books.supervisor.messages)
    assert books.least_margin > -ROUNDING


def carried(folder, assembly, source, backend="sim", robot=None):
    options = RunOptions(folder, 4, None, live=False, read_only=False, backend=backend)
    return carry_out(assembly, robot or sim_backend(assembly, 4), options, lambda *_: None, source)


@pytest.mark.parametrize("held", [False, True])
def test_a_recording_knows_what_was_asked_and_replays_bit_for_bit(tmp_path, held):
    assembly = led_assembly(tmp_path, held=held, force=0.0 if held else -4.0)
    carried(tmp_path / "run", assembly, RandomSender(assembly, 7, rate=12, loss=0.3))
    episode = read_episode(tmp_path / "run")
    name = "object" if held else "left.hand"
    fresh = episode.extra[f"set_point.{name}.fresh"]
    assert 0.3 < fresh[:800].mean() < 1.0 and not fresh[810:890].any()
    assert verify(episode, lambda part: None).samples == len(episode)
    # Fed back as a robot, the recording is followed likewise.
    again = carried(
        tmp_path / "again",
        assembly,
        RecordedSetPoints(episode, assembly.task.set_points),
        "replay",
        replay_backend(assembly, tmp_path / "run"),
    )
    then, now = (
        e.matrix("effort_command", assembly.model.joint_names)
        for e in (episode, read_episode(again.directory))
    )
    assert np.array_equal(then[: len(now)], now)


def test_a_policy_in_the_same_process_leads_a_hand(tmp_path):
    """It sees where the hand is, asks for 5 cm more, and is refused as anybody: the same policy gives the same run."""
    assembly = led_assembly(tmp_path, force=0.0)
    found = []
    for name in ("one", "two"):
        goal: list[np.ndarray] = []

        def policy(report, goal=goal):
            if not goal:
                goal.append(report.poses["left_hand"][:3] + np.array([0.05, 0.0, 0.0]))
            if report.time > 0.4:
                return {"left.hand": {"position": [9.0, 9.0, 9.0]}}
            return {"left.hand": {"position": goal[0].tolist()}}

        source = PolicySource(policy, assembly.task.set_points, rate=50)
        result = carried(tmp_path / name, assembly, source)
        found.append(read_episode(result.directory))
    reached = found[0].target["left_hand"][:, 0]
    assert 0.045 < reached[420] - reached[0] < 0.051
    # Refused from 0.4 s on: stale after 0.1 s more, at rest.
    assert np.ptp(reached[560:800]) == 0.0 and "m from its equilibrium" in source.refusals[-1]
    names = assembly.model.joint_names
    assert np.array_equal(*(episode.matrix("effort_command", names) for episode in found))
