# SPDX-License-Identifier: BSD-3-Clause
"""Every case that was answered wrongly, in words: what was planted, what was said, and who came close."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchmarks.blind.judged import Cases, Judged, is_right


def wrong_list(cases: Cases) -> str:
    """Returns one paragraph per wrong case, block by block; after it the blocks' counts."""
    wrong = sorted((case for case in cases if not is_right(case)), key=lambda case: (case.block, case.name))
    return "\n\n".join(describe(case) for case in wrong) + "\n"


def describe(case: Judged) -> str:
    """Returns truth, answer and the first rivals of one case."""
    motion = f" {case.truth['motion']}" if "motion" in case.truth else ""
    head = f"{case.block}{motion} {case.name}  noise x{case.truth['noise_level']:g}"
    head += f", inertias {100 * case.truth['inertia_error']:.1f} % off"
    head += f"  {case.answer.processor_seconds:.1f} s {case.answer.memory:.0f} MB"
    lines = [head, *(f"  truth   {_truth(effect)}" for effect in case.effects)]
    if not case.effects:
        lines.append("  truth   nothing")
    if case.block == "D":
        lines.append(f"  pair    {' / '.join(case.truth['pair'])}, apart {case.truth['apart']:.0f}")
    lines.append(f"  answer  {case.answer.verdict}")
    for cause in case.answer.causes[:4]:
        lines += _cause(cause)
    if case.answer.errors and not case.answer.causes:
        lines.append(f"  stderr  {case.answer.errors.strip().splitlines()[-1][:200]}")
    return "\n".join(lines)


def _truth(effect: Mapping[str, Any]) -> str:
    also = f" (or {', '.join(effect['also'])})" if effect["also"] else ""
    where = ",".join(effect["joints"]) if len(effect["joints"]) < 4 else "all joints"
    return (
        f"{effect['effect']}{also} {where or '-'} at {effect['port']}, size {_short(effect.get('size'))}"
        f" ({_short(effect.get('size_with_inertias'))} with inertias): {_numbers(effect['parameters'])}"
    )


def _cause(cause: Mapping[str, Any]) -> list[str]:
    joints = ",".join(cause.get("joints", [])) or "-"
    line = (
        f"    cause {cause['effect']} {joints} at {cause.get('port')}, weight {_short(cause.get('weight'))}"
    )
    line += f", shrink {_short(cause.get('shrink'))}: {_numbers(cause.get('parameters', {}))}"
    lines = [line]
    same = [f"{one['effect']} {','.join(one.get('joints', []))}" for one in cause.get("equivalent", [])]
    if same:
        lines.append(f"      equivalent {'; '.join(same[:5])}")
    for rival in cause.get("rivals", [])[:3]:
        lines.append(
            f"      rival {rival['effect']} {','.join(rival.get('joints', []))}: {rival.get('lost_because', '')}"
        )
    return lines


def _numbers(parameters: Mapping[str, Any]) -> str:
    parts = []
    for key, symbols in list(parameters.items())[:3]:
        words = " ".join(f"{symbol}={_value(value)}" for symbol, value in symbols.items())
        parts.append(f"{key} {words}")
    return "; ".join(parts)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        spread = f"+-{_short(value['std'])}" if value.get("std") is not None else ""
        return f"{_short(value.get('value'))}{spread}"
    return _short(value)


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, (int, float)) else str(value)
