"""The restitution certificate on the command line: ``laws --restitution`` and ``laws --check``."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from pounding_sweep.base.text import finite, print_json, print_pairs, print_table
from pounding_sweep.cli.app import numbers_of
from pounding_sweep.cli.reporting import FAILED, say_laws
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.rebound import RELATIONS

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.accuracy.law_check import LawCheck

#: What the check of a law tells of each restitution.
_CHECKED = ("damping_number", "measured", "solved", "analytic")


def print_certificate(nominal: str | None, as_json: bool) -> None:
    """Measure and print the restitution of every law, at the values of a list such as "0.2,0.6"."""
    from pounding_sweep.accuracy.certificate import certify, deviation
    from pounding_sweep.cli.progress import make_progress
    from pounding_sweep.run.execute import check_scheduler

    table = certify(_restitutions(nominal), workers=check_scheduler("threads", None), progress=make_progress())
    off = deviation(table)
    worst = off.isel(off.argmax(...))
    place = {name: worst[name].item() for name in ("law", "basis", "restitution")}
    summary = {name: table.attrs[name] for name in ("method", "steps_per_contact")}
    if as_json:
        print_json({**summary, "largest_deviation": {"value": worst.item(), **place}, "rows": _rows(table)})
        return
    lines = []
    for law in table.law.values:
        takes = get_law(str(law)).takes_restitution
        for e in table.restitution.values if takes else table.restitution.values[:1]:
            published, realised = (table.sel(law=law, basis=basis, restitution=e) for basis in table.basis.values)
            cells = [_cell(published.damping_number, ".6g"), _cell(published.measured, ".7f")]
            cells += [_cell(published.analytic, ".7f"), _cell(realised.damping_number, ".6g")]
            lines.append([str(law), f"{e:g}" if takes else "any", *cells, _cell(realised.measured, ".7f")])
    headings = ["law", "nominal e", "published damping", "measured e", "closed form", "realised damping", "measured e"]
    print_table(headings, lines, right=range(1, len(headings)))
    print()
    print("Two free masses, e = velocity of parting over velocity of approach, measured through the kernels.")
    print("damping: the law's damping number by its published formula, and with restitution_basis = 'realised'.")
    print(
        f"Largest |measured - closed form|: {worst.item():.1e} ({place['law']}, {place['basis']}, "
        f"e = {place['restitution']:g}), {summary['method']}, {summary['steps_per_contact']} steps per contact."
    )


def print_check(name: str, nominal: str | None, as_json: bool) -> None:
    """Check one law and print the result; exit with a failure where it is not what its formulas say."""
    from pounding_sweep.accuracy.law_check import check_law
    from pounding_sweep.cli.progress import make_progress
    from pounding_sweep.model.laws import find_law

    law = find_law(name)
    say_laws([law] if law.source else [])
    check = check_law(law, _restitutions(nominal), progress=make_progress())
    if as_json:
        about = {**law.described, "number": law.number_text, "sha256": law.sha256 if law.source else None}
        rest = {name: getattr(check, name) for name in ("twin", "impacts", "faults", "notes")}
        print_json({"law": about, "rows": _rows(check.certificate, "solved"), **rest})
    else:
        _print_check(check)
    if check.faults:
        raise typer.Exit(FAILED)


def _print_check(check: LawCheck) -> None:
    law, table = check.law, check.certificate.isel(law=0)
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
    lines = []
    for basis in table.basis.values:
        for e in table.restitution.values:
            row = table.sel(basis=basis, restitution=e)
            if row.measured.notnull():
                forms = zip(_CHECKED, (".6g", ".9f", ".9f", ".9f"), strict=True)
                lines.append([str(basis), f"{e:g}", *(_cell(row[name], form) for name, form in forms)])
    print_table(headings, lines, right=range(1, len(headings)))
    print()
    print(
        "Two free masses, e = velocity of parting over velocity of approach: by the kernels, by an independent solver"
    )
    print("of the formulas (DOP853), and by the closed form.")
    worst = max(check.twin, key=lambda name: check.twin[name])
    print(f"Kernel and its twin in plain Python, {check.impacts} impacts: up to {check.twin[worst]:.1e} ({worst}).")
    for fault in check.faults:
        print(f"fault: {fault}")
    if not check.faults:
        print("All agree: the kernels do what the formulas say.")
    for note in check.notes:
        print(f"note: {note}.")


def _cell(value: xr.DataArray, form: str) -> str:
    number = value.item()
    return "-" if np.isnan(number) else format(number + 0.0, form)


def _restitutions(nominal: str | None) -> Sequence[float]:
    from pounding_sweep.accuracy.certificate import RESTITUTIONS

    form = "restitutions; give numbers in [0, 1] with commas between, as 0.2,0.6"
    return RESTITUTIONS if nominal is None else numbers_of(nominal, "--e", form)


def _rows(table: xr.Dataset, *more: str) -> list[dict[str, Any]]:
    """One row per law, basis and nominal restitution; None where the law is not valid there."""
    places = itertools.product(*(table[name].values.tolist() for name in ("law", "basis", "restitution")))
    columns = {name: table[name].values.ravel().tolist() for name in (*_CHECKED[:2], "analytic", *more)}
    return [
        {"law": law, "basis": basis, "restitution": e} | {name: finite(values[i]) for name, values in columns.items()}
        for i, (law, basis, e) in enumerate(places)
    ]
