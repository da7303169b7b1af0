# SPDX-License-Identifier: BSD-3-Clause
"""The friction of a shaft that turns with two joints changes its sign with the speed of both."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from impedance_modules.effects.catalogue import CATALOGUE
from impedance_modules.effects.dry_reversals import REGULARISATION
from impedance_modules.effects.joint_motion import REGULARISATION_VELOCITY
from impedance_modules.effects.regressor import Site
from tests.effects.test_effects_catalogue import recording


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 7.0))
@settings(max_examples=10, deadline=None)
def test_a_shaft_of_two_joints_turns_its_friction_as_its_shape_says(seed: int, multiple: float) -> None:
    """The column of dry friction is that of the speed of both, and saturates at one where they are fast."""
    s, coupling = recording(), CATALOGUE["transmission_coupling"]
    random = np.random.default_rng(seed)
    speeds = 0.2 * random.standard_normal((s.samples, s.n))
    one, other = s.model.joint_names[:2]
    site = Site(replace(s, velocity=speeds), f"{one}<-{other}", "actuator")
    (start,) = coupling.shapes(site)
    found = coupling.regressor(site, "actuator", {**start, REGULARISATION: multiple})
    assert found is not None and coupling.refined(start) == (REGULARISATION,)
    speed = sum(site.signals.sample(i, motor_side=True).velocity for i in found.rows)
    assert found.columns[:, 0, 2] == pytest.approx(
        np.tanh(speed / (multiple * REGULARISATION_VELOCITY)), abs=1e-9
    )
    assert found.columns[:, 1, 2] == pytest.approx(found.columns[:, 0, 2])
