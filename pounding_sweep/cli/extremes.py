"""``extremes``: the stability suite, and the map of where each scheme can be trusted."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pounding_sweep.base.text import print_json, print_table, seconds_text
from pounding_sweep.cli.app import FIGURE_FILE, AsJson, Quiet, Workers, app
from pounding_sweep.cli.reporting import FAILED, reporting, say

if TYPE_CHECKING:
    from pounding_sweep.accuracy.extremes import Extremes

#: Violations that are printed in full.
SHOWN = 20


@app.command("extremes")
def extremes_command(
    scenes: Annotated[int, typer.Option("--scenes", metavar="N", help="Random scenes.")] = 320,
    seed: Annotated[int, typer.Option("--seed", metavar="S", help="Seed of the random scenes.")] = 1,
    law: Annotated[
        list[str] | None, typer.Option("--law", metavar="LAW", help="Contact law; repeat for several; all by default.")
    ] = None,
    family: Annotated[
        list[str] | None,
        typer.Option("--family", metavar="NAME", help="Family of scenarios; repeat for several; all by default."),
    ] = None,
    precision: Annotated[str, typer.Option(metavar="FORMAT", help="float64 or float32.")] = "float64",
    map_file: Annotated[
        Path | None, typer.Option("--map", metavar="MAP.nc", help="Also map error and status over stiffness and step.")
    ] = None,
    plot_file: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE", help=f"Draw that map: {FIGURE_FILE}")
    ] = None,
    workers: Workers = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace MAP.nc if it exists.")] = False,
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
            _print(suite)
            print(*files, sep="\n", end="\n" if files else "")
        if suite.faults:
            say(f"failed: {len(suite.faults)} violations; each names its scenario, and --json gives all of them")
            raise typer.Exit(FAILED)


def _map(map_file: Path | None, plot_file: Path | None, laws: list[str] | None) -> None:
    """Make the map's files."""
    from pounding_sweep.accuracy.stability_map import stability_map
    from pounding_sweep.figures import plot
    from pounding_sweep.output.netcdf import write_cube

    dataset = stability_map(laws[0]) if laws else stability_map()
    if map_file is not None:
        write_cube(dataset, map_file, overwrite=True)
    if plot_file is not None:
        plot(dataset, "stability-map", plot_file)


def _print(suite: Extremes) -> None:
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
