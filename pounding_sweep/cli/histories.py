"""``simulate`` and ``animate``: one scenario of a sweep with its histories, as a file and as a moving picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pounding_sweep.base.errors import InputError
from pounding_sweep.cli.app import Folders, Overwrite, SweepFile, app, axis_values
from pounding_sweep.cli.reporting import reporting, say, say_laws
from pounding_sweep.cli.run import SkipMissing

if TYPE_CHECKING:
    import xarray as xr

Law = Annotated[str | None, typer.Option("--law", metavar="LAW", help="Contact law, or FILE.py:NAME.")]
Gap = Annotated[float | None, typer.Option("--gap", metavar="M", help="Gap of every pair (m).")]
Stiffness = Annotated[
    float | None,
    typer.Option(
        "--stiffness", metavar="K", help="Contact stiffness (kN/m of laws with force ~ d, kN/m^1.5 with force ~ d^1.5)."
    ),
]
Factor = Annotated[
    float | None,
    typer.Option("--stiffness-factor", metavar="X", help="Factor on the scene's reference contact stiffness, instead."),
]
Restitution = Annotated[float | None, typer.Option("--restitution", metavar="E", help="Coefficient of restitution.")]
RecordName = Annotated[str | None, typer.Option("--record", metavar="NAME", help="One of the sweep's records.")]
Scale = Annotated[float | None, typer.Option("--scale", metavar="X", help="Factor on the record.")]
CaseNumber = Annotated[int | None, typer.Option("--case", metavar="N", help="Listed case, from 1.")]
Chosen = Annotated[
    list[str] | None,
    typer.Option(
        "--at",
        metavar="AXIS=VALUE",
        help="This value of any axis, such as period_factor_left, damping_ratio or pga; gap once per pair, or once.",
    ),
]
OutputStep = Annotated[
    float | None,
    typer.Option(
        "--output-step",
        metavar="S",
        help="Largest time (s) between instants of the histories; by default the sweep's step, or as short as it takes "
        "to show every peak that is reported.",
    ),
]
#: Arguments of both commands that choose a scenario, and how it is run.
_SELECTORS = (
    *("sweep", "folders", "skip_missing", "at", "output_step"),
    *("case", "law", "gap", "stiffness", "stiffness_factor", "restitution", "record", "scale"),
)


@app.command("simulate")
def simulate_command(
    sweep: SweepFile,
    out: Annotated[Path, typer.Option("-o", "--output", metavar="ONE.nc", help="netCDF file.", show_default=False)],
    law: Law = None,
    gap: Gap = None,
    stiffness: Stiffness = None,
    stiffness_factor: Factor = None,
    restitution: Restitution = None,
    record: RecordName = None,
    scale: Scale = None,
    case: CaseNumber = None,
    at: Chosen = None,
    output_step: OutputStep = None,
    folders: Folders = None,
    skip_missing: SkipMissing = False,
    overwrite: Overwrite = False,
) -> None:
    """Run one scenario of a sweep, the middle one by default, and write its histories."""
    given = locals()
    with reporting():
        from pounding_sweep.output.netcdf import check_output, write_cube

        check_output(out, overwrite)
        one = _simulate(**{name: given[name] for name in _SELECTORS})
        write_cube(one, out, overwrite)
        print(out)


@app.command("animate")
def animate_command(
    sweep: SweepFile,
    out: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="FILE", help="GIF, or MP4 with ffmpeg; replaced if it exists.", show_default=False
        ),
    ],
    law: Law = None,
    gap: Gap = None,
    stiffness: Stiffness = None,
    stiffness_factor: Factor = None,
    restitution: Restitution = None,
    record: RecordName = None,
    scale: Scale = None,
    case: CaseNumber = None,
    at: Chosen = None,
    output_step: OutputStep = None,
    folders: Folders = None,
    skip_missing: SkipMissing = False,
    start: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="First instant of the record shown (s); by default four periods of the motion before --end, or, "
            "without --end, one period before the strongest impact.",
        ),
    ] = None,
    end: Annotated[
        float | None, typer.Option(metavar="S", help="Last instant (s); by default four periods after the first one.")
    ] = None,
    frames: Annotated[int, typer.Option(metavar="N", help="Number of pictures.")] = 40,
    speed: Annotated[
        float | None,
        typer.Option(
            metavar="X", help="Seconds of the record per second of the animation; by default such that it takes 6 s."
        ),
    ] = None,
) -> None:
    """Animate the row in one scenario of a sweep, by default round its strongest impact."""
    given = locals()
    with reporting():
        from pounding_sweep.figures.animation import animate, check_movie
        from pounding_sweep.output.netcdf import check_output

        check_output(out, overwrite=True, netcdf=False)
        check_movie(out, frames, speed)
        one = _simulate(**{name: given[name] for name in _SELECTORS})
        print(animate(one, out, start=start, end=end, frames=frames, speed=speed))


def _simulate(
    sweep: Path,
    folders: list[Path] | None,
    skip_missing: bool,
    at: list[str] | None,
    output_step: float | None,
    **choice: Any,
) -> xr.Dataset:
    """Run the scenario that is chosen as for `simulate_one`; say which it is, and how fine its histories are."""
    from pounding_sweep.figures.shown import heading
    from pounding_sweep.run.one_scenario import simulate_shown
    from pounding_sweep.run.simulate import peaks_shown
    from pounding_sweep.run.sweep import load_sweep

    for name, values in axis_values(at or []).items():
        if choice.get(name) is not None:
            msg = f"{name} is given twice, by --{name.replace('_', '-')} and by --at; leave one out"
            raise InputError(msg)
        choice[name] = _value(name, values)
    spec = load_sweep(sweep, skip_missing_records=skip_missing, folders=folders or None).spec
    say_laws(spec.own_laws)
    one = simulate_shown(spec, output_step, **choice)
    say(heading(one))
    if "time" in one.sizes and one.sizes["time"] > 1:
        step = 1e3 * float(one["time"][1] - one["time"][0])
        say(f"histories at steps of {step:.4g} ms show at least {peaks_shown(one):.1%} of every peak")
    return one


def _value(name: str, values: list[str]) -> Any:
    """Return a value given by --at: a text, a number, or, of gaps, one number per pair."""
    if name in ("law", "record"):
        found: list[Any] = list(values)
    else:
        try:
            found = [int(value) if name == "case" else float(value) for value in values]
        except ValueError:
            msg = f"--at {name}={values[0]} is no {'whole ' * (name == 'case')}number"
            raise InputError(msg) from None
    if len(found) > 1 and name != "gap":
        msg = f"--at gives {len(found)} values of {name}, and one scenario has one; give one"
        raise InputError(msg)
    return found if len(found) > 1 else found[0]
