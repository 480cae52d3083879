"""The command line: parse, call, print.

Data go to stdout; progress, warnings and errors to stderr. Exit codes: 0, 1
failed, 2 wrong usage or bad input, 130 interrupted.
"""

from __future__ import annotations

import os
import signal
import sys
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pounding_sweep.figures import FIGURES
from pounding_sweep.tables import bytes_text, number_text, print_json, print_pairs, print_table, seconds_text

if TYPE_CHECKING:
    from pounding_sweep.sweep.execute import Outcome

NAME = "pounding-sweep"
FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130

app = typer.Typer(
    name=NAME,
    help="Parametric sweeps of seismic pounding between adjacent buildings. Units: kN, t, m, s.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

SweepFile = Annotated[Path, typer.Argument(metavar="SWEEP.toml", help="Sweep file.", show_default=False)]
CubeFile = Annotated[Path, typer.Argument(metavar="CUBE.nc", help="Cube made by 'run'.", show_default=False)]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON value instead of text.")]
Workers = Annotated[
    int | None, typer.Option("--workers", metavar="N", help="Threads or processes; one per core by default.")
]


def main() -> None:
    """Run the command line of this process and leave with its exit code."""
    app(prog_name=NAME)


def _version(wanted: bool) -> None:
    """Print the version and leave, if `wanted`."""
    if not wanted:
        return
    from importlib.metadata import PackageNotFoundError, version

    try:
        print(f"{NAME} {version(NAME)}")
    except PackageNotFoundError:  # run from a source tree that is not installed
        print(f"{NAME} (version unknown: not installed)")
    raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", is_eager=True, callback=_version, help="Print the version and leave.")
    ] = False,
) -> None:
    del version  # its callback has seen to it


@app.command("run")
def run_command(
    sweep: SweepFile,
    out: Annotated[
        Path, typer.Option("-o", "--output", metavar="OUT.nc", help="netCDF file for the cube.", show_default=False)
    ],
    scheduler: Annotated[
        str,
        typer.Option(metavar="WHICH", help="threads, processes, synchronous, or a dask address: tcp://HOST:PORT."),
    ] = "threads",
    workers: Workers = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT.nc if it exists.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Show no progress.")] = False,
    as_json: AsJson = False,
) -> None:
    """Run a sweep, write its cube and print a summary."""
    with _reporting(out) as said:
        from pounding_sweep.progress import make_progress
        from pounding_sweep.sweep.summary import status_table, summary_table
        from pounding_sweep.sweep.sweep import load_sweep

        job = load_sweep(sweep)
        progress = make_progress(quiet)
        try:
            cube = job.run(out, scheduler=scheduler, workers=workers, overwrite=overwrite, progress=progress)
        finally:
            progress.close()
        outcome = job.last_outcome
        assert outcome is not None
        report = {
            **_run_report(job.spec.n_scenarios, outcome),
            "statuses": status_table(cube),
            "summary": summary_table(cube),
            "warnings": said,
            "cube": str(out),
        }
        if as_json:
            print_json(report)
        else:
            _print_run(report)
        if outcome.failures:
            _say(
                "failed: some scenarios have no result (status not_run). What is finished is kept in "
                f"{_parts(out)}; run again with --overwrite to make only the rest"
            )
            raise typer.Exit(FAILED)


@app.command("plan")
def plan_command(sweep: SweepFile, workers: Workers = None, as_json: AsJson = False) -> None:
    """Say what a sweep would run, and at what cost; nothing is run."""
    with _reporting():
        from pounding_sweep.cube.variables import Status
        from pounding_sweep.sweep.execute import check_scheduler
        from pounding_sweep.sweep.sweep import load_sweep

        n_workers = check_scheduler("threads", workers)
        job = load_sweep(sweep)
        plan = job.plan()
        found = {**plan.summary(n_workers), "workers": n_workers, "sweep_sha256": plan.digest}
        limit = float(plan.limit[plan.refused].min()) if plan.refused.any() else None
        found["largest_stable_step"] = limit
        if as_json:
            print_json(found)
            return
        print(job.spec.title or sweep)
        axes = " x ".join(f"{len(values)} {name}" for name, values in job.spec.axes.items())
        steps = ", ".join(f"{count} ({name})" for name, count in found["steps"].items())
        rows = [
            ("axes", axes or f"{found['asked']} listed cases"),
            ("scenarios", f"{found['asked']} asked, at most {found['at_most']} to run"),
            ("", "(those that never touch are left out once the run without pounding is known)"),
            ("kernels", f"{found['kernels']}"),
            ("steps", f"{steps} per scenario"),
            ("time", f"about {seconds_text(found['seconds'])} with {n_workers} workers, compilation of kernels apart"),
            ("cube", f"{bytes_text(found['cube_bytes'])} of values in memory"),
        ]
        if limit is not None:
            remedy = f"{Status.BEYOND_STABILITY_LIMIT.remedy}; every scenario is stable at dt <= {limit:.3g} s"
            rows.insert(3, ("refused", f"{found['refused']}: beyond the stability limit; {remedy}"))
        print_pairs(rows)


@app.command("info")
def info_command(cube: CubeFile) -> None:
    """Describe a cube: axes, variables, statuses, records."""
    with _reporting():
        from pounding_sweep.cube.describe import describe
        from pounding_sweep.cube.write import open_cube

        with open_cube(cube) as found:
            print(describe(found))


@app.command("plot")
def plot_command(
    cube: CubeFile,
    kind: Annotated[str, typer.Argument(metavar="FIGURE", help=f"One of: {', '.join(FIGURES)}.", show_default=False)],
    out: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="PNG, SVG or PDF file.", show_default=False)
    ],
) -> None:
    """Draw a figure of a cube into a file."""
    with _reporting():
        from pounding_sweep.cube.write import open_cube
        from pounding_sweep.figures import plot

        with open_cube(cube) as found:
            print(plot(found, kind, out))


@app.command("laws")
def laws_command(as_json: AsJson = False) -> None:
    """List the contact laws."""
    with _reporting():
        from pounding_sweep.contact.laws import LAWS

        rows = [
            {
                "key": law.key,
                "model": law.model,
                "title": law.title,
                "formula": law.formula,
                "stiffness_unit": law.stiffness_unit,
                "restitution": law.validity,
                "damping_number": law.number_text,
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
    with _reporting():
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
            _say(f"warning: {item['error']}")
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


@app.command("doctor")
def doctor_command(as_json: AsJson = False) -> None:
    """Show versions, processor, kernel cache, problems."""
    with _reporting():
        from pounding_sweep.doctor import diagnose

        found = diagnose()
        if as_json:
            print_json(found)
            return
        cpu, cache = found["processor"], found["kernel_cache"]
        bits = cpu["vector_bits"]
        width = f"{bits} bit, {bits // 64} numbers at a time (guessed from the features)" if bits else "unknown"
        folders = found["record_folders"]
        print("Versions")
        print_pairs([(name, text or "not installed") for name, text in found["versions"].items()], indent=2)
        print("Processor")
        print_pairs(
            [
                ("system", found["system"]),
                ("name", cpu["name"]),
                ("vectors", width),
                ("scenarios", f"{cpu['lanes_per_kernel']} side by side in a kernel"),
                ("cores", f"{cpu['cores_usable']} usable of {cpu['cores']}"),
                ("features", " ".join(cpu["features"])),
            ],
            indent=2,
        )
        print("Kernel cache")
        kernels = f"{cache['kernels']}, {bytes_text(cache['bytes'])}"
        print_pairs([("folder", cache["folder"]), ("kernels", kernels)], indent=2)
        print("Record folders")
        print_pairs([(item["folder"], f"{item['files']} record files") for item in folders], indent=2)
        if not folders:
            print("  none (POUNDING_SWEEP_RECORDS is not set); el_centro is always there")
        print("Problems" if found["problems"] else "No problems found")
        for problem in found["problems"]:
            print(f"  {problem}")


# ---------------------------------------------------------------------------------------------------------------------
# errors and warnings


@contextmanager
def _reporting(out: Path | None = None) -> Iterator[list[str]]:
    """Turn errors into one message and an exit code; gives the list of warnings said so far.

    `out` is the cube of a run, whose finished chunks outlast an interruption.
    """
    from pounding_sweep.errors import InputError, OutputError, PoundingSweepError

    said: list[str] = []

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        text = str(message)
        if text not in said:
            said.append(text)
            _say(f"warning: {text}")

    with warnings.catch_warnings():
        warnings.showwarning = show
        try:
            yield said
            sys.stdout.flush()
        except PoundingSweepError as error:
            _say(f"error: {error}")
            raise typer.Exit(BAD_INPUT if isinstance(error, InputError | OutputError) else FAILED) from None
        except KeyboardInterrupt:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # a second Ctrl-C doesn't wait for the chunks under way
            _say(f"interrupted{_kept(out)}")
            raise typer.Exit(INTERRUPTED) from None
        except (typer.Exit, BrokenPipeError):
            raise
        except Exception as error:  # a fault of the package, or of the machine: the traceback is for the report
            traceback.print_exception(error)
            _say(f"failed: {type(error).__name__}: {error}{_kept(out)}")
            raise typer.Exit(FAILED) from None


def _say(text: str) -> None:
    print(f"{NAME}: {text}", file=sys.stderr, flush=True)


def _parts(out: Path) -> Path:
    """Folder in which a run keeps finished chunks."""
    return Path(os.path.realpath(out.expanduser()) + ".parts")


def _kept(out: Path | None) -> str:
    """Say what an unfinished run leaves behind; nothing for other commands."""
    from pounding_sweep.sweep.store import MANIFEST

    if out is None:
        return ""
    try:
        chunks = len((_parts(out) / MANIFEST).read_bytes().splitlines())
    except OSError:
        chunks = 0
    if not chunks:
        return "; nothing was finished yet"
    return f"; {chunks} finished chunks are kept in {out}.parts: running the same command again continues from there"


# ---------------------------------------------------------------------------------------------------------------------
# printing


def _run_report(asked: int, outcome: Outcome) -> dict[str, Any]:
    """Collect the counts and times of a run."""
    unique = len(outcome.values["status"])
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
    rate = report["scenarios_per_second"]
    compiled = report["kernels_compiled"]
    lines = [
        ("scenarios", run),
        ("not run", f"{counts['never_touching']} never touch, {counts['broadcast']} equal another scenario"),
        ("kernels", f"{compiled} compiled, ready after {seconds_text(report['compile_seconds'])}"),
        ("run", seconds_text(report["run_seconds"]) + (f", {number_text(rate)} scenarios per second" if rate else "")),
    ]
    for item in report["statuses"]:
        if item["remedy"]:
            lines.append((item["label"], f"{item['count']}: {item['meaning']}; {item['remedy']}"))
    print_pairs(lines)
    print(report["cube"])
