# SPDX-License-Identifier: BSD-3-Clause
"""Writes the inputs that every search begins with: small ones of each kind, all of which are fine.

python -m tests.fuzz.seeds
"""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io
import yaml

from impedance_modules.episode.file_format import write_episode
from impedance_modules.episode.metadata import METADATA_KEY
from tests.export.test_mujoco_models import MODEL
from tests.fuzz.readers import CORPUS
from tests.support.effect_recordings import applied
from tests.support.import_logs import Bag, base_map, map_of, motion, position_map, table_log
from tests.support.log_metadata import log_metadata
from tests.support.paths import CHECKOUT, EVERY_KEY, PRESS_BOX, SIX_JOINT_PAIR

ROWS = 60
ARM = [f"right_{short}" for short in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")]


def place(reader: str, name: str, content: bytes | str) -> Path:
    path = CORPUS / reader / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def texts() -> None:
    for path in (PRESS_BOX, EVERY_KEY, CHECKOUT / "tasks" / "soft-hold.yaml"):
        place("task", path.name, path.read_bytes())
    place("robot", "six_joint_pair.yaml", (SIX_JOINT_PAIR / "robot.yaml").read_bytes())
    place("urdf", "six_joint_pair.urdf", (SIX_JOINT_PAIR / "six_joint_pair.urdf").read_bytes())
    place("urdf", "emps.urdf", (CHECKOUT / "tests" / "maps" / "emps.urdf").read_bytes())
    for name in ("emps-pulses.yaml", "emps.yaml", "tx40.yaml", "baxter-left-arm.yaml"):
        place("map", name, (CHECKOUT / "tests" / "maps" / name).read_bytes())
    place("map", "plain.yaml", yaml.safe_dump(base_map(), sort_keys=False))
    ratios = {"ratio": [10, 20], "coupling": {"a": {"b": 0.5}}}
    motors = {"columns": {"a": "q1", "b": "q2"}, "unit": "counts", "counts_per_rev": 4096, "side": "motor"}
    table = {"separator": "semicolon", "header": True, "skip_rows": 2, "comment": "#", "position": motors}
    place("map", "motors.yaml", yaml.safe_dump(map_of(table, rate=100, transmission=ratios), sort_keys=False))
    place("map", "positions.yaml", yaml.safe_dump(position_map(decimate={"keep_every": 2, "low_pass": 10})))
    place("sweep", "two.txt", "arms.right.springs.hand.stiffness.x=100:300:2\nsafety.tank.initial=4:6:2\n")
    place("sweep", "one.txt", "environment.0.height=-0.11:-0.1\n")


def patches() -> None:
    port, joint = "port_lift", {"joints": ["port_lift"]}
    about = {"format": 1, "robot": "six-joint-pair", "provenance": {"origin": "hand", "date": "2026-11-21"}}

    def number(value: float, unit: str) -> dict[str, object]:
        return {"value": value, "unit": unit}

    effects = [
        {
            "effect": "coulomb_friction",
            **joint,
            "port": "actuator",
            "parameters": {port: {"fc": number(1.0, "N.m")}},
        },
        {
            "effect": "encoder_offset",
            **joint,
            "port": "sensor",
            "parameters": {port: {"dq0": number(0.01, "rad")}},
        },
    ]
    payload = {
        "m": number(0.5, "kg"),
        "cx": number(0.0, "m"),
        "cy": number(0.0, "m"),
        "cz": number(0.05, "m"),
    }
    effects.append({"effect": "payload", "joints": [], "port": "link", "parameters": {"port_palm": payload}})
    place("patch", "three.yaml", yaml.safe_dump({**about, "effects": effects}, sort_keys=False))


def exports() -> None:
    """Patches that fit the two-arm robot's URDF and the tests' MuJoCo model, and that model."""
    link, sensor, actuator = "link", "sensor", "actuator"
    lean = applied("base_tilt", link, "base", rx=0.1, ry=0.2)
    bodies = [
        applied("payload", link, "port_flange", m=0.5, cx=0.1, cy=0.0, cz=0.2),
        applied("coulomb_friction", link, "port_lift", fc=1.0),
        applied("encoder_offset", sensor, "port_bend", dq0=0.1),
        applied("torque_saturation", actuator, "port_bend", limit=9.0),
    ]
    motors = [
        applied("payload", link, "upper", m=0.5, cx=0.1, cy=0.0, cz=0.2),
        applied("parallel_spring", link, "elbow", k=2.0, q0=0.1),
        applied("viscous_friction", link, "elbow", fv=2.0),
        applied("encoder_offset", sensor, "shoulder", dq0=0.1),
        applied("torque_gain", actuator, "shoulder", s=0.9),
        applied("torque_saturation", actuator, "shoulder", limit=3.0),
        applied("command_delay", "timing", "shoulder", T=0.01),
        applied("controller_gain", actuator, "elbow", dkp=3.0),
    ]
    about = {"format": 1, "robot": "six-joint-pair", "provenance": {"origin": "hand", "date": "2026-11-21"}}
    for name, entries in (("bodies.yaml", [*bodies, lean]), ("motors.yaml", [*motors, lean])):
        effects = [entry.entry() for entry in entries]
        place("patch", name, yaml.safe_dump({**about, "effects": effects}, sort_keys=False))
    place("mujoco", "arm.xml", MODEL.format(turned='quat="0.3 -0.5 0.7 0.2"'))
    place("mujoco", "turned.xml", MODEL.format(turned='xyaxes="1 0.2 -0.3 0.5 2 1"').replace("zyx", "XYZ"))


def recordings(folder: Path) -> None:
    time, q, v = motion(ROWS)
    place("csv", "log.csv", table_log(folder / "log.csv", time=time, q=q, v=v).read_bytes())
    columns = {"time": time, **{f"position.{n}": q[:, i] for i, n in enumerate("ab")}}
    columns |= {f"effort.{n}": v[:, i] for i, n in enumerate("ab")} | {"tank": time, "phase": ["hold"] * ROWS}
    said = log_metadata()
    place("parquet", "own.parquet", write_episode(folder / "own.parquet", columns, said).read_bytes())
    table = pa.table(columns).replace_schema_metadata({METADATA_KEY: json.dumps(said)})
    for name, how in (("stock", {}), ("plain", {"compression": "none", "use_dictionary": False})):
        pq.write_table(table, folder / name, **how)
        place("parquet", f"{name}.parquet", (folder / name).read_bytes())
    place("metadata", "log.json", json.dumps(said, indent=1))
    limits = {"effort_max": {"a": 10.0, "b": 5.0}, "tank": {"floor": 0.5, "max": 4.0, "initial": 1.0}}
    run = {
        "rate": 500.0,
        "scale": 1.0,
        "seed": 0,
        "arm": None,
        "arms": ["port"],
        "backend": "sim",
        "acting": [0.0] * 2,
    }
    more = {
        "limbs": {"port": ["a", "b"]},
        "versions": {"numpy": "2.2"},
        "joint_origins": {"a": [[0, 0, 0], [0, 0, 0]]},
    }
    task = {"task": "format: 1\nname: x\nrobot: baxter\n", "task_path": "x.yaml", "complete": True}
    place(
        "metadata",
        "run.json",
        json.dumps({**said, **limits, **run, **more, **task, "effects": None}, indent=1),
    )
    np.savez(folder / "log.npz", q=q)
    np.savez_compressed(folder / "small.npz", q=q, gain=np.array(2.0))
    scipy.io.savemat(folder / "log.mat", {"q": q, "s": {"t": time, "name": "log"}})
    scipy.io.savemat(folder / "small.mat", {"q": q, "gain": 2.0, "c": [[1, 2]]}, do_compression=True)
    scipy.io.savemat(folder / "old.mat", {"q": q, "gain": 2.0}, format="4")
    for name in ("log.npz", "small.npz", "log.mat", "small.mat", "old.mat"):
        place("mat", name, (folder / name).read_bytes())


def bags(folder: Path) -> None:
    time, q, v = motion(ROWS // 3, 7)
    bag = Bag()
    for t, position, velocity in zip(time, q, v, strict=True):
        bag.state("/robot/joint_states", t, ARM, position=position, velocity=velocity, effort=velocity)
    for kind in ("bag", "bag-lz4", "db3", "mcap", "mcap-zstd"):
        path = bag.write(folder / kind, kind)
        file = path if path.is_file() else next(path.glob("*.db3" if kind == "db3" else "*.mcap"))
        place("bag", f"{kind}{file.suffix}", file.read_bytes())


def main() -> None:
    texts()
    patches()
    exports()
    with tempfile.TemporaryDirectory() as name:
        recordings(Path(name))
        bags(Path(name))
    shutil.rmtree(CORPUS / "__pycache__", ignore_errors=True)


if __name__ == "__main__":
    main()
