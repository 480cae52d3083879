"""``init``: write an example sweep to begin with."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from pounding_sweep.base.errors import InputError, MissingRecordError, OutputError, unknown
from pounding_sweep.base.text import print_json, print_table
from pounding_sweep.cli.app import AsJson, Overwrite, command
from pounding_sweep.cli.reporting import reporting, say


@command("init")
def init_command(
    out: Annotated[
        Path | None,
        Argument(metavar="[SWEEP.toml]", help="File to write; by default the example's name.", show_default=False),
    ] = None,
    example: Annotated[
        str | None,
        Option(
            "--from", metavar="EXAMPLE", help="Example to write; by default that of the file's name, or quickstart."
        ),
    ] = None,
    only_list: Annotated[bool, Option("--list", help="List the examples.")] = False,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Write a commented sweep file to begin with, or list the examples."""
    with reporting():
        from pounding_sweep.base.files import failure
        from pounding_sweep.output.netcdf import check_output
        from pounding_sweep.records import find_record
        from pounding_sweep.spec.toml import example_files, example_records, example_title, examples

        if only_list:
            titles = {name: example_title(name) for name in examples()}
            if as_json:
                print_json(titles)
            else:
                print_table(["example", "shows"], [list(item) for item in titles.items()])
            return
        if example is None:
            example = out.stem if out is not None and out.stem in examples() else "quickstart"
        if example not in examples():
            raise InputError(unknown("example", example, examples()))
        target = out or Path(f"{example}.toml")
        text = examples()[example].read_text(encoding="utf-8").replace(f"sweeps/{example}.toml", str(target))
        files = {target: text} | {target.parent / file.name: file.read_text("utf-8") for file in example_files(example)}
        for path in files:
            check_output(path, overwrite, netcdf=False)
        for path, content in files.items():
            try:
                path.write_text(content, encoding="utf-8")
            except OSError as error:
                raise OutputError(failure(f"writing {str(path)!r}", error)) from None
        for name in example_records(example):
            try:
                find_record(name)
            except MissingRecordError as error:
                say(f"warning: {error}")
        if as_json:
            print_json({"example": example, "files": [str(path) for path in files]})
            return
        say(f"wrote the example {example!r}: {example_title(example)}; now: pounding-sweep run {target}")
        print(*files, sep="\n")
