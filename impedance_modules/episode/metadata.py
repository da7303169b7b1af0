# SPDX-License-Identifier: BSD-3-Clause
"""What an episode says about itself: one JSON object under the schema metadata key ``impedance_modules``."""

from __future__ import annotations

import importlib.metadata
import json
from collections.abc import Mapping
from typing import Any

from impedance_modules.episode.metadata_values import check_values, is_name
from impedance_modules.errors import BadInput, nearest
from impedance_modules.strict_json import parse_json

METADATA_KEY = "impedance_modules"
FORMAT = 1
LONGEST = 50_000_000
"""Bytes of metadata that are read."""
EFFORT_SOURCES: tuple[str, ...] = ("joint_sensor", "motor")
GRAVITY_COMPENSATIONS: tuple[str, ...] = ("robot", "command", "none")
LIBRARIES: tuple[str, ...] = ("impedance-modules", "pin", "coal", "numpy", "scipy", "pyarrow")


def episode_metadata(
    *,
    robot: str,
    episode: str,
    effort_source: str | None,
    gravity_compensation: str,
    repeat_of: str | None,
    task: str | None,
    **more: Any,
) -> dict[str, Any]:
    """Builds and checks the metadata of one episode.

    Args:
        robot: Name of the robot folder.
        episode: Name of this recording.
        effort_source: ``joint_sensor`` (between gearbox and link), ``motor`` (before rotor and friction), or
            None where no effort was measured.
        gravity_compensation: What compensates the arms' weight: ``robot``, ``command`` or ``none``.
        repeat_of: Name of the episode that this one repeats, or None.
        task: Full text of the task file, or None.
        **more: Further JSON values. The picture and the viewer use ``effort_max`` {joint: N.m},
            ``tank`` {"floor": J, "max": J} and ``limbs`` {limb: [joint, ...]} where given.

    Raises:
        BadInput: A value that the format does not allow.
    """
    metadata = {
        "format": FORMAT,
        "robot": robot,
        "episode": episode,
        "effort_source": effort_source,
        "gravity_compensation": gravity_compensation,
        "repeat_of": repeat_of,
        "task": task,
        **more,
    }
    check_metadata(metadata, "episode metadata", has_effort=False)
    return metadata


def library_versions(*more: str) -> dict[str, str]:
    """Returns the installed version of every library that a run's numbers depend on, and of others by name."""
    found = {}
    for name in (*LIBRARIES, *more):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue  # a checkout that was never installed has no version to tell
    return found


def encode_metadata(metadata: Mapping[str, Any], place: str) -> dict[bytes, bytes]:
    """Returns the metadata as Parquet keeps it.

    Raises:
        BadInput: A value that JSON cannot hold (an array, NaN ...).
    """
    try:
        text = json.dumps(dict(metadata), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise BadInput(
            f"{place}: metadata is not JSON: {error} (valid: text, finite numbers, lists)"
        ) from error
    return {METADATA_KEY.encode(): text.encode()}


def decode_metadata(raw: Mapping[bytes, bytes] | None, place: str, *, has_effort: bool) -> dict[str, Any]:
    """Returns the checked metadata of a file's schema.

    Args:
        raw: Schema metadata as Parquet keeps it.
        place: File, for messages.
        has_effort: The file has ``effort`` columns, so it must say where they were measured.

    Raises:
        BadInput: No metadata, not JSON, or a missing or wrong value.
    """
    text = (raw or {}).get(METADATA_KEY.encode())
    if text is None:
        raise BadInput(
            f"{place}: no schema metadata '{METADATA_KEY}', so robot and sensors are unknown"
            " (valid: an episode; 'impedance import' turns other logs into one)"
        )
    if len(text) > LONGEST:
        raise BadInput(f"{place}: metadata '{METADATA_KEY}' has {len(text)} bytes (valid: at most {LONGEST})")
    try:
        metadata = parse_json(text)
    except ValueError as error:
        raise BadInput(f"{place}: metadata '{METADATA_KEY}' is not JSON: {error}") from error
    if not isinstance(metadata, dict):
        raise BadInput(
            f"{place}: metadata '{METADATA_KEY}' is a {type(metadata).__name__} (valid: an object)"
        )
    check_metadata(metadata, place, has_effort=has_effort)
    check_values(metadata, place)
    return metadata


def check_metadata(metadata: Mapping[str, Any], place: str, *, has_effort: bool) -> None:
    """Refuses metadata that leaves open which robot moved or what its torque sensors measure.

    Raises:
        BadInput: With the first key that is missing or wrong.
    """
    if metadata.get("format") != FORMAT or isinstance(metadata.get("format"), bool):
        raise BadInput(f"{place}: metadata 'format' is {metadata.get('format')!r} (valid: {FORMAT})")
    for key in ("robot", "episode"):
        if not is_name(metadata.get(key)):
            raise BadInput(f"{place}: metadata '{key}' is {metadata.get(key)!r} (valid: a name, of one line)")
    _check_choice(metadata, "gravity_compensation", GRAVITY_COMPENSATIONS, place)
    if has_effort or metadata.get("effort_source") is not None:
        _check_choice(metadata, "effort_source", EFFORT_SOURCES, place)
    for key in ("repeat_of", "task"):
        if not isinstance(metadata.get(key), str | None):
            raise BadInput(f"{place}: metadata '{key}' is {metadata[key]!r} (valid: text or null)")


def _check_choice(metadata: Mapping[str, Any], key: str, valid: tuple[str, ...], place: str) -> None:
    value = metadata.get(key)
    if value not in valid:
        near = nearest(value, valid) if isinstance(value, str) else ""
        raise BadInput(f"{place}: metadata '{key}' is {value!r}{near} (valid: {', '.join(valid)})")
