"""``laws`` and ``records``: what the registries hold."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pounding_sweep.cli.app import AsJson, app
from pounding_sweep.cli.reporting import reporting, say
from pounding_sweep.tables import print_json, print_table


@app.command("laws")
def laws_command(
    restitution: Annotated[
        bool, typer.Option("--restitution", help="Measure what restitution each law really gives, by the kernels.")
    ] = False,
    nominal: Annotated[
        str | None,
        typer.Option("--e", metavar="LIST", help="With --restitution: nominal values, as 0.2,0.6.", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the contact laws, or what restitution they really give."""
    with reporting():
        from pounding_sweep.cli.certificate import print_certificate
        from pounding_sweep.contact.laws import LAWS
        from pounding_sweep.contact.restitution import RELATIONS
        from pounding_sweep.errors import InputError

        if restitution:
            print_certificate(nominal, as_json)
            return
        if nominal is not None:
            msg = f"--e {nominal!r} says which restitutions to measure; give --restitution with it"
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
        print("paper: model number in Mate, Bakre & Jaiswal (2015).")


@app.command("records")
def records_command(
    folders: Annotated[
        list[Path] | None,
        typer.Option("--records", metavar="FOLDER", help="Folder of record files, instead of POUNDING_SWEEP_RECORDS."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List the records at hand and the known ones missing."""
    with reporting():
        from pounding_sweep.records import KNOWN_RECORDS, RECORDS_VARIABLE, STANDARD_GRAVITY, Record, list_records

        listed = list_records(folders or None)
        rows: list[dict[str, Any]] = [
            {
                "name": name,
                "pga_g": item.pga / STANDARD_GRAVITY,
                "dt": item.dt,
                "points": item.n_points,
                "duration": item.duration,
                "source": item.source,
            }
            for name, item in listed
            if isinstance(item, Record)
        ]
        unreadable = [{"name": name, "error": item} for name, item in listed if not isinstance(item, Record)]
        there = {name for name, _ in listed}
        missing: list[dict[str, Any]] = [
            {"name": entry.key, "description": entry.description, "files": list(entry.files), "place": _place(entry)}
            for entry in KNOWN_RECORDS.values()
            if entry.key not in there
        ]
        for item in unreadable:
            say(f"warning: {item['error']}")
        if as_json:
            print_json({"records": rows, "unreadable": unreadable, "missing": missing})
            return
        table = [
            [
                row["name"],
                f"{row['pga_g']:.4f}",
                f"{row['dt']:g}",
                str(row["points"]),
                f"{row['duration']:g}",
                row["source"] or "-",
            ]
            for row in rows
        ]
        print_table(["record", "PGA g", "dt s", "points", "duration s", "source"], table, right=(1, 2, 3, 4))
        if missing:
            print()
            print(f"Known by name, but not at hand; put the file into a folder named by {RECORDS_VARIABLE}:")
            print_table(
                ["record", "what", "file", "where to get it"],
                [[m["name"], m["description"], " or ".join(m["files"]), m["place"]] for m in missing],
            )


def _place(entry: Any) -> str:
    return f"{entry.place}, RSN {entry.rsn}" if entry.rsn else str(entry.place)
