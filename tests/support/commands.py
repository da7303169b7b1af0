# SPDX-License-Identifier: BSD-3-Clause
"""Commands as a user gives them: verbs within this process, and programs in a process of their own."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from impedance_modules.cli.main import impedance
from impedance_modules.errors import ImpedanceError
from tests.support.paths import CHECKOUT


def invoke(*words: object) -> Result:
    """Runs a verb; what it raises is raised, ``return_value`` is its exit code, ``output`` what it printed."""
    arguments = [str(word) for word in words]
    return CliRunner().invoke(impedance, arguments, standalone_mode=False, catch_exceptions=False)


def refusal(*words: object) -> str:
    """What a verb says that refuses its input."""
    with pytest.raises(ImpedanceError) as refused:
        invoke(*words)
    assert refused.value.exit_code == 2
    return str(refused.value)


def python(*arguments: str, cwd: Path = CHECKOUT, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs this Python to its end; a verb is ``python("-m", "impedance_modules", *words)``."""
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=cwd,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=900,
    )
