# SPDX-License-Identifier: BSD-3-Clause
"""An electric gripper of the simulated Baxter: its commands, its state, and what can fail.

How a real one answers is known from Rethink's SDK (baxter_interface), which waits for the sender and number of its
command in the state. Its motion is that of ``SimulatedGripper``. Commands without an effect here are answered too.
"""

from __future__ import annotations

import json

from impedance_modules.backends.baxter.gripper_link import CONFIGURE, FULL, GO, opening_of, width_of
from impedance_modules.backends.baxter.ros.messages import (
    EndEffectorCommand,
    EndEffectorProperties,
    EndEffectorState,
)
from impedance_modules.backends.sim_grippers import SimulatedGripper
from impedance_modules.spec.gripper_spec import GripperMotion, GripperSpec

HARDWARE = 65538
"""Number in its state, to which commands are addressed [assumed]."""

CALIBRATE, CLEAR_CALIBRATION, RESET = "calibrate", "clear_calibration", "reset"
"""What a person may command; a run never does."""

DEFAULTS = {"velocity": 50.0, "moving_force": 40.0, "holding_force": 30.0, "dead_zone": 5.0}
"""Settings before the first ``configure`` [%] [sdk]."""


class ElectricGripper:
    """One gripper.

    Attributes:
        body: Its fingers.
        calibrated, error: As its state says.
        silent: It publishes no state.
    """

    def __init__(self, spec: GripperSpec) -> None:
        """Takes what it can; begins open, calibrated, with nothing between its fingers."""
        self.body = SimulatedGripper(spec, None)
        self.calibrated, self.error, self.silent = True, False, False
        self._spec = spec
        self._settings = dict(DEFAULTS)
        self._last: EndEffectorCommand | None = None
        self._number = 0

    def take(self, command: EndEffectorCommand) -> None:
        """Takes a command; one for other hardware, or one seen before, is ignored."""
        last = self._last
        again = last is not None and (last.sender, last.sequence) == (command.sender, command.sequence)
        if command.id != HARDWARE or again:
            return
        self._last = command
        values = _numbers(command.args)
        if command.command == CONFIGURE:
            self._settings |= {key: values[key] for key in values.keys() & DEFAULTS.keys()}
        elif command.command == GO and "position" in values and self.calibrated and not self.error:
            self._go(min(max(values["position"], 0.0), FULL))
        elif command.command == CALIBRATE:
            self.calibrated = True
        elif command.command == CLEAR_CALIBRATION:
            self.calibrated = False
        elif command.command == RESET:
            self.error = False

    def advance(self, seconds: float) -> None:
        """Moves the fingers for a time [s]; after an error they stand."""
        if not self.error:
            self.body.advance(seconds)

    def state(self, stamp: int) -> EndEffectorState:
        """What it reports."""
        sample, last = self.body.sample(0.0), self._last
        moving = sample.ended < self._number and not self.error
        return EndEffectorState(
            timestamp=stamp,
            id=HARDWARE,
            enabled=EndEffectorState.STATE_TRUE,
            calibrated=int(self.calibrated),
            ready=int(self.calibrated and not self.error and not moving),
            moving=int(moving),
            gripping=int(sample.held),
            missed=EndEffectorState.STATE_FALSE,
            error=int(self.error),
            reverse=EndEffectorState.STATE_FALSE,
            position=opening_of(sample.width, self._spec),
            force=FULL * sample.force / self._spec.force,
            state="stalled" if self.error else "",
            command="" if last is None else last.command,
            command_sender="" if last is None else last.sender,
            command_sequence=0 if last is None else last.sequence,
        )

    def _go(self, opening: float) -> None:
        self._number += 1
        speed = self._spec.speed * self._settings["velocity"] / FULL
        force = self._spec.force * self._settings["holding_force"] / FULL
        self.body.order(self._number, GripperMotion(width_of(opening, self._spec), speed, force))


def properties() -> EndEffectorProperties:
    """What an electric gripper says it is."""
    return EndEffectorProperties(
        id=HARDWARE,
        ui_type=EndEffectorProperties.ELECTRIC_GRIPPER,
        manufacturer="simulated",
        product="electric gripper",
        serial_number="",
        hardware_rev="",
        firmware_rev="",
        firmware_date="",
        has_calibration=True,
        controls_grip=True,
        senses_grip=True,
        reverses_grip=False,
        controls_force=True,
        senses_force=True,
        controls_position=True,
        senses_position=True,
        properties="",
    )


def _numbers(text: str) -> dict[str, float]:
    """Reads the arguments of a command; what is no object of numbers says nothing."""
    try:
        said = json.loads(text) if text else {}
    except json.JSONDecodeError:
        return {}
    if not isinstance(said, dict):
        return {}
    return {key: float(value) for key, value in said.items() if isinstance(value, int | float)}
