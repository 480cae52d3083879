"""Figures: each takes a dataset and returns a matplotlib figure; `force_gap` draws ``force-gap``, as do all others."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from importlib import import_module
from inspect import cleandoc, signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pounding_sweep.base.errors import InputError, OutputError, check_choice, checked_arguments
from pounding_sweep.base.files import FilePath, expanded, read_data

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

#: What is said of figures, and how some parts of them look.
TABLES = read_data("figures.toml")
#: What figures are drawn from: name -> where such a file comes from.
SOURCES: dict[str, str] = TABLES["sources"]
#: A law with contact, and the one without, as needs.
CONTACT, NO_CONTACT = "a law with contact", "the law 'none'"
#: Axes that maps may be drawn along besides those of numbers.
LABELS = ("record", "storey")
#: Further needs: of a map, of profiles, of a design.
TWO_AXES = "two axes of several numbers such as gap and restitution"
FIRST_STOREY, SALTELLI = "the storeys from the first on", 'a design of kind "saltelli" or axes of several numbers'
#: Dots per inch that a page can be drawn in.
_DPI = (10, 1200)
_FIGURES: dict[str, Kind] = {}
#: All figures by name, found at their first use.
FIGURES: dict[str, Kind]


class Kind(NamedTuple):
    """A figure by name, what draws it, and what a dataset must have for that."""

    key: str
    draw: Callable[..., Figure]
    source: str  # what it is drawn from, a key of `SOURCES`
    title: str  # what it shows
    #: in words: variables, coordinates or dimensions, or what `missing` checks; of alternatives between ``|`` any one
    needs: tuple[str, ...]
    options: tuple[str, ...]  # what of it may be chosen: the arguments of its function that are given by name

    def missing(self, dataset: xr.Dataset) -> tuple[str, ...]:
        """Return in words what a dataset lacks of what the figure needs."""
        from pounding_sweep.analysis.scenarios import law_keys
        from pounding_sweep.figures.select import plot_axes

        laws = {*law_keys(dataset)} or {"", "none"}  # of both kinds if the dataset does not say
        contact, status = laws - {"none"}, dataset.get("status")
        grid, axes = ({axis.dim for axis in plot_axes(dataset, labels).values()} for labels in ((), LABELS))
        checks = {
            CONTACT: contact,
            NO_CONTACT: "none" in laws,
            TWO_AXES: len(axes) > 1,
            FIRST_STOREY: "storey" not in dataset.coords or 1 in dataset["storey"],
            SALTELLI: {"input", "design_block"} & {*dataset.coords} or (status is not None and grid & {*status.dims}),
        }
        present = {*dataset.variables, *dataset.sizes, *(text for text, is_met in checks.items() if is_met)}
        several = {dim for dim, size in dataset.sizes.items() if size > 1 and (dim != "law" or len(contact) > 1)}
        missing = []
        for need in self.needs:
            plural, names = need.startswith("several "), need.removeprefix("several ").split("|")
            if (several if plural else present).isdisjoint(names):
                words = " or ".join(TABLES["plurals"].get(axis, f"{axis}s") if plural else axis for axis in names)
                missing.append(f"several {words}" if plural else words)
        return tuple(missing)


@cache
def _figures() -> dict[str, Kind]:
    """Return all figures by name, in alphabetical order: modules of the gallery register theirs."""
    for module in ("cubes", "scenario", "spectra"):
        import_module(f"pounding_sweep.figures.gallery.{module}")
    return dict(sorted(_FIGURES.items()))


def figure_of(key: str, source: str, needs: str) -> Callable[[Callable[..., Figure]], Callable[..., Figure]]:
    """Register a function of a dataset as a figure by that name; its needs are separated by commas.

    Its docstring begins with "Draw"; its arguments by name are options, which the docstring gets a section on.
    """

    def register(draw: Callable[..., Figure]) -> Callable[..., Figure]:
        @wraps(draw)
        def drawn(dataset: xr.Dataset, **options: Any) -> Figure:
            import numpy as np

            from pounding_sweep.figures.select import NothingToDrawError, describe
            from pounding_sweep.figures.style import NotebookFigure, in_style
            from pounding_sweep.output.dataset import UNTITLED
            from pounding_sweep.output.netcdf import with_texts
            from pounding_sweep.variables.registry import Status

            prepared = _with_inner_dims(with_texts(dataset))
            require(prepared, key)
            with in_style():
                try:
                    figure = draw(prepared, **options)
                except NothingToDrawError:
                    at, codes = describe(prepared), np.ravel(prepared.get("status", [])).tolist()
                    failed = [status for status in Status if status != Status.OK and status in codes]
                    why = [f"{codes.count(status)} of {len(codes)} scenarios are {status.label}" for status in failed]
                    raise InputError(
                        f"figure {key!r} has nothing to draw{f' at {at}' if at else ''}: "
                        f"{', '.join(why) or 'none of its values is a number'}; choose others with --at"
                    ) from None
                if source in ("cube", "design") and isinstance(figure, NotebookFigure):
                    subject = figure.caption[0].replace("_", " ")
                    figure.caption[0] = subject[:1].upper() + subject[1:]
                    figure.name_subject(prepared.attrs.get("title", "").removeprefix(UNTITLED))
                return figure

        first, *options = signature(draw).parameters
        text = cleandoc(draw.__doc__ or "")
        about = {
            first: f"xarray.Dataset\n    From {SOURCES[source]}.",
            **{name: TABLES["options"][name] for name in options},
        }
        parameters = "\n".join(f"{name} : {words}" for name, words in about.items())
        drawn.__doc__ = (
            f"{text}\n\nParameters\n----------\n{parameters}\n\nReturns\n-------\nmatplotlib.figure.Figure\n"
        )
        title = text.partition("\n")[0].removeprefix("Draw ").rstrip(".")
        _FIGURES[key] = Kind(key, drawn, source, title, tuple(needs.split(", ")), tuple(options))
        return drawn

    return register


def _with_inner_dims(dataset: xr.Dataset) -> xr.Dataset:
    """Return a cube whose variables have the dimensions again of a building, pair or storey that was selected."""
    from pounding_sweep.variables.registry import INNER_DIMS, VARIABLES

    for dim in INNER_DIMS:
        names = [name for name in dataset.data_vars if name in VARIABLES and dim in VARIABLES[name].dims]
        if names and dim in dataset.coords and not dataset[dim].ndim:
            dataset = dataset.drop_vars(dim).assign({name: dataset[name].expand_dims(dim, -1) for name in names})
    return dataset


def require(dataset: xr.Dataset, key: str) -> None:
    """Raise `InputError` if a dataset lacks what a figure needs."""
    kind = _figures()[key]
    if missing := kind.missing(dataset):
        of_cube = kind.source == "cube" and "status" in dataset.variables
        remedy = ": choose others with --at, or run the sweep again with such a law, axis or output" * of_cube
        raise InputError(
            f"figure {key!r} needs {', '.join(missing)}, which this file has not; it is drawn from "
            f"{SOURCES[kind.source]}{remedy}"
        )


@checked_arguments
def plot(
    dataset: xr.Dataset,
    kind: str,
    path: FilePath,
    *,
    dpi: float = 150.0,
    title: str | None = None,
    caption: FilePath | None = None,
    units: str = "m/s2",
    report: Callable[[str], None] | None = None,
    **options: Any,
) -> Path:
    """Draw a figure of a dataset into a file (PNG, SVG, PDF by its suffix).

    Parameters
    ----------
    dataset : xarray.Dataset
        A cube, or what else the figure is drawn from.
    kind : str
        A key of `FIGURES`.
    path : path
        File to write.
    dpi : float
        Dots per inch of a PNG, 10 to 1200.
    title : str, optional
        Title in place of the figure's own, which names the study and what is shown; "" leaves it out.
    caption : path, optional
        Text file for the caption: the title, the values that the figure is of, how many records and laws it shows.
    units : str
        Of accelerations, "m/s2" or "g".
    report : callable, optional
        Called with the caption but for the title.
    **options
        Options of the figure, such as ``x``, ``y`` and ``value``; None or False leaves one out.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InputError
        The figure or option is unknown, the dataset lacks what it needs or has no values, or `dpi` is out of range.
    OutputError
        A file can't be written.

    Examples
    --------
    >>> import tempfile
    >>> import pounding_sweep as ps
    >>> cube = ps.Sweep("mate2015", records="el_centro", laws="linear", gaps=[0.01, 0.02]).run()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     plot(cube, "force-gap", f"{folder}/force.png").name
    'force.png'
    """
    figures = _figures()
    check_choice("figure", kind, figures)
    check_choice("unit of accelerations", units, ("g", "m/s2"))
    if not _DPI[0] <= dpi <= _DPI[1]:
        raise InputError(f"dpi is {dpi:g}; it must be from {_DPI[0]} to {_DPI[1]}")
    options = {name: value for name, value in options.items() if value is not None and value is not False}
    for name in options:
        if name not in figures[kind].options:
            raise InputError(f"figure {kind!r} takes no {name}; it takes {', '.join(figures[kind].options) or 'none'}")
    target = expanded(path)
    figure = figures[kind].draw(dataset, **options)
    if units == "g":
        import_module("pounding_sweep.figures.style").show_in_g(figure)
    heading, *notes = getattr(figure, "caption", [""])
    if title is not None:
        figure.suptitle(title, fontsize=9)
    if report is not None and notes:
        report(f"figure {kind!r}: {'; '.join(notes)}")
    try:
        figure.savefig(target, dpi=dpi)
        if caption is not None:
            expanded(caption).write_text("\n".join([title or heading, *notes, ""]), encoding="utf-8")
    except (OSError, ValueError) as error:
        raise OutputError(
            f"can't write {str(getattr(error, 'filename', None) or target)!r} ({error}); give a file in a folder that "
            "exists, a figure ending in .png, .svg or .pdf"
        ) from error
    return target


def __getattr__(name: str) -> Any:
    """Load the figures, and `animate`, when they are first asked for (PEP 562)."""
    if name == "animate":
        return import_module("pounding_sweep.figures.gallery.scenario").animate
    key = name.replace("_", "-")
    if name != "FIGURES" and (name.startswith("_") or key not in _figures()):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _figures() if name == "FIGURES" else _figures()[key].draw


def __dir__() -> list[str]:
    return sorted(["FIGURES", "SOURCES", "animate", "plot", *(key.replace("-", "_") for key in _figures())])
