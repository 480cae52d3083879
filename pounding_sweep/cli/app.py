"""The application that commands register on, and the arguments they share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pounding_sweep.base.errors import InputError
from pounding_sweep.cli.reporting import NAME, open_streams

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
At = Annotated[
    list[str] | None,
    typer.Option("--at", metavar="AXIS=VALUE", help="Only this value of an axis; repeat for more axes, or values."),
]
Intensity = Annotated[
    str | None,
    typer.Option(
        "--intensity",
        metavar="MEASURE",
        help="Of the ground motion: pga, pgv, sa(PERIOD), sa(BUILDING) at its first period, or sa at those of all; "
        "what the records are scaled to by default.",
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON value instead of text.")]
Folders = Annotated[
    list[Path] | None,
    typer.Option("--records", metavar="FOLDER", help="Folder of record files, instead of POUNDING_SWEEP_RECORDS."),
]
Workers = Annotated[
    int | None, typer.Option("--workers", metavar="N", help="Threads or processes; one per core by default.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace the output file if it exists.")]
#: Arguments of comparisons by the option that gives them.
ARGUMENTS = {
    "--reference": "reference",
    "--event": "event",
    "--level": "level",
    "--quantile": "quantiles",
    "--probability": "probabilities",
    "--intensity": "intensity",
    "--given": "levels",
    "--hazard": "hazard",
    "--years": "years",
    "--one-dispersion": "one_dispersion",
    "--records": "folders",
}
#: Help of every option that draws: a figure is made again from its data, which are never replaced unasked.
FIGURE_FILE = "PNG, SVG or PDF file; replaced if it exists."


def numbers_of(text: str, option: str, form: str) -> list[float]:
    """Read numbers separated by commas; `form` says what the option takes, with an example."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        msg = f"{option} {text!r} is no list of {form}"
        raise InputError(msg) from None


def axis_values(given: list[str]) -> dict[str, list[str]]:
    """Read texts AXIS=VALUE, of which several may be of one axis; raises `InputError` for any other text."""
    values: dict[str, list[str]] = {}
    for text in given:
        axis, equals, value = text.partition("=")
        if not equals:
            msg = f"--at {text!r} won't do; give AXIS=VALUE, such as gap=0.01"
            raise InputError(msg)
        values.setdefault(axis.strip(), []).append(value.strip())
    return values


def main() -> None:
    """Run the command line of this process and leave with its exit code."""
    open_streams()
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
