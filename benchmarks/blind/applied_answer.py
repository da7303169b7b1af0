# SPDX-License-Identifier: BSD-3-Clause
"""Applies a tool's answer to the benchmark's own arm, with the symbols and signs of design 3.3."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.arm_model import Inertial, Link
from benchmarks.blind.bodies import tilted, with_payload
from benchmarks.blind.injection import with_friction, with_joint
from benchmarks.blind.plant import Arm

Numbers = Mapping[str, float]
Array = NDArray[np.float64]

BEND = 3e-4
"""Bristle deflection [rad] of dry friction whose answer says nothing of it."""


def apply_answer(arm: Arm, causes: list[Mapping[str, Any]]) -> tuple[Arm, tuple[str, ...]]:
    """Returns the arm with every cause applied, and the ids of those that cannot be applied to it."""
    left_out = []
    for cause in causes:
        apply = _APPLY.get(cause["effect"])
        for key, symbols in cause.get("parameters", {}).items():
            numbers = {symbol: float(quantity["value"]) for symbol, quantity in symbols.items()}
            if apply is None:
                left_out.append(str(cause["effect"]))
            else:
                arm = apply(arm, key, str(cause.get("port", "actuator")), numbers)
    return arm, tuple(left_out)


def _friction(arm: Arm, key: str, port: str, n: Numbers) -> Arm:
    at = arm.drive.joints.index(key)
    record = arm.faults.friction[0 if port == "actuator" else 1][at]
    level = n.get("fs", n.get("fc", 0.0)) + 20.0 * n.get("kl", 0.0)
    values = {name: n[name] for name in ("vs", "k", "T") if name in n}
    values |= {
        name: float(record[name]) + n[name] for name in ("fc", "fv", "c", "da", "dv", "kl") if name in n
    }
    if "fs" in n:
        values["fs"] = max(n["fs"] - n["fc"], 0.0)
    if "s0" in n:
        values |= {"s0": n["s0"], "s1": 0.0}
    elif level > 0.0:
        inertia = arm.drive.rotor_inertia[at] * (1.0 if port == "actuator" else 0.01)
        values |= {"s0": level / BEND, "s1": 0.2 * float(np.sqrt(level / BEND * inertia))}
    return with_friction(arm, port, at, **values)


def _joint(**fields: str) -> Callable[[Arm, str, str, Numbers], Arm]:
    """Returns a hand that copies symbols into fields of the joint's record."""

    def apply(arm: Arm, key: str, _: str, n: Numbers) -> Arm:
        values = {field: n[symbol] for symbol, field in fields.items() if symbol in n}
        return with_joint(arm, arm.drive.joints.index(key), **values)

    return apply


def _offset(arm: Arm, key: str, port: str, n: Numbers) -> Arm:
    fields = {"actuator": ("offset", -1.0), "link": ("preload", -1.0), "sensor": ("effort_offset", 1.0)}
    field, sign = fields[port]
    at = arm.drive.joints.index(key)
    return with_joint(arm, at, **{field: float(arm.faults.joint[field][at]) + sign * n["c"]})


def _gain(arm: Arm, key: str, port: str, n: Numbers) -> Arm:
    field = "effort_gain" if port == "sensor" else "gain"
    return with_joint(arm, arm.drive.joints.index(key), **{field: n["s"]})


def _drive(field: str, symbol: str) -> Callable[[Arm, str, str, Numbers], Arm]:
    def apply(arm: Arm, key: str, _: str, n: Numbers) -> Arm:
        values = getattr(arm.joints, field).copy()
        values[arm.drive.joints.index(key)] = n[symbol]
        return replace(arm, joints=replace(arm.joints, **{field: values}))

    return apply


def _spring(arm: Arm, key: str, _: str, n: Numbers) -> Arm:
    at = arm.drive.joints.index(key)
    preload = n["preload"] if "preload" in n else n["k"] * n["q0"]
    return with_joint(arm, at, spring=n["k"], preload=float(arm.faults.joint["preload"][at]) + preload)


def _ripple(arm: Arm, key: str, _: str, n: Numbers) -> Arm:
    at = arm.drive.joints.index(key)
    return with_joint(arm, at, ripple=-n["A"], order=n["N"], phase=n.get("phi", 0.0))


def _between(arm: Arm, key: str, _: str, n: Numbers) -> Arm:
    at, other = (arm.drive.joints.index(name) for name in key.split("<-"))
    field = "crosstalk" if "c" in n else "coupling"
    table = getattr(arm.faults, field).copy()
    table[at, other] += n["c"] if "c" in n else n.get("fc", 0.0)
    return replace(arm, faults=replace(arm.faults, **{field: table}))


def _payload(arm: Arm, key: str, _: str, n: Numbers) -> Arm:
    place = np.array([n["cx"], n["cy"], n["cz"]])
    return replace(
        arm, links=tuple(with_payload(x, n["m"], place) if x.name == key else x for x in arm.links)
    )


def _inertia(arm: Arm, key: str, _: str, n: Numbers) -> Arm:
    return replace(arm, links=tuple(_changed(link, n) if link.name == key else link for link in arm.links))


def _changed(link: Link, n: Numbers) -> Link:
    """Adds mass, first moment and inertia about the link's origin."""
    old = link.inertial
    if old is None:
        return link
    moment = old.mass * old.com + np.array([n.get(f"dh{axis}", 0.0) for axis in "xyz"])
    mass = old.mass + n.get("dm", 0.0)
    more = np.zeros((3, 3))
    for i, a in enumerate("xyz"):
        for j, b in enumerate("xyz"):
            more[i, j] = n.get("dI" + "".join(sorted(a + b)), 0.0)
    com = moment / mass
    inertia = old.inertia + _steiner(old.mass, old.com) + more - _steiner(mass, com)
    return replace(link, inertial=Inertial(mass, com, inertia))


def _steiner(mass: float, com: Array) -> Array:
    return np.asarray(mass * (com @ com * np.eye(3) - np.outer(com, com)))


def _tilt(arm: Arm, _: str, __: str, n: Numbers) -> Arm:
    return replace(arm, gravity=tilted(n["rx"], n["ry"]))


def _clock(arm: Arm, _: str, __: str, n: Numbers) -> Arm:
    return replace(arm, faults=replace(arm.faults, stamps=1e-6 * n["ppm"]))


_FRICTIONS = ("coulomb_friction", "viscous_friction", "stribeck_friction", "quadratic_drag", "asymmetric_friction",
              "load_dependent_friction", "friction_drift", "hysteresis")  # fmt: skip
_APPLY: dict[str, Callable[[Arm, str, str, Numbers], Arm]] = {
    **dict.fromkeys(_FRICTIONS, _friction),
    "torque_offset": _offset,
    "torque_gain": _gain,
    "reflected_inertia": _drive("rotor_inertia", "Ia"),
    "backlash": _drive("gap", "b"),
    "joint_elasticity": _drive("stiffness", "K"),
    "parallel_spring": _spring,
    "torque_ripple": _ripple,
    "command_delay": _joint(T="delay"),
    "actuator_lag": _joint(T="lag"),
    "torque_saturation": _joint(limit="limit"),
    "controller_gain": _joint(dkp="dkp", dkd="dkd"),
    "transmission_coupling": _between,
    "crosstalk": _between,
    "payload": _payload,
    "link_inertia": _inertia,
    "base_tilt": _tilt,
    "encoder_offset": _joint(dq0="dq0"),
    "velocity_filter_lag": _joint(T="velocity_lag"),
    "clock_drift": _clock,
}
