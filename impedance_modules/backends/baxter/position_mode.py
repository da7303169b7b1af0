# SPDX-License-Identifier: BSD-3-Clause
"""Moves arms to a posture by the robot's own position mode: slowly, supervised, and without switching power on.

``named_posture`` finds a posture, ``Approach`` leads position mode there by minimum jerk, ``PostureMover`` does so for
``impedance baxter untuck``. Every target passes ``Stops``; the robot's own time-out holds the arms where they are when
this process ends.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.driver import Commander
from impedance_modules.backends.baxter.joint_states import StateSample
from impedance_modules.backends.baxter.robot_link import RobotCallbacks, RobotLink
from impedance_modules.backends.baxter.ros.messages import AssemblyState, Empty
from impedance_modules.backends.baxter.stops import Stops, stop_thresholds
from impedance_modules.errors import BadInput, RobotRefused, RobotStopped
from impedance_modules.robot.hand_postures import with_joint_angles
from impedance_modules.robot.model import Limb
from impedance_modules.safety.stop_levels import Event
from impedance_modules.spec.robot_spec import RobotSpec
from impedance_modules.spec.task_reader import read_task

if TYPE_CHECKING:
    from impedance_modules.backends.baxter.session import Session

PARTING = 10
"""How often the last hold is repeated, at 100 Hz."""

STALE = 0.1
"""A state older than this stops the move [s]."""

SUPPRESS_PERIOD = 0.05
"""Between two requests to suppress collision avoidance [s]; each lapses after 0.2 s."""

NEAR = 0.1
"""If every joint is this close to the start, the task's springs may pull it the rest of the way [rad]."""

ARRIVED = 0.03
"""If every joint is this close, the move is complete [rad]."""

TOP_SPEED = 0.25
"""Of the fastest joint during the move [rad/s]."""

SETTLING = 5.0
"""Longest wait at the end of the move; position mode lags by about 0.4 s [s]."""

STEP = 0.01
"""Between two targets [s]."""

NEUTRAL: Mapping[str, float] = {
    "s0": 0.0,
    "s1": -0.55,
    "e0": 0.0,
    "e1": 0.75,
    "w0": 0.0,
    "w1": 1.26,
    "w2": 0.0,
}
"""Rethink's neutral posture [rad] [sdk]."""

TUCKED: Mapping[str, float] = {
    "s0": -1.0,
    "s1": -2.175,
    "e0": 3.0,
    "e1": 2.55,
    "w0": 0.0,
    "w1": 0.01,
    "w2": 0.0,
}

UNTUCKED: Mapping[str, float] = {
    "s0": -0.08,
    "s1": -1.0,
    "e0": -1.19,
    "e1": 1.94,
    "w0": 0.67,
    "w1": 1.03,
    "w2": -0.50,
}
"""Of the left arm [rad] [sdk]; the right one mirrors them. Tucked, s1 lies outside its published range."""

MIRRORED: Mapping[str, int] = {"s0": -1, "s1": 1, "e0": -1, "e1": 1, "w0": -1, "w1": 1, "w2": -1}
"""Sign with which the right arm takes the left one's angles."""

POSTURES: Mapping[str, Mapping[str, float]] = {"neutral": NEUTRAL, "tucked": TUCKED, "untucked": UNTUCKED}
"""Of the arm whose angles are not mirrored."""


def named_posture(spec: RobotSpec, name: str) -> dict[str, dict[str, float]]:
    """Finds the posture of every limb by a name of ``POSTURES`` or by a task, limb -> short name -> [rad].

    A limb that the task leaves out stands at the neutral posture.

    Raises:
        BadInput: Neither; or the task is for another robot.
    """
    # The tables hold the first limb by name; the other has the mirror image.
    plain = min(spec.limbs)
    by_name = POSTURES.get(name, NEUTRAL)
    found = {
        limb: {
            short: by_name[short] if limb == plain else MIRRORED[short] * by_name[short]
            for short in spec.limbs[limb].joints
        }
        for limb in spec.limbs
    }
    if name in POSTURES:
        return found
    try:
        task, robot = read_task(name)
        task = with_joint_angles(task, robot)
    except BadInput as error:
        raise BadInput(f"posture '{name}': {error} (valid besides tasks: {', '.join(POSTURES)})") from None
    if robot.name != spec.name:
        raise BadInput(
            f"posture '{name}': the task is for robot '{robot.name}' (valid: one for '{spec.name}')"
        )
    found.update({arm: dict(task.arms[arm].posture) for arm in task.arms})
    return found


class Approach:
    """A move to a start posture."""

    def __init__(self, limbs: Mapping[str, Limb], start: Array, allowed: bool) -> None:
        """Args are the limbs that move, the posture (n,) [rad], and whether moving there was asked for."""
        self._start, self._allowed = start, allowed
        self._joints = np.concatenate([limb.joints for limb in limbs.values()])
        self._names = [name for limb in limbs.values() for name in limb.joint_names]

    def go(self, link: RobotLink, move: Callable[[Array], None]) -> None:
        """Moves there if need be; returns when the arms have arrived.

        Args:
            link: Tells where the arms are.
            move: Sets the target (n,) [rad] of the position mode; raises when the robot may not move any more.

        Raises:
            RobotRefused: The arms are elsewhere and moving them was not asked for, or they do not arrive.
        """
        here = _position(link)
        if self._distance(here) <= NEAR:
            return
        if not self._allowed:
            raise RobotRefused(
                f"{self._furthest(here)} from where the task begins (valid: within {NEAR} rad;"
                f" --approach lets the robot's position mode bring the arms there at {TOP_SPEED} rad/s,"
                " with only the robot's own collision avoidance between them and things)"
            )
        self._travel(here, move)
        end = time.monotonic() + SETTLING
        while self._distance(_position(link)) > ARRIVED:
            if time.monotonic() > end:
                raise RobotRefused(
                    f"{self._furthest(_position(link))} from where the task begins, and position mode brings it"
                    " no closer: is something in its way?"
                )
            move(self._start)
            time.sleep(STEP)

    def _travel(self, here: Array, move: Callable[[Array], None]) -> None:
        """Minimum jerk: s = 10 t^3 - 15 t^4 + 6 t^5, whose top speed is 15/8 of the mean."""
        duration = max(1.0, 15.0 / 8.0 * self._distance(here) / TOP_SPEED)
        began = time.monotonic()
        while (t := (time.monotonic() - began) / duration) < 1.0:
            s = t**3 * (10.0 - 15.0 * t + 6.0 * t * t)
            move(here + s * (self._start - here))
            time.sleep(STEP)
        move(self._start)

    def _distance(self, position: Array) -> float:
        return float(np.abs(position - self._start)[self._joints].max())

    def _furthest(self, position: Array) -> str:
        away = (position - self._start)[self._joints]
        worst = int(np.argmax(np.abs(away)))
        return f"{self._names[worst]} is {away[worst]:+.3f} rad"


class Interrupted(Exception):  # noqa: N818 - no error
    """A person asked to stop."""


class PostureMover:
    """Brings all arms of a robot to one posture."""

    def __init__(self, session: Session, tucked: bool, asked_to_end: Callable[[], bool]) -> None:
        """Prepares; sends nothing.

        Args:
            session: Its preflight checks have been made.
            tucked: The arms are within their own collision avoidance field, which is suppressed during the move.
            asked_to_end: Called at every step; True ends the move.
        """
        self._session, self._tucked, self._asked = session, tucked, asked_to_end
        model = session.model
        thresholds = stop_thresholds(STALE, model.column("effort_max"))
        self._stops = Stops(thresholds, {name: limb.joints for name, limb in model.limbs.items()})
        self._suppressed_at = -np.inf

    def go(self, target: Array) -> bool:
        """Moves to a posture (n,) [rad] and holds there; False when a person ended it on the way.

        Raises:
            RobotRefused: The commands have no subscriber, or the arms do not arrive.
            RobotStopped: The robot stopped, reported a collision, or fell silent during the move.
        """
        session, transport = self._session, self._session.transport
        limbs = session.model.limbs
        commander = Commander(transport, limbs)
        suppressions = [transport.advertise(topics.suppress_avoidance(name), Empty) for name in limbs]
        session.link.set_callbacks(
            RobotCallbacks(self._on_state, self._on_robot, self._on_collision, self._on_cuff)
        )
        try:
            missing = commander.wait_for_subscribers()
            if missing:
                raise RobotRefused(f"nobody listens to {', '.join(missing)} (valid: 'baxter check')")

            def step(position: Array) -> None:
                if self._tucked and time.monotonic() - self._suppressed_at > SUPPRESS_PERIOD:
                    self._suppressed_at = time.monotonic()
                    for suppression in suppressions:
                        suppression.send(Empty())
                self._step(commander, position)

            return self._travel(commander, step, target)
        finally:
            session.link.set_callbacks(None)
            for suppression in suppressions:
                suppression.close()
            commander.close()

    def _travel(self, commander: Commander, step: Callable[[Array], None], target: Array) -> bool:
        try:
            Approach(self._session.model.limbs, target, True).go(self._session.link, step)
        except Interrupted:
            self._park(commander)
            return False
        except RobotStopped as stop:
            if stop.event != Event.ROBOT_DISABLED:
                self._park(commander)
            raise
        self._park(commander)
        return True

    def _park(self, commander: Commander) -> None:
        """Holds where the arms are."""
        sample = self._session.link.sample
        if sample is None:
            return
        for _ in range(PARTING):
            self._stops.move(sample.state.position)
            commander.send(self._stops.watch(time.monotonic()))
            time.sleep(0.01)

    def _step(self, commander: Commander, position: Array) -> None:
        """Sends one target of the move."""
        if self._asked():
            raise Interrupted
        sample = self._session.link.sample
        if sample is None or time.monotonic() - sample.received > STALE:
            raise RobotStopped(Event.STATE_LOST, f"no state of the arms for {STALE:g} s: held where they are")
        reason = self._stops.reason
        why = self._stops.move(position) if reason is None else reason.detail
        if why is not None:
            event = Event.BACKEND_LOST if reason is None else reason.event
            raise RobotStopped(event, f"the arms stop on their way: {why}")
        commander.send(self._stops.watch(time.monotonic()))

    def _on_state(self, sample: StateSample) -> None:
        self._stops.on_state(sample.taken, sample.state.position)

    def _on_robot(self, robot: AssemblyState, received: float) -> None:
        self._stops.on_robot(received, robot)

    def _on_collision(self, limb: str, detected: bool, received: float) -> None:
        self._stops.on_collision(received, limb, detected)

    def _on_cuff(self, limb: str, squeezed: bool) -> None:
        self._stops.on_cuff(limb, squeezed)


def _position(link: RobotLink) -> Array:
    """The newest measured angles (n,) [rad]."""
    if link.sample is None:
        raise RobotRefused("no state of the arms: is the robot on, and does 'impedance baxter check' pass?")
    return link.sample.state.position
