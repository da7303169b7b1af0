# SPDX-License-Identifier: BSD-3-Clause
"""Power, stops and faults of the robot, as Rethink's SDK drives them.

    disabled --enable--> enabled --disable--> disabled
    any --stop, e-stop, joint fault--> stopped (power off) --reset--> disabled

Reset is refused while the button is pressed, and always leaves the robot disabled. Enabling a stopped robot does
nothing: it must be reset first.
"""

from __future__ import annotations

from impedance_modules.backends.baxter.ros.messages import AssemblyState

OFF = AssemblyState(False, False, False, False, AssemblyState.BUTTON_UNPRESSED, AssemblyState.SOURCE_NONE)
ON = AssemblyState(True, True, False, False, AssemblyState.BUTTON_UNPRESSED, AssemblyState.SOURCE_NONE)


class PowerMachine:
    """Whether the arms have power, and why not.

    Attributes:
        state: Now; ``ready`` means the same as ``enabled``.
        refusal: Why the last request did nothing; empty after one that was carried out.
    """

    def __init__(self, *, enabled: bool) -> None:
        self.state = ON if enabled else OFF
        self.refusal = ""

    def enable(self, *, blocked: str) -> None:
        """Switches power on.

        Args:
            blocked: Why the arms must not be powered as they stand (a collision flag); empty if they may.
        """
        if self.state.stopped:
            self.refusal = "stopped: reset first"
        elif blocked and not self.state.enabled:
            self.refusal = blocked
        else:
            self.state, self.refusal = ON, ""

    def disable(self) -> None:
        """Switches power off; a stop stays a stop."""
        self.refusal = ""
        if not self.state.stopped:
            self.state = OFF

    def reset(self) -> None:
        """Clears faults and stops, and disables."""
        if self.state.estop_button == AssemblyState.BUTTON_PRESSED:
            self.refusal = "the e-stop button is pressed: release it first"
        else:
            self.state, self.refusal = OFF, ""

    def stop(self) -> None:
        """Stops by software."""
        self._stop(AssemblyState.BUTTON_UNKNOWN, AssemblyState.SOURCE_UNKNOWN, error=False)

    def press(self) -> None:
        """Presses the e-stop button."""
        self._stop(AssemblyState.BUTTON_PRESSED, AssemblyState.SOURCE_USER, error=False)

    def release(self) -> None:
        """Releases the button; the robot stays stopped."""
        if self.state.estop_button == AssemblyState.BUTTON_PRESSED:
            self._stop(AssemblyState.BUTTON_RELEASED, AssemblyState.SOURCE_USER, error=False)

    def fault(self) -> None:
        """Stops because a joint board reports a fault."""
        self._stop(AssemblyState.BUTTON_UNKNOWN, AssemblyState.SOURCE_FAULT, error=True)

    def _stop(self, button: int, source: int, *, error: bool) -> None:
        self.refusal = ""
        self.state = AssemblyState(False, False, True, error, button, source)
