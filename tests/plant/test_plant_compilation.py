# SPDX-License-Identifier: BSD-3-Clause
"""Compiled code kept on disk is never older than any source it was made from."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from tests.support.paths import CHECKOUT

ROOT = CHECKOUT
CALLER = """
from impedance_modules.compiled import compiled
from impedance_modules.plant.contact.compiled_callee import callee

@compiled
def caller(x):
    return callee(x)
"""
CALLEE = """
from impedance_modules.compiled import compiled

@compiled
def callee(x):
    return x + {}
"""
QUESTION = """
from impedance_modules.plant.compiled_caller import caller
print(caller(1.0), len(caller.stats.cache_hits))
"""


def ask(folder: Path) -> list[str]:
    """The caller's answer in a fresh process, and whether its code came from the disk."""
    answer = subprocess.run(
        [sys.executable, "-c", QUESTION], cwd=folder, capture_output=True, text=True, check=True, timeout=120
    )
    return answer.stdout.split()


def test_a_changed_callee_recompiles_its_caller(tmp_path: Path) -> None:
    """Numba alone looks only at the caller's own file, and would answer with the old code."""
    plant = tmp_path / "impedance_modules" / "plant"
    (plant / "contact").mkdir(parents=True)
    for folder in (plant.parent, plant, plant / "contact"):
        (folder / "__init__.py").touch()
    shutil.copy(ROOT / "impedance_modules" / "compiled.py", plant.parent)
    (plant / "compiled_caller.py").write_text(CALLER)
    callee = plant / "contact" / "compiled_callee.py"
    callee.write_text(CALLEE.format("1.0"))
    assert ask(tmp_path) == ["2.0", "0"]
    assert ask(tmp_path) == ["2.0", "1"]
    callee.write_text(CALLEE.format("20.0"))
    assert ask(tmp_path) == ["21.0", "0"]
