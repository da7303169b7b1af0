# SPDX-License-Identifier: BSD-3-Clause
"""The confusable pairs of the catalogue, each in both directions, and the effect that is withheld in each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.regressor import PAIR

JOINT, OTHER = "port_lift", "port_bend"
"""The joint with the effect, and the joint beside it."""

BODY = "port_elbow"
"""The body with the effect: the one that the other joint carries."""

SLOW = frozenset({"command_delay", "actuator_lag", "velocity_filter_lag", "clock_drift", "reflected_inertia"})
"""Effects that need a motion of some speed to be seen at all."""

RUBBING = frozenset(
    {"coulomb_friction", "viscous_friction", "stribeck_friction", "quadratic_drag", "load_dependent_friction"}
    | {
        "friction_drift",
        "hysteresis",
        "backlash",
        "joint_elasticity",
        "transmission_coupling",
        "torque_ripple",
    }
    | {"asymmetric_friction", "controller_gain", "fluid_drag"}
)
"""Effects that need a motion to be seen, of any speed."""

LINK = frozenset({"link", "contact"})


@dataclass(frozen=True)
class Truth:
    """An effect with numbers: its port, the carrier of its numbers, and the numbers in the catalogue's units."""

    effect: str
    port: str
    key: str
    numbers: Mapping[str, float] = field(default_factory=dict)

    @property
    def joints(self) -> list[str]:
        """Joints that a patch names."""
        kinds = CATALOGUE[self.effect].description.keys
        return [self.key.partition(PAIR)[0]] if {"joint", "pair"} & set(kinds) else []

    def entry(self) -> dict[str, object]:
        """The effect as a patch file writes it."""
        described = CATALOGUE[self.effect].description
        numbers = {s: {"value": v, "unit": described.parameter(s).unit} for s, v in self.numbers.items()}
        return {
            "effect": self.effect,
            "joints": self.joints,
            "port": self.port,
            "parameters": {self.key: numbers},
        }


ON_PAIR = f"{JOINT}{PAIR}{OTHER}"
A, L, S = "actuator", "link", "sensor"

TRUTHS: tuple[Truth, ...] = (
    Truth("coulomb_friction", A, JOINT, {"fc": 1.5}),
    Truth("coulomb_friction", L, JOINT, {"fc": 1.5}),
    Truth("viscous_friction", A, JOINT, {"fv": 4.0}),
    Truth("viscous_friction", L, JOINT, {"fv": 4.0}),
    Truth("stribeck_friction", A, JOINT, {"fc": 1.0, "fs": 2.5, "vs": 0.1}),
    Truth("quadratic_drag", A, JOINT, {"c": 8.0}),
    Truth("quadratic_drag", L, JOINT, {"c": 8.0}),
    Truth("asymmetric_friction", A, JOINT, {"fc": 1.5, "da": 0.6, "dv": 0.0}),
    Truth("asymmetric_friction", L, JOINT, {"fc": 1.5, "da": 0.6, "dv": 0.0}),
    Truth("load_dependent_friction", A, JOINT, {"kl": 0.12}),
    Truth("load_dependent_friction", L, JOINT, {"kl": 0.12}),
    Truth("friction_drift", A, JOINT, {"fv": 4.0, "k": 0.6, "T": 8.0}),
    Truth("torque_offset", L, JOINT, {"c": 3.0}),
    Truth("torque_offset", A, JOINT, {"c": 3.0}),
    Truth("torque_offset", S, JOINT, {"c": 3.0}),
    Truth("reflected_inertia", A, JOINT, {"Ia": 0.9}),
    Truth("torque_gain", A, JOINT, {"s": 1.1}),
    Truth("torque_gain", S, JOINT, {"s": 1.1}),
    Truth("encoder_offset", S, JOINT, {"dq0": 0.05}),
    Truth("backlash", A, JOINT, {"b": 0.02}),
    Truth("hysteresis", A, JOINT, {"s0": 60.0, "fc": 1.5}),
    Truth("hysteresis", L, JOINT, {"s0": 60.0, "fc": 1.5}),
    Truth("joint_elasticity", A, JOINT, {"K": 500.0}),
    Truth("payload", L, BODY, {"m": 0.8, "cx": 0.02, "cy": 0.0, "cz": 0.1}),
    Truth(
        "link_inertia", L, BODY, {"dm": 0.8, "dhx": 0.0, "dhy": 0.0, "dhz": 0.12, "dIxx": 0.03, "dIyy": 0.03}
    ),
    Truth("base_tilt", L, "base", {"rx": 0.05, "ry": 0.06}),
    Truth("parallel_spring", L, JOINT, {"k": 8.0, "preload": 3.0}),
    Truth("torque_ripple", A, JOINT, {"A": 0.8, "N": 12.0, "phi": 0.4}),
    Truth("torque_ripple", L, JOINT, {"A": 0.8, "N": 12.0, "phi": 0.4}),
    Truth("command_delay", "timing", JOINT, {"T": 0.005}),
    Truth("actuator_lag", A, JOINT, {"T": 0.012}),
    Truth("torque_saturation", A, JOINT, {"limit": 12.0}),
    Truth("crosstalk", S, ON_PAIR, {"c": 0.15}),
    Truth("crosstalk", A, ON_PAIR, {"c": 0.15}),
    Truth("velocity_filter_lag", S, JOINT, {"T": 0.03}),
    Truth("clock_drift", "timing", "log", {"ppm": 20000.0}),
    Truth(
        "external_contact", "contact", BODY, {"fx": 4.0, "fy": 0.0, "fz": -8.0, "start": 0.0, "end": 1000.0}
    ),
    Truth("controller_gain", A, JOINT, {"dkp": 25.0, "dkd": 1.0}),
    Truth("transmission_coupling", A, ON_PAIR, {"Ia": 0.3, "fv": 1.0, "fc": 0.8}),
    Truth("buoyancy", L, BODY, {"m": 1.1, "cx": 0.02, "cy": 0.0, "cz": 0.1}),
    Truth("added_mass", L, BODY, {"mx": 1.5, "my": 1.5, "mz": 0.3, "cx": 0.0, "cy": 0.0, "cz": 0.1}),
    Truth("fluid_drag", L, BODY, {"dx": 20.0, "dy": 20.0, "dz": 4.0, "cx": 0.0, "cy": 0.0, "cz": 0.1}),
    Truth("bench_spring", "contact", JOINT, {"k": 8.0, "q0": 0.1}),
    Truth("surface_height", "contact", "surface 1", {"dh": 0.004}),
    Truth("surface_stiffness", "contact", "surface 1", {"k": 8000.0}),
    Truth("surface_friction", "contact", "surface 1", {"mu": 0.5}),
    Truth("object_inertia", L, "object", {"m": 1.5}),
)
"""Each effect at the ports where one of its pairs is a pair; the first one counts where the partner meets none."""

CONTACT = "it needs a hand that presses on a surface, and here arms move freely"
OTHER_RECORDINGS: Mapping[str, str] = {
    "surface_height": CONTACT,
    "surface_stiffness": CONTACT,
    "surface_friction": CONTACT,
    "object_inertia": "it needs a hand that holds an object, and here hands are empty",
}
"""Effects whose poor recordings this benchmark does not make, and why."""


@dataclass(frozen=True)
class PairCase:
    """One direction of a confusable pair.

    Attributes:
        truth: What the plant has and the model lacks.
        partner: Id of the effect that it is mistaken for.
        torque_sensor: Whether the recordings have measured torques. Where the sensor alone tells the two apart (one
            shows before it, one behind it), the recordings are those of a robot without one.
    """

    truth: Truth
    partner: str
    torque_sensor: bool

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.truth.effect}--{self.partner}"

    @property
    def under_water(self) -> bool:
        """Whether the diagnosis has to be told of water."""
        names = (self.truth.effect, self.partner)
        return any(CATALOGUE[name].searched == "under_water" for name in names)

    @property
    def motions(self) -> tuple[str, ...]:
        """Poor motions to try, the likeliest first (`poor_motions`)."""
        effect = self.truth.effect
        if effect in SLOW:
            return ("slow_tone", "one_speed")
        if effect in RUBBING:
            return ("one_way", "one_speed") if self.partner == "torque_offset" else ("one_speed", "slow_tone")
        return ("held", "small")


def unordered_pairs() -> list[tuple[str, str]]:
    """All pairs of effects of which one says that it looks like the other."""
    found = {
        tuple(sorted((effect.id, other)))
        for effect in CATALOGUE.values()
        for other in effect.description.confusable_with
    }
    return sorted((one, other) for one, other in found)


def pair_cases() -> Iterator[PairCase]:
    """Every pair in both directions."""
    for one, other in unordered_pairs():
        yield case_of(one, other)
        yield case_of(other, one)


def case_of(effect: str, partner: str) -> PairCase:
    """Chooses the port of the truth: one where the partner shows in the same measured torques, if there is one.

    Args:
        effect: Id of what is withheld.
        partner: Id of what it is mistaken for.
    """
    known = [truth for truth in TRUTHS if truth.effect == effect]
    theirs = [_seen_in(port) for port in CATALOGUE[partner].description.ports]
    met = [truth for truth in known if any(_seen_in(truth.port) & one for one in theirs)]
    return PairCase((met or known)[0], partner, torque_sensor=bool(met))


def _seen_in(port: str) -> frozenset[str]:
    """Residuals of a robot with torque sensors in which an effect at a port shows."""
    if port in LINK:
        return frozenset({"link"})
    return frozenset({"link", "actuator"}) if port == "sensor" else frozenset({"actuator"})
