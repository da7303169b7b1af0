# SPDX-License-Identifier: BSD-3-Clause
r"""The weight that a robot has beyond its description, as a torque and as a potential.

    \tau(q) = dV/dq,      V(q) = - \sum_links (m' g' - m g) . p + (h'_W . g' - h_W . g)

Primed numbers are those of the robot as it is, the others of the robot as it is described; p is the origin of a link's
joint, h_W the link's first moment m c in world axes. V is bounded whatever the joints do: a joint's origin stays within
the lengths of the links before it from the arm's first joint, and a moment's size does not depend on how it is turned,

    |V - V_0|  <=  \sum_links |m' g' - m g| L + |h' - h| |g'| + |h| |g' - g|,

V_0 the value with all the joints' origins at the arm's first joint, whose place is known.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from impedance_modules.arrays import Array
from impedance_modules.errors import BadInput
from impedance_modules.robot.model import RobotModel


class WeightDifference:
    """What a torque must hold because links, or gravity's direction, are not as described.

    Attributes:
        bound: Half the range of the potential, an upper bound of |V - V_0| [J].
        effort: (n,) dV/dq at the last ``update`` [N.m].
        carried: (n,) torque that holds the robot as it is described, its parallel springs included [N.m].
        energy: ``bound`` - (V - V_0), what is left above the lowest value of -V: never negative [J].
    """

    def __init__(self, described: RobotModel, real: RobotModel, joints: NDArray[np.intp]) -> None:
        """Takes two models of the same joints, and the indices of those whose links are weighed.

        Raises:
            BadInput: A joint slides without a limit, so the potential has no bound.
        """
        self._described, self._real = (_weighing(model, joints) for model in (described, real))
        self._wound = described.parallel_spring_effort
        self._data = self._described.createData(), self._real.createData()
        self._middle, self.bound = _middle_and_bound(self._described, self._real)
        self.effort, self.carried = np.zeros(described.n), np.zeros(described.n)
        self.energy = 0.0

    def update(self, q: Array) -> None:
        """Computes everything at positions q (n,) [rad]."""
        described, real = self._described, self._real
        before, after = self._data
        weight = pin.computeGeneralizedGravity(described, before, q)
        self.effort[:] = pin.computeGeneralizedGravity(real, after, q) - weight
        self.carried[:] = weight + self._wound(q)
        potential = pin.computePotentialEnergy(real, after, q) - pin.computePotentialEnergy(
            described, before, q
        )
        self.energy = max(0.0, self.bound - (float(potential) - self._middle))


def _weighing(model: RobotModel, joints: NDArray[np.intp]) -> pin.Model:
    """Copies a model and takes the mass from all links but those of some joints."""
    found = pin.Model(model.pin_model)
    weighed = set(joints.tolist())
    for joint in range(1, found.njoints):
        if int(found.idx_vs[joint]) not in weighed:
            found.inertias[joint] = pin.Inertia.Zero()
    return found


def _middle_and_bound(described: pin.Model, real: pin.Model) -> tuple[float, float]:
    """Gives V_0 and the bound of |V - V_0| [J]."""
    before, after = np.array(described.gravity.linear), np.array(real.gravity.linear)
    middle = bound = 0.0
    for joint in range(1, described.njoints):
        old, new = described.inertias[joint], real.inertias[joint]
        pull = new.mass * after - old.mass * before
        moment = old.mass * np.array(old.lever)
        change = new.mass * np.array(new.lever) - moment
        first = described.supports[joint][1]
        middle -= float(pull @ described.jointPlacements[first].translation)
        bound += float(np.linalg.norm(change) * np.linalg.norm(after))
        bound += float(np.linalg.norm(moment) * np.linalg.norm(after - before))
        if np.any(pull):
            bound += float(np.linalg.norm(pull)) * _reach(described, joint)
    return middle, bound


def _reach(model: pin.Model, joint: int) -> float:
    """Bounds the distance of a joint's origin from where its arm's first joint is at zero [m]."""
    chain = list(model.supports[joint])[1:]
    lengths = sum(float(np.linalg.norm(model.jointPlacements[j].translation)) for j in chain[1:])
    for j in chain:
        place = model.idx_vs[j]
        if model.joints[j].shortname().startswith("JointModelP"):
            lengths += max(
                abs(float(model.lowerPositionLimit[place])), abs(float(model.upperPositionLimit[place]))
            )
    if not math.isfinite(lengths):
        raise BadInput(
            f"joint '{model.names[joint]}' slides without a limit, so a weight behind it has a potential without"
            " a lowest value (valid: joints with a range)"
        )
    return lengths
