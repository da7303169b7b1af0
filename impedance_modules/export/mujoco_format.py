# SPDX-License-Identifier: BSD-3-Clause
r"""A patch in a MuJoCo model, joint by joint and body by body.

MuJoCo's joint with one axis obeys

    (M + armature) a + h(q, v) = qfrc_actuator - frictionloss sgn(v) - d_0 v - d_1 v|v| - k (q - springref)

with qfrc_actuator clipped to actuatorfrcrange, d_0 and d_1 the first two numbers of ``damping``, and sgn(v) by a
constraint instead of by tanh(v / v_0). What is written stands in the element itself and overrules its default class.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np

from impedance_modules.effects.simulator_numbers import Amount
from impedance_modules.export.carrier import Carrier, Format, NotCarried
from impedance_modules.export.edited_xml import numbers
from impedance_modules.export.mujoco_bodies import change_body, lean_base
from impedance_modules.export.mujoco_model import MujocoDescription, read_model

UNLIMITED = (-math.inf, math.inf)

TIME_STEP = 0.002
"""Of a model that does not say [s]."""


def add_friction(model: MujocoDescription, amount: Amount) -> None:
    """Adds F to a joint's dry friction [N.m]."""
    _refuse_switched_off(model, "frictionloss", "constraint")
    joint = model.joints[amount.key]
    model.set_number(
        joint, "frictionloss", float(model.numbers(joint, "frictionloss", (0.0,))[0]) + amount.numbers[0]
    )


def add_damping(model: MujocoDescription, amount: Amount) -> None:
    """Adds D to the damping that is linear in the speed [N.m.s/rad]."""
    _add_to_damping(model, amount, 0)


def add_drag(model: MujocoDescription, amount: Amount) -> None:
    """Adds C to the damping that grows with the square of the speed [N.m.s^2/rad^2]."""
    _add_to_damping(model, amount, 1)


def _add_to_damping(model: MujocoDescription, amount: Amount, power: int) -> None:
    joint = _passive_joint(model, amount.key, "damper")
    before = model.numbers(joint, "damping", (0.0,))
    after = np.zeros(max(before.size, power + 1))
    after[: before.size] = before
    after[power] += amount.numbers[0]
    joint.set("damping", numbers(after))


def replace_rotor(model: MujocoDescription, amount: Amount) -> None:
    """Replaces a joint's armature [kg.m^2]."""
    for element in model.acting_on(amount.key):
        if np.any(model.numbers(element, "armature", (0.0,))):
            raise NotCarried(
                f"line {model.faults.lines[element]}: the actuator of '{amount.key}' has an armature of its own,"
                " which adds to the joint's (valid: the joint's armature alone)"
            )
    model.set_number(model.joints[amount.key], "armature", amount.numbers[0])


def add_spring(model: MujocoDescription, amount: Amount) -> None:
    r"""Adds a spring to a joint's own: k = k_1 + k_2, springref = (k_1 springref_1 + preload_2) / k."""
    joint, unit = _passive_joint(model, amount.key, "spring"), model.angle_unit(model.joints[amount.key])
    own, stiffness, preload = model.numbers(joint, "stiffness", (0.0,)), *amount.numbers
    if np.any(own[1:]) or model.value(joint, "springyield") is not None:
        raise NotCarried(f"the joint '{amount.key}' has a spring of its own that is not linear")
    total = float(own[0]) + stiffness
    pull = float(own[0]) * unit * float(model.numbers(joint, "springref", (0.0,))[0]) + preload
    if total == 0.0:
        if pull != 0.0:
            raise NotCarried("a spring without stiffness that pulls would be a constant torque")
        return
    model.set_number(joint, "stiffness", total)
    model.set_number(joint, "springref", pull / total / unit)


def limit_torque(model: MujocoDescription, amount: Amount) -> None:
    """Clips all that actuators give to a joint: actuatorfrcrange within -L and L [N.m]."""
    joint, limit = model.joints[amount.key], amount.numbers[0]
    model.driving(amount.key)
    _refuse_switched_off(model, "actuation")
    lower, upper = _force_range(model, joint)
    lower, upper = max(lower, -limit), min(upper, limit)
    if lower >= upper:
        raise NotCarried(f"MuJoCo's limits leave some room between them, here {lower:g} to {upper:g} N.m")
    joint.set("actuatorfrcrange", numbers((lower, upper)))
    if model.setting("compiler", "autolimits") == "false" or model.value(joint, "actuatorfrclimited"):
        joint.set("actuatorfrclimited", "true")


def _force_range(model: MujocoDescription, joint: ET.Element) -> tuple[float, float]:
    """Gives the range to which actuator forces on a joint are clipped; infinite where they are not."""
    limited = model.value(joint, "actuatorfrclimited") or "auto"
    by_hand = model.setting("compiler", "autolimits") == "false"
    found = model.numbers(joint, "actuatorfrcrange", UNLIMITED)
    if limited == "false" or (limited == "auto" and by_hand) or found.size != 2:
        return UNLIMITED
    return float(found[0]), float(found[1])


def scale_drive(model: MujocoDescription, amount: Amount) -> None:
    """Multiplies what all actuators of a joint give by s, after every clip: gains and force ranges."""
    gain, joint = amount.numbers[0], model.joints[amount.key]
    for element in model.actuators(amount.key):
        _scale_actuator(model, element, gain)
    lower, upper = _force_range(model, joint)
    if math.isfinite(lower) and math.isfinite(upper):
        joint.set("actuatorfrcrange", numbers((gain * lower, gain * upper)))


def _scale_actuator(model: MujocoDescription, element: ET.Element, gain: float) -> None:
    kept = ("armature", "damping") if element.tag == "motor" else ("dampratio",)
    for key in kept:
        if np.any(model.numbers(element, key, (0.0,))):
            raise NotCarried(
                f"line {model.faults.lines[element]}: the <{element.tag}> has a '{key}', which must not scale"
            )
    if element.tag == "motor":  # its gain is 1; gear comes behind its force range
        element.set("gear", numbers(gain * model.numbers(element, "gear", (1.0,))))
        return
    _refuse_unusual_force(model, element)
    scaled = {"general": {"gainprm": (1.0,), "biasprm": ()}, "position": {"kp": (1.0,), "kv": ()}}
    for key, default in scaled.get(element.tag, {"kv": (1.0,)}).items():
        if default or model.holder(element, key) is not None:
            element.set(key, numbers(gain * model.numbers(element, key, default)))
    if model.holder(element, "forcerange") is not None:
        element.set("forcerange", numbers(gain * model.numbers(element, "forcerange", UNLIMITED)))


def _refuse_unusual_force(model: MujocoDescription, element: ET.Element) -> None:
    for key, valid in (("gaintype", ("fixed", "affine")), ("biastype", ("none", "affine"))):
        found = model.value(element, key) or valid[0]
        if found not in valid:
            raise NotCarried(
                f"line {model.faults.lines[element]}: the actuator has {key} '{found}' (valid: {', '.join(valid)})"
            )


def _open_loop(model: MujocoDescription, joint: str) -> list[ET.Element]:
    """Finds a joint's actuators, whose torque must be a number times the control."""
    found = model.actuators(joint)
    for element in found:
        bias = model.value(element, "biastype") or "none"
        gain = model.value(element, "gaintype") or "fixed"
        if element.tag not in ("motor", "general") or bias != "none" or gain != "fixed":
            raise NotCarried(
                f"line {model.faults.lines[element]}: '{joint}' is driven by a loop that closes in the actuator,"
                " behind what comes late (valid: <motor>, or <general> without bias)"
            )
    return found


def add_lag(model: MujocoDescription, amount: Amount) -> None:
    r"""Lets an actuator's force follow its control: dyntype "filterexact", T_1 \dot{act} = ctrl - act."""
    for element in _open_loop(model, amount.key):
        if element.tag == "motor" or (model.value(element, "dyntype") or "none") != "none":
            words = "a <motor>, which has no activation" if element.tag == "motor" else "one with a dyntype"
            raise NotCarried(
                f"line {model.faults.lines[element]}: the actuator of '{amount.key}' is {words}"
                " (valid: <general> without dyntype)"
            )
        if amount.numbers[0] > 0.0:
            element.set("dyntype", "filterexact")
            model.set_number(element, "dynprm", amount.numbers[0])


def delay_command(model: MujocoDescription, amount: Amount) -> None:
    """Delays an actuator's control by T more [s]; its history must reach back as far, in time steps."""
    step = _time_step(model)
    for element in _open_loop(model, amount.key):
        delay = float(model.numbers(element, "delay", (0.0,))[0]) + amount.numbers[0]
        samples = max(int(model.numbers(element, "nsample", (0.0,))[0]), math.ceil(delay / step) + 1)
        if amount.numbers[0] > 0.0:
            model.set_number(element, "delay", delay)
            element.set("nsample", str(samples))


def _time_step(model: MujocoDescription) -> float:
    """Gives the model's time step [s]; one that is not above 0 is a fault of the file."""
    option = model.section("option", "timestep")
    step = TIME_STEP if option is None else float(model.numbers(option, "timestep", (TIME_STEP,))[0])
    if option is not None and step <= 0.0:
        model.faults.add(option, f"<option> has 'timestep' {step:g} (valid: above 0)")
    return step if step > 0.0 else TIME_STEP


def change_servo(model: MujocoDescription, amount: Amount) -> None:
    """Adds K_p / gear^2 to the stiffness of a joint's position servo."""
    stiffness, damping = amount.numbers
    servos = model.actuators(amount.key)
    if len(servos) != 1 or servos[0].tag != "position":
        raise NotCarried(f"'{amount.key}' is not driven by one <position> actuator, whose kp it would change")
    servo = servos[0]
    if damping != 0.0:
        raise NotCarried(
            "a <position> actuator knows no commanded speed that K_d could act on (valid: K_d = 0)"
        )
    if np.any(model.numbers(servo, "dampratio", (0.0,))):
        raise NotCarried(
            f"line {model.faults.lines[servo]}: the damping of <position> follows its kp (dampratio)"
        )
    square = float(model.numbers(servo, "gear", (1.0,))[0]) ** 2
    after = float(model.numbers(servo, "kp", (1.0,))[0]) + (stiffness / square if square > 0.0 else -math.inf)
    if after < 0.0:
        raise NotCarried(f"the <position> actuator of '{amount.key}' would have kp {after:g}")
    model.set_number(servo, "kp", after)


def move_encoder_zero(model: MujocoDescription, amount: Amount) -> None:
    """Lets qpos be what the encoder reports, q + q_e: ref, range and springref move by q_e."""
    joint, unit = model.joints[amount.key], model.angle_unit(model.joints[amount.key])
    for fixed in model.root.iter("fixed"):
        if any(part.get("joint") == amount.key for part in fixed):
            raise NotCarried(
                f"line {model.faults.lines[fixed]}: a tendon's length follows the true angle of '{amount.key}'"
            )
    offset = amount.numbers[0] / unit
    model.set_number(joint, "ref", float(model.numbers(joint, "ref", (0.0,))[0]) + offset)
    if np.any(model.numbers(joint, "range", (0.0,))):
        joint.set("range", numbers(model.numbers(joint, "range", (0.0, 0.0)) + offset))
    if np.any(model.numbers(joint, "stiffness", (0.0,))) or model.holder(joint, "springdamper") is not None:
        model.set_number(joint, "springref", float(model.numbers(joint, "springref", (0.0,))[0]) + offset)


def _passive_joint(model: MujocoDescription, name: str, flag: str) -> ET.Element:
    """Finds a joint whose spring and damping are what its attributes ``stiffness`` and ``damping`` say."""
    _refuse_switched_off(model, flag, "passive")
    joint = model.joints[name]
    if np.any(model.numbers(joint, "springdamper", (0.0,)) > 0.0):
        raise NotCarried(f"MuJoCo computes stiffness and damping of the joint '{name}' itself (springdamper)")
    return joint


def _refuse_switched_off(model: MujocoDescription, *flags: str) -> None:
    found = model.switched_off(*flags)
    if found is not None:
        raise NotCarried(f"the model switches that off, {found}")


MUJOCO: Format[MujocoDescription] = Format(
    words="a MuJoCo model",
    read=read_model,
    carriers={
        "dry friction": Carrier("joint `frictionloss`", "frictionloss + F", add_friction),
        "viscous friction": Carrier("joint `damping`, first number", "d_0 + D", add_damping),
        "drag": Carrier("joint `damping`, second number", "d_1 + C", add_drag),
        "rotor inertia": Carrier("joint `armature`", "I", replace_rotor),
        "joint spring": Carrier(
            "joint `stiffness`, `springref`",
            "k_1 + k; (k_1 springref + k q_0) / (k_1 + k)",
            add_spring,
        ),
        "torque limit": Carrier("joint `actuatorfrcrange`", "max(lower, -L), min(upper, L)", limit_torque),
        "drive gain": Carrier(
            "actuator `gear` of a motor; `gainprm`, `biasprm`, `kp`, `kv`, `forcerange` of others; joint"
            " `actuatorfrcrange`",
            "each times s",
            scale_drive,
        ),
        "drive lag": Carrier("actuator `dyntype`, `dynprm` (general)", "filterexact, T_1", add_lag),
        "late command": Carrier(
            "actuator `delay`, `nsample` (motor, general)", "delay + T; delay / timestep + 1", delay_command
        ),
        "servo gains": Carrier("actuator `kp` (position), if K_d = 0", "kp + K_p / gear^2", change_servo),
        "encoder zero": Carrier("joint `ref`, `range`, `springref`", "each + q_e", move_encoder_zero),
        "body inertia": Carrier(
            "body `inertial`: `pos`, `mass`, `fullinertia`",
            "mass + m; m c and inertia about the body's origin likewise",
            change_body,
        ),
        "base lean": Carrier("option `gravity`", "exp((r_x, r_y, 0))^T gravity", lean_base),
    },
    refused={},
    apart={
        (
            "drive lag",
            "torque limit",
        ): "the torque limit of the same joint acts before it, in MuJoCo behind it",
        ("servo gains", "torque limit"): "the torque limit of the same joint would clip it, too",
    },
)
