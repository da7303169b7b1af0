# SPDX-License-Identifier: BSD-3-Clause
"""A probe as a JSON object: what it is for, what it does, and what it is expected to tell."""

from __future__ import annotations

import math
from typing import Any

from impedance_modules.diagnosis.experiment_design.probe_choice import CHI_SQUARE, SHARE
from impedance_modules.diagnosis.experiment_design.propose import Probe


def probe_object(probe: Probe) -> dict[str, Any]:
    """Builds the JSON object; a distance that was not measured is null."""
    proposal, joints = probe.proposal, probe.follower.model.joints
    return {
        "format": 1,
        "purpose": probe.brief.purpose,
        "robot": probe.follower.model.robot,
        "motions": list(proposal.motion.kinds),
        "joints": [joints[index] for index in proposal.motion.moved],
        "duration_s": proposal.motion.duration,
        "start": dict(zip(joints, probe.follower.start.tolist(), strict=True)),
        "nearest_m": proposal.nearest if math.isfinite(proposal.nearest) else None,
        "threshold": {"chi_square": CHI_SQUARE, "share": SHARE},
        "questions": [
            {
                "question": item.question.name,
                "chi_square": item.separation.chi_square,
                "share": item.separation.share,
                "answered": item.met,
            }
            for item in proposal.expected
        ],
    }
