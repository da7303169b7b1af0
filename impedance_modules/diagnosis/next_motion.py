# SPDX-License-Identifier: BSD-3-Clause
"""Stage 10: what to record next: the motion that tells rivals apart, or wakes joints that hardly moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from impedance_modules.diagnosis.data.log import DataReport
from impedance_modules.diagnosis.data.nominal_model import NominalModel
from impedance_modules.diagnosis.result import Cause
from impedance_modules.effects.catalogue import CATALOGUE


def propose(
    causes: Sequence[Cause], report: DataReport, model: NominalModel, start: Mapping[str, float]
) -> Mapping[str, object]:
    """Names the joints to move, the excitation that the catalogue asks for, and about which posture.

    `impedance probe` turns it into the shortest safe motion; it needs the robot's limits and shapes.

    Args:
        causes: What was found.
        report: Of the data.
        model: Of the robot.
        start: Joint -> middle of what was recorded [rad].
    """
    return {**_asked(causes, report, model), "start": dict(start)}


def _asked(causes: Sequence[Cause], report: DataReport, model: NominalModel) -> Mapping[str, object]:
    unclear = [cause for cause in causes if cause.equivalent]
    if unclear:
        cause = unclear[0]
        names = [cause.effect, *(rival.effect for rival in cause.equivalent)]
        asked = dict.fromkeys(CATALOGUE[name].description.excitation for name in names if name in CATALOGUE)
        return {
            "purpose": f"tell {', '.join(dict.fromkeys(names))} apart",
            "joints": list(cause.joints or model.joints),
            "excitation": "; ".join(asked),
        }
    if report.weak_joints:
        return {
            "purpose": "see joints that hardly moved",
            "joints": list(report.weak_joints),
            "excitation": "reversals at three or more speeds over the joint's range",
        }
    return {"purpose": "none needed", "joints": [], "excitation": ""}
