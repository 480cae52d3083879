"""What results are worth: ``tradeoff``, ``extremes``, ``laws`` with what they really give, ``doctor``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer import Exit

from pounding_sweep.base.errors import InputError
from pounding_sweep.base.text import bytes_text, finite, print_json, print_pairs, print_table, scientific, seconds_text
from pounding_sweep.cli import app
from pounding_sweep.cli.app import AsJson, Folders, Overwrite, Quiet, Workers, command, flag, option, output, say

if TYPE_CHECKING:
    import xarray as xr


@command("tradeoff")
def tradeoff_command(
    sweep: app.SweepFile,
    out: Path | None = output("TRADE.nc", "netCDF file for the result."),
    steps: str | None = option("LIST", "Time steps (s), separated by commas; 5e-3 to 2.5e-4 by default."),
    everything: bool = flag("--all", "Measure newmark and contacts that are not located too; list every setting."),
    scenarios: int = option("N", "About how many scenarios to measure on.", default=96),
    seed: int = option("S", "Seed of the random sample.", default=0),
    figure: Path | None = option("FILE", f"Work-precision figure: {app.FIGURE_FILE}", "--plot"),
    folders: Folders = None,
    workers: Workers = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Say which accuracy or step to take, by error and cost of each on a sample of a sweep."""
    from pounding_sweep.accuracy.tradeoff import DEFAULT_STEPS, report, tradeoff
    from pounding_sweep.figures import plot
    from pounding_sweep.output.netcdf import check_output, write_cube
    from pounding_sweep.plan.advice import measured_schemes
    from pounding_sweep.run.sweep import load_sweep

    if out is not None:
        check_output(out, overwrite)
    if figure is not None:
        check_output(figure, overwrite=True, netcdf=False)
    loaded = load_sweep(sweep, folders=folders)
    chosen = DEFAULT_STEPS if steps is None else app.numbers_of(steps, "--steps")
    with app.progress_display(quiet) as progress:
        more: Any = {"methods": measured_schemes(), "located": (True, False)} if everything else {}
        sample: Any = {"scenarios": scenarios, "seed": seed, "workers": workers}
        trade = tradeoff(loaded, steps=chosen, progress=progress, **sample, **more)
    if out is not None:
        write_cube(trade, out, overwrite)
    if figure is not None:
        plot(trade, "work-precision", figure, report=say)
    if as_json:
        print_json(report(trade))
    else:
        _print_trade(trade, everything)
        print("".join(f"{file}\n" for file in (figure, out) if file), end="")


def _print_trade(trade: xr.Dataset, everything: bool) -> None:
    from pounding_sweep.accuracy.tradeoff import answer, leading_outputs, table_of

    attributes, advice = trade.attrs, answer(trade)
    sample, sensitive = int(attributes["sample_scenarios"]), int(attributes["sensitive_scenarios"])
    best, current, fastest = (advice[name] for name in ("best", "own", "fastest"))

    def against_best(one: dict[str, Any]) -> str:
        errors = f", {one['error'] / best['error']:.2g} times the error" if one["error"] and best["error"] else ""
        return f"{one['setting']}: {one['cost'] / best['cost']:.2g} times the time{errors}"

    worst = "-" if best["error"] is None else f"{best['error']:.1e}"
    print(
        f"Take {best['setting']} (by {best['scheme']}, {best['precision']})"
        f"{', as your file does' * (best == current)}: "
        f"{best['cost']:.2g} s per 1000 scenarios on one core, worst error {worst}."
    )
    if current is None:
        print("Your file: a run refuses scenarios of it, beyond the stability limit of its step.")
    elif current != best:
        print(f"Your file, {against_best(current)}.")
    if fastest["cost"] < 0.9 * best["cost"]:
        print(f"Fastest within {advice['wanted']:g}, but only in this sample: {against_best(fastest)}.")
    texts = {name: scientific(x) if isinstance(x, float) else json.dumps(x) for name, x in advice["solver"].items()}
    lines = [f"{name} = {text}" for name, text in texts.items()]
    print("", "[solver]", *lines, "", sep="\n")
    headings, rows = table_of(trade, full=everything)
    right = range(1, len(headings) - 1)
    print_table(headings, rows, right)
    reference = trade["reference_error"].sel(population="steady", statistic="worst")
    limits = ", ".join(f"{reference.sel(output=name).item():.1e} ({name})" for name in leading_outputs(trade))
    print(
        f"\n{sample} of {attributes['touching_scenarios']} touching scenarios are measured. Errors are relative, of "
        f"the {sample - sensitive} that are not sensitive.\n"
        "s/1000: processor seconds per thousand scenarios on one core; * no other setting is cheaper and as accurate.\n"
        f"Compared with {attributes['reference']} at {attributes['reference_step']:.4g} s, whose worst error is at "
        f"most {limits}; < marks errors below {attributes['resolution_factor']:g} times that of the same scenarios."
    )
    if not everything:
        print(f"{trade.sizes['setting']} settings are measured; --all lists them, newmark and unlocated contacts too.")
    if sensitive:
        print(
            f"\n{sensitive} scenarios ({sensitive / sample:.1%}) are sensitive: gaps, stiffness and ground motion "
            f"changed by {attributes['input_change']:g} of themselves change an output by more than "
            f"{attributes['sensitive_change']:g}. Their errors:"
        )
        headings, rows = table_of(trade, "sensitive", everything)
        print_table(headings[:-1], [row[:-1] for row in rows], right)


@command("extremes")
def extremes_command(
    sweep: Path | None = app.argument("SWEEP.toml", "Sweep file whose row and laws are judged in place of families."),
    scenes: int = option("N", "Random scenes.", default=320),
    seed: int = option("S", "Seed of the random scenes.", default=1),
    law: list[str] | None = option("LAW", "Contact law; repeat for several; all by default."),
    family: list[str] | None = option("NAME", "Family of scenarios; repeat for several; all by default."),
    precision: str = option("FORMAT", "float64 or float32.", default="float64"),
    folders: Folders = None,
    map_file: Path | None = option("MAP.nc", "Also map error and status over stiffness and step.", "--map"),
    plot_file: Path | None = option("FILE", f"Draw that map: {app.FIGURE_FILE}", "--plot"),
    workers: Workers = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Judge extreme scenarios, of a sweep or of all kinds: crashes, false statuses, errors."""
    from pounding_sweep.accuracy.extremes import run_extremes, stability_map
    from pounding_sweep.figures import plot
    from pounding_sweep.output.netcdf import check_output, write_cube
    from pounding_sweep.run.sweep import load_sweep

    if map_file is not None:
        check_output(map_file, overwrite)
    if plot_file is not None:
        check_output(plot_file, overwrite=True, netcdf=False)
    spec = load_sweep(sweep, folders=folders).spec if sweep else None
    settings: Any = {"seed": seed, "laws": law, "families": family, "precision": precision, "workers": workers}
    with app.progress_display(quiet) as progress:
        report = run_extremes(scenes, sweep=spec, progress=progress, **settings)
    if map_file is not None or plot_file is not None:
        stability = stability_map(*(law or ())[:1])
        if map_file is not None:
            write_cube(stability, map_file, overwrite=True)
        if plot_file is not None:
            plot(stability, "stability-map", plot_file)
    files = [str(file) for file in (map_file, plot_file) if file is not None]
    if as_json:
        print_json({**report, "files": files})
    else:
        _print_extremes(report)
        print("".join(f"{file}\n" for file in files), end="")
    if report["violations"]:
        say(f"failed: {report['violations']} violations; each names its scenario, and --json gives all of them")
        raise Exit(app.FAILED)


def _print_extremes(report: dict[str, Any]) -> None:
    from pounding_sweep.variables.registry import CHANGE, OK_CLAIM, STATUS

    results = report["results"]
    print(report["conclusion"], end="\n\n")
    labels = [s.label for s in STATUS if any(s.label in result["statuses"] for result in results)]
    columns = [{"scenarios": "{scenarios}"} | {label.replace("_", " "): f"{{{label}}}" for label in labels}]
    columns.append(
        {name: f"{{{name}}}" for name in ("missed", "sensitive", "unknown")}
        | {"worst error": "{worst_error:.1e}", "created energy": "{worst_created_energy:.1e}"}
        | {"violations": "{faults}", "s": "{seconds:.2f}"}
    )
    for forms in columns:
        rows = []
        for result in results:
            values = dict.fromkeys(labels, 0) | result["statuses"] | result | {"faults": len(result["violations"])}
            rows.append([form.format(**values) for form in ("{family}", "{method}", *forms.values())])
        print_table(["family", "scheme", *forms], rows, right=range(2, len(forms) + 2))
        print()
    for fault in [fault for result in results for fault in result["violations"]][:20]:
        gaps = ", ".join(f"{g:.4g}" for g in fault["gaps"]) or "-"
        print(
            "{family} ({case}), {law}, {method} {precision}, dt {dt:g} s, k {stiffness:.4g}, e {restitution:.4g}, "
            "gaps {where} m, scale {scale:.4g}: {fault}".format(**fault, where=gaps)
        )
    print(
        f"{sum(result['scenarios'] for result in results)} scenarios of {len(report['laws'])} laws in "
        f"{seconds_text(report['seconds'])}, references included; "
        f"{seconds_text(report['compile_seconds'])} until the kernels were ready. {report['violations']} violations.\n"
        f"missed: ok, but a peak force, penetration or displacement is off by more than {OK_CLAIM:g}.\n"
        f"sensitive: those of them in which inputs changed by {CHANGE:g} change a peak by more than {OK_CLAIM:g}.\n"
        "worst error: of ok scenarios, but the sensitive ones and those that half the step gives away "
        "(error_estimate).\nunknown: ok, but no step tried was fine enough for a reference.\n"
        "created energy: made by contacts of ok scenarios, relative to the energy balance."
    )


#: What is listed of each law: attribute, its heading in the table ("": not there) and its name in JSON.
_LAW_COLUMNS = (
    ("key", "law", "key"),
    ("model", "paper", "model"),
    ("title", "", "title"),
    ("formula", "force (kN)", "formula"),
    ("stiffness_unit", "stiffness k", "stiffness_unit"),
    ("validity", "restitution e", "restitution"),
    ("number_text", "damping number", "damping_number"),
    ("relation", "", "relation"),
    ("reference", "source", "source"),
)


@command("laws")
def laws_command(
    restitution: bool = flag("--restitution", "Measure what restitution each law really gives, by the kernels."),
    nominal: str | None = option("LIST", "With --restitution or --check: nominal values, as 0.2,0.6.", "--e"),
    check: str | None = option("LAW", "Check one law, FILE.py:NAME for one of your own, by kernels, solver and twin."),
    as_json: AsJson = False,
) -> None:
    """List the contact laws, say what restitution they really give, or check one, such as one of your own."""
    if nominal is not None and not (restitution or check):
        raise InputError(f"--e {nominal!r} says which restitutions to measure; give --restitution or --check with it")
    values = None if nominal is None else app.numbers_of(nominal, "--e")
    if check is not None:
        _check_law(check, values, as_json)
    elif restitution:
        _print_certificate(values, as_json)
    else:
        _print_laws(as_json)


def _print_laws(as_json: bool) -> None:
    from pounding_sweep.model.laws import LAWS
    from pounding_sweep.model.rebound import RELATIONS

    if as_json:
        laws = [{key: str(getattr(law, name) or "") for name, _, key in _LAW_COLUMNS} for law in LAWS.values()]
        print_json([law | {"relation": law["relation"] and RELATIONS[law["relation"]].text} for law in laws])
        return
    columns = {heading: name for name, heading, _ in _LAW_COLUMNS if heading}
    print_table(list(columns), [[str(getattr(law, name) or "-") for name in columns.values()] for law in LAWS.values()])
    print("\nd: penetration (m), v: its rate (m/s), v0: v at the touch, m: effective mass of the pair (t).")
    print("paper: model number in Mate, Bakre & Jaiswal (2015). Laws of your own: FILE.py:NAME, see --check.")


def _print_certificate(nominal: Sequence[float] | None, as_json: bool) -> None:
    """Measure and print the restitution of every law."""
    from pounding_sweep.accuracy.certificate import RESTITUTIONS, certify, deviation
    from pounding_sweep.model.laws import get_law

    with app.progress_display() as progress:
        table = certify(nominal or RESTITUTIONS, progress=progress)
    off = deviation(table)
    worst = off.isel(off.argmax(...))
    place = {name: worst[name].item() for name in ("law", "basis", "restitution")}
    settings, rows = {name: table.attrs[name] for name in ("method", "steps_per_contact")}, _rows(table)
    if as_json:
        print_json({**settings, "largest_deviation": {"value": worst.item(), **place}, "rows": rows})
        return
    by_basis = ([row for row in rows if row["basis"] == basis] for basis in table.basis.values)
    lines = []
    for published, realised in zip(*by_basis, strict=True):
        takes = get_law(published["law"]).takes_restitution
        if takes or published["restitution"] == table.restitution[0]:
            cells = _cells(published, damping_number=".6g", measured=".7f", analytic=".7f")
            cells += _cells(realised, damping_number=".6g", measured=".7f")
            lines.append([published["law"], f"{published['restitution']:g}" if takes else "any", *cells])
    headings = ["law", "nominal e", "published damping", "measured e", "closed form", "realised damping", "measured e"]
    print_table(headings, lines, right=range(1, len(headings)))
    print(
        "\nTwo free masses, e = velocity of parting over velocity of approach, measured through the kernels.\n"
        "damping: the law's damping number by its published formula, and with restitution_basis = 'realised'.\n"
        f"Largest |measured - closed form|: {worst.item():.1e} ({place['law']}, {place['basis']}, "
        f"e = {place['restitution']:g}), {settings['method']}, {settings['steps_per_contact']} steps per contact."
    )


def _check_law(name: str, nominal: Sequence[float] | None, as_json: bool) -> None:
    """Check one law and print the result; exit with a failure where it is not what its formulas say."""
    from pounding_sweep.accuracy.certificate import RESTITUTIONS
    from pounding_sweep.accuracy.law_check import check_law
    from pounding_sweep.model.laws import find_law

    law = find_law(name)
    app.say_laws([law] if law.source else [])
    with app.progress_display() as progress:
        check = check_law(law, nominal or RESTITUTIONS, progress=progress)
    about = {**law.described, "number": law.number_text, "sha256": law.sha256 if law.source else None}
    rows, faults = _rows(check.certificate), check.faults
    if as_json:
        print_json({"law": about, "rows": rows, "twin": check.twin, "impacts": check.impacts, "faults": faults})
    else:
        print_pairs([(name, str(value)) for name, value in about.items() if value not in ("", None, False)])
        print()
        forms = {"restitution": "g", "damping_number": ".6g", "measured": ".9f", "solved": ".9f", "analytic": ".9f"}
        lines = [[row["basis"], *_cells(row, **forms)] for row in rows if row["measured"] is not None]
        headings = ["basis", "asked e", "damping number", "gives (kernels)", "by a solver", "closed form"]
        print_table(headings, lines, right=range(1, len(headings)))
        worst = max(check.twin, key=check.twin.__getitem__)
        print(
            "\nTwo free masses, e = velocity of parting over velocity of approach: by the kernels, by an independent\n"
            "solver of the formulas (DOP853), and by the closed form.\n"
            f"Kernel and its twin in plain Python, {check.impacts} impacts: up to {check.twin[worst]:.1e} ({worst})."
        )
        agree = ["All agree: the kernels do what the formulas say.", check.missed[1]]
        print("\n".join([f"fault: {fault}" for fault in faults] or filter(None, agree)))
    if faults:
        raise Exit(app.FAILED)


def _cells(row: dict[str, Any], **forms: str) -> list[str]:
    return ["-" if row[name] is None else format(row[name] + 0.0, form) for name, form in forms.items()]


def _rows(table: xr.Dataset) -> list[dict[str, Any]]:
    """One row per law, basis and nominal restitution; None where the law is not valid there."""
    rows = table.to_dataframe(["law", "basis", "restitution"]).reset_index().to_dict("records")
    return [{name: finite(value) for name, value in row.items()} for row in rows]


@command("doctor")
def doctor_command(
    no_check: bool = flag("--no-check", "Only look; run no scenarios."), as_json: AsJson = False
) -> None:
    """Show versions, processor, kernel cache, problems, and run a few scenarios whose results are known."""
    from pounding_sweep.accuracy.self_check import self_check
    from pounding_sweep.run.diagnosis import diagnose

    state = diagnose()
    if not as_json:
        _print_state(state)
    check = {} if no_check else {"self_check": self_check()}
    print_json(state | check) if as_json else _print_state(check)
    if check and not check["self_check"]["passed"]:
        say("failed: this installation does not compute the stored values; install it again, or report this")
        raise Exit(app.FAILED)


def _print_state(state: dict[str, Any]) -> None:
    """Print what JSON has, in words: a heading for each part, a line for each value."""
    for part, values in state.items():
        print(part.replace("_", " ").capitalize())
        items = [values] if isinstance(values, str) else values or ["none"]
        lines = values.items() if isinstance(values, dict) else [("", item) for item in items]
        print_pairs([(name, _in_words(f"{part}_{name}", value)) for name, value in lines], indent=2)


def _in_words(name: str, value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key}: {_in_words(key, inner)}" for key, inner in value.items()) or "none"
    if isinstance(value, list | tuple):
        return "; ".join(_in_words(name, inner) for inner in value) or "none"
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "none"}[value]
    if name.endswith("bytes"):
        return bytes_text(value)
    if "seconds" in name:
        return seconds_text(value)
    return f"{value:.3g}" if isinstance(value, float) else str(value)
