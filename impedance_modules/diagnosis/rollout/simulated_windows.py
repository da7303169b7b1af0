# SPDX-License-Identifier: BSD-3-Clause
"""Lives windows of recordings through again, on one plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from impedance_modules.diagnosis.residuals.preparation import Prepared
from impedance_modules.diagnosis.rollout.drive import driver_of, seed_at
from impedance_modules.diagnosis.rollout.simulated_robot import Dressed
from impedance_modules.diagnosis.rollout.windows import WINDOW, Window
from impedance_modules.errors import BadInput

Array = NDArray[np.float64]

LOOKS = 20
"""Times within a window at which recording and rollout are compared."""

SINGULAR = 1e-9
"""Least over greatest eigenvalue of a mass matrix that can be inverted."""

LOST = float(np.pi)
"""A joint that is half a turn (or metres) off is lost: errors count up to here, in speed up to LOST / WINDOW."""


@dataclass(frozen=True, eq=False)
class Lived:
    """Errors of all windows in the diagnosis's joint order.

    Attributes:
        time: (L,) since the seed [s].
        position, velocity: (W, L, n) rollout minus recording.
    """

    time: Array
    position: Array
    velocity: Array


def live(dressed: Dressed, drive: str, prepared: Sequence[Prepared], windows: Sequence[Window]) -> Lived:
    """Rolls every window out.

    Raises:
        BadInput: The plant's motion is not finite: the model has a body without inertia.
    """
    step = dressed.plant.division.step
    steps = round(WINDOW / step)
    looks = np.unique(np.linspace(0, steps, LOOKS + 1).round().astype(int))[1:]
    order = list(dressed.order)
    drivers = {index: driver_of(prepared[index], drive, dressed) for index in {w.recording for w in windows}}
    offset = dressed.worn.sensors.offset
    errors = []
    for driver in drivers.values():
        _refuse_without_inertia(dressed, driver.position[0])
    for window in windows:
        driver = drivers[window.recording]
        begin = float(driver.time[0]) + window.start
        dressed.plant.seed(seed_at(driver, begin, dressed))
        middle = np.asarray(begin + step * (np.arange(steps) + 0.5), dtype=float)
        # A light joint that lacks its friction may fly off beyond all numbers within a window.
        with np.errstate(over="ignore", invalid="ignore"):
            q, v = dressed.plant.roll(driver.acting(middle), driver.aimed(middle))
        reported = (q[looks - 1] + offset)[:, order], v[looks - 1][:, order]
        errors.append(_compare(prepared[window.recording], begin + step * looks, *reported))
    position, velocity = (np.array(part) for part in zip(*errors, strict=True))
    return Lived(step * looks, _counted(position, LOST), _counted(velocity, LOST / WINDOW))


def _refuse_without_inertia(dressed: Dressed, position: Array) -> None:
    model = dressed.plant.model
    values, vectors = np.linalg.eigh(model.mass_matrix(position))
    if values[0] > SINGULAR * values[-1]:
        return
    joint = model.joint_names[int(np.argmax(np.abs(vectors[:, 0])))]
    raise BadInput(
        f"the model cannot be simulated: around '{joint}' nothing has inertia"
        " (valid: a moment of inertia about every joint's axis, or a reflected_inertia)"
    )


def _counted(errors: Array, most: float) -> Array:
    """Counts what is lost, or no number any more, as lost."""
    return np.clip(np.nan_to_num(errors, nan=most, posinf=most, neginf=-most), -most, most)


def _compare(prepared: Prepared, time: Array, position: Array, velocity: Array) -> tuple[Array, Array]:
    """Subtracts the recording, at the looks' times: the position as it was read, the filtered velocity."""
    s = prepared.signals
    measured = [_between(time, s.time, values) for values in (prepared.log.position, s.velocity)]
    return position - measured[0], velocity - measured[1]


def _between(time: Array, grid: Array, values: Array) -> Array:
    return np.column_stack([np.interp(time, grid, column) for column in values.T])
