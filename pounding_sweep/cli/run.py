"""``run`` and ``plan``: a sweep file in, a cube or its cost out."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pounding_sweep.base.tables import number_text, print_json, print_pairs, print_table, seconds_text
from pounding_sweep.base.text import printable
from pounding_sweep.cli.app import AsJson, Folders, Quiet, SweepFile, Workers, app
from pounding_sweep.cli.records import print_read, read_as
from pounding_sweep.cli.reporting import FAILED, reporting, say, say_laws

if TYPE_CHECKING:
    from pounding_sweep.output.results import Outcome
    from pounding_sweep.run.sweep import Sweep

Accuracy = Annotated[
    float | None,
    typer.Option(metavar="ERROR", help="Relative error asked for, 1e-2 to 1e-6, in place of the file's step."),
]
SkipMissing = Annotated[
    bool, typer.Option("--skip-missing-records", help="Go on without the records that are not found.")
]


Laws = Annotated[
    list[str] | None,
    typer.Option("--law", metavar="LAW", help="Contact law in place of the file's, or FILE.py:NAME; may be repeated."),
]


def _load(sweep: Path, accuracy: float | None, skip: bool, folders: list[Path] | None, laws: list[str] | None) -> Sweep:
    """Read a sweep file; ask for `accuracy` and `laws` if they are given."""
    from pounding_sweep.run.sweep import load_sweep
    from pounding_sweep.spec.own_laws import LAW_GROUPS, find_law

    chosen = [name if name in LAW_GROUPS else find_law(name) for name in laws or ()]
    loaded = load_sweep(sweep, skip_missing_records=skip, folders=folders or None, laws=chosen or None)
    say_laws(loaded.spec.own_laws)
    if accuracy is None:
        return loaded
    from pounding_sweep.spec.spec import with_accuracy

    return loaded.from_spec(with_accuracy(loaded.spec, accuracy))


@app.command("run")
def run_command(
    sweep: SweepFile,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="OUT.nc", help="netCDF file for the cube; SWEEP.nc here by default."),
    ] = None,
    scheduler: Annotated[
        str, typer.Option(metavar="WHICH", help="threads, processes, synchronous, or a dask address: tcp://HOST:PORT.")
    ] = "threads",
    workers: Workers = None,
    laws: Laws = None,
    accuracy: Accuracy = None,
    folders: Folders = None,
    skip_missing: SkipMissing = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT.nc if it exists.")] = False,
    extend: Annotated[
        Path | None,
        typer.Option(metavar="OLD.nc", help="Take from this cube what it holds of the sweep, and run the rest."),
    ] = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Run a sweep, write its cube and print a summary."""
    named, out = out is not None, out or Path(f"{sweep.stem}.nc")
    with reporting(out) as said:
        from pounding_sweep.cli.progress import make_progress
        from pounding_sweep.output.audited import audit_sentence, audit_table
        from pounding_sweep.output.netcdf import check_output

        check_output(out, overwrite)  # strengths for ductilities, which reading may look for, take a while
        loaded = _load(sweep, accuracy, skip_missing, folders, laws)
        if not named:
            say(f"the cube is written to {out}; -o names another file")
        with closing(make_progress(quiet)) as progress:
            cube = loaded.write(
                out, scheduler=scheduler, workers=workers, overwrite=overwrite, progress=progress, extend=extend
            )
        outcome = loaded.last_outcome
        assert outcome is not None
        report = {
            "row": _row(loaded),
            "records": [read_as(record) for record in loaded.spec.records],
            **_run_report(loaded.spec.n_scenarios, outcome),
            "extended_from": json.loads(cube.frame.attrs.get("extended_from", "null")),
            "accuracy_choice": cube.frame.attrs.get("accuracy_choice", ""),
            "accuracy_numbers": json.loads(cube.frame.attrs.get("accuracy_numbers", "null")),
            "records_left_out": list(loaded.spec.records_left_out),
            "own_laws": {law.key: law.sha256 for law in loaded.spec.own_laws},
            "audit": audit_table(cube.frame),
            "audit_sentence": audit_sentence(cube.frame),
            "statuses": cube.tally.statuses(),
            "summary": cube.tally.summary(),
            "warnings": said,
            "cube": str(out),
        }
        if as_json:
            print_json(report)
        else:
            _print_run(report)
        if outcome.failures:
            from pounding_sweep.resume.checkpoint import parts_folder

            say(
                "failed: some scenarios have no result (status not_run). What is finished is kept in "
                f"{parts_folder(out)}; run again with --overwrite to make only the rest"
            )
            raise typer.Exit(FAILED)


@app.command("plan")
def plan_command(
    sweep: SweepFile,
    workers: Workers = None,
    laws: Laws = None,
    accuracy: Accuracy = None,
    folders: Folders = None,
    skip_missing: SkipMissing = False,
    as_json: AsJson = False,
) -> None:
    """Say what a sweep would run, and at what cost; nothing is run."""
    with reporting() as said:
        from pounding_sweep.engine.compile import still_to_compile
        from pounding_sweep.run.execute import check_scheduler

        n_workers = check_scheduler("threads", workers)
        loaded = _load(sweep, accuracy, skip_missing, folders, laws)
        plan = loaded.plan()
        found = {**plan.summary(n_workers), "workers": n_workers, "sweep_sha256": plan.digest}
        missing, seconds = still_to_compile(plan.shapes())
        found |= {"kernels_to_compile": missing, "compile_seconds": seconds}
        found["total_seconds"] = found["seconds"] + seconds / n_workers
        limit = float(plan.limit[plan.refused].min()) if plan.refused.any() else None
        found["largest_stable_step"] = limit
        found |= {"records_left_out": list(loaded.spec.records_left_out), "warnings": said}
        found["own_laws"] = {law.key: law.sha256 for law in loaded.spec.own_laws}
        found["row"] = _row(loaded)
        found["records"] = [read_as(record) for record in loaded.spec.records]
        if as_json:
            print_json(found)
            return
        print(printable(str(loaded.spec.title or sweep)))
        _print_row(found["row"])
        print_read(found["records"])
        rows = plan.rows(found)
        rows += _left_out(found)
        print_pairs(rows)


def _row(loaded: Sweep) -> list[dict[str, str]]:
    """Describe the row of a sweep, one entry per building and pair."""
    from pounding_sweep.spec.overview import overview

    return [{"name": name, "about": text} for name, text in overview(loaded.spec.scene)]


def _print_row(row: list[dict[str, str]]) -> None:
    """Print what is to be known of the row, one line per building and pair."""
    print_pairs([(each["name"], each["about"]) for each in row])
    print()


def _run_report(asked: int, outcome: Outcome) -> dict[str, Any]:
    """Collect the counts and times of a run."""
    unique = len(outcome.results.status)
    seconds = outcome.run_seconds
    return {
        "scenarios": {
            "asked": asked,
            "run": outcome.run,
            "reused": outcome.reused,
            "never_touching": outcome.untouched,
            "broadcast": asked - unique,
        },
        "scenarios_per_second": outcome.run / seconds if outcome.run and seconds > 0 else None,
        "run_seconds": seconds,
        "compile_seconds": outcome.compile_seconds,
        "kernels_compiled": outcome.compiled,
        "failures": outcome.failures,
    }


def _print_run(report: dict[str, Any]) -> None:
    counts = report["scenarios"]
    _print_row(report["row"])
    print_read(report["records"])
    rows = [
        [
            row["law"],
            row["pair"],
            number_text(row["peak_force"]),
            number_text(row["impacts_max"]),
            number_text(row["impacts_median"]),
            "-" if row["touching"] is None else f"{row['touching']}/{row['scenarios']}",
        ]
        for row in report["summary"]
    ]
    if rows:
        headings = ["law", "pair", "peak force kN", "impacts", "median", "touching"]
        print_table(headings, rows, right=(2, 3, 4, 5))
        print("impacts: most at one floor in one scenario; median: of that, over the scenarios that touch")
        print()
    run = f"{counts['asked']} asked, {counts['run']} run"
    if counts["reused"]:
        run += f", {counts['reused']} kept from an interrupted run"
    if report["extended_from"]:
        run += f", {report['extended_from']['scenarios_taken']} taken from {report['extended_from']['file']}"
    rate = report["scenarios_per_second"]
    compiled = report["kernels_compiled"]
    lines = [
        ("scenarios", run),
        ("not run", f"{counts['never_touching']} never touch, {counts['broadcast']} equal another scenario"),
        ("kernels", f"{compiled} compiled, ready after {seconds_text(report['compile_seconds'])}"),
        ("run", seconds_text(report["run_seconds"]) + (f", {number_text(rate)} scenarios per second" if rate else "")),
    ]
    if report["accuracy_choice"]:
        lines.append(("accuracy", report["accuracy_choice"]))
    lines += _left_out(report)
    lines += _audit_lines(report)
    for item in report["statuses"]:
        if item["remedy"]:
            lines.append((item["label"], f"{item['count']}: {item['meaning']}; {item['remedy']}"))
    print_pairs(lines)
    print(report["cube"])


def _left_out(report: dict[str, Any]) -> list[tuple[str, str]]:
    """Name the missing records that the sweep goes without."""
    names = report["records_left_out"]
    return [("left out", f"{', '.join(names)}: no such record at hand")] if names else []


def _audit_lines(report: dict[str, Any]) -> list[tuple[str, str]]:
    """Say what was audited, and the measured error of each output."""
    if not report["audit"]:
        return []
    errors = [
        f"{row['output']} {'infinite' if row['error_max'] is None else format(row['error_max'], '.1e')}"
        for row in report["audit"]
        if row["scenarios"]
    ]
    lines = [("audit", report["audit_sentence"])]
    return [*lines, ("errors", f"relative, up to: {', '.join(errors)}")] if errors else lines
