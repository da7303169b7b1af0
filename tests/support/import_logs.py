# SPDX-License-Identifier: BSD-3-Clause
"""Small foreign logs for the import's tests: tables, maps, and bags of every kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from impedance_modules.episode.imports.pipeline import import_sources
from impedance_modules.episode.reader import read_episode

EPOCH = 1_700_000_000_000_000_000
STATE = "sensor_msgs/msg/JointState"
SEA = "maker_msgs/msg/SpringState"
SEA_DEFINITION = """
std_msgs/Header header
string[] name
float64[] commanded_effort
float64[] hysteresis_model_effort
"""


def motion(samples=400, joints=2, rate=100.0):
    """Time, positions and their true velocities: (N,), (N, n), (N, n)."""
    time = np.arange(samples) / rate
    pulse = 2 * np.pi * (0.3 + 0.2 * np.arange(joints))
    return time, 0.4 * np.sin(np.outer(time, pulse)), 0.4 * pulse * np.cos(np.outer(time, pulse))


def write_table(path, header, *columns, separator=",", form="%.9g"):
    values = np.column_stack(columns)
    with path.open("w") as stream:
        if header:
            stream.write(separator.join(header) + "\n")
        np.savetxt(stream, values, delimiter=separator, fmt=form)
    return path


COMMA = {"separator": "comma", "header": True}
TIME = {"column": "t", "unit": "s"}
POSITION = {"columns": "q{index}", "unit": "rad"}
VELOCITY = {"columns": "v{index}", "unit": "rad/s"}


def map_of(*tables, **more):
    """A map of two joints."""
    about = {"format": 1, "robot": "nobody", "joints": ["a", "b"], "gravity_compensation": "none"}
    return {**about, "tables": list(tables), **more}


def base_map(**more):
    """A map of two joints in a comma table: t, q1, q2, v1, v2."""
    return map_of({**COMMA, "time": TIME, "position": POSITION, "velocity": VELOCITY}, **more)


def position_map(**more):
    """A map of two joints in a comma table: t, q1, q2."""
    return map_of({**COMMA, "time": TIME, "position": POSITION}, **more)


def table_log(path, **change):
    """The table that `base_map` describes; ``change`` replaces ``time``, ``q`` or ``v``."""
    time, q, v = motion()
    time, q, v = change.get("time", time), change.get("q", q), change.get("v", v)
    return write_table(path, ["t", "q1", "q2", "v1", "v2"], time, q, v)


def write_map(path, data):
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return path


def imported(folder, sources, data=None, rate=None):
    """Imports into ``folder/out`` and reads the episodes back."""
    map_path = None if data is None else write_map(Path(folder) / "map.yaml", data)
    done = import_sources([Path(source) for source in sources], map_path, rate, Path(folder) / "out")
    return [read_episode(entry.path) for entry in done], done


class Bag:
    """Messages to be written as any kind of recording."""

    def __init__(self):
        self.messages = []

    def state(self, topic, stamp, names, *, received=None, **fields):
        """Adds a JointState; ``stamp`` in seconds after the epoch, None leaves the header empty."""
        moment = EPOCH + round(1e9 * (stamp if received is None else received))
        self.messages.append((topic, STATE, moment, stamp, names, fields))

    def springs(self, topic, stamp, names, **fields):
        """Adds a message of a maker's own type."""
        self.messages.append((topic, SEA, EPOCH + round(1e9 * stamp), stamp, names, fields))

    def write(self, path, kind):
        """Writes ``bag``, ``bag-lz4``, ``bag-bz2``, ``db3``, ``mcap`` or ``mcap-zstd``; returns the path to import."""
        ros1 = kind.startswith("bag")
        store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        store.register(get_types_from_msg(SEA_DEFINITION, SEA))
        path = path.with_suffix(".bag") if ros1 else path
        plugin = StoragePlugin.SQLITE3 if kind == "db3" else StoragePlugin.MCAP
        writer = Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=plugin)
        if kind in ("bag-lz4", "bag-bz2"):
            writer.set_compression(Writer1.CompressionFormat[kind.removeprefix("bag-").upper()])
        if kind == "mcap-zstd":
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            kinds = dict.fromkeys((topic, msgtype) for topic, msgtype, *_ in self.messages)
            topics = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in kinds}
            for topic, msgtype, moment, stamp, names, fields in sorted(self.messages, key=lambda m: m[2]):
                message = _message(store, msgtype, stamp, names, fields, ros1)
                serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
                writer.write(topics[topic], moment, serialize(message, msgtype))
        return path


def _message(store, msgtype, stamp, names, fields, ros1):
    moment = 0 if stamp is None else EPOCH + round(1e9 * stamp)
    time = store.types["builtin_interfaces/msg/Time"](sec=moment // 10**9, nanosec=moment % 10**9)
    header = store.types["std_msgs/msg/Header"](stamp=time, frame_id="", **({"seq": 0} if ros1 else {}))
    empty = ("position", "velocity", "effort") if msgtype == STATE else ()
    numbers = {key: np.array(fields.get(key, ()), dtype=float) for key in (*empty, *fields)}
    return store.types[msgtype](header=header, name=list(names), **numbers)
