"""Pages: HTML files that need no other file and no network, made of templates that lie beside what fills them."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

from pounding_sweep.base.files import replacing

#: Cells that are numbers.
_NUMBER = re.compile(r"-|[-+]?[\d.]+(e[-+]?\d+)?%?( of \d+| ms)?")


class Grid(NamedTuple):
    """A table as text."""

    title: str  # above it
    headings: Sequence[tuple[str, str]]  # group and heading of each column
    rows: Sequence[Sequence[str]]  # cells

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Groups of the headings with their widths; none where no heading has one."""
        groups = [(group, len(list(columns))) for group, columns in groupby(self.headings, key=lambda pair: pair[0])]
        return groups if any(group for group, _ in groups) else []

    @property
    def is_text(self) -> list[bool]:
        """Whether each column holds texts rather than numbers, which stand at the right."""
        columns = [[row[i] for row in self.rows if row[i]] for i in range(len(self.headings))]
        return [not all(map(_NUMBER.fullmatch, column)) for column in columns]


def ungrouped(*texts: str) -> list[tuple[str, str]]:
    """Return headings without groups."""
    return [("", text) for text in texts]


def write_page(template: str, path: Path, **contents: Any) -> Path:
    """Fill a template of the package, in which the filter ``base64`` is for the bytes of a picture; write the page."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(loader=PackageLoader("pounding_sweep", "."), autoescape=True, undefined=StrictUndefined)
    environment.trim_blocks = environment.lstrip_blocks = True
    environment.filters["base64"] = lambda data: base64.b64encode(data).decode("ascii")
    page = environment.get_template(template).render(**contents)
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path
