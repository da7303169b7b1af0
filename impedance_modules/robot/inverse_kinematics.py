# SPDX-License-Identifier: BSD-3-Clause
r"""The posture of a limb that brings a frame to a pose, or as near as its joints let it.

Steps of differential inverse kinematics (pink), each a quadratic program over the limb's joints:

    min_{dq}  |J dq - e|^2 + \mu |e|^2 |dq|^2,      q_min <= q + dq <= q_max

e is the pose's error. From several starts; what is left at the best end is how far the pose is out of reach. A limb
with more joints than the pose needs may say where its elbow is: by the angle of the plane through shoulder, elbow and
hand about the line from shoulder to hand, 0 with the elbow below that line, positive by the right-hand rule along it.
The shoulder is the limb's first joint; the elbow the joint nearest to half of the way along its links.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from impedance_modules.arrays import Array
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import log3

STARTS, FEWER_STARTS = 30, 12
"""Random postures from which a pose is sought, beside those that are given; from a fixed seed. The second number is
enough where several postures are compared, if one of them reaches the pose."""

STEPS = 100
"""Of one search."""

AHEAD, TURN_AHEAD = 0.1, 0.5
"""How far before the frame its goal is set at most in one step [m], [rad]: far goals alone would make joints jump."""

ARRIVED = 1e-9
"""A pose this near is reached [m, rad]."""

COMPARED = 1e-6
"""Postures this near are compared by their joints [m, rad]."""

STOPPED = 1e-7
"""A search whose joints move less in a step has ended [rad]."""

DAMPING = 1.0
"""mu, Levenberg and Marquardt's: near a singular posture steps stay short."""

NEWTON_STEPS, NEWTON_DAMPING, LONGEST = 30, 1e-6, 0.3
"""Of ``reaches``: steps, what is added to J J^T [m^2], longest step of a joint [rad]."""

NEAR = 1e-4
"""What ``reaches`` takes for reached [m, rad]."""

LINED_UP = 1e-3
"""An elbow this near to the line from shoulder to hand has no angle [m]."""


@dataclass(frozen=True)
class FrameGoal:
    """Where a frame shall be.

    Attributes:
        frame: Name.
        pose: X_WF.
        oriented: Whether its orientation counts, too.
        elbow: Angle of the elbow [rad]; None leaves it free.
    """

    frame: str
    pose: Pose
    oriented: bool = True
    elbow: float | None = None


@dataclass(frozen=True)
class FoundPosture:
    """The nearest posture that was found.

    Attributes:
        q: (k,) of the limb's joints [rad].
        distance: From the frame to its goal [m].
        angle: Between the orientations [rad]; 0 where they do not count.
        elbow: Angle of the elbow there [rad]; None where it has none.
    """

    q: Array
    distance: float
    angle: float
    elbow: float | None

    def missed(self, goal: FrameGoal) -> float:
        """Distance [m] plus angles [rad] that are left; a measure for comparison only."""
        return self.distance + self.angle + elbow_missed(self.elbow, goal.elbow)


def elbow_missed(found: float | None, asked: float | None) -> float:
    """Gives by how much an elbow misses its angle, in [0, pi] [rad]; 0 where none is asked for."""
    if asked is None:
        return 0.0
    return math.pi if found is None else abs(math.remainder(found - asked, 2.0 * math.pi))


class LimbKinematics:
    """One limb of a robot, all other joints fixed."""

    def __init__(self, model: RobotModel, limb: Limb, q: Array) -> None:
        """Takes the robot, the limb, and a posture (n,) [rad] for the other joints."""
        others = [int(joint) for joint in range(1, model.pin_model.njoints) if joint - 1 not in limb.joints]
        self._links: pin.Model = pin.buildReducedModel(model.pin_model, others, q)
        self._order = np.argsort(np.argsort(limb.joints))
        low, high = model.column("position_min")[limb.joints], model.column("position_max")[limb.joints]
        self.low, self.high = low, high
        self._links.lowerPositionLimit, self._links.upperPositionLimit = (
            self._in_model(low),
            self._in_model(high),
        )
        self._shoulder, self._elbow = limb.joint_names[0], _middle_joint(model, limb)
        self._limb = limb

    def nearest(self, goal: FrameGoal, starts: list[Array]) -> FoundPosture:
        """Finds the posture that brings a frame nearest to its goal; the first that reaches it ends the search.

        Args:
            goal: Where the frame shall be.
            starts: (k,) postures to begin from [rad], before random ones.
        """
        best: FoundPosture | None = None
        for start in [*starts, *self._drawn()]:
            found = self._descended(goal, start)
            if best is None or found.missed(goal) < best.missed(goal) - 1e-6:
                best = found
            if best.missed(goal) < 10.0 * ARRIVED:
                break
        if best is None:
            raise ValueError("a search needs a start")
        return best

    def reaches(self, goal: FrameGoal, start: Array) -> bool:
        """Tells whether Newton's method finds a posture that brings a frame to its goal; False may be wrong.

        Args:
            goal: Where the frame shall be; the elbow is left free.
            start: (k,) [rad].
        """
        data, frame = self._links.createData(), self._links.getFrameId(goal.frame)
        rows = 6 if goal.oriented else 3
        low, high = self._links.lowerPositionLimit, self._links.upperPositionLimit
        q = np.clip(self._in_model(start), low, high)
        for _ in range(NEWTON_STEPS):
            J = pin.computeFrameJacobian(self._links, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:rows]
            pose = pin.updateFramePlacement(self._links, data, frame)
            turn = log3(goal.pose.rotation @ pose.rotation.T)
            left = np.concatenate([goal.pose.translation - pose.translation, turn])[:rows]
            if float(np.max(np.abs(left))) < NEAR:
                return True
            step = J.T @ np.linalg.solve(J @ J.T + NEWTON_DAMPING * np.eye(rows), left)
            q = np.clip(q + step * min(1.0, LONGEST / max(float(np.max(np.abs(step))), LONGEST)), low, high)
        return False

    def most_central(self, goal: FrameGoal) -> FoundPosture:
        """Finds, of several postures that reach a goal, the one whose joints are farthest from their limits.

        Where none reaches it, the nearest.
        """
        found = list[FoundPosture]()
        for start in self._drawn():
            if len(found) > FEWER_STARTS and min(each.missed(goal) for each in found) < COMPARED:
                break
            found.append(self._descended(goal, start))
        least = min(each.missed(goal) for each in found)
        reaching = [each for each in found if each.missed(goal) < max(COMPARED, 1.01 * least)]
        return min(reaching, key=lambda each: float(np.max(np.abs(self._off_centre(each.q)))))

    def elbow_angle(self, q: Array, frame: str) -> float | None:
        """Gives the elbow's angle at q (k,) [rad]; None where the elbow lies on the line from shoulder to hand."""
        data = self._links.createData()
        pin.framesForwardKinematics(self._links, data, self._in_model(q))
        return self._elbow_at(data, frame)

    def _descended(self, goal: FrameGoal, start: Array) -> FoundPosture:
        """Searches from one start."""
        # Imported only here: takes longer than everything that `check` does without it.
        import pink  # noqa: PLC0415
        from pink.limits import ConfigurationLimit  # noqa: PLC0415

        from impedance_modules.robot.elbow_task import ElbowTask  # noqa: PLC0415

        room = 1e-9 + 1e-6 * (self.high - self.low)
        inside = np.clip(start, self.low + room, self.high - room)
        now = pink.Configuration(self._links, self._links.createData(), self._in_model(inside))
        hand = pink.FrameTask(goal.frame, 1.0, 0.3 if goal.oriented else 0.0, lm_damping=DAMPING)
        tasks, limits = [hand], [ConfigurationLimit(self._links, 0.9)]
        if goal.elbow is not None:
            tasks.append(
                ElbowTask(goal.elbow, lambda q: self.elbow_angle(q[self._order], goal.frame), DAMPING)
            )
        best = self._found(goal, now)
        for _ in range(STEPS):
            hand.set_target(_set_ahead(now.get_transform_frame_to_world(goal.frame), goal.pose))
            step = pink.solve_ik(now, tasks, 1.0, "daqp", damping=1e-10, limits=limits, safety_break=False)
            now.integrate_inplace(step, 1.0)
            found = self._found(goal, now)
            best = min(best, found, key=lambda each: each.missed(goal))
            if float(np.max(np.abs(step))) < STOPPED or best.missed(goal) < ARRIVED:
                break
        return best

    def _found(self, goal: FrameGoal, now: Any) -> FoundPosture:
        """Sums up where the limb is."""
        pose = now.get_transform_frame_to_world(goal.frame)
        turn = float(np.linalg.norm(log3(pose.rotation @ goal.pose.rotation.T))) if goal.oriented else 0.0
        distance = float(np.linalg.norm(pose.translation - goal.pose.translation))
        q = np.clip(now.q[self._order], self.low, self.high)
        return FoundPosture(q, distance, turn, self._elbow_at(now.data, goal.frame))

    def _elbow_at(self, data: pin.Data, frame: str) -> float | None:
        shoulder, elbow, hand = (self._origin(data, name) for name in (self._shoulder, self._elbow, frame))
        reach = float(np.linalg.norm(hand - shoulder))
        if reach < LINED_UP:
            return None
        along = (hand - shoulder) / reach
        below = _across(np.array([0.0, 0.0, -1.0]), along)
        if float(np.linalg.norm(below)) < LINED_UP:
            below = _across(np.array([1.0, 0.0, 0.0]), along)
        out = _across(elbow - shoulder, along)
        if float(np.linalg.norm(out)) < LINED_UP:
            return None
        return math.atan2(float(along @ np.cross(below, out)), float(below @ out))

    def _origin(self, data: pin.Data, name: str) -> Array:
        return np.asarray(data.oMf[self._links.getFrameId(name)].translation.copy())

    def _drawn(self) -> Iterator[Array]:
        random = np.random.default_rng(0)
        yield 0.5 * (self.low + self.high)
        for _ in range(STARTS):
            yield random.uniform(self.low, self.high)

    def _off_centre(self, q: Array) -> Array:
        return np.asarray((q - 0.5 * (self.low + self.high)) / (0.5 * (self.high - self.low)))

    def _in_model(self, q: Array) -> Array:
        """Puts the limb's joints (k,), from the base outwards, into the reduced model's order."""
        out = np.empty_like(q)
        out[self._order] = q
        return out


def _set_ahead(here: pin.SE3, goal: Pose) -> pin.SE3:
    """Gives a pose on the way from here to a goal, at most ``AHEAD`` and ``TURN_AHEAD`` away."""
    way, turn = goal.translation - here.translation, log3(goal.rotation @ here.rotation.T)
    part = min(1.0, AHEAD / max(float(np.linalg.norm(way)), AHEAD))
    turned = min(1.0, TURN_AHEAD / max(float(np.linalg.norm(turn)), TURN_AHEAD))
    return pin.SE3(pin.exp3(turned * turn) @ here.rotation, here.translation + part * way)


def _across(vector: Array, along: Array) -> Array:
    """Leaves of a vector (3,) what is perpendicular to a unit vector (3,)."""
    return np.asarray(vector - (vector @ along) * along)


def _middle_joint(model: RobotModel, limb: Limb) -> str:
    """Names the joint that is nearest to half of the way from the limb's first joint to its hand, along the links."""
    links = model.pin_model
    lengths = [
        float(np.linalg.norm(links.jointPlacements[links.getJointId(name)].translation))
        for name in limb.joint_names[1:]
    ]
    whole = model.reach(limb.name)
    ways = np.cumsum([0.0, *lengths])
    return limb.joint_names[int(np.argmin(np.abs(ways - 0.5 * whole)))]
