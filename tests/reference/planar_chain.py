# SPDX-License-Identifier: BSD-3-Clause
r"""Endpoint inertia of a planar chain, from its kinetic energy alone: a second opinion on eq. 4.28 to 4.30.

With absolute link angles \phi_i the links' centres and the tip are sums of unit vectors; nothing of the package is
used.
"""

import numpy as np

LINK_MASS, LINK_LENGTH, LINK_RADIUS = 5.0, 1.0, 0.1
"""Of each link, a solid cylinder [kg], [m], [m]; not printed in the thesis, recovered from its results."""


def planar_inertia(link_angles: np.ndarray) -> np.ndarray:
    r"""Computes (J M^-1 J^T)^-1 in (x, y, \theta), M = \sum m_i Jc_i^T Jc_i + I_c w_i w_i^T.

    Args:
        link_angles: (k,) against the x axis [rad], k >= 3.

    Returns:
        (3, 3) [kg, kg.m, kg.m^2].
    """
    k = len(link_angles)
    across = LINK_LENGTH * np.array([-np.sin(link_angles), np.cos(link_angles)])
    central = LINK_MASS * (3.0 * LINK_RADIUS**2 + LINK_LENGTH**2) / 12.0
    inertia = np.zeros((k, k))
    for link in range(k):
        at_centre = across * np.where(np.arange(k) < link, 1.0, np.where(np.arange(k) == link, 0.5, 0.0))
        inertia += LINK_MASS * at_centre.T @ at_centre
        inertia[link, link] += central
    tip = np.vstack([across, np.eye(k)[-1]])
    return np.linalg.inv(tip @ np.linalg.inv(inertia) @ tip.T)
