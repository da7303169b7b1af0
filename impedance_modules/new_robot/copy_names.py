# SPDX-License-Identifier: BSD-3-Clause
"""How the links and joints of a copy are called."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CopyNames:
    """Names of one copy of a description.

    Attributes:
        prefix: What stands before a name; empty where there is only one copy.
        prefixes: Those of all copies: a name that begins with one of them gets the copy's own instead.
    """

    prefix: str = ""
    prefixes: tuple[str, ...] = ()

    def __call__(self, name: str) -> str:
        """Names a link or joint of the copy by its name in the description."""
        own = next((one for one in self.prefixes if one and name.startswith(one)), "")
        return f"{self.prefix}{name.removeprefix(own)}"


def names_of_copies(limbs: tuple[str, ...], copies: int) -> dict[str, CopyNames]:
    """Gives each limb the names of its copy: with the limb's name in front where there are several copies."""
    if copies < 2:
        return dict.fromkeys(limbs, CopyNames())
    prefixes = tuple(f"{limb}_" for limb in limbs)
    return {limb: CopyNames(prefix, prefixes) for limb, prefix in zip(limbs, prefixes, strict=True)}
