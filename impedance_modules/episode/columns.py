# SPDX-License-Identifier: BSD-3-Clause
"""The one place that builds and reads the column names of an episode.

``time``; per joint ``position.<joint>`` [rad], ``velocity.<joint>`` [rad/s], ``effort_command.<joint>`` and
``effort.<joint>`` [N.m]; optional ``position_command.<joint>``, ``wrench.<frame>.fx`` ..., ``pose.<frame>.x``
..., ``target.<frame>.x`` ..., ``phase``, ``tank``, and anything else as an extra column. Joint and frame
names may contain dots: the kind is what stands before the first dot, a component what stands after the last.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from impedance_modules.errors import BadInput, printable

TIME = "time"
PHASE = "phase"
TANK = "tank"
JOINT_KINDS: tuple[str, ...] = ("position", "velocity", "effort_command", "effort", "position_command")
WRENCH_COMPONENTS: tuple[str, ...] = ("fx", "fy", "fz", "tx", "ty", "tz")
POSE_COMPONENTS: tuple[str, ...] = ("x", "y", "z", "qx", "qy", "qz", "qw")
FRAME_KINDS: Mapping[str, tuple[str, ...]] = {
    "wrench": WRENCH_COMPONENTS,
    "pose": POSE_COMPONENTS,
    "target": POSE_COMPONENTS,
}

HINGE = "hinge"
HINGE_COLUMNS: tuple[str, ...] = ("hinge.angle", "hinge.torque")
"""Of a held object's hinge: its measured angle [rad], and the torque of the hands about its axis [N.m]."""


def joint_column(kind: str, joint: str) -> str:
    """Returns e.g. ``effort.<joint>``; ``kind`` is one of `JOINT_KINDS`."""
    if kind not in JOINT_KINDS:
        raise BadInput(f"episode column: '{kind}' is not a joint quantity (valid: {', '.join(JOINT_KINDS)})")
    return f"{kind}.{joint}"


def joint_columns(kind: str, joints: Iterable[str]) -> tuple[str, ...]:
    """Returns one column name per joint, in the given order."""
    return tuple(joint_column(kind, joint) for joint in joints)


def wrench_columns(frame: str) -> tuple[str, ...]:
    """Returns the six columns of a wrench at ``frame``'s origin in world axes: force [N], torque [N.m]."""
    return tuple(f"wrench.{frame}.{component}" for component in WRENCH_COMPONENTS)


def pose_columns(frame: str) -> tuple[str, ...]:
    """Returns the seven columns of X_W<frame>: position [m], unit quaternion (x, y, z, w)."""
    return tuple(f"pose.{frame}.{component}" for component in POSE_COMPONENTS)


def target_columns(frame: str) -> tuple[str, ...]:
    """Returns the seven columns of a frame's equilibrium pose in world."""
    return tuple(f"target.{frame}.{component}" for component in POSE_COMPONENTS)


def set_point_columns(target: str) -> tuple[str, ...]:
    """Returns the columns of one target's set-points: whether they count, pose in world, stiffness, force.

    Stiffness [N/m, N.m/rad] and force [N, N.m] are along the spring's axes.
    """
    axes = ("x", "y", "z", "rx", "ry", "rz")
    parts = ("fresh", *POSE_COMPONENTS, *(f"stiffness.{a}" for a in axes), *(f"force.{a}" for a in axes))
    return tuple(f"set_point.{target}.{part}" for part in parts)


@dataclass(frozen=True)
class EpisodeColumns:
    """Column names sorted by what they mean.

    Attributes:
        joints: Kind -> joint -> column.
        frames: Kind (``wrench``, ``pose``, ``target``) -> frame -> one column per component, None where
            absent.
        extra: Columns of no known kind, in file order.
    """

    joints: Mapping[str, Mapping[str, str]]
    frames: Mapping[str, Mapping[str, tuple[str | None, ...]]]
    extra: tuple[str, ...]


def parse_columns(names: Sequence[str], place: str) -> EpisodeColumns:
    """Sorts column names by meaning.

    Args:
        names: Columns of one episode.
        place: File the names come from, for messages.

    Raises:
        BadInput: No ``time``, a name twice or with control characters, a joint column without a joint, or no
            ``position.<joint>`` at all.
    """
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise BadInput(f"{place}: column '{twice[0]}' occurs more than once (valid: each column once)")
    strange = next((name for name in names if printable(name) != name), None)
    if strange is not None:
        raise BadInput(f"{place}: column {strange[:60]!r} has control characters in its name (valid: none)")
    if TIME not in names:
        raise BadInput(f"{place}: no column 'time' (valid: 'time' in seconds; present: {_some(names)})")
    joints: dict[str, dict[str, str]] = {kind: {} for kind in JOINT_KINDS}
    parts: dict[str, dict[str, dict[str, str]]] = {kind: {} for kind in FRAME_KINDS}
    extra: list[str] = []
    for name in names:
        kind, _, rest = name.partition(".")
        frame, _, component = rest.rpartition(".")
        if kind in joints and rest:
            joints[kind][rest] = name
        elif kind in parts and frame and component in FRAME_KINDS[kind]:
            parts[kind].setdefault(frame, {})[component] = name
        elif name not in (TIME, PHASE, TANK):
            extra.append(name)
    if not joints["position"]:
        raise BadInput(f"{place}: no column 'position.<joint>' in rad (present: {_some(names)})")
    frames = {
        kind: {
            frame: tuple(found.get(component) for component in FRAME_KINDS[kind])
            for frame, found in parts[kind].items()
        }
        for kind in FRAME_KINDS
    }
    return EpisodeColumns(joints, frames, tuple(extra))


def _some(names: Sequence[str], most: int = 6) -> str:
    """Returns the first few names, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return (", ".join(names[:most]) or "none") + more
