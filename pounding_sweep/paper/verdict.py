"""The plain verdict that the report opens with: what of the paper is reproduced, what is not, and what can't be.

All of it is computed: shares of cells of the tables, verdicts on the conclusions, impossibilities of the tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from pounding_sweep.paper.checks import Finding
from pounding_sweep.paper.compare import CLOSE, Grid, paper_source, resolution, ungrouped
from pounding_sweep.paper.conclusions import HOLDS_SHARE, PARTLY_SHARE, Judgement, Support, Verdict
from pounding_sweep.paper.readings import READINGS

#: What the tables hold, in words, and the outputs that are it.
_CONTENTS: dict[int, dict[str, tuple[str, ...]]] = {
    3: {"displacements": ("displacement_max", "displacement_min")},
    4: {"peak forces": ("impact_force_max",), "impacts": ("impact_count",)},
    5: {"peak forces": ("impact_force_max",), "impacts": ("impact_count",)},
    6: {"energies transferred": ("energy_transfer_max", "energy_transfer_min")},
}
#: Verdicts of claims in this verdict's words.
_WORDS = {
    Verdict.HOLDS: "Reproduced",
    Verdict.PARTLY: "Reproduced in part",
    Verdict.FAILS: "Not reproduced",
    Verdict.UNTESTED: "Not tested",
}
#: When something is reproduced.
RULE = (
    f"Numbers of a table are reproduced where {HOLDS_SHARE:.0%} of those that are not zero in both are within "
    f"{CLOSE[-1]:.0%}, in part from {PARTLY_SHARE:.0%}; a conclusion is where it holds."
)


@dataclass(frozen=True)
class Reproduction:
    """What is reproduced, or is not, of one reading; or what can't be."""

    word: str
    reading: str
    items: tuple[str, ...]


def table_outcome(compared: xr.Dataset, names: Sequence[str], reading: str) -> Support:
    """Count the cells of a table of `side_by_side`, not zero in both, that a reading comes near to."""
    held = cases = 0
    for name in names:
        printed, own = (compared[name].sel(source=source).values for source in (paper_source(compared), reading))
        cell = np.isfinite(own) & ((printed != 0.0) | (np.abs(own) >= resolution(name)))
        near = np.abs(own - printed) <= CLOSE[-1] * np.abs(printed)
        held, cases = held + int((near & cell).sum()), cases + int(cell.sum())
    return Support(held, cases, f"{held} of {cases} numbers within {CLOSE[-1]:.0%}")


def verdict_of_all(
    compared: Mapping[int, xr.Dataset], judgements: Sequence[Judgement], findings: Sequence[Finding]
) -> list[Reproduction]:
    """Return the verdict; `compared` are the tables side by side by their number."""
    parts = []
    for reading in compared[3]["reading"].values.tolist():
        said: dict[Verdict, list[str]] = {verdict: [] for verdict in _WORDS}
        for number, contents in _CONTENTS.items():
            for what, names in contents.items():
                outcome = table_outcome(compared[number], names, reading)
                said[outcome.verdict].append(f"{what} of Table {number} ({outcome.numbers})")
        for one in judgements:
            if one.reading == reading:
                said[one.verdict].append(f"conclusion {one.conclusion.key}: {one.conclusion.text}")
        parts += [
            Reproduction(_WORDS[verdict], READINGS[reading].label, tuple(items) or ("nothing",))
            for verdict, items in said.items()
            if items or verdict is not Verdict.UNTESTED
        ]
    impossible = tuple(f"{one.title}: {one.printed}" for one in findings if one.impossible)
    return [*parts, Reproduction("Can't be", "in the paper itself", impossible)]


def opening_grid(parts: Sequence[Reproduction]) -> Grid:
    """Write the verdict, a row for each item."""
    rows = [
        [part.word, part.reading, item] if item is part.items[0] else ["", "", item]
        for part in parts
        for item in part.items
    ]
    return Grid("The verdict", ungrouped("verdict", "reading", "what"), rows)
