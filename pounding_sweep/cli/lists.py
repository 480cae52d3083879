"""``laws``: what the registry holds."""

from __future__ import annotations

from typing import Annotated

import typer

from pounding_sweep.base.tables import print_json, print_table
from pounding_sweep.cli.app import AsJson, app
from pounding_sweep.cli.reporting import reporting


@app.command("laws")
def laws_command(
    restitution: Annotated[
        bool, typer.Option("--restitution", help="Measure what restitution each law really gives, by the kernels.")
    ] = False,
    nominal: Annotated[
        str | None,
        typer.Option(
            "--e", metavar="LIST", help="With --restitution or --check: nominal values, as 0.2,0.6.", show_default=False
        ),
    ] = None,
    check: Annotated[
        str | None,
        typer.Option(
            metavar="LAW", help="Check one law, FILE.py:NAME for one of your own, by kernels, solver and twin."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the contact laws, say what restitution they really give, or check one, such as one of your own."""
    with reporting():
        from pounding_sweep.base.errors import InputError
        from pounding_sweep.cli.certificate import print_certificate, print_check
        from pounding_sweep.model.laws import LAWS
        from pounding_sweep.model.rebound import RELATIONS

        if check is not None:
            if restitution:
                msg = "--check measures the restitution of its law too; leave out --restitution"
                raise InputError(msg)
            print_check(check, nominal, as_json)
            return
        if restitution:
            print_certificate(nominal, as_json)
            return
        if nominal is not None:
            msg = f"--e {nominal!r} says which restitutions to measure; give --restitution or --check with it"
            raise InputError(msg)
        rows = [
            {
                "key": law.key,
                "model": law.model,
                "title": law.title,
                "formula": law.formula,
                "stiffness_unit": law.stiffness_unit,
                "restitution": law.validity,
                "damping_number": law.number_text,
                "relation": RELATIONS[law.relation].text if law.relation else "",
                "source": law.reference,
            }
            for law in LAWS.values()
        ]
        if as_json:
            print_json(rows)
            return
        headings = {
            "key": "law",
            "model": "paper",
            "formula": "force (kN)",
            "stiffness_unit": "stiffness k",
            "restitution": "restitution e",
            "damping_number": "damping number",
            "source": "source",
        }
        print_table(list(headings.values()), [[row[name] or "-" for name in headings] for row in rows])
        print()
        print("d: penetration (m), v: its rate (m/s), v0: v at the touch, m: effective mass of the pair (t).")
        print("paper: model number in Mate, Bakre & Jaiswal (2015). Laws of your own: FILE.py:NAME, see --check.")
