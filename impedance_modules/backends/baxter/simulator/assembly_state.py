# SPDX-License-Identifier: BSD-3-Clause
"""Power, stops and faults of the robot, as Rethink's SDK drives them.

    disabled --enable--> enabled --disable--> disabled
    any --stop, e-stop, joint fault--> stopped (power off) --reset--> disabled

Reset is refused while the button is pressed, and always leaves the robot disabled. Enabling a stopped robot does
nothing: it must be reset first.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class EstopButton(IntEnum):
    """``estop_button`` of an AssemblyState."""

    UNPRESSED = 0
    PRESSED = 1
    UNKNOWN = 2
    RELEASED = 3


class EstopSource(IntEnum):
    """``estop_source`` of an AssemblyState."""

    NONE = 0
    USER = 1
    UNKNOWN = 2
    FAULT = 3
    BRAIN = 4


@dataclass(frozen=True)
class PowerState:
    """What an AssemblyState says."""

    enabled: bool
    stopped: bool
    error: bool
    button: EstopButton
    source: EstopSource

    @property
    def ready(self) -> bool:
        """False just means not enabled."""
        return self.enabled


OFF = PowerState(
    enabled=False, stopped=False, error=False, button=EstopButton.UNPRESSED, source=EstopSource.NONE
)
ON = PowerState(
    enabled=True, stopped=False, error=False, button=EstopButton.UNPRESSED, source=EstopSource.NONE
)


class PowerMachine:
    """Who may move the arms.

    Attributes:
        standing: Now.
        refusal: Why the last request did nothing; empty after one that was carried out.
    """

    def __init__(self, *, enabled: bool) -> None:
        self.power = ON if enabled else OFF
        self.refusal = ""

    def enable(self, *, blocked: str) -> None:
        """Switches power on.

        Args:
            blocked: Why the arms must not be powered as they stand (a collision flag); empty if they may.
        """
        if self.power.stopped:
            self.refusal = "stopped: reset first"
        elif blocked and not self.power.enabled:
            self.refusal = blocked
        else:
            self.power, self.refusal = ON, ""

    def disable(self) -> None:
        """Switches power off; a stop stays a stop."""
        self.refusal = ""
        if not self.power.stopped:
            self.power = OFF

    def reset(self) -> None:
        """Clears faults and stops, and disables."""
        if self.power.button is EstopButton.PRESSED:
            self.refusal = "the e-stop button is pressed: release it first"
        else:
            self.power, self.refusal = OFF, ""

    def stop(self) -> None:
        """Stops by software."""
        self._stop(EstopButton.UNKNOWN, EstopSource.UNKNOWN, error=False)

    def press(self) -> None:
        """Somebody presses the e-stop button."""
        self._stop(EstopButton.PRESSED, EstopSource.USER, error=False)

    def release(self) -> None:
        """Somebody releases it; the robot stays stopped."""
        if self.power.button is EstopButton.PRESSED:
            self._stop(EstopButton.RELEASED, EstopSource.USER, error=False)

    def fault(self) -> None:
        """A joint board reports a fault."""
        self._stop(EstopButton.UNKNOWN, EstopSource.FAULT, error=True)

    def _stop(self, button: EstopButton, source: EstopSource, *, error: bool) -> None:
        self.refusal = ""
        self.power = PowerState(enabled=False, stopped=True, error=error, button=button, source=source)
