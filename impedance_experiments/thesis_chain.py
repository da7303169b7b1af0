# SPDX-License-Identifier: BSD-3-Clause
r"""The thesis's own model of Baxter's right arm: its Denavit-Hartenberg chain, and the listing of its Appendix A.

The listing writes x_u, the links' centres of mass and three angles for each link, differentiates it by the joints,
j = dx_u / dq, and takes j^T M j with M block diagonal (2.9 to 2.15). Its angles are

    first link (0, 0, q_1),        link k: R_{k-1} (0, 0, q_k) + (0, 0, q_1)

R the rotation up to the joint. Their derivative is no angular velocity, and each link's inertia stands in M as it is in
the link's own axes, whatever the posture: both are kept here, because the printed numbers have them.
"""

from __future__ import annotations

import math

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.robot.pose import Pose
from impedance_modules.superposition.examples import DISTANCE, LENGTH, SECOND_OFFSET, TWIST

BASE = (0.064027, -0.25903, 0.09066)
"""Of the first axis in the robot's base (2.7) [m]; it is turned by BASE_TURN about z."""
BASE_TURN = -math.pi / 4
MASSES = (5.70044, 3.22698, 4.31272, 2.07206, 2.24665, 1.60979, 0.54218)
"""Of the links, the last with the hand [kg]."""
CENTRES = (
    (-0.05117, 0.07908, 0.00086),
    (0.00269, -0.00529, 0.06845),
    (-0.07176, 0.08149, 0.00132),
    (0.00159, -0.01117, 0.02618),
    (-0.01168, 0.13111, 0.0046),
    (0.00697, 0.006, 0.06048),
    (0.005137, 0.000957, -0.066823),
)
"""Of mass, in the frame after each joint [m]."""
INERTIAS = (
    (0.047091, -0.006149, 0.000128, 0.03596, -0.000781, 0.03767),
    (0.027886, -0.000188, -0.000301, 0.020787, 0.002077, 0.011752),
    (0.026617, -0.003922, 0.000293, 0.01248, -0.001084, 0.028444),
    (0.013182, -0.000197, 0.00036, 0.009269, 0.000746, 0.007116),
    (0.016677, -0.000187, 0.000184, 0.003746, 0.000647, 0.016755),
    (0.007005, 0.000153, -0.000444, 0.005528, -0.000211, 0.003876),
    (0.000816, 0.000128, 0.00019, 0.000874, 0.000106, 0.000549),
)
"""xx, xy, xz, yy, yz, zz at the centre of mass in the same frame [kg.m^2]."""
STEP = 1e-6
"""Of the central differences [rad]."""


def chain_frames(q: Array) -> list[Pose]:
    """Gives the frames before the first joint and after each, (k + 1), in the robot's base."""
    c, s = math.cos(BASE_TURN), math.sin(BASE_TURN)
    frames = [Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array(BASE))]
    offsets = np.zeros(q.size)
    offsets[1] = SECOND_OFFSET
    for angle, d, a, quarter in zip(q + offsets, DISTANCE, LENGTH, TWIST, strict=True):
        ct, st, ca, sa = math.cos(angle), math.sin(angle), float(quarter == 0), float(quarter)
        turn = np.array([[ct, -st * ca, st * sa], [st, ct * ca, -ct * sa], [0.0, sa, ca]])
        frames.append(frames[-1] @ Pose(turn, np.array([a * ct, a * st, d])))
    return frames


def chain_hand(q: Array) -> Pose:
    """Gives the hand's pose by the chain (2.8), in the robot's base."""
    return chain_frames(q)[-1]


def chain_inertia(q: Array) -> Array:
    """Gives the diagonal of M from the same parameters by each link's twist, its inertia turned with it [kg.m^2]."""
    frames = chain_frames(q)
    total = np.zeros((q.size, q.size))
    for k, (mass, centre) in enumerate(zip(MASSES, CENTRES, strict=True)):
        after = frames[k + 1]
        place = after.translation + after.rotation @ np.array(centre)
        axes = [frame.rotation[:, 2] for frame in frames[: k + 1]]
        linear, angular = np.zeros((3, q.size)), np.zeros((3, q.size))
        angular[:, : k + 1] = np.array(axes).T
        levers = [place - frame.translation for frame in frames[: k + 1]]
        linear[:, : k + 1] = np.array([np.cross(*pair) for pair in zip(axes, levers, strict=True)]).T
        own = after.rotation @ _own_inertia(k) @ after.rotation.T
        total += mass * linear.T @ linear + angular.T @ own @ angular
    return np.diag(total).copy()


def _own_inertia(link: int) -> Array:
    xx, xy, xz, yy, yz, zz = INERTIAS[link]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def listing_inertia(q: Array) -> Array:
    """Gives the diagonal of j^T M j as the listing computes it (k,) [kg.m^2]."""
    steps = STEP * np.eye(q.size)
    jacobian = np.array(
        [(_coordinates(q + step) - _coordinates(q - step)) / (2.0 * STEP) for step in steps]
    ).T
    total = np.zeros((q.size, q.size))
    for k, mass in enumerate(MASSES):
        centre, angles = jacobian[6 * k : 6 * k + 3], jacobian[6 * k + 3 : 6 * k + 6]
        total += mass * centre.T @ centre + angles.T @ _own_inertia(k) @ angles
    return np.diag(total).copy()


def _coordinates(q: Array) -> Array:
    """Writes x_u (6 k,): centre of mass [m] and angles [rad] of every link."""
    frames = chain_frames(q)
    rows: list[Array] = []
    for k, centre in enumerate(CENTRES):
        after, before = frames[k + 1], frames[k]
        about = np.array([0.0, 0.0, q[k]])
        angles = about if k == 0 else before.rotation @ about + np.array([0.0, 0.0, q[0]])
        rows += [after.translation + after.rotation @ np.array(centre), angles]
    return np.concatenate(rows)
