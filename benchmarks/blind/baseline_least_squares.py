# SPDX-License-Identifier: BSD-3-Clause
"""Baseline: ordinary least squares with friction, armature and offset; the cause is the largest t.

What the textbooks of identification offer: tau_residual = fc sgn v + fv v + Ia a + c per joint, on both torque
ports, one pooled error variance, |t| above the quantile that a whole table of coefficients would ask for.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from benchmarks.blind.arm_model import read_arm, read_drive
from benchmarks.blind.logs import read_log
from benchmarks.blind.plant import rigid_model
from benchmarks.blind.residual import CUT, FEW, low_pass, residual

Array = NDArray[np.float64]

EFFECTS = (
    ("coulomb_friction", "fc", "N.m"),
    ("viscous_friction", "fv", "N.m.s/rad"),
    ("reflected_inertia", "Ia", "kg.m^2"),
    ("torque_offset", "c", "N.m"),
)
PORTS = ("actuator", "link")
LEVEL = 0.01
"""Chance of a false alarm in the whole table."""


@dataclass(frozen=True)
class Coefficient:
    """One fitted number with its error."""

    effect: int
    joint: int
    port: int
    value: float
    error: float

    @property
    def t(self) -> float:
        """Number of standard errors from zero."""
        return abs(self.value) / self.error


@click.command()
@click.argument("answer", type=click.Path(path_type=Path))
@click.argument("logs", nargs=-1, type=click.Path(path_type=Path))
@click.option("--holdout", multiple=True, type=click.Path(path_type=Path))
def main(answer: Path, logs: tuple[Path, ...], holdout: tuple[Path, ...]) -> None:  # noqa: ARG001
    """Fits all logs and writes the answer."""
    columns = [read_log(path) for path in logs]
    side = columns[0].side
    drive, model = read_drive(side), rigid_model(read_arm(side), side)
    torques = np.concatenate([residual(one.channels, drive, model)[:2] for one in columns], axis=1)
    motion = [_motion(one.channels) for one in columns]
    v, a = (np.concatenate([part[i] for part in motion]) for i in (0, 1))
    found = [
        c for joint in range(v.shape[1]) for port in (0, 1) for c in _fit(torques[port], v, a, joint, port)
    ]
    answer.write_text(json.dumps(_report(found, drive.joints, drive.rotor_inertia, len(v))))


def _fit(torque: Array, v: Array, a: Array, joint: int, port: int) -> list[Coefficient]:
    table = np.stack([np.tanh(v[:, joint] / 0.01), v[:, joint], a[:, joint], np.ones(len(v))], axis=1)
    value, *_ = np.linalg.lstsq(table, torque[:, joint], rcond=None)
    left = torque[:, joint] - table @ value
    spread = float(left @ left) / (len(v) - table.shape[1])
    error = np.sqrt(spread * np.diag(np.linalg.inv(table.T @ table)))
    return [Coefficient(k, joint, port, float(value[k]), float(error[k])) for k in range(len(EFFECTS))]


def _report(
    found: list[Coefficient], joints: tuple[str, ...], rotors: Array, samples: int
) -> dict[str, object]:
    limit = float(stats.t.ppf(1 - LEVEL / (2 * len(found)), samples - len(EFFECTS)))
    sure = sorted((c for c in found if c.t > limit), key=lambda c: -c.t)
    causes = []
    for c in sure[:3]:
        effect, symbol, unit = EFFECTS[c.effect]
        value = rotors[c.joint] + c.value if effect == "reflected_inertia" else c.value
        quantity = {"value": value, "std": c.error, "unit": unit}
        parameters = {joints[c.joint]: {symbol: quantity}}
        cause = {
            "effect": effect,
            "joints": [joints[c.joint]],
            "port": PORTS[c.port],
            "parameters": parameters,
        }
        causes.append(cause | {"equivalent": []})
    return {"format": 1, "verdict": "explained" if causes else "no_gap", "causes": causes}


def _motion(channels: dict[str, Array]) -> tuple[Array, Array]:
    q, period = low_pass(channels["position"]), float(np.median(np.diff(channels["time"])))
    v = np.gradient(q, period, axis=0)
    return v[CUT:-CUT:FEW], np.gradient(v, period, axis=0)[CUT:-CUT:FEW]


if __name__ == "__main__":
    main()
