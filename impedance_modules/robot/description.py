# SPDX-License-Identifier: BSD-3-Clause
"""Reads robot descriptions (URDF) as their makers ship them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from impedance_modules.errors import BadInput
from impedance_modules.spec.robot_spec import UPRIGHT_GRAVITY

MARK = " (joint)"
"""Added to the name of a joint's frame that is called like a link; no joint of a URDF is asked for by such a name."""


def rigid_model(urdf: Path, text: str | None = None) -> pin.Model:
    """Builds pinocchio's model of a description, all its joints free, its base upright.

    A URDF may give a joint the name of a link (Rethink's own Baxter: ``left_hand``; the SO-100: ``gripper``). Frames of
    joints are named apart from links then, since joints of a model with two frames of one name cannot be locked.

    Args:
        urdf: The file; named in messages.
        text: The description, where it is not the file's own.

    Raises:
        BadInput: It is no description that can be read.
    """
    try:
        model = pin.buildModelFromUrdf(str(urdf)) if text is None else pin.buildModelFromXML(text)
    except (ValueError, RuntimeError) as error:
        raise BadInput(f"{urdf}: not a robot description that can be read: {error}") from None
    model.gravity.linear = np.array(UPRIGHT_GRAVITY)
    links = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
    for frame in model.frames:
        if frame.type in (pin.FrameType.FIXED_JOINT, pin.FrameType.JOINT) and frame.name in links:
            frame.name += MARK
    return model


def name_apart(model: pin.Model, joints: Sequence[int]) -> None:
    """Names joints that will be locked apart from links: what is left of them is a frame of the same name.

    Args:
        model: From ``rigid_model``; changed.
        joints: Their indices.
    """
    links = {frame.name for frame in model.frames if frame.type == pin.FrameType.BODY}
    for joint in joints:
        if model.names[joint] in links:
            model.names[joint] += MARK
