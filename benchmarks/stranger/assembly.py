# SPDX-License-Identifier: BSD-3-Clause
"""Puts planted effects into a machine: bodies, laws at their stages, soft gears."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.stranger.engine import Arm
from benchmarks.stranger.laws import (
    Law,
    State,
    bristles,
    changed,
    lag,
    late,
    of_position,
    of_speed,
    push,
    shaft,
)
from benchmarks.stranger.machine import Build, Gear
from benchmarks.stranger.motions import TICK
from benchmarks.stranger.outside import OUTSIDE, outside_law
from benchmarks.stranger.planting import Planted, scaled_link
from benchmarks.stranger.robots import add_body

Array = NDArray[np.float64]


def with_bodies(root: ET.Element, planted: list[Planted]) -> ET.Element:
    """The links as they are, with tools and with links that weigh something else."""
    for p in planted:
        if p.effect == "payload":
            root = add_body(root, p.link, p.values["m"], np.array([p.values[k] for k in ("cx", "cy", "cz")]))
        if p.effect == "link_inertia":
            root = scaled_link(root, p.link, 1.0 + p.values["part"])
    return root


def assemble(real: ET.Element, model: Arm, planted: list[Planted]) -> Build:
    """A machine for one recording."""
    build = Build(Arm(with_bodies(real, planted)), model, rotors_of(planted, model.n))
    for p in planted:
        if p.outside:
            build.laws[OUTSIDE[p.effect][3]].append(outside_law(p))
        elif p.effect == "base_tilt":
            build.arm.lean(p.values["rx"], p.values["ry"])
        elif p.effect in ("joint_elasticity", "backlash"):
            x = p.values
            build.gear = Gear(p.joints[0], x["K"], x["D"], x["rotor"], x.get("b", 0.0))
        else:
            stage, law = _law(p, model.n)
            if law is not None:
                build.laws[stage].append(law)
    return build


def rotors_of(planted: list[Planted], n: int) -> Array:
    """Inertia on the motors' side: on the diagonal, or of a shaft that turns with two joints."""
    rotors = np.zeros((n, n))
    for p in planted:
        if p.effect == "reflected_inertia":
            rotors[p.joints[0], p.joints[0]] += p.values["Ia"]
        if p.effect == "transmission_coupling":
            rotors[np.ix_(p.joints, p.joints)] += p.values["Ia"]
    return rotors


def _law(p: Planted, n: int) -> tuple[str, Law | None]:
    """Stage and law of an effect of the catalogue; None where it is no law of the machine."""
    if "friction" in p.effect or p.effect in ("hysteresis", "quadratic_drag"):
        return p.place, _rubbing(p)
    x, j = p.values, p.joints[0] if p.joints else 0
    if p.effect == "torque_offset":
        return p.place, changed(j, lambda _, u: float(u[j] + x["c"]))
    if p.effect == "parallel_spring":
        return "link", of_position(j, lambda q: x["k"] * (q - x["q0"]))
    if p.effect == "torque_ripple":
        return p.place, _cogging(p)
    if p.effect == "encoder_offset":
        return "position", changed(j, lambda _, q: float(q[j] + x["dq0"]))
    if p.effect == "external_contact":
        return "link", push(p.link, _steady(x))
    if p.effect == "transmission_coupling":
        return "motor", shaft(p.joints[0], p.joints[1], x["fc"], x["fv"], x["travel"])
    return _on_the_way(p, n)


def _on_the_way(p: Planted, n: int) -> tuple[str, Law | None]:
    """Drives and readings."""
    x, j = p.values, p.joints[0] if p.joints else 0
    if p.effect == "command_delay":
        return "command", late(j, x["T"], TICK)
    if p.effect == "actuator_lag":
        return "drive", lag(j, x["T"], TICK)
    if p.effect == "torque_saturation":
        return "drive", changed(j, lambda _, u: float(np.clip(u[j], -x["limit"], x["limit"])))
    if p.effect == "controller_gain":
        return "drive", changed(
            j,
            lambda s, u: float(
                u[j] + x["dkp"] * (s.aim_q[j] - s.seen_q[j]) + x["dkd"] * (s.aim_v[j] - s.seen_v[j])
            ),
        )
    if p.effect == "torque_gain":
        return _stage(p), _reading(p, lambda u, k: u[k] * x["s"], n)
    if p.effect == "crosstalk":
        other = p.joints[1]
        return _stage(p), _reading(p, lambda u, k: u[k] + x["c"] * u[k - p.joints[0] + other], n)
    return "effort", None  # velocity_filter_lag, clock_drift: the recorder's


def _stage(p: Planted) -> str:
    return "drive" if p.place == "drive" else "effort"


def _reading(p: Planted, to: Callable[[Array, int], float], n: int) -> Law:
    """Changes a torque on its way to the motor, or what both sensors of the joint say."""
    j = p.joints[0]

    def law(_: State, u: Array) -> Array:
        out = u.copy()
        for k in (j,) if p.place == "drive" else (j, n + j):
            out[k] = to(u, k)
        return out

    return law


def _rubbing(p: Planted) -> Law:
    """The friction laws; v is the speed of the side on which it rubs."""
    x, j, motor = p.values, p.joints[0], p.place == "motor"
    if p.effect == "viscous_friction":
        return of_speed(j, lambda _, v: x["fv"] * v, motor)
    if p.effect == "quadratic_drag":
        return of_speed(j, lambda _, v: x["c"] * v * abs(v), motor)
    if p.effect == "friction_drift":
        return of_speed(
            j,
            lambda s, v: x["fv"] * v * (x["k"] + (1 - x["k"]) * float(np.exp(-max(s.t, 0.0) / x["T"]))),
            motor,
        )
    if p.effect == "stribeck_friction":
        return bristles(
            j,
            lambda _, v: x["fc"] + (x["fs"] - x["fc"]) * float(np.exp(-((v / x["vs"]) ** 2))),
            x["travel"],
            motor,
        )
    if p.effect == "asymmetric_friction":
        return _two_sided(j, x["fc"], x["da"], x["travel"], motor)
    if p.effect == "load_dependent_friction":
        return bristles(j, lambda s, _: x["kl"] * abs(float(s.tau[j])), x["travel"], motor)
    return bristles(j, lambda _s, _v: x["fc"], x["travel"], motor)


def _two_sided(j: int, fc: float, da: float, bend: float, motor: bool) -> Law:
    """Bristles that slip at fc + da one way and at fc - da the other."""
    bent = [0.0]

    def law(s: State, torque: Array) -> Array:
        v = float((s.vm if motor else s.v)[j])
        limit = np.sign(v) * bend
        bent[0] = limit + (bent[0] - limit) * np.exp(-abs(v) * s.h / bend)
        torque[j] += (fc + da * np.sign(bent[0])) * bent[0] / bend
        return torque

    return law


def _cogging(p: Planted) -> Law:
    x, j = p.values, p.joints[0]
    return of_position(j, lambda q: x["A"] * float(np.sin(x["N"] * q + x["phi"])))


def _steady(x: dict[str, float]) -> Callable[[State], Array | None]:
    """A force that is there in one recording, from start to end, and comes and goes within 50 ms."""
    f = np.array([x["fx"], x["fy"], x["fz"]])

    def force(s: State) -> Array | None:
        if s.recording != int(x["recording"]) or not x["start"] <= s.t <= x["end"]:
            return None
        return f * min(1.0, (s.t - x["start"]) / 0.05, (x["end"] - s.t) / 0.05)

    return force
