# SPDX-License-Identifier: BSD-3-Clause
"""Roughness of the surface that a hand rubbed in a recording, window by window; or what is missing to compute it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.control.roughness_detection import (
    LEAST_FORCE,
    LENGTH,
    SAMPLE_RATE,
    Directions,
    HandForce,
    Window,
    WindowFinder,
    frequencies,
)
from impedance_modules.episode.data import Episode
from impedance_modules.errors import BadInput
from impedance_modules.robot.model import RobotModel
from impedance_modules.spec.robot_reader import read_robot

CONTACT_FORCE = 1.0
"""A hand whose normal force is never this large touched nothing [N]."""
SLOWEST = 0.9 * SAMPLE_RATE
"""Least rate of a recording [Hz]."""
_KINDS = ("position", "velocity", "effort")


@dataclass(frozen=True)
class Touched:
    """Motion of one hand and force on it, ``SAMPLE_RATE`` samples in a second.

    Attributes:
        hand: Its frame.
        source: Column kind the force comes from, ``effort`` or ``wrench``.
        time: (N,) [s].
        position: (N, 3) in world [m].
        force: (N, 3) of the surface on the hand, world axes [N].
    """

    hand: str
    source: str
    time: Array
    position: Array
    force: Array


@dataclass(frozen=True)
class Roughness:
    """Roughness of a surface from a recording.

    Attributes:
        touched: The samples.
        directions: Direction of the strokes and normal of the surface.
        windows: In order of time.
        refused: How many strokes gave no window, by reason.
    """

    touched: Touched
    directions: Directions
    windows: tuple[Window, ...]
    refused: dict[str, int]

    def of(self, name: str) -> Array:
        """Collects one number of every window, e.g. ``band``."""
        return np.array([getattr(window, name) for window in self.windows])

    @property
    def spectrum(self) -> tuple[Array, Array]:
        """Frequencies [Hz] and mean amplitudes over all windows [N], (m,) each."""
        mean = np.mean([window.spectrum for window in self.windows], axis=0)
        return frequencies(), mean


def judge_roughness(
    touched: Touched, along: Array | None, normal: Array, least: int, span: tuple[float, float]
) -> Roughness:
    """Finds the windows of a recording.

    Args:
        touched: Positions and forces of the hand.
        along: (3,) direction of the strokes that count; None takes the main direction of the motion in contact,
            towards the world's origin.
        normal: (3,) out of the surface.
        least: How many windows there must be.
        span: First and last time that count [s].

    Raises:
        BadInput: The hand touches nothing, or there are too few windows.
    """
    pressed = touched.force @ normal
    strongest = float(np.percentile(pressed, 99.0))
    if strongest < CONTACT_FORCE:
        raise BadInput(
            f"no contact: {touched.hand} never has {CONTACT_FORCE:g} N along the surface's normal "
            f"({_vector_text(normal)}), at most {strongest:.2f} N (valid: an episode in which the hand rubs a surface; "
            "--normal if the surface faces another way)"
        )
    directions = Directions(_main_direction(touched, normal) if along is None else along, normal)
    finder = WindowFinder(directions)
    windows = []
    for time, position, force in zip(touched.time, touched.position, touched.force, strict=True):
        if span[0] <= time <= span[1] and (found := finder.add(float(time), position, force)) is not None:
            windows.append(found)
    if len(windows) < least:
        raise BadInput(_too_few(len(windows), least, directions, finder))
    return Roughness(touched, directions, tuple(windows), dict(finder.refused))


def _too_few(found: int, least: int, directions: Directions, finder: WindowFinder) -> str:
    strokes = "".join(f"; {count} strokes were {why}" for why, count in finder.refused.items())
    return (
        f"too few windows: {found} strokes along {_vector_text(directions.along)} keep contact for {LENGTH:g} s, "
        f"{least} are needed{strokes} (valid: a longer episode, another --along, a wider --from and --to, "
        "or fewer --windows)"
    )


def _vector_text(direction: Array) -> str:
    return "(" + ", ".join(f"{value:.2g}" for value in direction + 0.0) + ")"


def _main_direction(touched: Touched, normal: Array) -> Array:
    """Finds the direction (3,) along the surface in which the touching hand moves most, towards the origin."""
    places = touched.position[touched.force @ normal > LEAST_FORCE]
    along = places - places.mean(axis=0)
    along = along - np.outer(along @ normal, normal)
    direction: Array = np.linalg.svd(along, full_matrices=False)[2][0]
    return -direction if direction @ places.mean(axis=0) > 0.0 else direction


def touched_by(episode: Episode, hand: str | None) -> Touched:
    """Takes position and force of one hand from a recording.

    The force comes from joint efforts where they were recorded, by the robot's model and unfiltered; from the
    columns ``wrench.<hand>`` otherwise.

    Args:
        episode: The recording.
        hand: Frame of the hand; None where the recording has only one.

    Raises:
        BadInput: There is no force, no such hand, or the recording is too slow.
    """
    picks = _picks(episode)
    if episode.effort:
        return _from_effort(episode, hand, picks)
    return _from_wrench(episode, hand, picks)


def _picks(episode: Episode) -> NDArray[np.intp]:
    """Chooses the samples nearest to an even grid."""
    steps = np.diff(episode.time)
    rate = 1.0 / float(np.median(steps)) if steps.size and np.median(steps) > 0.0 else 0.0
    if rate < SLOWEST:
        raise BadInput(
            f"{episode.source}: {rate:.0f} samples in a second are too few to see 20 Hz "
            f"(valid: at least {SAMPLE_RATE:g})"
        )
    grid = np.arange(episode.time[0], episode.time[-1], 1.0 / SAMPLE_RATE)
    return np.minimum(np.searchsorted(episode.time, grid), len(episode) - 1)


def _from_wrench(episode: Episode, hand: str | None, picks: NDArray[np.intp]) -> Touched:
    whole = [
        frame
        for frame, wrench in episode.wrench.items()
        if frame in episode.pose and np.isfinite(wrench[:, :3]).all()
    ]
    if not whole:
        raise BadInput(
            f"{episode.source}: no force: the recording has neither effort.<joint> nor wrench.<frame>.fx fy fz "
            "beside pose.<frame> (valid: an episode with one of them)"
        )
    frame = _choose(episode, hand, whole)
    position, force = episode.pose[frame][picks, :3], episode.wrench[frame][picks, :3]
    return Touched(frame, "wrench", episode.time[picks], position, force)


def _from_effort(episode: Episode, hand: str | None, picks: NDArray[np.intp]) -> Touched:
    model = RobotModel(read_robot(episode.robot))
    limbs = {
        limb.hand: limb
        for limb in model.limbs.values()
        if all(joint in episode.position and joint in episode.effort for joint in limb.joint_names)
    }
    if not limbs:
        raise BadInput(
            f"{episode.source}: no force: no limb of '{episode.robot}' has position and effort of all its joints "
            "(valid: effort.<joint> of a whole limb)"
        )
    moved = [model.limbs[name].hand for name in episode.metadata.get("arms", []) if name in model.limbs]
    frame = _choose(episode, hand, [name for name in limbs if name in moved] or list(limbs), list(limbs))
    position, velocity, effort = (_joints(episode, model, kind)[picks] for kind in _KINDS)
    sensor = HandForce(model, limbs[frame])
    rows = [sensor.of(q, v, tau) for q, v, tau in zip(position, velocity, effort, strict=True)]
    places, forces = (np.array(column) for column in zip(*rows, strict=True))
    return Touched(frame, "effort", episode.time[picks], places, forces)


def _joints(episode: Episode, model: RobotModel, kind: str) -> Array:
    """Collects one quantity of all joints (N, n); joints that were not recorded stand at 0."""
    found = np.zeros((len(episode), model.n))
    for column, joint in enumerate(model.joint_names):
        recorded = getattr(episode, kind)
        if joint in recorded:
            found[:, column] = recorded[joint]
        elif kind == "velocity" and joint in episode.position:
            found[:, column] = np.gradient(episode.position[joint], episode.time)
    return found


def _choose(episode: Episode, hand: str | None, likely: list[str], valid: list[str] | None = None) -> str:
    """Returns the hand that is asked for, or the only one."""
    known = valid or likely
    if hand is not None and hand not in known:
        raise BadInput(f"{episode.source}: no force on '{hand}' (valid: {', '.join(known)})")
    if hand is None and len(likely) > 1:
        raise BadInput(f"{episode.source}: which hand? give --hand (valid: {', '.join(likely)})")
    return likely[0] if hand is None else hand
