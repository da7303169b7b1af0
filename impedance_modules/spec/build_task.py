# SPDX-License-Identifier: BSD-3-Clause
"""From clean plain data to the frozen parts of a TaskSpec. Nothing is checked here, nothing can fail.

Every rule for a key that is left out stands in ``schemas/task.schema.json`` and is carried out here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from impedance_modules.spec.gripper_spec import GripperCondition, build_gripper_order
from impedance_modules.spec.hinge_spec import ANGLE, build_hinge
from impedance_modules.spec.path_spec import PATH, build_path
from impedance_modules.spec.submovement_spec import SUBMOVEMENTS, build_submovements
from impedance_modules.spec.task import (
    AXES,
    WORLD,
    ContactCondition,
    Coordinate,
    HandPosture,
    HybridAxis,
    JointBiasSpec,
    Matrix,
    ObjectSpec,
    PhaseSpec,
    PushSpec,
    ReachedCondition,
    RoughnessSpec,
    SheetSpec,
    Sine,
    SmoothCondition,
    SplintersSpec,
    SpringSpec,
    SurfaceSpec,
    TankSpec,
    TaskPlayback,
    WoodSpec,
)

Raw = Mapping[str, Any]


def build_matrix(raw: Any) -> Matrix:
    """Makes a (6, 6) matrix, linear then angular, of a mapping by axis or of six rows.

    An axis that a mapping leaves out is 0. The array is read-only.
    """
    if isinstance(raw, dict):
        matrix = np.diag([float(raw.get(axis, 0.0)) for axis in AXES])
    else:
        matrix = np.array(raw, dtype=np.float64)
    matrix.setflags(write=False)
    return matrix


def build_axes(raw: Raw) -> Mapping[str, HybridAxis]:
    """Makes hybrid axes by axis name [N], [N.m], [m/s], [rad/s]."""
    return {
        axis: HybridAxis(float(given["force"]), _number(given, "speed_limit")) for axis, given in raw.items()
    }


def build_spring(raw: Raw) -> SpringSpec:
    """Makes one spring."""
    return SpringSpec(
        name=raw["name"],
        frame=raw["frame"],
        expressed_in=raw["expressed_in"],
        stiffness=build_matrix(raw["stiffness"]),
        damping=build_matrix(raw["damping"]) if "damping" in raw else None,
        damping_ratio=_number(raw, "damping_ratio"),
        axes=build_axes(raw.get("axes", {})),
        damping_against=raw.get("damping_against", WORLD),
    )


def build_joint_bias(raw: Raw) -> JointBiasSpec:
    """Makes a joint bias [N.m/rad], [N.m.s/rad]."""
    return JointBiasSpec(
        stiffness=build_numbers(raw["stiffness"]),
        damping=build_numbers(raw["damping"]) if "damping" in raw else None,
        damping_ratio=_number(raw, "damping_ratio"),
        damping_against=raw.get("damping_against", WORLD),
    )


def build_hand_posture(raw: Raw) -> HandPosture:
    """Makes a posture by the hand's pose [m], [rad]."""
    hand = raw["hand"]
    turned = any(axis in hand for axis in ("rx", "ry", "rz"))
    turn = (float(hand.get("rx", 0.0)), float(hand.get("ry", 0.0)), float(hand.get("rz", 0.0)))
    place = (float(hand["x"]), float(hand["y"]), float(hand["z"]))
    return HandPosture(place, turn if turned else None, _number(raw, "elbow"))


def build_numbers(raw: Raw) -> Mapping[str, float]:
    """Makes a read-only mapping of floats."""
    return {name: float(value) for name, value in raw.items()}


def build_object(raw: Raw) -> ObjectSpec:
    """Makes the held object."""
    return ObjectSpec(
        held_by=tuple(raw["held_by"]),
        shape=raw["shape"],
        mass=float(raw["mass"]),
        size=tuple(float(length) for length in raw["size"]),
        position=_triple(raw["position"]) if "position" in raw else None,
        grasp=raw.get("grasp", "weld"),
        friction=_number(raw, "friction"),
        squeeze=float(raw["squeeze"]["force"]) if "squeeze" in raw else 0.0,
        carry_weight=raw.get("carry_weight", False),
        hinge=build_hinge(raw["hinge"]) if "hinge" in raw else None,
    )


def build_tank(raw: Raw) -> TankSpec:
    """Makes the energy tank [J]."""
    return TankSpec(initial=float(raw["initial"]), max=float(raw["max"]), floor=float(raw["floor"]))


def build_surface(raw: Raw) -> SurfaceSpec:
    """Makes one surface of the plant; a mesh is still without its triangles, which are in another file."""
    return SurfaceSpec(
        surface=raw["surface"],
        height=_number(raw, "height"),
        position=_triple(raw["position"]) if "position" in raw else None,
        rotation=_triple(raw.get("rotation", (0.0, 0.0, 0.0))),
        size=tuple(float(length) for length in raw["size"]) if "size" in raw else None,
        stiffness=float(raw["stiffness"]),
        damping=float(raw["damping"]),
        friction=float(raw["friction"]),
        wood=build_wood(raw["wood"]) if "wood" in raw else None,
        sheet=_sheet(raw) if raw["surface"] == "sheet" else None,
        radii=(float(raw["radii"][0]), float(raw["radii"][1])) if "radii" in raw else None,
    )


def build_scale(raw: Raw) -> float:
    """Gives the metres per unit of a mesh's file."""
    return float(raw.get("scale", 1.0))


def _sheet(raw: Raw) -> SheetSpec:
    """Makes what a sheet has beyond other surfaces [m], [N.m^2]."""
    return SheetSpec(
        supports=tuple((float(support["at"]), float(support["height"])) for support in raw["supports"]),
        width=float(raw["width"]),
        bending_stiffness=float(raw["bending_stiffness"]),
    )


def build_wood(raw: Raw) -> WoodSpec:
    """Makes the wood of one surface from clean plain data."""
    roughness, splinters = raw.get("roughness"), raw.get("splinters")
    return WoodSpec(
        seed=int(raw["seed"]),
        roughness=None
        if roughness is None
        else RoughnessSpec(
            **{name: float(roughness[name]) for name in ("height", "wavelength", "friction", "wear")}
        ),
        splinters=None
        if splinters is None
        else SplintersSpec(
            density=float(splinters["density"]),
            force=(float(splinters["force"][0]), float(splinters["force"][1])),
            endurance=float(splinters["endurance"]),
            reach=float(splinters["reach"]),
        ),
    )


def build_playback(raw: Raw) -> TaskPlayback:
    """Makes the robot's own playback."""
    return TaskPlayback(
        mode=raw["mode"], taught_on=tuple(build_surface(surface) for surface in raw["taught_on"])
    )


def build_push(raw: Raw) -> PushSpec:
    """Makes one push on the plant [N], [N.m], [s]."""
    x, y, z, rx, ry, rz = (float(raw["wrench"].get(axis, 0.0)) for axis in AXES)
    return PushSpec(
        target=raw["target"],
        wrench=(x, y, z, rx, ry, rz),
        start=float(raw["start"]),
        rise=float(raw.get("rise", 0.0)),
        hold=float(raw["hold"]),
        fall=float(raw.get("fall", 0.0)),
    )


def build_phase(raw: Raw, listened: tuple[str, ...] = ()) -> PhaseSpec:
    """Makes one phase; ``listened`` are the targets that set-points move where a phase listens."""
    return PhaseSpec(
        name=raw["name"],
        duration=float(raw["duration"]),
        equilibrium={target: _coordinates(given) for target, given in raw.get("equilibrium", {}).items()},
        posture={arm: build_numbers(given) for arm, given in raw.get("posture", {}).items()},
        axes={target: build_axes(given) for target, given in raw.get("axes", {}).items()},
        stiffness={target: build_matrix(given) for target, given in raw.get("stiffness", {}).items()},
        until=_until(raw["until"]) if "until" in raw else None,
        otherwise=raw.get("otherwise", "stop"),
        blend=_number(raw, "blend"),
        listen=listened if raw.get("listen", False) else (),
        beyond_reach=raw.get("beyond_reach", False),
        submovements={
            target: build_submovements(given[SUBMOVEMENTS])
            for target, given in raw.get("equilibrium", {}).items()
            if SUBMOVEMENTS in given
        },
        grippers={arm: build_gripper_order(given) for arm, given in raw.get("grippers", {}).items()},
        paths={
            target: build_path(given[PATH])
            for target, given in raw.get("equilibrium", {}).items()
            if PATH in given
        },
    )


def _coordinates(raw: Raw) -> Mapping[str, Coordinate]:
    return {axis: _coordinate(given) for axis, given in raw.items() if axis in (*AXES, ANGLE)}


def _coordinate(raw: Any) -> Coordinate:
    if not isinstance(raw, dict):
        return float(raw)
    sine = raw["sine"]
    return Sine(float(sine["amplitude"]), float(sine["frequency"]), _number(sine, "center"))


def _until(raw: Raw) -> ContactCondition | ReachedCondition | SmoothCondition | GripperCondition:
    if "gripper" in raw:
        return GripperCondition(dict(raw["gripper"]))
    if "smooth" in raw:
        smooth = raw["smooth"]
        return SmoothCondition(
            target=smooth["target"],
            along=smooth["along"],
            normal=smooth.get("normal", "z"),
            by=smooth["by"],
            below=float(smooth["below"]),
            windows=int(smooth["windows"]),
            friction_below=_number(smooth, "friction_below"),
        )
    if "reached" in raw:
        return ReachedCondition(float(raw["reached"]["distance"]), float(raw["reached"]["angle"]))
    contact = raw["contact"]
    if isinstance(contact, bool):
        return ContactCondition(present=contact, force=None, time=None, target=None)
    return ContactCondition(
        present=contact.get("present", True),
        force=_number(contact, "force"),
        time=_number(contact, "time"),
        target=contact.get("target"),
    )


def _number(raw: Raw, key: str) -> float | None:
    return float(raw[key]) if key in raw else None


def _triple(raw: Any) -> tuple[float, float, float]:
    first, second, third = (float(value) for value in raw)
    return first, second, third
