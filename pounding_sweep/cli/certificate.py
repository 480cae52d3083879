"""The restitution certificate on the command line: ``laws --restitution``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.base.tables import print_json, print_table

if TYPE_CHECKING:
    import xarray as xr


def print_certificate(nominal: str | None, as_json: bool) -> None:
    """Measure and print the restitution of every law, at the values of a list such as "0.2,0.6".

    Raises
    ------
    InputError
        The list holds something that is no number in [0, 1].
    """
    from pounding_sweep.accuracy.certificate import RESTITUTIONS, certify
    from pounding_sweep.cli.progress import make_progress
    from pounding_sweep.run.execute import check_scheduler

    restitutions = RESTITUTIONS if nominal is None else _numbers(nominal)
    found = certify(restitutions, workers=check_scheduler("threads", None), progress=make_progress())
    if as_json:
        print_json({**_summary(found), "rows": _rows(found)})
    else:
        _print_text(found)


def _numbers(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        msg = f"--e {text!r} is no list of restitutions; give numbers in [0, 1] with commas between, as 0.2,0.6"
        raise InputError(msg) from None


def _plain(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def _rows(found: xr.Dataset) -> list[dict[str, Any]]:
    """One row per law, basis and nominal restitution; None where the law is not valid there."""
    return [
        {
            "law": str(law),
            "basis": str(basis),
            "restitution": float(e),
            **{name: _plain(found[name].values[i, j, n]) for name in ("damping_number", "measured", "analytic")},
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
        return ["-" if np.isnan(value) else format(value + 0.0, spec) for value, spec in values]

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
