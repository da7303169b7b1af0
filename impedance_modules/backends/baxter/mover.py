# SPDX-License-Identifier: BSD-3-Clause
"""Moves arms to a posture by the robot's own position mode: slowly, watched, and never with power of its own making.

Every target passes ``Stops``; the robot's time-out holds the arms wherever they are when this process dies.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from impedance_modules.backends.baxter import topics
from impedance_modules.backends.baxter.approach import Approach
from impedance_modules.backends.baxter.commander import Commander
from impedance_modules.backends.baxter.joint_states import Sample
from impedance_modules.backends.baxter.link import Listener
from impedance_modules.backends.baxter.messages import AssemblyState, Empty
from impedance_modules.backends.baxter.session import BRAKING_SHARE, Session
from impedance_modules.backends.baxter.stop_rules import stop_rules
from impedance_modules.backends.baxter.stops import Stops
from impedance_modules.errors import RobotRefused, RobotStopped
from impedance_modules.safety.stop_levels import Event

Array = NDArray[np.float64]

ATTACH_TIME = 0.3
"""A robot needs about 0.24 s to listen to a new publisher [s]."""

PARTING = 10
"""How often the last hold is repeated, at 100 Hz."""

STALE = 0.1
"""A state older than this stops the move [s]."""

SUPPRESS_PERIOD = 0.05
"""The force field is suppressed 20 times a second: it lapses after 0.2 s."""


class Interrupted(Exception):  # noqa: N818 - nobody's error
    """A person asked for the end."""


class Mover:
    """Brings all arms of a robot to one posture."""

    def __init__(self, session: Session, tucked: bool, asked_to_end: Callable[[], bool]) -> None:
        """Prepares; sends nothing.

        Args:
            session: Its gates have been asked.
            tucked: The arms lie in their own force field, which is suppressed on the way.
            asked_to_end: Asked at every step.
        """
        self._session, self._tucked, self._asked = session, tucked, asked_to_end
        model = session.model
        rules = stop_rules(STALE, model.column("effort_max"), model.column("velocity_max"), BRAKING_SHARE)
        self._stops = Stops(rules, {name: limb.joints for name, limb in model.limbs.items()})
        self._suppressed_at = -np.inf

    def go(self, target: Array) -> bool:
        """Moves to a posture (n,) [rad] and holds there; False when a person ended it on the way.

        Raises:
            RobotRefused: Nobody listens, or the arms do not arrive.
            RobotStopped: The robot stopped, felt a collision, or fell silent on the way.
        """
        session, transport = self._session, self._session.transport
        limbs = session.model.limbs
        commander = Commander(transport, limbs)
        fields = [transport.advertise(topics.suppress_avoidance(name), Empty) for name in limbs]
        session.link.tell(Listener(self._on_state, self._on_robot, self._on_collision, self._on_cuff))
        try:
            time.sleep(ATTACH_TIME)
            deaf = commander.deaf()
            if deaf:
                raise RobotRefused(
                    f"nobody listens to the commands of {', '.join(deaf)} (valid: 'baxter check')"
                )

            def step(position: Array) -> None:
                if self._tucked and time.monotonic() - self._suppressed_at > SUPPRESS_PERIOD:
                    self._suppressed_at = time.monotonic()
                    for field in fields:
                        field.send(Empty())
                self._step(commander, position)

            return self._travel(commander, step, target)
        finally:
            session.link.tell(None)
            for field in fields:
                field.close()
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
        """Sends one target on the way."""
        if self._asked():
            raise Interrupted
        sample = self._session.link.sample
        if sample is None or time.monotonic() - sample.received > STALE:
            raise RobotStopped(Event.STATE_LOST, f"no state of the arms for {STALE:g} s: held where they are")
        fault = self._stops.fault
        why = self._stops.move(position) if fault is None else fault.detail
        if why is not None:
            event = Event.BACKEND_LOST if fault is None else fault.event
            raise RobotStopped(event, f"the arms stop on their way: {why}")
        commander.send(self._stops.watch(time.monotonic()))

    def _on_state(self, sample: Sample) -> None:
        self._stops.on_state(sample.taken, sample.state.position, sample.state.velocity)

    def _on_robot(self, robot: AssemblyState, received: float) -> None:
        self._stops.on_robot(received, robot)

    def _on_collision(self, limb: str, felt: bool, received: float) -> None:
        self._stops.on_collision(received, limb, felt)

    def _on_cuff(self, limb: str, squeezed: bool) -> None:
        self._stops.on_cuff(limb, squeezed)
