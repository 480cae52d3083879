"""``laws``: what the registry holds."""

from __future__ import annotations

from typing import Annotated

from typer import Option

from pounding_sweep.base.errors import InputError
from pounding_sweep.base.text import print_json, print_table
from pounding_sweep.cli.app import AsJson, command
from pounding_sweep.cli.reporting import reporting

#: What is listed of each law, and its heading in the table.
_COLUMNS = {
    "key": "law",
    "model": "paper",
    "title": "",
    "formula": "force (kN)",
    "stiffness_unit": "stiffness k",
    "validity": "restitution e",
    "number_text": "damping number",
    "relation": "",
    "reference": "source",
}
#: What JSON calls them, where that is not the name of the attribute.
_JSON = {"validity": "restitution", "number_text": "damping_number", "reference": "source"}


@command("laws")
def laws_command(
    restitution: Annotated[
        bool, Option("--restitution", help="Measure what restitution each law really gives, by the kernels.")
    ] = False,
    nominal: Annotated[
        str | None, Option("--e", metavar="LIST", help="With --restitution or --check: nominal values, as 0.2,0.6.")
    ] = None,
    check: Annotated[
        str | None,
        Option(metavar="LAW", help="Check one law, FILE.py:NAME for one of your own, by kernels, solver and twin."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the contact laws, say what restitution they really give, or check one, such as one of your own."""
    with reporting():
        from pounding_sweep.cli.certificate import print_certificate, print_check
        from pounding_sweep.model.laws import LAWS
        from pounding_sweep.model.rebound import RELATIONS

        if check is not None:
            if restitution:
                raise InputError("--check measures the restitution of its law too; leave out --restitution")
            print_check(check, nominal, as_json)
            return
        if restitution:
            print_certificate(nominal, as_json)
            return
        if nominal is not None:
            raise InputError(
                f"--e {nominal!r} says which restitutions to measure; give --restitution or --check with it"
            )
        rows = [{name: str(getattr(law, name) or "") for name in _COLUMNS} for law in LAWS.values()]
        for row in rows:
            row["relation"] = RELATIONS[row["relation"]].text if row["relation"] else ""
        if as_json:
            print_json([{_JSON.get(name, name): text for name, text in row.items()} for row in rows])
            return
        shown = {name: heading for name, heading in _COLUMNS.items() if heading}
        print_table(list(shown.values()), [[row[name] or "-" for name in shown] for row in rows])
        print()
        print("d: penetration (m), v: its rate (m/s), v0: v at the touch, m: effective mass of the pair (t).")
        print("paper: model number in Mate, Bakre & Jaiswal (2015). Laws of your own: FILE.py:NAME, see --check.")
