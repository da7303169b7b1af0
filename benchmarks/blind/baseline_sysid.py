# SPDX-License-Identifier: BSD-3-Clause
"""Baseline: MuJoCo's own system identification toolbox; the cause is the largest change over its interval.

A rigid arm with armature, damping and dry friction of every joint, gain of every motor and the mass in the
hand, fitted to positions and velocities over short rollouts that start at measured states. The torque is what
the robot sends: command a delay ago plus its compensation of the weight. The toolbox's own 95 % intervals
decide what has changed.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from pathlib import Path

import click
import mujoco
import numpy as np
from mujoco import sysid
from numpy.typing import NDArray

from benchmarks.blind.arm_model import GRAVITY, Drive, hand_of, read_arm, read_drive, write_mjcf
from benchmarks.blind.excitation import inverse_dynamics
from benchmarks.blind.logs import Log, read_log
from benchmarks.blind.plant import rigid_model
from benchmarks.blind.residual import low_pass

Array = NDArray[np.float64]

WINDOW = 50
"""Samples of a rollout: half a second."""
WINDOWS = 6
"""Rollouts per log."""
VELOCITY_WEIGHT = 0.05
"""What a rad/s counts against a rad: about the ratio of their noises."""
SYMBOLS = {
    "armature": ("reflected_inertia", "Ia", "kg.m^2", "actuator"),
    "damping": ("viscous_friction", "fv", "N.m.s/rad", "actuator"),
    "frictionloss": ("coulomb_friction", "fc", "N.m", "actuator"),
    "gain": ("torque_gain", "s", "1", "actuator"),
    "mass": ("payload", "m", "kg", "link"),
}


@click.command()
@click.argument("answer", type=click.Path(path_type=Path))
@click.argument("logs", nargs=-1, type=click.Path(path_type=Path))
@click.option("--holdout", multiple=True, type=click.Path(path_type=Path))
def main(answer: Path, logs: tuple[Path, ...], holdout: tuple[Path, ...]) -> None:  # noqa: ARG001
    """Fits all logs and writes the answer."""
    logging.disable(logging.CRITICAL)
    read = [read_log(path) for path in logs]
    side = read[0].side
    drive = read_drive(side)
    spec = mujoco.MjSpec.from_string(_model(side, drive))
    parameters = _parameters(spec, drive, hand_of(side))
    sequences = _sequences(spec, read, drive, rigid_model(read_arm(side), side))
    residuals = sysid.build_residual_fn(models_sequences=[sequences], sensor_weights=_weights(drive))
    believed = np.array(
        [
            0.0 if name.startswith("frictionloss") else parameters[name].value[0]
            for name in list(parameters.keys())
        ]
    )
    fitted, result = sysid.optimize(
        initial_params=parameters, residual_fn=residuals, verbose=False, max_iters=6
    )
    left, *_ = residuals(result.x, fitted)
    _, intervals = sysid.calculate_intervals([np.ravel(one) for one in left], result.jac)
    answer.write_text(json.dumps(_report(list(fitted.keys()), believed, result.x, intervals, drive)))


def _model(side: str, drive: Drive) -> str:
    """Returns the rigid arm with motors, rotor inertia and the sensors that the log has."""
    text = write_mjcf(read_arm(side), None, np.array([0.0, 0.0, -GRAVITY]), hand_of(side))
    motors = "".join(f'<motor name="{name}" joint="{name}"/>' for name in drive.joints)
    sensors = "".join(
        f'<jointpos name="p_{n}" joint="{n}"/><jointvel name="v_{n}" joint="{n}"/>' for n in drive.joints
    )
    text = text.replace("</mujoco>", f"<actuator>{motors}</actuator><sensor>{sensors}</sensor></mujoco>")
    return text.replace('timestep="0.0005"', 'timestep="0.002"')


def _parameters(spec: mujoco.MjSpec, drive: Drive, hand: str) -> sysid.ParameterDict:
    """Returns what is fitted, at its nominal values."""
    found = sysid.ParameterDict()
    for i, name in enumerate(drive.joints):
        rotor, drag = float(drive.rotor_inertia[i]), float(drive.motor_damping[i])
        for key, nominal, low, high in (
            ("armature", rotor, 0.05 * rotor, 4 * rotor),
            ("damping", drag, 0.0, 20.0),
            ("frictionloss", 0.02, 0.0, 15.0),
        ):
            found.add(sysid.Parameter(f"{key}:{name}", nominal, low, high, modifier=_set_joint(name, key)))
        found.add(sysid.Parameter(f"gain:{name}", 1.0, 0.3, 2.0, modifier=_set_gear(name)))
    mass = float(spec.body(hand).mass)
    found.add(sysid.Parameter(f"mass:{hand}", mass, 0.5 * mass, mass + 3.0, modifier=_set_mass(hand)))
    return found


Modifier = Callable[[mujoco.MjSpec, sysid.Parameter], None]


def _set_joint(name: str, key: str) -> Modifier:
    def put(spec: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
        joint = spec.joint(name)
        if key == "damping":
            joint.damping = np.array([parameter.value[0], *np.ravel(joint.damping)[1:]])
        else:
            setattr(joint, key, parameter.value[0])

    return put


def _set_gear(name: str) -> Modifier:
    def put(spec: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
        gear = np.array(spec.actuator(name).gear)
        gear[0] = parameter.value[0]
        spec.actuator(name).gear = gear

    return put


def _set_mass(hand: str) -> Modifier:
    def put(spec: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
        spec.body(hand).mass = parameter.value[0]

    return put


def _sequences(
    spec: mujoco.MjSpec, logs: list[Log], drive: Drive, model: mujoco.MjModel
) -> sysid.ModelSequences:
    compiled = spec.compile()
    names, starts, controls, sensors = [], [], [], []
    for i, log in enumerate(logs):
        time, q = log.channels["time"], log.channels["position"]
        smooth = low_pass(q)
        v = np.gradient(smooth, time, axis=0)
        weight = inverse_dynamics(model, q, 0 * q, 0 * q)
        torque = weight + _delayed(log.channels["effort_command"], time, drive.command_delay)
        seen = np.stack([q, v], axis=2).reshape(len(q), -1)
        for k in np.linspace(50, len(time) - WINDOW - 50, WINDOWS).astype(int):
            part = slice(k, k + WINDOW)
            clock = time[part] - time[k]
            names.append(f"{i}_{k}")
            starts.append(sysid.create_initial_state(compiled, smooth[k], v[k]))
            controls.append(sysid.TimeSeries(clock, torque[part]))
            sensors.append(sysid.TimeSeries.from_names(clock, seen[part], compiled))
    return sysid.ModelSequences("arm", spec, names, starts, controls, sensors)


def _weights(drive: Drive) -> dict[str, float]:
    return {f"v_{name}": VELOCITY_WEIGHT for name in drive.joints} | {
        f"p_{name}": 1.0 for name in drive.joints
    }


def _delayed(values: Array, time: Array, delay: float) -> Array:
    return np.stack([np.interp(time - delay, time, column) for column in values.T], axis=1)


def _report(names: list[str], start: Array, end: Array, half: Array, drive: Drive) -> dict[str, object]:
    """Names the parameters whose interval misses the nominal value, most changed first."""
    order = sorted(range(len(names)), key=lambda i: -abs(end[i] - start[i]) / half[i])
    causes = []
    for i in [i for i in order if abs(end[i] - start[i]) > half[i]][:3]:
        kind, owner = names[i].split(":")
        effect, symbol, unit, port = SYMBOLS[kind]
        value = end[i] - start[i] if kind in ("damping", "mass") else end[i]
        quantity = {"value": float(value), "std": float(half[i]) / 1.96, "unit": unit}
        joints = [owner] if owner in drive.joints else [drive.joints[-1]]
        cause = {"effect": effect, "joints": joints, "port": port, "parameters": {owner: {symbol: quantity}}}
        causes.append(cause | {"equivalent": []})
    return {"format": 1, "verdict": "explained" if causes else "no_gap", "causes": causes}


if __name__ == "__main__":
    main()
