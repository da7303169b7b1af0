# SPDX-License-Identifier: BSD-3-Clause
"""What can be wrong with the links, the base and the surroundings; and inertias 0 to 3 % off those of the URDF."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.blind.arm_model import GRAVITY, Inertial, Link, hand_of
from benchmarks.blind.injection import Draw, Injection, Situation
from benchmarks.blind.plant import Arm, Push

Array = NDArray[np.float64]


def payload(s: Situation) -> Injection:
    """A mass held by the hand."""
    place = np.array([*s.rng.uniform(-0.03, 0.03, 2), s.rng.uniform(0.0, 0.08)])
    hand = hand_of(s.arm.side)

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return replace(
            arm,
            links=tuple(with_payload(link, a, place) if link.name == hand else link for link in arm.links),
        )

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {hand: {"m": a, "cx": float(place[0]), "cy": float(place[1]), "cz": float(place[2])}}

    return Injection("payload", (s.drive.joints[-1],), "link", 0.1, 2.2, apply, truth)


def link_inertia(s: Situation) -> Injection:
    """A link heavier than believed, in proportion."""
    chosen = next(link for link in s.arm.links if link.joint == s.name)
    mass = chosen.inertial.mass if chosen.inertial is not None else 0.0

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return replace(
            arm,
            links=tuple(
                _scaled(link, 1 + a / mass) if link.name == chosen.name else link for link in arm.links
            ),
        )

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {chosen.name: {"dm": a}}

    return Injection("link_inertia", (s.name,), "link", 0.1 * mass, 1.0 * mass, apply, truth)


def base_tilt(s: Situation) -> Injection:
    """The base leans: gravity turns by rx, ry in its axes."""
    way = float(s.rng.uniform(0, 2 * np.pi))

    def apply(arm: Arm, a: float, _: int) -> Arm:
        return replace(arm, gravity=tilted(a * np.cos(way), a * np.sin(way)))

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {"base": {"rx": a * float(np.cos(way)), "ry": a * float(np.sin(way))}}

    return Injection("base_tilt", (), "link", 0.02, 0.3, apply, truth)


def external_contact(s: Situation) -> Injection:
    """Somebody pushes the hand now and then, each time differently."""
    seed = int(s.rng.integers(2**31))

    def apply(arm: Arm, a: float, episode: int) -> Arm:
        rng = np.random.default_rng((seed, episode))
        pushes = []
        for begin in (2.0, 7.0):
            start = begin + rng.uniform(0.0, 2.0)
            way = rng.standard_normal(3)
            pushes.append(Push(start, start + rng.uniform(0.6, 1.5), a * way / np.linalg.norm(way)))
        return replace(arm, pushes=tuple(pushes))

    def truth(a: float) -> dict[str, dict[str, float]]:
        return {hand_of(s.arm.side): {"F": a}}

    return Injection("external_contact", (), "contact", 3.0, 60.0, apply, truth)


def tilted(rx: float, ry: float) -> Array:
    """Returns gravity (3,) in the axes of a base that is turned by the vector (rx, ry, 0)."""
    angle = float(np.hypot(rx, ry))
    if angle == 0.0:
        return np.array([0.0, 0.0, -GRAVITY])
    x, y = rx / angle, ry / angle
    return -GRAVITY * np.array([-y * np.sin(angle), x * np.sin(angle), np.cos(angle)])


def with_payload(link: Link, mass: float, place: Array) -> Link:
    """Returns a link that carries a small ball of some mass [kg] at a place (3,) [m] in its frame."""
    if link.inertial is None:
        raise ValueError(f"link {link.name}: cannot be loaded, it has no mass")
    old = link.inertial
    total = old.mass + mass
    com = (old.mass * old.com + mass * place) / total
    ball = 0.4 * mass * 0.03**2 * np.eye(3)
    inertia = old.inertia + _at(old.mass, old.com - com) + ball + _at(mass, place - com)
    return replace(link, inertial=Inertial(total, com, inertia))


def _scaled(link: Link, factor: float) -> Link:
    if link.inertial is None:
        raise ValueError(f"link {link.name}: cannot be scaled, it has no mass")
    old = link.inertial
    return replace(link, inertial=Inertial(old.mass * factor, old.com, old.inertia * factor))


def _at(mass: float, arm: Array) -> Array:
    return np.asarray(mass * (arm @ arm * np.eye(3) - np.outer(arm, arm)))


BODIES: dict[str, Draw] = {
    "payload": payload,
    "link_inertia": link_inertia,
    "base_tilt": base_tilt,
    "external_contact": external_contact,
}


def wrong_by(links: tuple[Link, ...], level: float, rng: np.random.Generator) -> tuple[Link, ...]:
    """Returns links whose inertial numbers are off by a relative standard deviation ``level``."""
    return tuple(
        link if link.inertial is None else replace(link, inertial=_vary(link.inertial, level, rng))
        for link in links
    )


def _vary(inertial: Inertial, level: float, rng: np.random.Generator) -> Inertial:
    mass, size = np.exp(level * rng.standard_normal(2))
    shift = level * float(np.linalg.norm(inertial.com)) / np.sqrt(3) * rng.standard_normal(3)
    return Inertial(inertial.mass * mass, inertial.com + shift, inertial.inertia * mass * size)
