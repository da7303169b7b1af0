# SPDX-License-Identifier: BSD-3-Clause
"""A recording as a backend: it reports what was measured, and ignores commands."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.backends.grippers import GripperReport, GripperState
from impedance_modules.backends.protocol import Finish, FirstState
from impedance_modules.episode.data import Episode
from impedance_modules.errors import BadInput, EndOfRecording
from impedance_modules.robot.state import RobotState
from impedance_modules.spec.gripper_spec import GripperMotion

LONGEST_GAP = 60.0
"""Longest time between two states of a recording that is fed back [s]; a run is stopped long before."""


class ReplayBackend:
    """Returns an episode's states, sample by sample.

    Attributes:
        sample: Index of the last state returned.
    """

    def __init__(self, episode: Episode, joint_names: tuple[str, ...], acting: Array) -> None:
        """Takes an episode that has position, velocity and effort of every joint.

        Args:
            episode: The recording.
            joint_names: Of the model, in the order of its vectors.
            acting: (n,) torque in force when the recording began [N.m].

        Raises:
            BadInput: A joint's position, velocity or effort was not recorded, or the time is not in seconds.
        """
        _check_steps(episode)
        self._time = episode.time
        self._position = _columns(episode.position, joint_names, "position")
        self._velocity = _columns(episode.velocity, joint_names, "velocity")
        self._effort = _columns(episode.effort, joint_names, "effort")
        self._acting = acting
        self._grippers = _recorded_grippers(episode)
        self.sample = 0

    def start(self) -> FirstState:
        """Returns the first recorded state."""
        self.sample = 0
        return FirstState(self._state(), self._acting)

    def read(self) -> RobotState | None:
        """Returns the next recorded state.

        Raises:
            EndOfRecording: After the last one.
        """
        if self.sample + 1 >= len(self._time):
            raise EndOfRecording(f"the recording ends after {len(self._time)} samples")
        self.sample += 1
        return self._state()

    def write(self, effort: Array) -> None:
        """Ignores a torque."""

    def gripper_limbs(self) -> tuple[str, ...]:
        """Names the limbs whose grippers were recorded."""
        return tuple(self._grippers)

    def order_gripper(self, limb: str, motion: GripperMotion) -> None:
        """Ignores an order."""

    def gripper_report(self, limb: str) -> GripperReport:
        """What was recorded of a gripper with the last state that was returned."""
        width, force, state = (float(column[self.sample]) for column in self._grippers[limb])
        number = int(state)
        why = "failed in the recording" if number == GripperState.FAILED else ""
        return GripperReport(width, force, GripperState(number), why)

    def finish(self, how: Finish) -> None:
        """Ends the replay; there is nothing to hold or release."""

    def _state(self) -> RobotState:
        k = self.sample
        return RobotState(float(self._time[k]), self._position[k], self._velocity[k], self._effort[k])


def _check_steps(episode: Episode) -> None:
    """Refuses a time whose steps no run has: every period of a gap is booked one by one."""
    with np.errstate(over="ignore"):
        steps = np.abs(np.diff(episode.time))
    if steps.size and steps.max() > LONGEST_GAP:
        row = int(np.argmax(steps))
        raise BadInput(
            f"{episode.source}: {steps[row]:.6g} s between the samples {row} and {row + 1} (valid: time in seconds,"
            f" without a gap of more than {LONGEST_GAP:g} s)"
        )


def _recorded_grippers(episode: Episode) -> dict[str, tuple[Array, Array, Array]]:
    """Finds width, force and state of each recorded gripper, (N,) each, by limb."""
    found: dict[str, tuple[Array, Array, Array]] = {}
    for name, state in episode.extra.items():
        if not (name.startswith("gripper.") and name.endswith(".state")):
            continue
        limb = name.removeprefix("gripper.").removesuffix(".state")
        others = [f"gripper.{limb}.{part}" for part in ("width", "force")]
        missing = [other for other in others if other not in episode.extra]
        wrong = ~np.isin(state, [int(known) for known in GripperState])
        if missing or wrong.any():
            said = f"no column {missing[0]}" if missing else f"'{name}' is {state[np.argmax(wrong)]}"
            valid = ", ".join(f"{known.value} {known.name.lower()}" for known in GripperState)
            raise BadInput(f"{episode.source}: {said} (valid: width, force and state of a gripper; {valid})")
        found[limb] = (episode.extra[others[0]], episode.extra[others[1]], state)
    return found


def _columns(recorded: Mapping[str, Array], names: tuple[str, ...], kind: str) -> Array:
    missing = [name for name in names if name not in recorded]
    if missing:
        raise BadInput(f"the recording has no {kind} of {', '.join(missing)}; a replay needs every joint's")
    return np.ascontiguousarray(np.column_stack([recorded[name] for name in names]))
