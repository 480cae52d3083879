"""The one scenario, or the few, that a figure shows of a cube with more axes than it can draw."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from pounding_sweep.cube.audited import AUDIT_DIMS
from pounding_sweep.cube.variables import INNER_DIMS
from pounding_sweep.errors import InputError
from pounding_sweep.figures.style import unit_text

if TYPE_CHECKING:
    import xarray as xr


def middle(cube: xr.Dataset, keep: Collection[str]) -> tuple[xr.Dataset, str]:
    """Take the middle value of every scenario axis that a figure does not draw.

    Parameters
    ----------
    cube : xarray.Dataset
        A cube; axes may be missing, or scalar coordinates.
    keep : collection of str
        Axes that are drawn.

    Returns
    -------
    cube : xarray.Dataset
        With the axes `keep` alone, and the dimensions inside a scenario.
    shown : str
        The values taken, ``"gap 0.01 m; record el_centro"``; axes of one value that say nothing are left out.

    Examples
    --------
    >>> import xarray as xr
    >>> cube = xr.Dataset({"x": (("law", "gap"), [[1, 2, 3]])}, {"law": ["linear"], "gap": [0.01, 0.02, 0.03]})
    >>> middle(cube, ["law"])[1]
    'gap 0.02'
    """
    inner = {*INNER_DIMS, *AUDIT_DIMS}
    varied = {str(dim): size for dim, size in cube.sizes.items() if dim not in inner and dim not in keep}
    cube = cube.isel({dim: (size - 1) // 2 for dim, size in varied.items()})
    names = ["law", "gap", "stiffness", "stiffness_factor", "restitution", "record", "scale", "damping_ratio", "case"]
    names += [dim for dim in varied if dim not in names]
    said = []
    for name in names:
        if name in keep or name not in cube.coords or cube[name].ndim:
            continue
        value, alone = cube[name].item(), varied.get(name, 0) == 1
        silent = alone or cube[name].isnull().item() or (name == "scale" and value == 1.0)
        if name in ("law", "record") or not silent:
            text = value if isinstance(value, str) else f"{value:g}"
            said.append(f"{name.replace('_', ' ')} {text} {unit_text(cube[name].attrs)}".rstrip())
    return cube, "; ".join(said)


def along(cube: xr.Dataset, axis: str) -> xr.Dataset:
    """Return a cube with that axis as a dimension, of one value where it is a scalar coordinate.

    Raises
    ------
    InputError
        The cube lists its scenarios as cases.
    """
    if axis in cube.dims:
        return cube
    if cube[axis].ndim:
        msg = f"a figure along {axis!r} needs that axis, and this cube lists cases; draw one of them, with --at case=N"
        raise InputError(msg)
    return cube.expand_dims(axis)


def heading(one: xr.Dataset) -> str:
    """Return what a simulated scenario is: its title and its gaps."""
    gaps = [f"{1e3 * gap:.4g}" for gap in one.pair_gap.values] if "pair_gap" in one.coords else []
    said = f"; gap{'s' * (len(set(gaps)) > 1)} {', '.join(gaps if len(set(gaps)) > 1 else gaps[:1])} mm" if gaps else ""
    return f"{one.attrs.get('title', 'one scenario')}{said}"
