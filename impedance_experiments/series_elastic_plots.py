# SPDX-License-Identifier: BSD-3-Clause
"""Drawings of a series-elastic joint: Bode, poles and zeros, the answer to a blow (thesis fig. 3-2 to 3-5)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from impedance_experiments.blow import BLOW_TIME, Blow
from impedance_experiments.page import Plot
from impedance_experiments.series_elastic_joint import SeriesElasticJoint

Array = NDArray[np.float64]


def draw_bode(joint: SeriesElasticJoint, omega: Array) -> Plot:
    """Draws the link's velocity per torque, in magnitude and phase, for both inputs."""
    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    mobility, rigid = joint.mobility(omega)[:, 0, :], joint.rigid_mobility(omega)
    for column, title in enumerate(("external torque (collocated)", "motor torque (non-collocated)")):
        magnitude, phase = axes[0, column], axes[1, column]
        for values, label, style in ((mobility[:, column], "with its spring", "-"), (rigid, "reduced", "--")):
            magnitude.loglog(omega, np.abs(values), style, label=label)
            phase.semilogx(omega, np.degrees(np.unwrap(np.angle(values))), style)
        magnitude.set_title(f"{title} to link velocity", fontsize=10)
        magnitude.axvline(90.0, color="0.7", linewidth=0.8)
        phase.axvline(90.0, color="0.7", linewidth=0.8)
        phase.axhspan(-300.0, -90.0, color="C3", alpha=0.08)
        phase.set(xlabel="frequency [rad/s]", ylim=(-290.0, 100.0))
    axes[0, 0].set_ylabel("rad/s per N.m")
    axes[1, 0].set_ylabel("phase [deg]")
    axes[0, 0].legend(fontsize=8)
    return Plot(
        "bode",
        "Fig. 3-2. Grey: the thesis's 90 rad/s. Shaded: phase below -90 degrees, where the port gives energy away",
        figure,
    )


def draw_poles(joint: SeriesElasticJoint) -> Plot:
    """Draws the poles, the link's zeros, and where a damper that reads the link drives the poles."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    limit = joint.highest_damping_gain(sensed_at_link=True)
    for gain in np.linspace(0.0, 3.0 * limit, 40):
        loop = joint.system - gain * np.outer(joint.inputs[:, 1], [0.0, 0.0, 1.0, 0.0])
        values = np.linalg.eigvals(loop)
        axes.plot(values.real, values.imag, ".", color="C1", markersize=3, alpha=0.7)
    axes.plot(joint.poles.real, joint.poles.imag, "x", color="C0", markersize=9, label="poles")
    zeros = _zeros_at_the_link(joint)
    axes.plot(zeros.real, zeros.imag, "o", color="C0", fillstyle="none", label="zeros, external torque")
    axes.axvline(0.0, color="0.4", linewidth=0.8)
    axes.set(xlabel="real [rad/s]", ylabel="imaginary [rad/s]")
    axes.plot([], [], ".", color="C1", label=f"damper at the link, b up to {3.0 * limit:.3g} N.m.s/rad")
    axes.legend(fontsize=8)
    return Plot(
        "poles",
        "Fig. 3-5. The elastic pair lies near the imaginary axis; modest gains push it across",
        figure,
    )


def _zeros_at_the_link(joint: SeriesElasticJoint) -> NDArray[np.complex128]:
    """Zeros from external torque to link velocity: the rotor on its spring, the link held."""
    damping = joint.spring_damping + joint.motor_damping
    return np.roots([joint.reflected_inertia, damping, joint.spring_stiffness]).astype(np.complex128)


def draw_blow(blow: Blow) -> Plot:
    """Draws angle and velocity after the blow, and the blow."""
    figure = Figure(figsize=(9.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for axes, row, label in ((left, 0, "link angle [rad]"), (right, 1, "link velocity [rad/s]")):
        axes.plot(blow.time, blow.full[row], label="with its spring")
        axes.plot(blow.time, blow.reduced[row], "--", label="reduced")
        axes.set(xlabel="time [s]", ylabel=label)
    left.legend(fontsize=8, loc="lower right")
    right.set_xlim(BLOW_TIME - 0.1, BLOW_TIME + 0.6)
    force = right.twinx()
    force.plot(blow.time, blow.force, color="0.6", linewidth=0.8)
    force.set_ylabel("blow [N]", color="0.5")
    return Plot(
        "blow", "Fig. 3-4. The answer to the blow of fig. 3-3: the whole way, and the first moments", figure
    )
