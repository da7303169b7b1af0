# SPDX-License-Identifier: BSD-3-Clause
"""What each rule of the diagnosis is worth: cases asked without it, where it makes a difference.

`watch_all` asks every case once with all rules. Each function whose result a rule can change is evaluated a second
time without the rule, and the rules whose result differed are written beside the answer. `ask_without` asks each such
case again without that rule; where a rule changed nothing on the way, the answer without it is the answer with it.
Of several rules at once that does not hold (one may do what another did): every case is asked without them, and
`ask_all` is enough before. All go on where they were stopped. Each diagnosis runs in a process of its own:

    python -m benchmarks.wide.ablation watch FILE -- WORDS     `impedance WORDS`, rules that mattered written to FILE
    python -m benchmarks.wide.ablation without RULE -- WORDS   `impedance WORDS` without a rule, or RULE,RULE
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmarks.blind.run import ask_waiting
from benchmarks.wide.rules import RULES, LeftOut, Rule, rules_named
from benchmarks.wide.run import CASES, Selection, names_of, run_case
from benchmarks.wide.thresholds import set_everywhere

DIAGNOSIS = "impedance_modules.diagnosis"
PROGRAM = "benchmarks.wide.ablation"
WITH_ALL = "all"
MATTERED = ".rules.json"
PARTS = ("term", "model", "model_fit", "words", "effect", "equal", "equivalent", "verdict", "causes")
"""Attributes of a result by which two are compared."""
TIME_LIMIT = 600.0
"""Processor time of a watched diagnosis [s]: it evaluates many things twice."""


@dataclass(frozen=True)
class Place:
    """Where a number or function stands: an attribute of a module or of a class in it."""

    holder: ModuleType | type
    name: str

    @classmethod
    def of(cls, text: str) -> Place:
        """Reads MODULE:NAME or MODULE:CLASS.NAME."""
        module, _, path = text.partition(":")
        holder: Any = importlib.import_module(f"{DIAGNOSIS}.{module}")
        *classes, name = path.split(".")
        for one in classes:
            holder = getattr(holder, one)
        return cls(holder, name)

    def set(self, value: Any) -> list[tuple[Any, Any]]:
        """Sets it, also in modules that took it from where it is defined; returns what to set back."""
        return set_everywhere(self.holder, self.name, value)

    def restore(self, taken: Sequence[tuple[Any, Any]]) -> None:
        """Sets back what `set` returned."""
        for holder, before in taken:
            setattr(holder, self.name, before)


@contextmanager
def left_out(rule: Rule) -> Iterator[None]:
    """The diagnosis without a rule."""
    place = Place.of(rule.place)
    taken = place.set(rule.without)
    try:
        yield
    finally:
        place.restore(taken)


@contextmanager
def watched(rules: Sequence[Rule]) -> Iterator[set[str]]:
    """The diagnosis, in which decisions are evaluated again without each rule that can change them.

    Yields:
        Names of the rules without which a result differed, as they are found.
    """
    mattered: set[str] = set()
    held: list[tuple[Place, list[tuple[Any, Any]]]] = []
    deciding = Deciding(mattered)
    for text in dict.fromkeys(place for rule in rules for place in rule.shows_in):
        place = Place.of(text)
        some = [rule for rule in rules if text in rule.shows_in]
        held.append((place, place.set(deciding.compared(getattr(place.holder, place.name), text, some))))
    try:
        yield mattered
    finally:
        for place, taken in reversed(held):
            place.restore(taken)


class Deciding:
    """Compares what a function decides with what it would without some rules; one decision at a time."""

    def __init__(self, mattered: set[str]) -> None:
        """Takes where the names of rules go that made a difference."""
        self._mattered, self._busy = mattered, False

    def compared(self, inner: Callable[..., Any], text: str, rules: Sequence[Rule]) -> Callable[..., Any]:
        """The function, which also asks itself without the rules; within one that does, it only decides."""

        @wraps(inner)
        def decided(*arguments: Any, **options: Any) -> Any:
            found = inner(*arguments, **options)
            if self._busy:
                return found
            self._busy = True
            try:
                for rule in rules:
                    if shown(_without(rule, text, inner, arguments, options)) != shown(found):
                        self._mattered.add(rule.name)
            finally:
                self._busy = False
            return found

        return decided


def _without(
    rule: Rule, text: str, inner: Callable[..., Any], arguments: tuple[Any, ...], options: dict[str, Any]
) -> Any:
    """What a function at a place decides without a rule, which may be the function itself."""
    if rule.place == text:
        return rule.without(*arguments, **options)
    with left_out(rule):
        return inner(*arguments, **options)


def shown(result: Any) -> Any:
    """What of a result can be compared: names of causes, verdicts, whether a test passed."""
    if isinstance(result, str):
        return "reason" if " " in result else result
    if result is None or isinstance(result, bool | int | float):
        return result
    if isinstance(result, list | tuple):
        return tuple(shown(part) for part in result)
    if hasattr(result, "key"):
        return result.key
    parts = [getattr(result, name) for name in PARTS if hasattr(result, name)]
    if parts:
        return tuple(part if isinstance(part, str) else shown(part) for part in parts)
    return type(result).__name__


def watch_all(
    out: Path, answers: Path, blocks: Sequence[str], jobs: int, tell: Callable[[str], None]
) -> None:
    """Asks every case of some blocks once with all rules, and writes which of them mattered."""

    def watching(answer: Path) -> list[str]:
        return [PROGRAM, "watch", str(answer.with_suffix(MATTERED)), "--"]

    folder = answers / WITH_ALL
    # Those that `ask_all` has answered were not watched: they are asked again.
    names = [name for name in names_of(out, blocks) if not (folder / f"{name}{MATTERED}").exists()]
    _ask(out, folder, names, watching, jobs, tell, again=True)


def ask_all(out: Path, answers: Path, blocks: Sequence[str], jobs: int, tell: Callable[[str], None]) -> None:
    """Asks every case of some blocks once with all rules."""
    _ask(out, answers / WITH_ALL, names_of(out, blocks), lambda _: [], jobs, tell)


def ask_without(
    groups: Sequence[LeftOut],
    out: Path,
    answers: Path,
    blocks: Sequence[str],
    jobs: int,
    tell: Callable[[str], None],
) -> None:
    """Asks the cases in which a rule mattered again without it, one rule after the other; of several, every case."""
    for left in groups:
        names = [name for name in names_of(out, blocks) if asked_without(left, answers, name)]
        words = [PROGRAM, "without", left.name, "--"]
        _ask(out, answers / left.name, names, lambda _, w=words: w, jobs, _named(tell, left.name))


def _named(tell: Callable[[str], None], name: str) -> Callable[[str], None]:
    return lambda line: tell(f"{name} {line}")


def asked_without(left: LeftOut, answers: Path, name: str) -> bool:
    """Whether a case has to be asked without some rules."""
    return len(left.rules) > 1 or left.name in mattered_in(answers / WITH_ALL, name)


def mattered_in(folder: Path, name: str) -> list[str]:
    """Names of the rules that mattered in a case; none where it was not watched, or got no answer."""
    path = folder / f"{name}{MATTERED}"
    return list(json.loads(path.read_text())) if path.exists() else []


def _ask(
    out: Path,
    folder: Path,
    names: Sequence[str],
    program: Callable[[Path], Sequence[str]],
    jobs: int,
    tell: Callable[[str], None],
    *,
    again: bool = False,
) -> None:
    """Asks some cases; ``program`` says for the path of an answer what stands for ``impedance``."""
    folder.mkdir(parents=True, exist_ok=True)

    def one(name: str) -> str:
        answer = (folder / f"{name}.json").resolve()
        record = run_case(out / CASES / name, Selection(timeout=TIME_LIMIT), answer, program(answer))
        (folder / f"{name}.run.json").write_text(json.dumps(record) + "\n")
        return f"{name} exit {record['exit']} {record['processor_seconds']:.1f} s"

    ask_waiting(names, folder, one, tell, again=again, jobs=jobs)


def main() -> None:
    """Runs `impedance` while rules are watched, or without one."""
    at = sys.argv.index("--")
    how, what = sys.argv[1:at]
    sys.argv = ["impedance", *sys.argv[at + 1 :]]
    from impedance_modules.cli.main import main as impedance

    importlib.import_module(f"{DIAGNOSIS}.diagnose")
    if how == "without":
        with ExitStack() as stack:
            for rule in rules_named([what])[0].rules:
                stack.enter_context(left_out(rule))
            impedance()
        return
    with watched(RULES) as mattered:
        try:
            impedance()
        finally:
            Path(what).write_text(json.dumps(sorted(mattered)) + "\n")


if __name__ == "__main__":
    main()
