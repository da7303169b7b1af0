# SPDX-License-Identifier: BSD-3-Clause
"""Rollouts: windows of held-out recordings, simulated without the causes, with all, and with all but each one.

A cause that explains torque must also improve the simulated motion; one that worsens it is not named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

from impedance_modules.arrays import Array
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.model_selection.evidence import Evidence
from impedance_modules.diagnosis.result import Cause, Diagnosis
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
    DrivenRecording,
    RolloutWindow,
    WindowErrors,
    choose_drive,
    common_windows,
    floor_windows,
    held_out_windows,
)
from impedance_modules.diagnosis.rollout.simulation import RolloutRobot, Simulation, simulate
from impedance_modules.diagnosis.rollout_result import CauseRollout, LeftOut, Rollout, no_rollout
from impedance_modules.errors import BadFile, ImpedanceError
from impedance_modules.spec.patch_file import EffectSpec
from impedance_modules.worker_processes import OrderedMap, map_here

LEAVE_OUT_STEP_MAX = 4
"""To test several causes, each is left out on every second to fourth window only."""


@dataclass(frozen=True, eq=False)
class _RolloutSet:
    """What all simulations of one diagnosis have in common."""

    evidence: Evidence
    robot: RolloutRobot
    windows: tuple[RolloutWindow, ...]
    pairs: tuple[tuple[int, int], ...]
    each: OrderedMap

    def simulate(self, simulations: Sequence[Simulation]) -> Iterator[WindowErrors]:
        used = sorted({window.recording for simulation in simulations for window in simulation.windows})
        recordings = {index: DrivenRecording.of(self.evidence.prepared[index]) for index in used}
        return self.each(partial(simulate, self.robot, recordings), simulations)

    @cached_property
    def fitted(self) -> FittedNuisance:
        return fitted_nuisance(self.evidence)

    def floors(
        self, refitted: WindowErrors, effects: Sequence[EffectSpec]
    ) -> tuple[str, tuple[Array, Array]]:
        """Source of the noise floors, and those of position and velocity (n,): repeats, else the initial states."""
        common = common_windows(self.windows, self.pairs)
        if common:
            return "repeats", self._repeated(refitted, common)
        windows = floor_windows(self.evidence.prepared, self.pairs)
        if windows:
            (apart,) = self.simulate([Simulation(tuple(effects), self.fitted, windows)])
            return "repeats", self._repeated(apart, common_windows(windows, self.pairs))
        held = [self.evidence.prepared[index] for index in self.evidence.heldout]
        perturbed = apply_causes(self.robot.spec, (), self.fitted, self.robot.tree)
        return "weak", floor_of_seeds(
            held, refitted.time, None if self.robot.drive == "command" else perturbed.squared_mobility
        )

    @staticmethod
    def _repeated(errors: WindowErrors, common: Sequence[tuple[int, int]]) -> tuple[Array, Array]:
        return floor_of_repeats(errors.position, common), floor_of_repeats(errors.velocity, common)


def with_rollouts(
    found: Diagnosis,
    evidence: Evidence,
    model: NominalModel,
    urdf: Path,
    known_effects: Sequence[EffectSpec],
    each: OrderedMap = map_here,
) -> Diagnosis:
    """Adds the rollouts to a diagnosis.

    Causes that worsen them are not named: see ``model_selection.naming``. What all together change is no verdict: the
    links that are fitted beside them change the motion, too.

    Args:
        found: The diagnosis by torques.
        evidence: All recordings and the fit.
        model: The nominal model.
        urdf: Its links.
        known_effects: Effects of a patch that the nominal model includes.
        each: Where simulations are computed, one by one.
    """
    rollout = roll_out(found, evidence, model, urdf, known_effects, each)
    causes = tuple(
        replace(cause, rollout=rollout.causes.get((cause.effect, cause.port))) for cause in found.causes
    )
    return replace(found, rollout=rollout, causes=causes)


def roll_out(
    found: Diagnosis,
    evidence: Evidence,
    model: NominalModel,
    urdf: Path,
    known_effects: Sequence[EffectSpec],
    each: OrderedMap,
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
        spec = robot_of_model(model, links, drive, held[0].log.gravity_compensation)
        robot = RolloutRobot(spec, links.read_bytes(), held[0].tree, drive)
        return _compared(_RolloutSet(evidence, robot, windows, pairs, each), found.causes, known_effects)


def _compared(runs: _RolloutSet, causes: Sequence[Cause], known_effects: Sequence[EffectSpec]) -> Rollout:
    drive = runs.robot.drive
    base, left_out = effects_to_simulate(known_effects, drive)
    # A push happened at one time of one recording, and is not simulated.
    specs: dict[tuple[str, str], EffectSpec] = {
        (c.effect, c.port): spec_of_cause(c) for c in causes if c.port != "contact"
    }
    kept, dropped = effects_to_simulate(tuple(specs.values()), drive)
    chosen = {key: spec for key, spec in specs.items() if spec in kept}
    try:
        chosen, refused = _able(runs, base, chosen)
        before, after, refitted, *without = runs.simulate(_simulations(runs, base, chosen))
        floor, floors = runs.floors(refitted, (*base, *chosen.values()))
        verdicts = _verdicts(runs, chosen, refitted, floors, without)
    except ImpedanceError as error:
        return no_rollout(LeftOut("all recordings", _reason(error)))
    outcome = BeforeAfter(before, after, refitted, floors)
    return summarise(
        runs.evidence, drive, runs.windows, outcome, floor, verdicts, (*left_out, *dropped, *refused)
    )


def _able(
    runs: _RolloutSet, base: Sequence[EffectSpec], chosen: Mapping[tuple[str, str], EffectSpec]
) -> tuple[dict[tuple[str, str], EffectSpec], tuple[LeftOut, ...]]:
    """Separates the causes that the plant supports together from the others, with the reason."""
    able: dict[tuple[str, str], EffectSpec] = {}
    refused: list[LeftOut] = []
    for key, spec in chosen.items():
        try:
            apply_causes(runs.robot.spec, (*base, *able.values(), spec), runs.fitted, runs.robot.tree)
        except ImpedanceError as error:
            refused.append(LeftOut(f"{spec.effect} on {', '.join(spec.parameters)}", _reason(error)))
        else:
            able[key] = spec
    return able, tuple(refused)


def _simulations(
    runs: _RolloutSet, base: Sequence[EffectSpec], chosen: Mapping[tuple[str, str], EffectSpec]
) -> list[Simulation]:
    """The simulations without causes, with them alone, refitted too, and so but for each one on some of the windows."""
    nominal = no_nuisance(runs.robot.tree)
    some = runs.windows[:: _step(chosen)]
    return [
        Simulation(tuple(base), nominal, runs.windows),
        Simulation((*base, *chosen.values()), nominal, runs.windows),
        Simulation((*base, *chosen.values()), runs.fitted, runs.windows),
        *(
            Simulation((*base, *(other for name, other in chosen.items() if name != key)), runs.fitted, some)
            for key in chosen
        ),
    ]


def _step(chosen: Mapping[tuple[str, str], EffectSpec]) -> int:
    """Every so many windows a cause is left out on."""
    return min(max(1, len(chosen)), LEAVE_OUT_STEP_MAX)


def _verdicts(
    runs: _RolloutSet,
    chosen: Mapping[tuple[str, str], EffectSpec],
    refitted: WindowErrors,
    floors: tuple[Array, Array],
    without: Sequence[WindowErrors],
) -> dict[tuple[str, str], CauseRollout]:
    """Compares all causes with all but one, for each cause, on the same windows."""
    every = _step(chosen)
    scales = error_scales(refitted, floors)
    thinned = WindowErrors(refitted.time, refitted.position[::every], refitted.velocity[::every])
    names = runs.robot.tree.joints
    out = {}
    for (key, spec), left in zip(chosen.items(), without, strict=True):
        # A cause is judged at its joints; one without joints at all of them.
        joints = [names.index(joint) for joint in spec.joints] or range(len(names))
        out[key] = judge(power(left, scales, joints), power(thinned, scales, joints))
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
