"""The restitution certificate on the command line: ``laws --restitution`` and ``laws --check``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from pounding_sweep.base.tables import finite, print_json, print_pairs, print_table
from pounding_sweep.cli.app import numbers_of
from pounding_sweep.cli.reporting import FAILED, say_laws
from pounding_sweep.model.rebound import RELATIONS

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.accuracy.law_check import LawCheck

#: What the check of a law tells of each restitution.
_CHECKED = ("damping_number", "measured", "solved", "analytic")


def print_certificate(nominal: str | None, as_json: bool) -> None:
    """Measure and print the restitution of every law, at the values of a list such as "0.2,0.6"."""
    from pounding_sweep.accuracy.certificate import certify
    from pounding_sweep.cli.progress import make_progress
    from pounding_sweep.run.execute import check_scheduler

    found = certify(_restitutions(nominal), workers=check_scheduler("threads", None), progress=make_progress())
    if as_json:
        print_json({**_summary(found), "rows": _rows(found)})
    else:
        _print_text(found)


def print_check(name: str, nominal: str | None, as_json: bool) -> None:
    """Check one law and print what was found; exit with a failure where it is not what its formulas say."""
    from pounding_sweep.accuracy.law_check import check_law
    from pounding_sweep.cli.progress import make_progress
    from pounding_sweep.spec.own_laws import find_law

    law = find_law(name)
    say_laws([law] if law.source else [])
    found = check_law(law, _restitutions(nominal), progress=make_progress())
    if as_json:
        print_json(
            {
                "law": {**law.described, "number": law.number_text, "sha256": law.sha256 if law.source else None},
                "rows": _rows(found.certificate, "solved"),
                "twin": found.twin,
                "impacts": found.impacts,
                "faults": found.faults,
                "notes": found.notes,
            }
        )
    else:
        _print_check(found)
    if found.faults:
        raise typer.Exit(FAILED)


def _print_check(found: LawCheck) -> None:
    law, table = found.law, found.certificate
    relation = RELATIONS[law.relation].text if law.relation else "none known: it may depend on the approach velocity"
    factor = f", with {law.relation_factor:.6g} times the damping number" * (law.relation_factor != 1.0)
    print_pairs(
        [
            ("law", f"{law.key}: {law.title}"),
            ("force (kN)", law.formula),
            ("slopes", f"dE/dd = {law.elastic_slope}" + f", dB/dd = {law.damper_slope}" * bool(law.damper)),
            ("stiffness", f"k in {law.stiffness_unit}"),
            ("damping", f"{law.damping}, {law.number_text}" if law.damper else "none"),
            ("restitution", f"{law.validity}; closed form: {relation + factor if law.damper else 'e = 1'}"),
        ]
    )
    print()
    headings = ["basis", "asked e", "damping number", "gives (kernels)", "by a solver", "closed form"]
    columns = [(table[name], form) for name, form in zip(_CHECKED, (".6g", ".9f", ".9f", ".9f"), strict=True)]
    lines = [
        [str(basis), f"{e:g}", *(_cell(column.values[0, j, i], form) for column, form in columns)]
        for j, basis in enumerate(table.basis.values)
        for i, e in enumerate(table.restitution.values)
        if np.isfinite(table.measured.values[0, j, i])
    ]
    print_table(headings, lines, right=range(1, len(headings)))
    print()
    print(
        "Two free masses, e = velocity of parting over velocity of approach: by the kernels, by an independent solver"
    )
    print("of the formulas (DOP853), and by the closed form.")
    worst = max(found.twin, key=lambda name: found.twin[name])
    print(f"Kernel and its twin in plain Python, {found.impacts} impacts: up to {found.twin[worst]:.1e} ({worst}).")
    for fault in found.faults:
        print(f"fault: {fault}")
    if not found.faults:
        print("All agree: the kernels do what the formulas say.")
    for note in found.notes:
        print(f"note: {note}.")


def _cell(value: float, form: str) -> str:
    return "-" if np.isnan(value) else format(value + 0.0, form)


def _restitutions(nominal: str | None) -> Sequence[float]:
    from pounding_sweep.accuracy.certificate import RESTITUTIONS

    form = "restitutions; give numbers in [0, 1] with commas between, as 0.2,0.6"
    return RESTITUTIONS if nominal is None else numbers_of(nominal, "--e", form)


def _rows(found: xr.Dataset, *more: str) -> list[dict[str, Any]]:
    """One row per law, basis and nominal restitution; None where the law is not valid there."""
    return [
        {
            "law": str(law),
            "basis": str(basis),
            "restitution": float(e),
            **{name: finite(float(found[name].values[i, j, n])) for name in (*_CHECKED[:2], "analytic", *more)},
        }
        for i, law in enumerate(found.law.values)
        for j, basis in enumerate(found.basis.values)
        for n, e in enumerate(found.restitution.values)
    ]


def _summary(found: xr.Dataset) -> dict[str, Any]:
    """How it was measured, and the largest deviation with its place."""
    from pounding_sweep.accuracy.certificate import deviation

    off = deviation(found)
    law, basis, e = np.unravel_index(int(np.nanargmax(off.values)), off.shape)
    return {
        "method": found.attrs["method"],
        "steps_per_contact": found.attrs["steps_per_contact"],
        "largest_deviation": {
            "value": float(off.values[law, basis, e]),
            "law": str(off.law.values[law]),
            "basis": str(off.basis.values[basis]),
            "restitution": float(off.restitution.values[e]),
        },
    }


def _print_text(found: xr.Dataset) -> None:
    from pounding_sweep.model.laws import get_law

    published, realised = found.sel(basis="published"), found.sel(basis="realised")

    def cells(i: int, n: int) -> list[str]:
        columns = [
            (published.damping_number, ".6g"),
            (published.measured, ".7f"),
            (published.analytic, ".7f"),
            (realised.damping_number, ".6g"),
            (realised.measured, ".7f"),
        ]
        values = [(column.values[i, n], spec) for column, spec in columns]
        return [_cell(value, spec) for value, spec in values]

    lines = []
    for i, law in enumerate(found.law.values):
        if get_law(str(law)).takes_restitution:
            lines += [[str(law), f"{e:g}", *cells(i, n)] for n, e in enumerate(found.restitution.values)]
        else:
            lines.append([str(law), "any", *cells(i, 0)])
    headings = ["law", "nominal e", "published damping", "measured e", "closed form", "realised damping", "measured e"]
    print_table(headings, lines, right=range(1, len(headings)))
    summary = _summary(found)
    worst = summary["largest_deviation"]
    print()
    print("Two free masses, e = velocity of parting over velocity of approach, measured through the kernels.")
    print("damping: the law's damping number by its published formula, and with restitution_basis = 'realised'.")
    print(
        f"Largest |measured - closed form|: {worst['value']:.1e} ({worst['law']}, {worst['basis']}, "
        f"e = {worst['restitution']:g}), {summary['method']}, {summary['steps_per_contact']} steps per contact."
    )
