# SPDX-License-Identifier: BSD-3-Clause
"""Which functions of the package do the commands call? Runs every verb with every option, and judges the rest.

    python -m tests.seen_functions [--only TEXT]

The commands stand in ``commands.py``, each with the exit codes that are right; a simulated Baxter keeps real time, so
nothing else should run beside. Each function that no command calls is printed with its reason in ``reasons.yaml``.
Exit 1: a command ended otherwise, an option is given by no command, a function was not called and has no reason, or a
reason is for a function that there is not. ``--only`` runs the sections whose name contains a text, and judges nothing
else.

What is not looked at: laws (``@compiled``), which run as machine code that reports nothing (law tests and mutants are
about them), and methods of protocols, which have no body.
"""

from __future__ import annotations

import argparse
import os
import pkgutil
import sys
import tempfile
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path

from tests.seen_functions.instrument import PACKAGE, Calls
from tests.seen_functions.reasons import by_reason, not_needed, outdated, package_functions
from tests.support.paths import CHECKOUT

ENVIRONMENT = {
    "COLUMNS": "200",
    "MPLBACKEND": "Agg",
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONPATH": str(CHECKOUT),
}
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")


def main() -> int:
    """Runs the commands, or with ``--record FILE WORDS...`` one of them, whose calls go to the file."""
    calls = Calls()
    calls.install()
    for module in pkgutil.walk_packages([str(PACKAGE)], f"{PACKAGE.name}."):
        if not module.name.endswith("__main__"):
            import_module(module.name)
    from tests.seen_functions.run_commands import exit_of, options_not_given, run_sections

    if sys.argv[1:2] == ["--record"]:
        code = exit_of(sys.argv[3:])
        calls.write(Path(sys.argv[2]))
        return code
    only = read_options().only
    os.environ.update(ENVIRONMENT)
    # Whoever sits at a display would be shown windows.
    for name in DISPLAYS:
        os.environ.pop(name, None)
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        problems = run_sections(only, calls)
        os.chdir(CHECKOUT)
    return report(problems if only else [*problems, *options_not_given(), *judge(calls)])


def read_options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.seen_functions")
    parser.add_argument("--only", default="", metavar="TEXT", help="sections whose name contains this")
    return parser.parse_args()


def judge(calls: Calls) -> Iterable[str]:
    """Prints the functions that were not called under their reasons, and gives what is wrong with them."""
    functions, places = package_functions(), calls.places
    unseen = [function for function in functions if function.place not in places]
    grouped = by_reason(unseen)
    for reason, members in grouped.items():
        if reason is not None:
            print(f"\n{reason} ({len(members)})")
            print("\n".join(f"    {function.name}" for function in members))
    surplus = not_needed(functions, places)
    if surplus:
        print("\ncalled today, although a reason says why not:", *surplus, sep="\n    ")
    print(f"\n{len(functions)} functions, {len(functions) - len(unseen)} called, {len(unseen)} not")
    yield from (f"not called, and without a reason: {function.name}" for function in grouped.get(None, []))
    yield from outdated(functions)


def report(problems: list[str]) -> int:
    for problem in problems:
        print(problem, file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
