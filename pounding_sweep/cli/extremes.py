"""``extremes``: the stability suite, and the map of where each scheme can be trusted."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pounding_sweep.base.tables import print_json, print_table, seconds_text
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
        n_workers = check_scheduler("threads", workers)
        with closing(make_progress(quiet)) as progress:
            found = run_extremes(
                scenes, seed=seed, laws=law, families=family, precision=precision, workers=n_workers, progress=progress
            )
        files = _map(map_file, plot_file, law)
        if as_json:
            print_json(_report(found, files))
        else:
            _print(found)
            for file in files:
                print(file)
        if found.faults:
            say(f"failed: {len(found.faults)} violations; each names its scenario, and --json gives all of them")
            raise typer.Exit(FAILED)


def _map(map_file: Path | None, plot_file: Path | None, laws: list[str] | None) -> list[str]:
    """Make the map's files; returns their names."""
    if map_file is None and plot_file is None:
        return []
    from pounding_sweep.accuracy.stability_map import stability_map
    from pounding_sweep.figures import plot
    from pounding_sweep.output.netcdf import write_cube

    dataset = stability_map(laws[0]) if laws else stability_map()
    if map_file is not None:
        write_cube(dataset, map_file, overwrite=True)
    if plot_file is not None:
        plot(dataset, "stability-map", plot_file)
    return [str(file) for file in (map_file, plot_file) if file is not None]


def _report(found: Extremes, files: list[str]) -> dict[str, Any]:
    from pounding_sweep.accuracy.judge import OK_CLAIM

    return {
        "claim": OK_CLAIM,
        "laws": list(found.laws),
        "scenes": found.scenes,
        "seed": found.seed,
        "results": [result.as_dict() for result in found.results],
        "violations": len(found.faults),
        "seconds": found.seconds,
        "compile_seconds": found.compile_seconds,
        "files": files,
    }


def _print(found: Extremes) -> None:
    from pounding_sweep.accuracy.judge import OK_CLAIM
    from pounding_sweep.outputs.differences import CHANGE
    from pounding_sweep.outputs.variables import STATUS

    counted = [s for s in STATUS if any(result.statuses[s.label] for result in found.results)]
    headings = ["family", "scheme", "scenarios", *(s.label.replace("_", " ") for s in counted)]
    headings += ["missed", "sensitive", "unknown", "worst error", "created energy", "violations", "s"]
    rows = [
        [
            result.family,
            result.method,
            str(result.scenarios),
            *(str(result.statuses[s.label]) for s in counted),
            str(result.missed),
            str(result.sensitive),
            str(result.unknown),
            f"{result.worst_error:.1e}",
            f"{result.worst_created_energy:.1e}",
            str(len(result.violations)),
            f"{result.seconds:.2f}",
        ]
        for result in found.results
    ]
    print_table(headings, rows, right=range(2, len(headings)))
    print()
    for fault in found.faults[:SHOWN]:
        print(
            f"{fault['family']} ({fault['case']}), {fault['law']}, {fault['method']} {fault['precision']}, "
            f"dt {fault['dt']:g} s, k {fault['stiffness']:.4g}, e {fault['restitution']:.4g}, gaps "
            f"{', '.join(f'{g:.4g}' for g in fault['gaps']) or '-'} m, scale {fault['scale']:.4g}: {fault['fault']}"
        )
    total = sum(result.scenarios for result in found.results)
    print(
        f"{total} scenarios of {len(found.laws)} laws in {seconds_text(found.seconds)}, references included; "
        f"{seconds_text(found.compile_seconds)} until the kernels were ready. {len(found.faults)} violations."
    )
    print(f"missed: ok, but a peak force, penetration or displacement is off by more than {OK_CLAIM:g}.")
    print(f"sensitive: those of them in which inputs changed by {CHANGE:g} change a peak by more than {OK_CLAIM:g}.")
    print(
        "worst error: of ok scenarios, but the sensitive ones and those that half the step gives away (error_estimate)."
    )
    print("unknown: ok, but no step tried was fine enough for a reference.")
    print("created energy: made by contacts of ok scenarios, relative to the energy balance.")
