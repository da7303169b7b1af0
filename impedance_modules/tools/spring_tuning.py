# SPDX-License-Identifier: BSD-3-Clause
r"""Chooses posture and joint springs for an arm whose joints carry a force at the hand.

The hand exerts a force f d by its joint springs, f anywhere in a range, d a direction; whatever resists puts F_b = -f d
on the hand. The springs then exert the joint torque tau = J^T f d, so their equilibrium lies K^-1 tau beyond the
posture.

**Least stiffness.** The moment arms of F_b turn with the joints: the arm returns to its posture only if

    H = diag(K) + S - sym(\Gamma(F_b))   is positive definite       (Rancourt & Hogan 2001; docs/tune.md)

S is what other springs contribute in joint space. \Gamma is linear in F_b, so that a range of forces is safe if its
two ends are. Among all K that reach this bound the one with the smallest sum is taken: joint springs that do no more
than keep the links from folding leave the hand to its own springs, as the thesis wanted (5.1.2).

**Posture.** Among the postures of the self-motion (the hand stays, the elbow moves) the best one needs the smallest sum
of joint stiffness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linprog

from impedance_modules.arrays import Array
from impedance_modules.control.assembly import Assembly
from impedance_modules.errors import BadInput
from impedance_modules.modules.arms import build_modules
from impedance_modules.modules.damping import phase_damping
from impedance_modules.modules.equilibrium import start_equilibrium
from impedance_modules.prediction.mechanism import Mechanism, Setting
from impedance_modules.prediction.statics import analyse_state
from impedance_modules.robot.kinematics import Kinematics
from impedance_modules.robot.model import Limb, RobotModel
from impedance_modules.robot.pose import Pose
from impedance_modules.robot.rotation import log3
from impedance_modules.superposition.net_stiffness import gamma

MARGIN = 1.02
"""Times the stiffness at which the arm just folds: what is handed out."""
STIFFEST = 10000.0
"""Of a joint spring in a task file [N.m/rad]."""
CUTTING_ROUNDS = 400
"""Most cutting planes' rounds; a seven-joint arm takes about thirty."""
CUT_TOLERANCE = 1e-5
"""By how much, as a share of the largest stiffness, the bound may be missed."""
SELF_MOTION_STEP = 0.02
"""Joint-space length of a step [rad]."""
FARTHEST = 4.0
"""Joint-space length at which a self-motion is given up [rad]."""
LIMIT_DISTANCE = 0.05
"""Distance kept from the joints' limits [rad]."""
CORRECTIONS = 4
HAND_TOLERANCE = 1e-8
"""Of the hand, m and rad, after the corrections."""


@dataclass(frozen=True)
class TuningRequest:
    """A load case, and the bounds of its springs.

    Attributes:
        arm: Limb whose joints carry the force.
        direction: (3,) of the force that the hand exerts, world axes, length 1.
        low, high: Its range [N].
        postures: How many postures of the self-motion are compared; 1 keeps the task's.
        reach: How far a spring's rest may lie from the posture [rad].
        softest: No joint spring is softer [N.m/rad]: a joint that the load does not turn would drift.
        alone: Whether the task's other springs are left out.
    """

    arm: str
    direction: Array
    low: float
    high: float
    postures: int
    reach: float
    softest: float
    alone: bool

    @property
    def ends(self) -> tuple[float, ...]:
        """The forces at both ends of the range [N]."""
        return (self.low, self.high)


@dataclass(frozen=True)
class TunedPosture:
    """One posture with its least joint springs.

    Attributes:
        posture: Which.
        stiffness: (k,) joint springs [N.m/rad], a little above the bound.
        folds_at: Share of ``stiffness`` at which the arm folds; 0 where other springs alone hold it.
        torque: (k,) that the springs exert at the end of the range with the larger force [N.m].
        rest: (k,) where the springs then rest [rad].
        share: Largest torque, the arm's own weight included, over its limit.
        hand: Stiffness of the hand along the force at both ends of the range [N/m].
    """

    posture: Posture
    stiffness: Array
    folds_at: float
    torque: Array
    rest: Array
    share: float
    hand: tuple[float, ...]

    @property
    def total(self) -> float:
        """Sum of the joint springs [N.m/rad], by which postures are compared."""
        return float(np.sum(self.stiffness))


@dataclass(frozen=True)
class TuningResult:
    """All postures that can carry the force, and the best of them.

    Attributes:
        best: Needs the least joint stiffness.
        found: In the order of the self-motion.
        refused: Position along the self-motion [rad] -> why a posture cannot.
    """

    best: TunedPosture
    found: tuple[TunedPosture, ...]
    refused: dict[float, str]


def tune(assembly: Assembly, request: TuningRequest) -> TuningResult:
    """Compares postures and finds each one's least joint springs.

    Raises:
        BadInput: The task holds an object, or no posture can carry the force, with the reason of each.
    """
    if assembly.task.object is not None:
        raise BadInput(
            f"task '{assembly.task.name}' holds an object: tune looks at one free arm (valid: a task without object)"
        )
    limb = assembly.model.limbs[request.arm]
    found, refused = list[TunedPosture](), dict[float, str]()
    for posture in self_motion(assembly.model, limb, assembly.modules.posture, request.postures):
        try:
            found.append(tune_posture(assembly, request, posture))
        except BadInput as error:
            refused[posture.along] = str(error)
    if not found:
        reasons = "; ".join(f"at {along:+.2f} rad: {why}" for along, why in refused.items())
        raise BadInput(f"no posture of arm '{request.arm}' carries this: {reasons}")
    best = min(found, key=lambda tuned: (round(tuned.total, 6), abs(tuned.posture.along)))
    return TuningResult(best, tuple(found), refused)


def tune_posture(assembly: Assembly, request: TuningRequest, posture: Posture) -> TunedPosture:
    """Finds the least joint springs of one posture.

    Raises:
        BadInput: A torque passes its limit, a rest cannot lie far enough, or no stiffness is enough.
    """
    jacobian, others = unloaded_arm(assembly, request, posture)
    forces = [np.append(f * request.direction, np.zeros(3)) for f in request.ends]
    torques = np.array([jacobian.T @ force for force in forces])
    share = _share(assembly, request, posture, torques)
    loads = unloading(jacobian, others, [-force for force in forces])
    room = _room(assembly, request, posture, torques)
    least = np.maximum(np.max(np.abs(torques) / room, axis=0), request.softest)
    stiffness = MARGIN * least_stiffness(loads, least, STIFFEST)
    largest = int(np.argmax(np.abs(request.ends)))
    limb = assembly.model.limbs[request.arm]
    return TunedPosture(
        posture=posture,
        stiffness=stiffness,
        folds_at=folding_share(stiffness, loads),
        torque=torques[largest],
        rest=posture.q[limb.joints] + torques[largest] / stiffness,
        share=share,
        hand=tuple(_along(jacobian, np.diag(stiffness) - load, request.direction) for load in loads),
    )


def unloaded_arm(assembly: Assembly, request: TuningRequest, posture: Posture) -> tuple[Array, Array]:
    """Gives the hand's Jacobian (6, k) and S (k, k), the task's other springs in joint space, at a posture."""
    limb = assembly.model.limbs[request.arm]
    arm = assembly.task.arms[request.arm]
    angles = dict(zip(limb.short_names, map(float, posture.q[limb.joints]), strict=True))
    moved = replace(arm, posture=angles)
    if request.alone:
        moved = replace(moved, springs=())
    task = replace(assembly.task, arms={**assembly.task.arms, request.arm: moved})
    modules = build_modules(task, assembly.model)
    mechanism = Mechanism(replace(assembly, task=task, modules=modules))
    mechanism.update(posture.q, np.zeros_like(posture.q))
    setting = Setting(modules, start_equilibrium(modules), phase_damping(modules, mechanism.kinematics))
    seen = analyse_state(mechanism, setting, posture.q).arms[request.arm]
    bias = modules.arm(request.arm).bias
    own = np.zeros(limb.joints.size) if bias is None else np.asarray(bias.stiffness)
    return seen.jacobian.copy(), seen.system.stiffness - np.diag(own)


def _share(assembly: Assembly, request: TuningRequest, posture: Posture, torques: Array) -> float:
    """Gives the largest torque over its limit, the arm's own weight included; refuses what passes it."""
    model, limb = assembly.model, assembly.model.limbs[request.arm]
    limit, weight = model.column("effort_max")[limb.joints], model.gravity(posture.q)[limb.joints]
    shares = np.abs(torques + weight) / limit
    end, joint = np.unravel_index(int(np.argmax(shares)), shares.shape)
    if shares[end, joint] > 1.0:
        raise BadInput(
            f"{request.ends[end]:g} N ask {abs(torques[end, joint] + weight[joint]):.1f} N.m of"
            f" {limb.joint_names[joint]} with the arm's weight (valid: up to {limit[joint]:g} N.m)"
        )
    return float(shares.max())


def _room(assembly: Assembly, request: TuningRequest, posture: Posture, torques: Array) -> Array:
    """Gives how far each spring's rest may lie from the posture, in the direction of its torque, (2, k) [rad]."""
    model, limb = assembly.model, assembly.model.limbs[request.arm]
    q = posture.q[limb.joints]
    up, down = model.column("position_max")[limb.joints] - q, q - model.column("position_min")[limb.joints]
    room = np.minimum(request.reach, np.where(torques > 0.0, up, down))
    if np.any(room <= 0.0):
        joint = limb.joint_names[int(np.argmin(np.min(room, axis=0)))]
        raise BadInput(f"{joint} stands at its limit: its spring's rest cannot lie beyond")
    return np.asarray(room)


def _along(jacobian: Array, hessian: Array, direction: Array) -> float:
    """Gives the hand's stiffness along a direction, 1 / (d^T J H^-1 J^T d) [N/m]."""
    row = direction @ jacobian[:3]
    return float(1.0 / (row @ np.linalg.solve(hessian, row)))


def named(values: Array, names: Sequence[str], digits: int) -> dict[str, float]:
    """Puts rounded numbers (k,) beside their joints' short names."""
    return {name: round(float(value), digits) for name, value in zip(names, values, strict=True)}


def unloading(jacobian: Array, others: Array, wrenches: Sequence[Array]) -> list[Array]:
    r"""Gives sym(\Gamma(F_b)) - S (k, k) for each wrench (6,): what diag(K) must exceed [N.m/rad].

    Args:
        jacobian: (6, k) of the hand.
        others: (k, k) S.
        wrenches: F_b in world axes at the hand [N, N.m].
    """
    turned = (gamma(jacobian, wrench) for wrench in wrenches)
    return [0.5 * (g + g.T) - 0.5 * (others + others.T) for g in turned]


def folding_share(stiffness: Array, loads: Sequence[Array]) -> float:
    """Finds the largest share s at which s K just folds under the worst load; 0 where it never does.

    Args:
        stiffness: (k,) K, above zero.
        loads: From ``unloading``.
    """
    root = 1.0 / np.sqrt(stiffness)
    highest = max(float(np.linalg.eigvalsh(root[:, None] * load * root)[-1]) for load in loads)
    return max(0.0, highest)


def least_stiffness(loads: Sequence[Array], least: Array, most: float) -> Array:
    """Finds K (k,) of the smallest sum with diag(K) - load positive semidefinite for all loads.

    By cutting planes: every direction u in which a K still folds requires u^2 . K >= u . load u, which is linear.

    Args:
        loads: From ``unloading``.
        least: (k,) lower bounds for other reasons [N.m/rad].
        most: Upper bound of every joint [N.m/rad].

    Raises:
        BadInput: No K below ``most`` holds these loads.
    """
    k = least.size
    cuts = [(u, load) for load in loads for u in np.eye(k)]
    for _ in range(CUTTING_ROUNDS):
        rows = np.array([-(u**2) for u, _ in cuts])
        bounds = np.array([-(u @ load @ u) for u, load in cuts])
        found = linprog(np.ones(k), A_ub=rows, b_ub=bounds, bounds=[(low, most) for low in least])
        if found.x is None:
            break
        new = list[tuple[Array, Array]]()
        for load in loads:
            values, vectors = np.linalg.eigh(np.diag(found.x) - load)
            missed = values < -CUT_TOLERANCE * max(1.0, float(found.x.max()))
            new += [(vector, load) for vector in vectors[:, missed].T]
        if not new:
            return _on_the_bound(np.asarray(found.x), loads, least)
        cuts += new
    raise BadInput(
        f"no joint stiffness up to {most:g} N.m/rad keeps the arm from folding (valid: less force, or another posture)"
    )


def _on_the_bound(stiffness: Array, loads: Sequence[Array], least: Array) -> Array:
    """Removes what the cuts' tolerance leaves: K just folds, or stands on its lower bounds."""
    share = folding_share(np.maximum(stiffness, 1e-9), loads)
    return np.maximum(stiffness * max(share, 1.0), least)


@dataclass(frozen=True)
class Posture:
    """One posture of the self-motion.

    Attributes:
        along: Distance along the self-motion from the task's posture, in joint space [rad].
        q: (n,) all joints [rad].
    """

    along: float
    q: Array


def self_motion(model: RobotModel, limb: Limb, q: Array, count: int) -> tuple[Posture, ...]:
    """Lists postures with the hand where it is at q, spread evenly between the joints' limits.

    An arm of six joints or fewer has none but its own.

    Args:
        model: The robot.
        limb: The arm.
        q: (n,) posture to begin at; it is always among them.
        count: How many at most.
    """
    if count == 1 or limb.joints.size <= 6:
        return (Posture(0.0, q),)
    follower = _Follower(model, limb, q)
    path = [*reversed(follower.walk(-1.0)), Posture(0.0, q), *follower.walk(1.0)]
    wanted = np.linspace(path[0].along, path[-1].along, count - 1)
    nearest = [min(path, key=lambda posture, w=w: abs(posture.along - w)) for w in wanted]  # type: ignore[misc]
    found = {posture.along: posture for posture in [*nearest, Posture(0.0, q)]}
    return tuple(found[along] for along in sorted(found))


class _Follower:
    """Walks along the null space of the hand's Jacobian."""

    def __init__(self, model: RobotModel, limb: Limb, q: Array) -> None:
        self._kinematics = Kinematics(model, (limb.hand,))
        self._limb, self._start = limb, q
        self._still = np.zeros(model.n)
        self._low = model.column("position_min")[limb.joints] + LIMIT_DISTANCE
        self._high = model.column("position_max")[limb.joints] - LIMIT_DISTANCE
        self._goal = self._look(q)[0]

    def _look(self, q: Array) -> tuple[Pose, Array]:
        self._kinematics.update(q, self._still)
        hand = self._limb.hand
        pose = self._kinematics.pose(hand)
        kept = Pose(pose.rotation.copy(), pose.translation.copy())
        return kept, self._kinematics.jacobian_of(hand)[:, self._limb.joints].copy()

    def walk(self, sign: float) -> list[Posture]:
        """Steps in one direction until a joint's limit, a singular posture, or far enough."""
        q, along, found = self._start.copy(), 0.0, list[Posture]()
        direction = sign * _null(self._look(q)[1])
        while along < FARTHEST:
            ahead = _null(self._look(q)[1])
            direction = ahead if ahead @ direction > 0.0 else -ahead
            q = self._corrected(q, direction)
            here = q[self._limb.joints]
            missed, _ = self._miss(q)
            if np.abs(missed).max() > HAND_TOLERANCE or np.any(here < self._low) or np.any(here > self._high):
                break
            along += SELF_MOTION_STEP
            found.append(Posture(sign * along, q.copy()))
        return found

    def _corrected(self, q: Array, direction: Array) -> Array:
        q = q.copy()
        q[self._limb.joints] += SELF_MOTION_STEP * direction
        for _ in range(CORRECTIONS):
            missed, J = self._miss(q)
            q[self._limb.joints] += np.linalg.pinv(J) @ missed
        return q

    def _miss(self, q: Array) -> tuple[Array, Array]:
        pose, J = self._look(q)
        turn = log3(self._goal.rotation @ pose.rotation.T)
        return np.concatenate([self._goal.translation - pose.translation, turn]), J


def _null(jacobian: Array) -> Array:
    """Gives the joint direction (k,) that moves the hand least, of length 1."""
    return np.asarray(np.linalg.svd(jacobian)[2][-1])
