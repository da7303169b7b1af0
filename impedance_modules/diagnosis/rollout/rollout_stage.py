# SPDX-License-Identifier: BSD-3-Clause
"""Rollouts: windows of held-out recordings, simulated without the causes, with all, and with all but each one.

A cause that explains torque must also improve the simulated motion; one that worsens it is not named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.result import Cause, CauseRollout, Diagnosis, LeftOut, Rollout, no_rollout
from impedance_modules.diagnosis.rollout.rollout_error import (
    BeforeAfter,
    error_scales,
    floor_of_repeats,
    floor_of_seeds,
    judge,
    power,
    summarise,
)
from impedance_modules.diagnosis.rollout.simulated_robot import (
    FittedNuisance,
    apply_causes,
    effects_to_simulate,
    fitted_nuisance,
    no_nuisance,
    robot_of_model,
    spec_of_cause,
    without_endless_joints,
)
from impedance_modules.diagnosis.rollout.simulated_windows import (
    RolloutWindow,
    WindowErrors,
    choose_drive,
    common_windows,
    floor_windows,
    held_out_windows,
    simulate_windows,
)
from impedance_modules.errors import BadFile, ImpedanceError
from impedance_modules.spec.patch_file import EffectSpec
from impedance_modules.spec.robot_spec import RobotSpec

LEAVE_OUT_STEP_MAX = 4
"""To test several causes, each is left out on every second to fourth window only."""


@dataclass(frozen=True, eq=False)
class _RolloutSet:
    """What all simulations of one diagnosis have in common."""

    evidence: Evidence
    robot: RobotSpec
    drive: str
    windows: tuple[RolloutWindow, ...]
    pairs: tuple[tuple[int, int], ...]

    def simulate_windows(
        self, effects: Sequence[EffectSpec], nuisance: FittedNuisance, windows: Sequence[RolloutWindow]
    ) -> WindowErrors:
        prepared = self.evidence.prepared
        return simulate_windows(
            apply_causes(self.robot, effects, nuisance, prepared[0].tree), self.drive, prepared, windows
        )

    @cached_property
    def fitted(self) -> FittedNuisance:
        return fitted_nuisance(self.evidence)

    def floors(self, after: WindowErrors, effects: Sequence[EffectSpec]) -> tuple[str, tuple[Array, Array]]:
        """Source of the noise floors, and those of position and velocity (n,): repeats, else the initial states."""
        common = common_windows(self.windows, self.pairs)
        if common:
            return "repeats", self._repeated(after, common)
        windows = floor_windows(self.evidence.prepared, self.pairs)
        if windows:
            apart = self.simulate_windows(effects, self.fitted, windows)
            return "repeats", self._repeated(apart, common_windows(windows, self.pairs))
        held = [self.evidence.prepared[index] for index in self.evidence.heldout]
        perturbed = apply_causes(self.robot, (), self.fitted, held[0].tree)
        return "weak", floor_of_seeds(
            held, after.time, None if self.drive == "command" else perturbed.squared_mobility
        )

    @staticmethod
    def _repeated(errors: WindowErrors, common: Sequence[tuple[int, int]]) -> tuple[Array, Array]:
        return floor_of_repeats(errors.position, common), floor_of_repeats(errors.velocity, common)


def with_rollouts(
    found: Diagnosis, evidence: Evidence, model: NominalModel, urdf: Path, known_effects: Sequence[EffectSpec]
) -> Diagnosis:
    """Adds the rollouts to a diagnosis; if all causes together worsen them, `explained` is `partly_explained`.

    Single causes that worsen them are not named: see ``model_selection.naming``.

    Args:
        found: The diagnosis by torques.
        evidence: All recordings and the fit.
        model: The nominal model.
        urdf: Its links.
        known_effects: Effects of a patch that the nominal model includes.
    """
    rollout = roll_out(found, evidence, model, urdf, known_effects)
    causes = tuple(
        replace(cause, rollout=rollout.causes.get((cause.effect, cause.port))) for cause in found.causes
    )
    verdict, remainder = found.verdict, found.remainder
    if verdict == "explained" and rollout.whole is not None and rollout.whole.verdict == "worsens":
        verdict = "partly_explained"
        words = f"{remainder.structure}; better torques but worse simulated motion with all causes together"
        remainder = replace(remainder, explained=False, structure=words)
    return replace(found, rollout=rollout, causes=causes, verdict=verdict, remainder=remainder)


def roll_out(
    found: Diagnosis, evidence: Evidence, model: NominalModel, urdf: Path, known_effects: Sequence[EffectSpec]
) -> Rollout:
    """Simulates the held-out recordings without and with the causes."""
    held = [evidence.prepared[index] for index in evidence.heldout]
    drive = choose_drive(held[0])
    if not drive:
        return no_rollout(LeftOut("all recordings", "they hold no torque that could drive a plant"))
    # Recordings without this torque cannot be compared with the others.
    alike = [index for index, item in enumerate(evidence.prepared) if choose_drive(item) == drive]
    windows = held_out_windows(evidence.prepared, [index for index in evidence.heldout if index in alike])
    if not windows:
        return no_rollout(LeftOut("all recordings", "the held-out ones are too short for a window"))
    pairs = tuple(pair for pair in _pairs(evidence) if set(pair) <= set(alike))
    with without_endless_joints(urdf) as links:
        robot = robot_of_model(model, links, drive, held[0].log.gravity_compensation)
        return _compared(_RolloutSet(evidence, robot, drive, windows, pairs), found.causes, known_effects)


def _compared(runs: _RolloutSet, causes: Sequence[Cause], known_effects: Sequence[EffectSpec]) -> Rollout:
    base, left_out = effects_to_simulate(known_effects, runs.drive)
    # A push happened at one time of one recording, and is not simulated.
    specs: dict[tuple[str, str], EffectSpec] = {
        (c.effect, c.port): spec_of_cause(c) for c in causes if c.port != "contact"
    }
    kept, dropped = effects_to_simulate(tuple(specs.values()), runs.drive)
    chosen = {key: spec for key, spec in specs.items() if spec in kept}
    try:
        before = runs.simulate_windows(base, no_nuisance(runs.evidence.prepared[0].tree), runs.windows)
        after, chosen, refused = _with_all_causes(runs, base, chosen)
        floor, floors = runs.floors(after, (*base, *chosen.values()))
        verdicts = _verdicts(runs, base, chosen, after, floors)
    except ImpedanceError as error:
        return no_rollout(LeftOut("all recordings", _reason(error)))
    outcome = BeforeAfter(before, after, floors)
    return summarise(
        runs.evidence, runs.drive, runs.windows, outcome, floor, verdicts, (*left_out, *dropped, *refused)
    )


def _with_all_causes(
    runs: _RolloutSet, base: Sequence[EffectSpec], chosen: dict[tuple[str, str], EffectSpec]
) -> tuple[WindowErrors, dict[tuple[str, str], EffectSpec], tuple[LeftOut, ...]]:
    """Simulates with all causes that the plant supports together; the others are left out, with the reason."""
    able: dict[tuple[str, str], EffectSpec] = {}
    refused: list[LeftOut] = []
    tree = runs.evidence.prepared[0].tree
    for key, spec in chosen.items():
        try:
            apply_causes(runs.robot, (*base, *able.values(), spec), runs.fitted, tree)
        except ImpedanceError as error:
            refused.append(LeftOut(f"{spec.effect} on {', '.join(spec.parameters)}", _reason(error)))
        else:
            able[key] = spec
    return runs.simulate_windows((*base, *able.values()), runs.fitted, runs.windows), able, tuple(refused)


def _verdicts(
    runs: _RolloutSet,
    base: Sequence[EffectSpec],
    chosen: dict[tuple[str, str], EffectSpec],
    after: WindowErrors,
    floors: tuple[Array, Array],
) -> dict[tuple[str, str], CauseRollout]:
    """Compares all causes with all but one, for each cause, on the same windows."""
    every = min(max(1, len(chosen)), LEAVE_OUT_STEP_MAX)
    some = runs.windows[::every]
    scales = error_scales(after, floors)
    thinned = WindowErrors(after.time, after.position[::every], after.velocity[::every])
    names = runs.evidence.prepared[0].tree.joints
    out = {}
    for key, spec in chosen.items():
        others = [other for name, other in chosen.items() if name != key]
        # A cause is judged at its joints; one without joints at all of them.
        joints = [names.index(joint) for joint in spec.joints] or range(len(names))
        without = runs.simulate_windows((*base, *others), runs.fitted, some)
        out[key] = judge(power(without, scales, joints), power(thinned, scales, joints))
    return out


def _reason(error: ImpedanceError) -> str:
    """The reason in words, without a place in a file: the causes are in none."""
    if isinstance(error, BadFile):
        return "; ".join(problem.message for problem in error.problems)
    return str(error)


def _pairs(evidence: Evidence) -> list[tuple[int, int]]:
    """Pairs of recordings of one motion, held-out ones first."""
    prepared, held = evidence.prepared, set(evidence.heldout)
    found = [
        (j, i)
        for i in range(len(prepared))
        for j in range(i)
        if prepared[i].log.group == prepared[j].log.group and (i in held) == (j in held)
    ]
    return sorted(found, key=lambda pair: pair[0] not in held)
