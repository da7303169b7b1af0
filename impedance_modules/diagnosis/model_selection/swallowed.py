# SPDX-License-Identifier: BSD-3-Clause
r"""What the priors swallowed: errors of links, weights and stamps, fitted beside the causes, that are no finding.

Every fit adjusts the links' inertial parameters, the weights that the robot compensates and the stamps within stated
deviations. A real mass can hide there. Beside the sizes, in deviations, stands the point mass at the outermost body
whose torque comes closest to what the links' adjustment changes, t = Y \delta:

    m = \sum t^T W y / \sum y^T W y,     share = (\sum t^T W y)^2 / (\sum t^T W t \sum y^T W y)

y is the torque of 1 kg there, W one over the noise power of each joint, sums over all samples.
"""

from __future__ import annotations

import numpy as np

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.rigid_tree import Body, RigidTree
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.regression.nuisance_columns import (
    ASSISTANCE_PRIOR,
    READING_PRIOR,
    SPEED_PRIOR,
    TIMING_PRIOR,
    inertia_prior,
)
from impedance_modules.diagnosis.result import Adjustment, HandMass, Swallowed

LIKE = 0.5
"""Share of the swallowed torque's power that a mass in the hand must make to be named."""

MOTION = ("link", "motor", "whole")
"""Residuals that see the links' inertia."""


def swallowed_by_priors(evidence: Evidence) -> Swallowed:
    """Reads what the accepted fit adjusted within its priors; the shape of the velocities' filter is left out."""
    tree = evidence.prepared[0].tree
    found = evidence.model_fit.whole.coefficients[: evidence.design.nuisance.size]
    prior = inertia_prior(tree.inertia)
    size, period = len(prior), 1.0 / evidence.prepared[0].log.rate
    links = found[:size].reshape(-1, 10)
    # The columns of readings are per second that these are early, the others per second that torque acts later.
    late = (
        ("commands", TIMING_PRIOR * period),
        ("efforts", -READING_PRIOR * period),
        ("velocities", -SPEED_PRIOR * period),
        ("positions of compensated weights", ASSISTANCE_PRIOR),
    )
    return Swallowed(
        links={
            body.link: Adjustment(float(row[0] * width), "kg", float(np.abs(row).max()))
            for body, row, width in zip(tree.bodies, links, prior[::10], strict=True)
        },
        weights=float(np.abs(found[size : 2 * size]).max(initial=0.0)),
        times={
            name: Adjustment(float(value * deviation), "s", float(abs(value)))
            for (name, deviation), value in zip(late, found[2 * size : 2 * size + len(late)], strict=True)
            if value != 0.0
        },
        hand=_hand_mass(evidence, found[:size] * prior),
    )


def outermost(tree: RigidTree) -> int:
    """Index of the body behind most joints; the first of several."""
    depth: list[int] = []
    for body in tree.bodies:
        depth.append(0 if body.parent is None else depth[body.parent] + 1)
    return int(np.argmax(depth))


def _hand_mass(evidence: Evidence, change: Array) -> HandMass | None:
    """The mass at the outermost body that does most of what the links' change (10 n,) does; None if none does."""
    tree = evidence.prepared[0].tree
    index = outermost(tree)
    body = tree.bodies[index]
    unit = np.zeros(len(change))
    unit[10 * index : 10 * index + 10] = _point_mass(body)
    weight = _weights(evidence)
    both = own = whole = 0.0
    for item in evidence.prepared:
        swallowed, made = item.link_nuisance @ change, item.link_nuisance @ unit
        both += float(np.sum(weight * swallowed * made))
        own += float(np.sum(weight * made**2))
        whole += float(np.sum(weight * swallowed**2))
    if own <= 0.0 or whole <= 0.0 or both**2 < LIKE * own * whole:
        return None
    return HandMass(body.link, both / own, both**2 / (own * whole))


def _point_mass(body: Body) -> Array:
    """Ten parameters of 1 kg at a body's centre of mass, at its joint's origin if it has none."""
    mass = float(body.inertia[0])
    x, y, z = body.inertia[1:4] / mass if mass > 0.0 else np.zeros(3)
    return np.array([1.0, x, y, z, y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y])


def _weights(evidence: Evidence) -> Array:
    """(n,) one over the noise power of each joint; 0 where no residual sees the links."""
    out = np.zeros(len(evidence.prepared[0].tree.bodies))
    for (residual, joint), noise in zip(evidence.design.groups, evidence.heldout_noise, strict=True):
        if residual in MOTION and noise > 0.0:
            out[joint] = 1.0 / noise**2
    return out
