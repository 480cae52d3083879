"""Sweep files: ``init``, ``run``, ``plan``, and one scenario of one: ``simulate`` and ``animate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Exit

from pounding_sweep.base.errors import InputError, check_choice
from pounding_sweep.base.text import number_text, print_json, print_pairs, print_table, printable, seconds_text
from pounding_sweep.cli import app
from pounding_sweep.cli.app import (
    AsJson,
    Folders,
    Overwrite,
    ScenarioOptions,
    SweepFile,
    SweepOptions,
    argument,
    command,
    flag,
    option,
    output,
    say,
)
from pounding_sweep.cli.records import print_read, read_as

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.run.sweep import Sweep


@command("init")
def init_command(
    out: Path | None = app.argument("[SWEEP.toml]", "File to write; by default the example's name."),
    example: str | None = option(
        "EXAMPLE", "Example to write; by default that of the file's name, or quickstart.", "--from"
    ),
    only_list: bool = flag("--list", "List the examples."),
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Write a commented sweep file to begin with, or list the examples."""
    from pounding_sweep.output.netcdf import check_output
    from pounding_sweep.request.toml import example_files, example_title, examples

    if only_list:
        titles = {name: example_title(name) for name in examples()}
        if as_json:
            print_json(titles)
        else:
            print_table(["example", "shows"], [list(item) for item in titles.items()])
        return
    if example is None:
        example = out.stem if out is not None and out.stem in examples() else "quickstart"
    check_choice("example", example, examples())
    target = out or Path(f"{example}.toml")
    text = examples()[example].read_text(encoding="utf-8").replace(f"sweeps/{example}.toml", str(target))
    files = {target: text} | {target.parent / file.name: file.read_text("utf-8") for file in example_files(example)}
    for path in files:
        check_output(path, overwrite, netcdf=False)
    for path, content in files.items():
        path.write_text(content, encoding="utf-8")
    if as_json:
        print_json({"example": example, "files": [str(path) for path in files]})
        return
    say(f"wrote the example {example!r}: {example_title(example)}; now: pounding-sweep run {target}")
    print(*files, sep="\n")


@command("run")
def run_command(
    options: SweepOptions,
    out: Path | None = output("OUT.nc", "netCDF file for the cube; SWEEP.nc here by default."),
    scheduler: str = option(
        "WHICH", "threads, processes, synchronous, or a dask address: tcp://HOST:PORT.", default="threads"
    ),
    overwrite: Overwrite = False,
    extend: Path | None = option("OLD.nc", "Reuse the results in this cube and run only the missing scenarios."),
    check: bool = flag("--check", "Compare all scenarios with more exact runs; prints errors by law and output."),
    quiet: app.Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Run a sweep, write its cube and print a summary."""
    named, out = out is not None, out or Path(f"{options.sweep.stem}.nc")
    with app.reporting(out):
        from pounding_sweep.output.netcdf import check_output

        check_output(out, overwrite)  # strengths for ductilities, which reading may look for, take a while
        sweep = options.load()
        if not named:
            say(f"the cube is written to {out}; -o names another file")
        with app.progress_display(quiet) as progress:
            sweep.make_cube(out, scheduler, options.workers, overwrite, progress, extend, check)
        report = _report(sweep, out)
        if as_json:
            print_json(report)
        else:
            _print_run(report, check)
        if report["failures"]:
            from pounding_sweep.resume import parts_folder

            say(
                "failed: some scenarios have no result (status not_run). What is finished is kept in "
                f"{parts_folder(out)}; run again with --overwrite to make only the rest"
            )
        if report["failures"] or not report["scenarios"]["usable"]:
            raise Exit(app.FAILED)


def _report(sweep: Sweep, out: Path) -> dict[str, Any]:
    """Return what a run did, for JSON."""
    from pounding_sweep.output.describe import summarize
    from pounding_sweep.variables.registry import VALID

    outcome, asked, summary = sweep.last_outcome, sweep.spec.n_scenarios, summarize(out)
    assert outcome is not None
    return {
        **_description(sweep),
        "scenarios": {
            "asked": asked,
            "usable": sum(end["count"] for end in summary["statuses"] if end["status"] in VALID),
            "run": outcome.run,
            "reused": outcome.reused,
            "never_touching": outcome.untouched,
            "broadcast": asked - len(outcome.results.status),
        },
        "scenarios_per_second": outcome.run / outcome.run_seconds if outcome.run and outcome.run_seconds > 0 else None,
        "run_seconds": outcome.run_seconds,
        "compile_seconds": outcome.compile_seconds,
        "kernels_compiled": outcome.compiled,
        "failures": outcome.failures,
        "refined": outcome.refined if "error_estimate" in outcome.results.names else None,
        **summary,
        "warnings": app.WARNINGS,
        "cube": str(out),
    }


@command("plan")
def plan_command(options: SweepOptions, as_json: AsJson = False) -> None:
    """Show what a sweep would run and at what cost; a few scenarios are run for it where their kernels are ready."""
    from pounding_sweep.engine.compile import still_to_compile
    from pounding_sweep.run.execute import check_scheduler, measured_seconds

    workers = check_scheduler("threads", options.workers)
    sweep = options.load()
    plan = sweep.plan()
    kernels, seconds = still_to_compile(plan.shapes())
    summary = plan.summary(workers)
    measured = measured_seconds(plan)
    if measured is not None:
        summary["seconds"] = measured / workers
    report = {
        **summary,
        "seconds_measured": measured is not None,
        "workers": workers,
        "sweep_sha256": plan.digest,
        "kernels_to_compile": kernels,
        "compile_seconds": seconds,
        "total_seconds": summary["seconds"] + seconds / workers,
        "largest_stable_step": float(plan.limit[plan.refused].min()) if plan.refused.any() else None,
        "warnings": app.WARNINGS,
        **_description(sweep),
    }
    if as_json:
        print_json(report)
        return
    print(printable(str(sweep.spec.title or options.sweep)))
    print_pairs(plan.rows(report))
    print()
    _print_description(report)


def _description(sweep: Sweep) -> dict[str, Any]:
    """Describe the row, records and laws of a sweep."""
    from pounding_sweep.records.catalogue import describe_files
    from pounding_sweep.request.spec import overview

    spec = sweep.spec
    return {
        "row": [{"name": name, "about": text} for name, text in overview(spec.scene)],
        "records": [read_as(record) for record in spec.records],
        "record_files": describe_files(spec.records),
        "records_left_out": list(spec.records_left_out),
        "user_laws": {law.key: law.sha256 for law in spec.user_laws},
    }


def _print_description(report: dict[str, Any]) -> None:
    print_pairs([(item["name"], item["about"]) for item in report["row"]])
    print()
    print_read(report["records"], report["records_left_out"], report["record_files"])


#: What is said of a sweep with a gap of 0.
_AT_REST = (
    "floors rest on each other: their number of impacts has no meaning, and the last digits of the inputs may decide "
    "their forces where three or more buildings touch"
)


def _print_run(report: dict[str, Any], check: bool) -> None:
    counts = report["scenarios"]
    if not counts["usable"]:
        print(f"0 of {counts['asked']} scenarios usable: each ended with a status that says why, below\n")
    _print_description(report)
    print()
    if report["summary"]:
        rows = []
        for row in report["summary"]:
            touching = "-" if row["touching"] is None else f"{row['touching']}/{row['scenarios']}"
            numbers = (number_text(row[name]) for name in ("peak_force", "impacts_max", "impacts_median"))
            rows.append([row["law"], row["pair"], *numbers, touching])
        print_table(["law", "pair", "peak force kN", "impacts", "median", "touching"], rows, right=(2, 3, 4, 5))
        print("impacts: most at one floor in one scenario; median: of that, over the scenarios that touch\n")
    run = f"{counts['asked']} asked, {counts['run']} run"
    if counts["reused"]:
        run += f", {counts['reused']} kept from an interrupted run"
    if source := report["extended_from"]:
        run += f", {source['scenarios_taken']} taken from {source['file']}"
    rate = report["scenarios_per_second"]
    speed = f", {number_text(rate)} scenarios per second" if rate else ""
    lines = [
        ("scenarios", run),
        ("not run", f"{counts['never_touching']} never touch, {counts['broadcast']} equal another scenario"),
        ("kernels", f"{report['kernels_compiled']} compiled, ready after {seconds_text(report['compile_seconds'])}"),
        ("run", seconds_text(report["run_seconds"]) + speed),
    ]
    refined = f"{report['refined']} of {counts['run']} scenarios run beyond half their step"
    notes = {
        "gap 0": _AT_REST * report["at_rest"],
        "rest": report["rest_note"],
        "accuracy": report["accuracy_choice"],
        "refined": refined * (report["refined"] is not None),
        "errors": report["errors_sentence"],
    }
    ends = {
        item["label"]: "{count}: {meaning}; {remedy}".format(**item) for item in report["statuses"] if item["remedy"]
    }
    print_pairs([*lines, *((name, text) for name, text in (notes | ends).items() if text)])
    if check:
        columns, errors = ("median", "most", "largest"), report["errors_by_law"]
        rows = [[row["law"], row["output"], *(f"{row[name]:.1e}" for name in columns)] for row in errors]
        print_table(["law", "output", "error median", "99 %", "largest"], rows, right=(2, 3, 4))
    print(report["cube"])


@command("simulate")
def simulate_command(
    options: ScenarioOptions, out: Path = output("ONE.nc", "netCDF file.", default=...), overwrite: Overwrite = False
) -> None:
    """Run one scenario of a sweep or a cube, the middle one by default, and write its histories."""
    from pounding_sweep.output.netcdf import check_output, write_cube

    check_output(out, overwrite)
    write_cube(_simulate(options), out, overwrite)
    print(out)


@command("animate")
def animate_command(
    options: ScenarioOptions,
    out: Path = output("FILE", "GIF, or MP4 with ffmpeg; replaced if it exists.", default=...),
    start: float | None = option(
        "S",
        "First instant of the record shown (s); by default four periods of the motion before --end, or, "
        "without --end, one period before the strongest impact.",
    ),
    end: float | None = option("S", "Last instant (s); by default four periods after the first one."),
    frames: int = option("N", "Number of pictures.", default=40),
    speed: float | None = option(
        "X", "Seconds of the record per second of the animation; by default such that it takes 6 s."
    ),
) -> None:
    """Animate the row in one scenario of a sweep or a cube, by default round its strongest impact."""
    from pounding_sweep.figures.gallery.scenario import animate, check_movie
    from pounding_sweep.output.netcdf import check_output

    check_output(out, overwrite=True, netcdf=False)
    check_movie(out, frames, speed)
    print(animate(_simulate(options), out, start=start, end=end, frames=frames, speed=speed))


@command("storey")
def storey_command(
    sweep: SweepFile,
    name: str = argument("NAME", "Building of the row.", default=...),
    storey: int = option("N", "Storey, from 1 at the bottom.", default=1),
    out: Path = output("FILE", app.FIGURE_FILE, default=...),
    target: float | None = option("M", "Largest drift (m); by default 3% of the storey height."),
    start: float | None = option("M", "First amplitude (m); by default 4.8% of the largest drift."),
    folders: Folders = None,
) -> None:
    """Draw loops and backbone of a storey under the drifts of FEMA 461, without dynamics."""
    from pounding_sweep.figures import plot
    from pounding_sweep.run.cyclic import cyclic_test, fema_461
    from pounding_sweep.run.sweep import load_sweep

    buildings = load_sweep(sweep, skip_missing_records=True, folders=folders).spec.scene.buildings
    check_choice("building", name, [building.name for building in buildings])
    building = next(building for building in buildings if building.name == name)
    if target is None:
        heights = building.storey_heights or ()
        target = 0.03 * heights[min(storey, len(heights)) - 1]
    test = cyclic_test(building, fema_461(target, start), storey)
    print(plot(test, "loops", out))


#: Options that choose a value of an axis.
_CHOICES = ("law", "gap", "stiffness", "stiffness_factor", "restitution", "record", "scale", "case")


def _simulate(options: ScenarioOptions) -> xr.Dataset:
    """Run the chosen scenario; say which it is, and how fine its histories are."""
    from pounding_sweep.analysis.rebuild import stored_spec
    from pounding_sweep.figures.select import scenario_title
    from pounding_sweep.output.netcdf import open_cube
    from pounding_sweep.run.histories import peak_share
    from pounding_sweep.run.simulate import simulate_finely
    from pounding_sweep.run.sweep import load_sweep

    choice = {name: getattr(options, name) for name in _CHOICES}
    for name, values in app.axis_values(options.at).items():
        if choice.get(name) is not None:
            raise InputError(f"{name} is given twice, by --{name.replace('_', '-')} and by --at; leave one out")
        choice[name] = _value(name, values)
    if options.sweep.suffix.lower() == ".nc":
        with open_cube(options.sweep) as cube:
            spec = stored_spec(cube, options.folders, record=choice["record"], case=choice["case"])
    else:
        spec = load_sweep(options.sweep, skip_missing_records=options.skip_missing, folders=options.folders).spec
    app.say_laws(spec.user_laws)
    histories = simulate_finely(spec, options.output_step, **choice)
    say(scenario_title(histories))
    if histories.sizes.get("time", 0) > 1:
        interval = 1e3 * float(histories["time"][1] - histories["time"][0])
        say(f"histories at steps of {interval:.4g} ms show at least {peak_share(histories):.1%} of every peak")
    return histories


def _value(name: str, texts: list[str]) -> Any:
    """Return a value given by --at: a text, a number, or, of gaps, one number per pair."""
    kind = {"law": str, "record": str, "case": int}.get(name, float)
    try:
        values = [kind(text) for text in texts]
    except ValueError:
        raise InputError(f"--at {name}={texts[0]} is no {'whole ' * (name == 'case')}number") from None
    if len(values) > 1 and name != "gap":
        raise InputError(f"--at gives {len(values)} values of {name}, and one scenario has one; give one")
    return values if len(values) > 1 else values[0]
