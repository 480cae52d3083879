"""A page of a cube: its values, packed, and what draws them where sliders of its axes stand (view.js)."""

from __future__ import annotations

import base64
import json
import shlex
import zlib
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pounding_sweep.analysis.rebuild import stored_scene, stored_sweep
from pounding_sweep.analysis.scenarios import scenario_dims
from pounding_sweep.base.errors import InputError, check_choice, checked_arguments
from pounding_sweep.base.files import FilePath, expanded
from pounding_sweep.base.text import counts_text, finite
from pounding_sweep.output.audited import errors_sentence
from pounding_sweep.output.describe import about, statuses
from pounding_sweep.output.netcdf import check_output, with_texts
from pounding_sweep.output.select import select
from pounding_sweep.pages import write_page
from pounding_sweep.variables.registry import INNER_DIMS

#: Numbers that a page holds at most, and up to which they are kept as float32; beyond they are rounded.
MOST_NUMBERS, MOST_EXACT = 5_000_000, 1_000_000
#: Bits of a mantissa (of 23) that are rounded away then, and bytes of the page that a number takes at most.
_ROUNDED_BITS, _NUMBER_BYTES = 11, 2.4
#: Outputs that every page has where the cube does.
_ALWAYS = ("status", "error_estimate", "unsettled_output", "run")
#: Outputs and axes of which the first that is there is drawn first.
_OUTPUTS = ("impact_force_max", "drift_max", "displacement_max", "acceleration_max", "storey_shear_max")
_ACROSS, _PER = ("gap", "pga", "sa", "scale", "stiffness_factor", "stiffness"), ("law", "record")
#: Lines of a figure at most.
_MOST_LINES = 24


@checked_arguments
def view(
    cube: xr.Dataset,
    out: FilePath | None = None,
    *,
    at: Mapping[str, Any] | None = None,
    names: Sequence[str] | None = None,
) -> Path:
    """Write a page that shows a cube in any browser: sliders for its axes, lines, maps, the row, each scenario.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube of 'pounding-sweep run'.
    out : path, optional
        File to write, replaced if it exists; by default the name of the cube with the ending .html, in this folder.
    at : mapping of str to values, optional
        Only these values of axes, as for `pounding_sweep.output.select.select`.
    names : sequence of str, optional
        Only these variables; by default all.

    Returns
    -------
    Path
        The file. It holds all that it shows and asks for nothing from the network. Values are 32-bit floats, in pages
        of more than `MOST_EXACT` numbers rounded to 12 bits after the leading one (0.012 %), as the page says.

    Raises
    ------
    InputError
        plotly is not installed, an axis, value or variable is not there, or the page would hold more than
        `MOST_NUMBERS` numbers; the message has the size of each variable.
    OutputError
        The file can't be written.

    Examples
    --------
    >>> import tempfile
    >>> import pounding_sweep as ps
    >>> cube = ps.Sweep("mate2015", records="el_centro", laws="linear", gaps=[0.01, 0.02]).run()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     ps.view(cube, f"{folder}/gaps.html").name
    'gaps.html'
    """
    try:
        packed = {"plotly": _pack(files("plotly").joinpath("package_data", "plotly.min.js").read_bytes())}
    except ImportError:
        raise InputError("a page needs plotly, which is not installed: pip install 'pounding-sweep[view]'") from None
    file = Path(cube.encoding.get("source", "CUBE.nc"))
    path = expanded(file.with_suffix(".html").name if out is None else out)
    check_output(path, overwrite=True, netcdf=False)
    content = _content(select(with_texts(cube), at or {}, [*map(str, cube.dims)]), names, file.name, packed)
    text = json.dumps(content, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    return write_page("pages/view.html.j2", path, **content, json=text, packed=packed)


def _pack(content: bytes) -> str:
    """Deflate bytes and spell them in base64."""
    return base64.b64encode(zlib.compress(content, 6)).decode("ascii")


def _content(cube: xr.Dataset, names: Sequence[str] | None, file: str, packed: dict[str, str]) -> dict[str, Any]:
    """Return what a page says of a cube, as JSON holds it; the values of fields go into `packed`."""
    dims = scenario_dims(cube["status"]) if "status" in cube.data_vars else ()
    if not dims:
        raise InputError("a page is made of a cube of 'pounding-sweep run'; this file has no statuses of scenarios")
    outputs = [str(name) for name, part in cube.data_vars.items() if {*dims} <= {*part.dims} <= {*dims, *INNER_DIMS}]
    for name in names or ():
        check_choice("variable", name, outputs)
    outputs = [name for name in outputs if names is None or name in (*names, *_ALWAYS)]
    inputs = [
        str(name)
        for name, part in cube.coords.items()
        if name not in part.dims and {*dims} & {*part.dims} and {*part.dims} <= {*dims, "building", "pair"}
    ]
    count = sum(cube[name].size for name in (*outputs, *inputs))
    if count > MOST_NUMBERS:
        have, most = (
            f"{n / 1e6:.3g} million numbers (about {n * _NUMBER_BYTES / 1e6 + 2:.0f} MB)" for n in (count, MOST_NUMBERS)
        )
        sizes = ", ".join(f"{name} {cube[name].size / 1e6:.2g}" for name in outputs if name not in _ALWAYS)
        raise InputError(
            f"a page of this cube would hold {have}; it may hold {most}. Choose variables with --var (millions of "
            f"numbers: {sizes}), or values of axes with --at ({counts_text(cube['status'].sizes)})"
        )
    described, fields = about(cube), dict[str, Any]()
    for name in (*outputs, *inputs):
        part = cube[name].transpose(*dims, ..., missing_dims="ignore")
        labels, packed[name] = _pack_numbers(part, rounded=count > MOST_EXACT and part.dtype.kind == "f")
        units, title = (str(part.attrs.get(key, "")) for key in ("units", "long_name"))
        fields[name] = {
            **{"units": "" if units == "1" else units, "long_name": title or name.replace("_", " ")},
            **{"dims": [*map(str, part.dims)], "labels": labels, "input": name in inputs},
        }
    drawn = [name for name in outputs if not fields[name]["labels"] and name != "run"]
    if not drawn:
        raise InputError(
            f"a page needs a variable of numbers; this cube, as far as it is chosen, has {', '.join(outputs)}"
        )
    return {key: described[key] for key in ("title", "history", "versions", "row", "scenarios")} | {
        **{"file": file, "fields": fields, "scenario_dims": dims, "outputs": drawn},
        "dims": {dim: described["dims"][dim] for dim in (*dims, *INNER_DIMS) if dim in described["dims"]},
        "statuses": statuses(cube["status"], cube.get("unsettled_output", ())),
        "accuracy": finite(cube.attrs.get("accuracy")),
        "errors": errors_sentence(cube, cube.attrs),
        **{"numbers": count, "rounded": count > MOST_EXACT},
        **_choices(cube, dims, drawn, inputs),
        **_of_sweep(cube, file),
    }


def _pack_numbers(part: xr.DataArray, *, rounded: bool) -> tuple[list[str] | None, str]:
    """Return the labels of flags and texts, and numbers packed as float32, the first bytes of all before the second."""
    labels, values = part.attrs["flag_meanings"].split() if "flag_meanings" in part.attrs else None, part.values
    if values.dtype.kind not in "iuf":
        labels, values = np.unique(values.astype(str), return_inverse=True)
    bits = np.ascontiguousarray(values, "<f4").view("<u4").ravel()
    if rounded:
        bits = (bits + np.uint32(1 << (_ROUNDED_BITS - 1))) & ~np.uint32((1 << _ROUNDED_BITS) - 1)
    packed = _pack(bits.view("u1").reshape(-1, 4).T.tobytes())  # deflates well
    return labels if labels is None else list(map(str, labels)), packed


def _choices(cube: xr.Dataset, dims: Sequence[str], drawn: Sequence[str], inputs: Sequence[str]) -> dict[str, Any]:
    """Return what can be drawn along, and what is drawn first."""
    axes = [dim for dim in (*dims, *INNER_DIMS) if cube.sizes.get(dim, 1) > 1]
    unique = {name: np.unique(cube[name]).size for name in inputs if cube[name].ndim == 1}
    along = [name for name, size in unique.items() if size > 1 and not name.startswith("design_")]
    few = [*axes, *(name for name in along if unique[name] <= _MOST_LINES)]
    axes = [*axes, *along] or [dims[0]]
    numbers = [name for name in axes if cube[name].dtype.kind in "iuf" and name not in ("case", *INNER_DIMS)]
    output = next(name for name in (*_OUTPUTS, *drawn) if name in drawn)
    varying = [name for name in axes if {*cube[name].dims} <= {*cube[output].dims}]
    across = next(name for name in (*_ACROSS, *numbers, *varying) if name in axes)
    return {
        **{"axes": axes, "few": few, "inputs": along, "across": across, "most_lines": _MOST_LINES},
        "output": output,
        "per": next((name for name in _PER if name in few), ""),
        "up": next((name for name in (*numbers, *varying, *axes) if name != across), ""),
    }


#: Pixels of the drawn row: its height, a building, a wall, what is between two, and room above and beside.
_TALL, _BUILDING, _WALL, _BETWEEN, _ABOVE, _BESIDE = 230.0, 110, 18, 50, 30, 20


def _of_sweep(cube: xr.Dataset, file: str) -> dict[str, Any]:
    """Return the row as it is drawn, and the command that replays a scenario; of a cube without its sweep neither."""
    if "sweep" not in cube.attrs:
        return {"members": [], "spots": {}, "width": 0, "command": "", "chosen": []}
    scene, gaps = stored_scene(cube), stored_sweep(cube)["gaps"]
    low = min(item.base_elevation for item in scene.buildings)
    top = max(float(item.levels[-1]) for item in scene.buildings)

    def height(level: float) -> float | None:
        return round(_ABOVE + _TALL * (top - level) / (top - low), 1) if np.isfinite(level) else None

    members, x = list[dict[str, Any]](), _BESIDE
    for item in scene.row:
        levels = [*map(float, getattr(item, "levels", ()))]  # of a wall there are none
        width = _BUILDING if levels else _WALL
        floors, base = [*map(height, levels)], height(getattr(item, "base_elevation", low))
        roof = floors[-1] if levels else _ABOVE
        members.append({"name": item.name, "x": x, "width": width, "floors": floors, "base": base, "roof": roof})
        x += width + _BETWEEN
    spots = dict[str, list[Any]]()
    by_name = {member["name"]: member for member in members if member["floors"]}
    if "building" in cube.coords:
        standing = (by_name[name] for name in cube["building"].values.astype(str))
        spots["building"] = [{"x": m["x"] + m["width"] / 2, "floors": m["floors"], "top": m["roof"]} for m in standing]
    if "pair" in cube.coords and "contact_elevation" in cube.coords:
        left = dict(zip(scene.pair_labels, scene.pair_of_label, strict=True))
        sides = [members[left[str(name)]] for name in cube["pair"].values]
        meets = cube["contact_elevation"].transpose("pair", "storey").values
        spots["pair"] = [
            {"x": m["x"] + m["width"] + _BETWEEN / 2, "floors": [*map(height, row)], "top": _ABOVE}
            for m, row in zip(sides, meets, strict=True)
        ]
    return {
        **{"members": members, "spots": spots, "width": x - _BETWEEN + _BESIDE},
        "command": f"pounding-sweep simulate {shlex.quote(file)}",
        "chosen": [dim for dim in cube["status"].dims if dim != "gap" or gaps is not None],
    }
