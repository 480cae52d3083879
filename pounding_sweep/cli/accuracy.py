"""What results are worth: ``tradeoff``, ``extremes``, ``laws`` with what they really give, ``doctor``."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Exit, Option

from pounding_sweep.base.errors import InputError
from pounding_sweep.base.text import bytes_text, finite, print_json, print_pairs, print_table, printable, seconds_text
from pounding_sweep.cli.app import (
    FAILED,
    FIGURE_FILE,
    NAME,
    AsJson,
    Folders,
    Quiet,
    SweepFile,
    Workers,
    command,
    numbers_of,
    reporting,
    say,
    say_laws,
)

if TYPE_CHECKING:
    import xarray as xr

    from pounding_sweep.accuracy.extremes import Extremes
    from pounding_sweep.accuracy.law_check import LawCheck


@command("tradeoff")
def tradeoff_command(
    sweep: SweepFile,
    out: Annotated[
        Path | None, Option("-o", "--output", metavar="TRADE.nc", help="netCDF file for the result.")
    ] = None,
    steps: Annotated[
        str | None, Option(metavar="LIST", help="Time steps (s), separated by commas; 5e-3 to 2.5e-4 by default.")
    ] = None,
    scenarios: Annotated[int, Option(metavar="N", help="About how many scenarios to measure on.")] = 96,
    seed: Annotated[int, Option(metavar="S", help="Seed of the random sample.")] = 0,
    figure: Annotated[
        Path | None, Option("--plot", metavar="FILE", help=f"Work-precision figure: {FIGURE_FILE}")
    ] = None,
    folders: Folders = None,
    workers: Workers = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Replace TRADE.nc if it exists.")] = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Measure error and cost of schemes, steps and number formats on a sample of a sweep."""
    with reporting():
        from pounding_sweep.accuracy.tradeoff import DEFAULT_STEPS, tradeoff
        from pounding_sweep.cli.progress import make_progress
        from pounding_sweep.figures import plot
        from pounding_sweep.output.netcdf import check_output, write_cube
        from pounding_sweep.run.sweep import load_sweep

        if out is not None:
            check_output(out, overwrite)
        if figure is not None:
            check_output(figure, overwrite=True, netcdf=False)
        loaded = load_sweep(sweep, folders=folders or None)
        form = "steps (s); give numbers with commas between, as 2e-3,1e-3"
        chosen = DEFAULT_STEPS if steps is None else numbers_of(steps, "--steps", form)
        with closing(make_progress(quiet)) as progress:
            trade = tradeoff(loaded, steps=chosen, scenarios=scenarios, seed=seed, workers=workers, progress=progress)
        if out is not None:
            write_cube(trade, out, overwrite)
        if as_json:
            print_json(_trade_report(trade))
        else:
            _print_trade(trade)
        files = [] if figure is None else [plot(trade, "work-precision", figure)]
        files += [] if out is None else [out]
        if files and not as_json:
            print(*files, sep="\n")


def _trade_report(trade: xr.Dataset) -> dict[str, Any]:
    """Collect everything that is printed, and every output."""
    from pounding_sweep.accuracy.tradeoff import trade_rows

    counts = ("sample_scenarios", "sensitive_scenarios", "touching_scenarios", "unique_scenarios")
    errors: dict[str, Any] = {}
    frame = trade["reference_error"].transpose("output", "population", "statistic").to_series()
    for (output, population, statistic), error in frame.items():
        errors.setdefault(output, {}).setdefault(population, {})[statistic] = finite(error)
    return {
        **{name: int(trade.attrs[name]) for name in counts},
        "reference_step": float(trade.attrs["reference_step"]),
        "reference_errors": errors,
        "configurations": trade_rows(trade),
    }


def _print_trade(trade: xr.Dataset) -> None:
    from pounding_sweep.accuracy.tradeoff import leading_outputs, order_table, table_of

    attributes = trade.attrs
    sample, sensitive = int(attributes["sample_scenarios"]), int(attributes["sensitive_scenarios"])
    headings, rows = table_of(trade)
    right = tuple(range(3, len(headings) - 1))
    print_table(headings, rows, right=right)
    print()
    print(
        f"{sample} of {attributes['touching_scenarios']} touching scenarios are measured. Errors are relative, of the "
        f"{sample - sensitive} that are not sensitive."
    )
    print(
        "s per 1000: processor seconds per thousand scenarios on one core; * no other row is cheaper and as accurate."
    )
    own = trade["reference_error"].sel(population="steady", statistic="worst")
    limits = ", ".join(f"{own.sel(output=name).item():.1e} ({name})" for name in leading_outputs(trade))
    print(
        f"Compared with {attributes['reference']} at {attributes['reference_step']:.4g} s, whose worst error is at "
        f"most {limits}; < marks errors below {attributes['resolution_factor']:g} times that of the same scenarios."
    )
    print()
    headings, rows = order_table(trade)
    print_table(headings, rows, right=tuple(range(2, len(headings))))
    print("order: by which power of the step the median error falls (located, float64; resolved errors only).")
    if sensitive:
        print()
        print(
            f"{sensitive} scenarios ({sensitive / sample:.1%}) are sensitive: gaps, stiffness and ground motion "
            f"changed by {attributes['input_change']:g} of themselves change an output by more than "
            f"{attributes['sensitive_change']:g}. Their errors:"
        )
        headings, rows = table_of(trade, "sensitive")
        print_table(headings[:-2], [row[:-2] for row in rows], right=right)


#: Violations that are printed in full.
SHOWN = 20


@command("extremes")
def extremes_command(
    scenes: Annotated[int, Option("--scenes", metavar="N", help="Random scenes.")] = 320,
    seed: Annotated[int, Option("--seed", metavar="S", help="Seed of the random scenes.")] = 1,
    law: Annotated[
        list[str] | None, Option("--law", metavar="LAW", help="Contact law; repeat for several; all by default.")
    ] = None,
    family: Annotated[
        list[str] | None,
        Option("--family", metavar="NAME", help="Family of scenarios; repeat for several; all by default."),
    ] = None,
    precision: Annotated[str, Option(metavar="FORMAT", help="float64 or float32.")] = "float64",
    map_file: Annotated[
        Path | None, Option("--map", metavar="MAP.nc", help="Also map error and status over stiffness and step.")
    ] = None,
    plot_file: Annotated[Path | None, Option("--plot", metavar="FILE", help=f"Draw that map: {FIGURE_FILE}")] = None,
    workers: Workers = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Replace MAP.nc if it exists.")] = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Judge extreme scenarios: crashes, false statuses, errors."""
    with reporting():
        from pounding_sweep.accuracy.extremes import run_extremes
        from pounding_sweep.cli.progress import make_progress
        from pounding_sweep.output.netcdf import check_output
        from pounding_sweep.run.execute import check_scheduler

        if map_file is not None:
            check_output(map_file, overwrite)
        if plot_file is not None:
            check_output(plot_file, overwrite=True, netcdf=False)
        n_workers, tell = check_scheduler("threads", workers), None if quiet else say
        with closing(make_progress(quiet)) as progress:
            suite = run_extremes(
                scenes, seed=seed, laws=law, families=family, precision=precision, workers=n_workers, progress=progress,
                tell=tell,
            )  # fmt: skip
        files = [str(file) for file in (map_file, plot_file) if file is not None]
        if files:
            _map(map_file, plot_file, law)
        if as_json:
            print_json({**suite.as_dict(), "files": files})
        else:
            _print_extremes(suite)
            print(*files, sep="\n", end="\n" if files else "")
        if suite.faults:
            say(f"failed: {len(suite.faults)} violations; each names its scenario, and --json gives all of them")
            raise Exit(FAILED)


def _map(map_file: Path | None, plot_file: Path | None, laws: list[str] | None) -> None:
    """Make the map's files."""
    from pounding_sweep.accuracy.extremes import stability_map
    from pounding_sweep.figures import plot
    from pounding_sweep.output.netcdf import write_cube

    dataset = stability_map(laws[0]) if laws else stability_map()
    if map_file is not None:
        write_cube(dataset, map_file, overwrite=True)
    if plot_file is not None:
        plot(dataset, "stability-map", plot_file)


def _print_extremes(suite: Extremes) -> None:
    from pounding_sweep.outputs.variables import CHANGE, OK_CLAIM, STATUS

    labels = [s.label for s in STATUS if any(result.statuses[s.label] for result in suite.results)]
    statuses, judged = ["scenarios", *(label.replace("_", " ") for label in labels)], ["missed", "sensitive", "unknown"]
    judged += ["worst error", "created energy", "violations", "s"]
    rows: list[list[list[str]]] = [[], []]
    for each in suite.results:
        worst = f"{each.worst_error:.1e}", f"{each.worst_created_energy:.1e}"
        counts = (each.missed, each.sensitive, each.unknown, *worst, len(each.violations), f"{each.seconds:.2f}")
        for table, cells in zip(rows, ((each.scenarios, *(each.statuses[x] for x in labels)), counts), strict=True):
            table.append([each.family, each.method, *map(str, cells)])
    for headings, table in zip((statuses, judged), rows, strict=True):
        print_table(["family", "scheme", *headings], table, right=range(2, len(headings) + 2))
        print()
    for fault in suite.faults[:SHOWN]:
        gaps = ", ".join(f"{g:.4g}" for g in fault["gaps"]) or "-"
        print(
            "{family} ({case}), {law}, {method} {precision}, dt {dt:g} s, k {stiffness:.4g}, e {restitution:.4g}, "
            "gaps {where} m, scale {scale:.4g}: {fault}".format(**fault, where=gaps)
        )
    total = sum(result.scenarios for result in suite.results)
    print(
        f"{total} scenarios of {len(suite.laws)} laws in {seconds_text(suite.seconds)}, references included; "
        f"{seconds_text(suite.compile_seconds)} until the kernels were ready. {len(suite.faults)} violations.\n"
        f"missed: ok, but a peak force, penetration or displacement is off by more than {OK_CLAIM:g}.\n"
        f"sensitive: those of them in which inputs changed by {CHANGE:g} change a peak by more than {OK_CLAIM:g}.\n"
        "worst error: of ok scenarios, but the sensitive ones and those that half the step gives away "
        "(error_estimate).\nunknown: ok, but no step tried was fine enough for a reference.\n"
        "created energy: made by contacts of ok scenarios, relative to the energy balance."
    )


#: What is listed of each law, and its heading in the table.
_LAW_COLUMNS = {
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
_LAW_JSON = {"validity": "restitution", "number_text": "damping_number", "reference": "source"}


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
        from pounding_sweep.model.laws import LAWS
        from pounding_sweep.model.rebound import RELATIONS

        if check is not None:
            if restitution:
                raise InputError("--check measures the restitution of its law too; leave out --restitution")
            _check_law(check, nominal, as_json)
            return
        if restitution:
            _print_certificate(nominal, as_json)
            return
        if nominal is not None:
            raise InputError(
                f"--e {nominal!r} says which restitutions to measure; give --restitution or --check with it"
            )
        rows = [{name: str(getattr(law, name) or "") for name in _LAW_COLUMNS} for law in LAWS.values()]
        for row in rows:
            row["relation"] = RELATIONS[row["relation"]].text if row["relation"] else ""
        if as_json:
            print_json([{_LAW_JSON.get(name, name): text for name, text in row.items()} for row in rows])
            return
        shown = {name: heading for name, heading in _LAW_COLUMNS.items() if heading}
        print_table(list(shown.values()), [[row[name] or "-" for name in shown] for row in rows])
        print()
        print("d: penetration (m), v: its rate (m/s), v0: v at the touch, m: effective mass of the pair (t).")
        print("paper: model number in Mate, Bakre & Jaiswal (2015). Laws of your own: FILE.py:NAME, see --check.")


#: What the check of a law tells of each restitution.
_CHECKED = ("damping_number", "measured", "solved", "analytic")


def _print_certificate(nominal: str | None, as_json: bool) -> None:
    """Measure and print the restitution of every law, at the values of a list such as "0.2,0.6"."""
    from pounding_sweep.accuracy.certificate import certify, deviation
    from pounding_sweep.cli.progress import make_progress
    from pounding_sweep.model.laws import get_law
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


def _check_law(name: str, nominal: str | None, as_json: bool) -> None:
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
        _print_law_check(check)
    if check.faults:
        raise Exit(FAILED)


def _print_law_check(check: LawCheck) -> None:
    from pounding_sweep.model.rebound import RELATIONS

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
    return "-" if math.isnan(number) else format(number + 0.0, form)


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


@command("doctor")
def doctor_command(
    no_check: Annotated[bool, Option("--no-check", help="Only look; run no scenarios.")] = False,
    as_json: AsJson = False,
) -> None:
    """Show versions, processor, kernel cache, problems, and run a few scenarios whose results are known."""
    with reporting():
        from pounding_sweep.run.diagnosis import diagnose

        state = diagnose()
        if not as_json:
            _print_state(state)
        if not no_check:
            from pounding_sweep.accuracy.self_check import TOLERANCE, self_check, to_compile

            if not as_json:
                missing, seconds = to_compile()
                first = f"; {missing} kernels are compiled first: about {seconds_text(seconds)} of CPU time"
                say(f"running the self-check{first if missing else ''}")
            check = self_check()
            error = check.error_max if math.isfinite(check.error_max) else None
            state["self_check"] = asdict(check) | {"error_max": error, "passed": check.passed, "tolerance": TOLERANCE}
            if not as_json:
                _print_self_check(state["self_check"])
        if as_json:
            print_json(state)
        if not no_check and not state["self_check"]["passed"]:
            say("failed: this installation does not compute the stored values; install it again, or report this")
            raise Exit(FAILED)


def _print_state(state: dict[str, Any]) -> None:
    cpu, cache, memory, output = (state[name] for name in ("processor", "kernel_cache", "memory", "output"))
    bits, free = cpu["vector_bits"], output["free_bytes"]
    missing = {name: f"not installed; pip install '{NAME}[{extra}]'" for name, extra in state["optional"].items()}
    limits = " ".join(f"{name}={value}" for name, value in state["threads"]["environment"].items())
    default, every = (seconds_text(state["compile_seconds"][name]) for name in ("default", "all"))
    space = "free space unknown" if free is None else f"{bytes_text(free)} free"
    sections = {
        "Versions": [(name, text or missing.get(name, "not installed")) for name, text in state["versions"].items()],
        "Processor": [
            ("system", state["system"]),
            ("name", cpu["name"]),
            (
                "vectors",
                f"{bits} bit, {bits // 64} numbers at a time (guessed from the features)" if bits else "unknown",
            ),
            ("scenarios", f"{cpu['lanes_per_kernel']} side by side in a kernel"),
            ("cores", f"{cpu['cores_usable']} usable of {cpu['cores']}"),
            ("features", " ".join(cpu["features"])),
        ],
        "Threads": [("workers", str(state["threads"]["workers"])), ("limits", limits or "none set")],
        "Memory": [
            (
                "free",
                "unknown"
                if memory["free_bytes"] is None
                else f"{bytes_text(memory['free_bytes'])} ({memory['limit']})",
            )
        ],
        "Kernel cache": [
            ("folder", cache["folder"] or "none"),
            ("kernels", f"{cache['kernels']}, {bytes_text(cache['bytes'])}"),
            (
                "compiling",
                f"about {default} of CPU time each for three 3-storey buildings, {every} with all outputs (estimated)",
            ),
        ],
        "Record folders": [(item["folder"], f"{item['files']} record files") for item in state["record_folders"]]
        or [("none", "POUNDING_SWEEP_RECORDS is not set; el_centro is always there")],
        "Output": [(output["folder"] or "none", space if output["writable"] else "can't be written")],
    }
    for heading, rows in sections.items():
        print(heading)
        print_pairs(rows, indent=2)
    print("Problems" if state["problems"] else "No problems found")
    for problem in state["problems"]:
        print(f"  {printable(problem)}")


def _print_self_check(check: dict[str, Any]) -> None:
    print("Self-check")
    largest = "infinite" if check["error_max"] is None else f"{check['error_max']:.1e}"
    stored = f"converged values, themselves right to {check['error_stored']:.0e}"
    print_pairs(
        [
            ("compared", f"{check['values']} numbers of {check['scenarios']} scenarios with {stored}"),
            ("largest error", f"{largest} of the largest value; at most {check['tolerance']:g} is right"),
            ("kernels", f"ready after {seconds_text(check['compile_seconds'])}"),
            ("run", seconds_text(check["run_seconds"])),
            ("result", "passed" if check["passed"] else "failed"),
        ],
        indent=2,
    )
    for fault in check["faults"]:
        print(f"  {fault}")
