# SPDX-License-Identifier: BSD-3-Clause
"""Experiments of the thesis in their short form."""

import pytest

from impedance_experiments.thesis_experiments import find_experiment
from impedance_experiments.thesis_page import Settings, Size


@pytest.fixture
def facts_of(tmp_path):
    """Carries an experiment out in short form: the numbers behind its page, by their names."""

    def carry_out(name: str) -> dict[str, float]:
        settings = Settings(Size.SHORT, 0, tmp_path, lambda _share, _text: None)
        return find_experiment(name).run(settings).facts

    return carry_out
