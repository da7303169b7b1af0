# SPDX-License-Identifier: BSD-3-Clause
"""Sentences about a diagnosis that report and terminal share."""

from __future__ import annotations

from typing import Any

NOTABLE = 1.0
"""Deviations of a prior from which what it swallowed is said."""

LEAST_MASS = 1e-3
"""Mass from which it is said by how much a link is heavier or lighter [kg]."""

WHOLE = 0.9
"""Share of the swallowed torque from which a mass does the same, and not a part of it."""


def swallowed_sentences(swallowed: dict[str, Any] | None) -> list[str]:
    """Says what priors swallowed: links, a mass in the hand that would do the same, weights and stamps.

    Args:
        swallowed: The object of the JSON; null without a fit.
    """
    if swallowed is None:
        return []
    links = swallowed["links"]
    name, most = max(links.items(), key=lambda item: item[1]["deviations"], default=("", None))
    out = []
    if most is not None and most["deviations"] >= NOTABLE:
        way = "heavier" if most["mass"] > 0.0 else "lighter"
        # A moment or an inertia may err without the mass, which turns about a fixed axis do not show.
        by = f" ({abs(most['mass']):.2g} kg {way})" if abs(most["mass"]) >= LEAST_MASS else ""
        out.append(
            f"links other than stated by up to {most['deviations']:.2g} of their stated deviation, most '{name}'{by}"
        )
        out += _hand(swallowed["hand"])
    if swallowed["weights"]["deviations"] >= NOTABLE:
        out.append(
            "weights that the robot compensates, other than stated by up to"
            f" {swallowed['weights']['deviations']:.2g} of their stated deviation"
        )
    for kind, found in swallowed["times"].items():
        if found["deviations"] >= NOTABLE:
            way = "later" if found["later"] > 0.0 else "earlier"
            size = 1e3 * abs(found["later"])
            out.append(f"{kind} stamped {size:.2g} ms {way} ({found['deviations']:.2g} deviations)")
    return out


def _hand(hand: dict[str, Any] | None) -> list[str]:
    if hand is None:
        return []
    size = f"{abs(hand['mass']):.2g} kg {'more' if hand['mass'] > 0.0 else 'less'} at '{hand['link']}'"
    if hand["share"] >= WHOLE:
        return [f"{size} would do the same"]
    return [f"{size} would do {100.0 * hand['share']:.0f} % of the same"]
