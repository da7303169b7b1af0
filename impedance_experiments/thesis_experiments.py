# SPDX-License-Identifier: BSD-3-Clause
"""All experiments, in the thesis's order; a module is imported only when its experiment runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module

from impedance_experiments.thesis_page import Page, Settings
from impedance_modules.errors import BadInput, nearest


@dataclass(frozen=True)
class Experiment:
    """One experiment of the thesis.

    Attributes:
        name: As in ``impedance reproduce NAME``.
        section: Of the thesis.
        question: What it answers, in one line.
        module: Of this package; its function ``reproduce(settings)`` returns the page.
    """

    name: str
    section: str
    question: str
    module: str

    def run(self, settings: Settings) -> Page:
        """Carries the experiment out."""
        reproduce: Callable[[Settings], Page] = import_module(
            f"impedance_experiments.{self.module}"
        ).reproduce
        page = reproduce(settings)
        settings.on_progress(1.0, "done")
        return page


_ALL: tuple[Experiment, ...] = (
    Experiment("securing", "1.2", "On which surfaces does a hand hold itself?", "securing"),
    Experiment("valve", "1.2", "Can a valve be operated with acceptable torque?", "valve"),
    Experiment("guarded-move", "1.3", "How hard does a guarded move strike?", "guarded_move"),
    Experiment("kinematics", "2.2", "Do two models of Baxter's arm agree?", "printed_kinematics"),
    Experiment("series-elastic", "3.1", "What do the springs in the joints do?", "series_elastic_joint"),
    Experiment("reflected-inertia", "3.2", "How large is a rotor's reflected inertia?", "reflected_inertia"),
    Experiment(
        "reflected-inertia-matters",
        "3.3",
        "How much heavier do the rotors make a blow?",
        "reflected_inertia_matters",
    ),
    Experiment("torque-loop", "3.2, 4", "How light may torque feedback make a rotor?", "torque_loop"),
    Experiment("one-joint", "4.1", "Does one joint follow eq. 4.8?", "one_joint"),
    Experiment("self-motion", "4.3", "Do the joints come back when the hand does?", "self_motion"),
    Experiment(
        "reaction-moment", "4.4, 4.5", "Does a blow along the normal turn the hand?", "reaction_moment"
    ),
    Experiment("planar-arms", "4.5", "Do the inertias of two mirrored planar arms add?", "planar_arms"),
    Experiment(
        "impedance-controller",
        "4.1 to 4.7, 5.1.3",
        "How does one impedance-controlled arm react?",
        "impedance_controller",
    ),
    Experiment(
        "pseudo-hybrid", "4.7", "What differs between pressing by a force and by a spring?", "pseudo_hybrid"
    ),
    Experiment("stiffness-matrix", "5.1.3, app. C", "What is the stiffness of eq. 5.1?", "stiffness_matrix"),
    Experiment("stability-limits", "5.1.3", "How stiff and how soft can a hand be?", "stability_limits"),
    Experiment("terrain", "5.1", "Who keeps contact with a surface that the map does not show?", "terrain"),
    Experiment(
        "terrain-shapes",
        "5.1.4",
        "Who keeps contact where the map does not know the shape?",
        "terrain_shapes",
    ),
    Experiment(
        "press-25-newton", "5.1.3", "From where could the force of the first task come?", "pressing_force"
    ),
    Experiment("surface-map", "5.1.5, 6.2.3", "What does a hand learn of what it strokes?", "surface_map"),
    Experiment("sanding", "5.2", "Can it sand wood, and tell when the wood is smooth?", "sanding"),
    Experiment("two-arms", "4.5, 6.2.4", "Do two real arms on one object add?", "two_arms"),
    Experiment("folding", "6.2.2", "How soft may joints be before the links fold?", "folding"),
    Experiment("nonlinear-damping", "6.2.1", "Does damping depend on who excites it?", "nonlinear_damping"),
    Experiment("under-water", "6.2.5", "How stiff, heavy and damped is a hand under water?", "under_water"),
)
EXPERIMENTS: dict[str, Experiment] = {entry.name: entry for entry in _ALL}


def find_experiment(name: str) -> Experiment:
    """Returns the experiment of that name.

    Raises:
        BadInput: There is none.
    """
    if name not in EXPERIMENTS:
        known = tuple(EXPERIMENTS)
        raise BadInput(f"no experiment '{name}'{nearest(name, known)} (valid: all, {', '.join(known)})")
    return EXPERIMENTS[name]
