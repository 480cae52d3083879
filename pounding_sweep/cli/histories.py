"""``simulate`` and ``animate``: one scenario of a sweep with its histories, as a file and as a moving picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pounding_sweep.cli.app import Folders, Overwrite, SweepFile, app
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
    folders: Folders = None,
    skip_missing: SkipMissing = False,
    overwrite: Overwrite = False,
) -> None:
    """Run one scenario of a sweep, the middle one by default, and write its histories."""
    with reporting():
        from pounding_sweep.output.netcdf import check_output, write_cube

        check_output(out, overwrite)
        one = _simulate(
            sweep,
            folders,
            skip_missing,
            case=case,
            law=law,
            gap=gap,
            stiffness=stiffness,
            stiffness_factor=stiffness_factor,
            restitution=restitution,
            record=record,
            scale=scale,
        )
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
    with reporting():
        from pounding_sweep.figures.animation import animate, check_movie
        from pounding_sweep.output.netcdf import check_output

        check_output(out, overwrite=True, netcdf=False)
        check_movie(out, frames, speed)
        one = _simulate(
            sweep,
            folders,
            skip_missing,
            case=case,
            law=law,
            gap=gap,
            stiffness=stiffness,
            stiffness_factor=stiffness_factor,
            restitution=restitution,
            record=record,
            scale=scale,
        )
        print(animate(one, out, start=start, end=end, frames=frames, speed=speed))


def _simulate(sweep: Path, folders: list[Path] | None, skip_missing: bool, **choice: Any) -> xr.Dataset:
    """Run the scenario that is chosen as for `simulate_one`; say which it is."""
    from pounding_sweep.figures.shown import heading
    from pounding_sweep.run.one_scenario import simulate_one
    from pounding_sweep.run.sweep import load_sweep

    spec = load_sweep(sweep, skip_missing_records=skip_missing, folders=folders or None).spec
    say_laws(spec.own_laws)
    one = simulate_one(spec, **choice)
    say(heading(one))
    return one
