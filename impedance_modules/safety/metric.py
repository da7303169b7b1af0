# SPDX-License-Identifier: BSD-3-Clause
"""What a change of torque costs, and what breaking a soft row costs in the same currency.

Gauss's principle of least constraint: the natural size of a torque change dtau is the size of the
acceleration it causes, weighed by inertia. Seen by the whole arm that is
(Minv dtau)^T M (Minv dtau) = dtau^T Minv dtau; seen by the hands it is the same with the hands'
acceleration and their operational inertia.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from impedance_modules.safety.problem import Matrix, RowKind, Vector

POSTURE_WEIGHT = 0.1
"""eps: a torque change that no hand feels costs eps / (1 + eps) of one that moves a hand."""

HEAVIEST_HAND = (100.0, 10.0)
"""Bounds of a hand's operational inertia, (mass [kg], rotational inertia [kg.m^2]), near singularities."""

LOWEST_PENALTY = 1e2
"""kappa of the lowest rank: about 1 / kappa of the excess that the desired torque asks for gets through."""

RANK_FACTOR = 12.0
"""kappa of a rank over that of the rank below it."""


def metric(
    inverse_inertia: Matrix,
    jacobians: Sequence[Matrix],
    eps: float = POSTURE_WEIGHT,
    heaviest: tuple[float, float] = HEAVIEST_HAND,
) -> Matrix:
    r"""How much a torque change matters: first the hands' acceleration, then the posture's.

    W = sum_hands Minv J^T Lambda J Minv + eps Minv,   Lambda = (J Minv J^T + C)^-1,
    C = diag(1/mass x 3, 1/inertia x 3) of the heaviest hand the filter believes in.

    C bounds Lambda where an arm is singular and its true operational inertia infinite; elsewhere it
    changes Lambda by about Lambda / heaviest. Since Lambda never exceeds the true one, the sum is a
    weighted projection: eps Minv <= W <= (1 + eps) Minv, so W is as well conditioned as the inertia
    up to the factor (1 + eps) / eps, in every posture.

    Args:
        inverse_inertia: (n, n) Minv = (M + I_r)^-1 [1/(kg.m^2)].
        jacobians: J_WE (6, n) of each hand, linear rows first. Hands must not share joints.
        eps: Weight of the posture, > 0.
        heaviest: Largest mass [kg] and rotational inertia [kg.m^2] of a hand.

    Returns:
        (n, n) symmetric positive definite [1/(kg.m^2)].

    Raises:
        ValueError: If eps or an entry of ``heaviest`` is not positive.

    Source: design section 4 "QP".
    """
    if not (eps > 0.0 and min(heaviest) > 0.0):
        raise ValueError(
            f"metric needs eps > 0 and a positive heaviest hand, got eps={eps}, heaviest={heaviest}"
        )
    result = eps * inverse_inertia
    floor = np.repeat(1.0 / np.asarray(heaviest), 3)
    for jacobian in jacobians:
        acceleration = jacobian @ inverse_inertia
        mobility = acceleration @ jacobian.T
        mobility.flat[:: mobility.shape[0] + 1] += floor
        result += acceleration.T @ np.linalg.solve(mobility, acceleration)
    return 0.5 * (result + result.T)


def relative_penalty(kind: RowKind) -> float:
    """Returns kappa of a soft kind: LOWEST_PENALTY at the lowest rank, RANK_FACTOR times more per rank above.

    Two rows of the same direction that cannot both hold are broken in the ratio of their kappas.

    Raises:
        ValueError: For a hard kind, which has no penalty.
    """
    if kind.hard:
        raise ValueError(f"a {kind.label} row is hard; only soft rows have a penalty")
    return LOWEST_PENALTY * RANK_FACTOR ** (RowKind.VELOCITY.value - kind.value)


def penalty(kind: RowKind, row_mobility: Vector) -> Vector:
    """Penalty of a soft row, commensurate with the metric.

    Moving a row a . tau by one unit costs at least 1 / (a W^-1 a^T), and a W^-1 a^T lies between
    g / (1 + eps) and g / eps with g = a M a^T. So w = kappa / g makes a row resist between kappa /
    (1 + eps) and kappa / eps times harder than the desired torque pulls, whatever its units.

    Args:
        kind: Rank of the rows.
        row_mobility: g of each row: Minv_ii for an acceleration row Minv_i, 1 / Minv_ii (a lower bound
            of M_ii) for a single torque, c Minv c^T for the acceleration along c. Zero: no such row.

    Returns:
        w, same shape; 1 where g = 0 (the row is absent, its weight without effect).
    """
    present = row_mobility > 0.0
    return np.where(present, relative_penalty(kind) / np.where(present, row_mobility, 1.0), 1.0)
