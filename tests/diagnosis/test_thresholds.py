# SPDX-License-Identifier: BSD-3-Clause
"""The list of the diagnosis' hand-set numbers, and a process in which one of them has another value."""

import re
import subprocess
import sys

import pytest
from click.testing import CliRunner

from benchmarks.wide.__main__ import main
from benchmarks.wide.thresholds import ROOT, changes_of, thresholds

LINE = re.compile(r"^(?P<name>[A-Z][A-Z_0-9]*) = -?[0-9.e-]+$", re.MULTILINE)


def test_every_number_that_stands_alone_on_a_line_is_listed_where_it_stands() -> None:
    listed = {(item.module, item.name): item for item in thresholds()}
    for path in (ROOT / "impedance_modules" / "diagnosis").rglob("*.py"):
        text, module = path.read_text(), ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for match in LINE.finditer(text):
            item = listed[module, match["name"]]
            assert item.line == text[: match.start()].count("\n") + 1
            assert float(match[0].split(" = ")[1]) == item.value


def test_the_list_says_what_a_number_decides_and_takes_pairs_apart() -> None:
    text = CliRunner().invoke(main, ["thresholds"]).output
    assert re.search(r"model_selection/acceptance.py:\d+ +BIC_MIN +15.0 +Least improvement", text)
    assert re.search(r"residuals/band.py:\d+ +BAND_MIN +3.0", text) and re.search(r"BAND_MAX +20.0", text)


@pytest.mark.parametrize("word", ["BIC_MIN", "NO_SUCH=1", "LEAST=0", "EDGES=1", "BIC_MIN=much"])
def test_a_change_that_names_no_single_number_is_refused(word: str) -> None:
    with pytest.raises(ValueError, match=r"valid: NAME=VALUE|could not convert"):
        changes_of([word])


def test_a_changed_number_reaches_the_modules_that_took_it() -> None:
    """`PASSBAND` is read where it stands; `LEAST` of `sensor_noise` was taken by `noise_floor`."""
    words = ["time_base.PASSBAND=0.3", "sensor_noise.LEAST=0.2"]
    program = (
        "from benchmarks.wide.thresholds import change; import impedance_modules.diagnosis.regression.noise_floor as f;"
        f"change({words!r}); import impedance_modules.diagnosis.data.time_base as t;"
        "print(t.PASSBAND, f.LEAST)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert done.stdout.split() == ["0.3", "0.2"]
