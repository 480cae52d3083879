"""``simulate`` and ``animate``: one scenario of a sweep with its histories, as a file and as a moving picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from pounding_sweep.base.errors import InputError
from pounding_sweep.cli.app import Overwrite, ScenarioOptions, axis_values, command
from pounding_sweep.cli.reporting import reporting, say, say_laws

if TYPE_CHECKING:
    import xarray as xr


@command("simulate")
def simulate_command(
    out: Annotated[Path, Option("-o", "--output", metavar="ONE.nc", help="netCDF file.", show_default=False)],
    options: ScenarioOptions,
    overwrite: Overwrite = False,
) -> None:
    """Run one scenario of a sweep, the middle one by default, and write its histories."""
    with reporting():
        from pounding_sweep.output.netcdf import check_output, write_cube

        check_output(out, overwrite)
        write_cube(_simulate(options), out, overwrite)
        print(out)


@command("animate")
def animate_command(
    out: Annotated[
        Path,
        Option(
            "-o", "--output", metavar="FILE", help="GIF, or MP4 with ffmpeg; replaced if it exists.", show_default=False
        ),
    ],
    options: ScenarioOptions,
    start: Annotated[
        float | None,
        Option(
            metavar="S",
            help="First instant of the record shown (s); by default four periods of the motion before --end, or, "
            "without --end, one period before the strongest impact.",
        ),
    ] = None,
    end: Annotated[
        float | None, Option(metavar="S", help="Last instant (s); by default four periods after the first one.")
    ] = None,
    frames: Annotated[int, Option(metavar="N", help="Number of pictures.")] = 40,
    speed: Annotated[
        float | None,
        Option(
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
        print(animate(_simulate(options), out, start=start, end=end, frames=frames, speed=speed))


def _simulate(options: ScenarioOptions) -> xr.Dataset:
    """Run the chosen scenario; say which it is, and how fine its histories are."""
    from pounding_sweep.figures.select import scenario_title
    from pounding_sweep.run.one_scenario import simulate_shown
    from pounding_sweep.run.simulate import peaks_shown
    from pounding_sweep.run.sweep import load_sweep

    choice = dict(vars(options))
    sweep, folders, skip_missing, at, step = (
        choice.pop(name) for name in ("sweep", "folders", "skip_missing", "at", "output_step")
    )
    for name, values in axis_values(at or []).items():
        if choice.get(name) is not None:
            raise InputError(f"{name} is given twice, by --{name.replace('_', '-')} and by --at; leave one out")
        choice[name] = _value(name, values)
    spec = load_sweep(sweep, skip_missing_records=skip_missing, folders=folders or None).spec
    say_laws(spec.own_laws)
    histories = simulate_shown(spec, step, **choice)
    say(scenario_title(histories))
    if histories.sizes.get("time", 0) > 1:
        interval = 1e3 * float(histories["time"][1] - histories["time"][0])
        say(f"histories at steps of {interval:.4g} ms show at least {peaks_shown(histories):.1%} of every peak")
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
