"""Cubes of one study, from several machines or days, put together along their axes or their listed cases."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.base.errors import InputError
from pounding_sweep.output.dataset import as_read, as_stored
from pounding_sweep.output.merge_cases import CASE, case_name, cases_together, telling
from pounding_sweep.output.merge_checks import check_statuses, outer_dims, reading
from pounding_sweep.output.merge_labels import attributes, coordinates, places, together, with_audit
from pounding_sweep.output.merge_study import check_parts, parts_makers, scenario_variables
from pounding_sweep.output.netcdf import check_output, check_space, open_cube, write_in_slabs
from pounding_sweep.output.slabs import BLOCK_BYTES, SLAB_BYTES, block_shape, slab_shape, slabs
from pounding_sweep.outputs.variables import VARIABLES, Status

if TYPE_CHECKING:
    import xarray as xr

#: Scenarios, missing or in conflict, that are named.
NAMED = 5
#: Relative difference between two results of the same scenario that is no conflict.
TOLERANCE = 1e-6


@dataclass
class Merged:
    """What a merge found.

    Attributes
    ----------
    path : Path
        The cube of all parts.
    scenarios : int
        Scenarios of it: every combination of the values on its axes, or all listed cases.
    overlapping : int
        Scenarios that several parts have a result of.
    missing : int
        Scenarios that no part has a result of; their status is not_run.
    named : list of str
        The first of the missing, by what they differ in from others.
    sources : int
        States of the package's source that made the parts, each with other versions of the libraries that compute
        counted apart.
    """

    path: Path
    scenarios: int
    overlapping: int = 0
    missing: int = 0
    named: list[str] = field(default_factory=list)
    sources: int = 1


def merge_cubes(
    paths: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    tolerance: float = TOLERANCE,
    mix_sources: bool = False,
) -> Merged:
    """Put cubes of one study together: same scene, numerics and outputs, other or overlapping axes or listed cases.

    Parameters
    ----------
    paths : sequence of path-like
        Cubes made by sweeps, at least two: all over the same axes, or all of listed cases.
    out : path-like
        netCDF file for the cube of all of them.
    overwrite : bool
        Whether a file `out` may be replaced.
    tolerance : float
        Relative difference at which two results of the same scenario are in conflict; of
        a variable's largest value in the scenario.
    mix_sources : bool
        Whether the parts may be made by several states of one version's source, or with several versions of numba,
        llvmlite or numpy; each is named in ``merged_from``, and the cube itself can't be extended.

    Returns
    -------
    Merged
        What was found. The cube's attribute ``merged_from`` says where each part is from.

    Raises
    ------
    InputError
        The cubes are not of one study, one is given twice or is not as it was made, or they have
        different results of the same scenario; the message names what differs, where, and both values.
    OutputError
        A cube can't be read, or the file can't be written.

    Notes
    -----
    No more than a slab of the cube is in memory at a time. Of identical results of a scenario the
    first part's is taken. Counts of what was run are sums over the runs that made the parts, each once: a part may
    hold others of them, or be a copy of one.

    Cases are known by law, record, scale, gaps, stiffness, restitution and building properties. The cube has each
    once, in the order given, numbered anew; labels that a user gave them in place of numbers are kept.
    """
    if len(paths) < 2 or not math.isfinite(tolerance) or tolerance < 0:
        msg = f"merging takes at least two cubes and a tolerance >= 0, not {len(paths)} and {tolerance!r}"
        raise InputError(msg)
    _check_distinct(paths)
    target = check_output(out, overwrite)
    with ExitStack() as files:
        parts = {os.fspath(path): files.enter_context(open_cube(path)) for path in paths}
        merge = _Merge(parts, check_parts(parts, mix_sources=mix_sources), tolerance)
        blocks, values = merge.blocks(), merge.slabs()
        check_space(target.parent, merge.n_bytes, f"the cube of {merge.scenarios:,} scenarios")
        merge.found.path = write_in_slabs(merge.frame(), target, blocks, values, overwrite=overwrite)
    return merge.found


def _check_distinct(paths: Sequence[str | os.PathLike[str]]) -> None:
    """Raise `InputError` where two paths lead to one file: most likely another one was meant."""
    seen: dict[tuple[int, int], str] = {}
    for path in [os.fspath(path) for path in paths]:
        try:
            found = Path(path).expanduser().stat()
        except (OSError, ValueError, RuntimeError):
            continue  # opening it tells what is wrong
        key = (found.st_dev, found.st_ino)
        if key in seen:
            first = seen[key]
            twice = f"{path!r} is given twice" if first == path else f"{first!r} and {path!r} are the same file"
            msg = f"{twice}; give each cube once"
            raise InputError(msg)
        seen[key] = path


class _Merge:
    """Parts on their way into one cube."""

    def __init__(self, parts: Mapping[str, xr.Dataset], sweeps: list[dict[str, Any]], tolerance: float) -> None:
        dims = outer_dims(next(iter(parts.values())))
        listed = cases_together(parts, sweeps) if dims == [CASE] else None
        if listed:
            parts, along = listed.parts, [{CASE: keys} for keys in listed.keys]
        else:
            along = [{dim: cube[dim].values.tolist() for dim in dims} for cube in parts.values()]
        axes = {dim: together(dim, [values[dim] for values in along]) for dim in dims}
        self.parts, self.tolerance, self.where = parts, tolerance, places(along, axes)
        self.axes = {CASE: listed.labels} if listed else axes
        self.labels = coordinates(parts, self.axes, self.where)
        self.telling = telling(self.labels) if listed else []
        base = next(iter(parts.values()))
        self.base, self.names = base, [str(name) for name in scenario_variables(base)]
        self.sizes = [len(values) for values in self.axes.values()]
        self.scenarios = math.prod(self.sizes)
        self.inner = {name: [base.sizes[dim] for dim in VARIABLES[name].dims] for name in self.names}
        each = {name: np.dtype(VARIABLES[name].dtype).itemsize * math.prod(self.inner[name]) for name in self.names}
        self.n_bytes = self.scenarios * sum(each.values())
        self.block = block_shape(self.sizes, BLOCK_BYTES // max(each.values()))
        self.slab = slab_shape(self.sizes, self.block, max(1, SLAB_BYTES // sum(each.values())))
        self.found = Merged(Path(), self.scenarios, sources=len(parts_makers(parts)))
        self.about = attributes(parts, sweeps, self.scenarios, listed.described if listed else None)
        self.conflicts: list[str] = []
        self.n_conflicts = 0

    def blocks(self) -> dict[str, tuple[int, ...]]:
        """Shape of the blocks in which the file stores each variable."""
        return {name: (*self.block, *self.inner[name]) for name in self.names}

    def frame(self) -> xr.Dataset:
        """Return the cube of all parts without its values, which would not fit into memory."""
        import xarray as xr

        data = {}
        for name in self.names:
            zero = as_read(name, np.zeros((), VARIABLES[name].dtype))
            about = {key: v for key, v in self.base[name].attrs.items() if not str(key).startswith("audit_")}
            whole = np.broadcast_to(zero, (*self.sizes, *self.inner[name]))
            data[name] = ((*self.axes, *VARIABLES[name].dims), whole, about)
        cube = xr.Dataset(data, self.labels, self.about)
        for name, variable in self.labels.items():
            cube[name].encoding = variable.encoding
        return with_audit(cube, self.parts)

    def slabs(self) -> Iterator[tuple[tuple[slice, ...], dict[str, np.ndarray]]]:
        """Values of all parts as they are stored; raises `InputError` at the end if some are in conflict."""
        for slab in slabs(self.sizes, self.slab):
            shape = [part.stop - part.start for part in slab]
            values = {
                name: np.full((*shape, *self.inner[name]), VARIABLES[name].fill, VARIABLES[name].dtype)
                for name in self.names
                if name != "status"
            }
            values["status"] = np.full(shape, int(Status.NOT_RUN), np.int8)
            origin = np.full(shape, -1)
            for index, at in enumerate(self.where):
                self._lay(index, at, slab, values, origin)
            gone = values["status"] == Status.NOT_RUN
            self.found.missing += int(gone.sum())
            self.found.named += self._names(gone, slab, NAMED - len(self.found.named))
            yield slab, values
        if self.conflicts:
            more = self.n_conflicts - len(self.conflicts)
            msg = (
                f"parts have different results of {self.n_conflicts} scenarios: {'; '.join(self.conflicts)}"
                f"{f'; and {more} more' if more else ''}. Leave one of the parts out, or allow a larger tolerance"
            )
            raise InputError(msg)

    def _lay(
        self,
        index: int,
        at: Mapping[str, np.ndarray],
        slab: tuple[slice, ...],
        values: dict[str, np.ndarray],
        origin: np.ndarray,
    ) -> None:
        """Put what a part has of a slab into it, and compare it with what is there."""
        mine = {dim: np.flatnonzero((at[dim] >= s.start) & (at[dim] < s.stop)) for dim, s in zip(at, slab, strict=True)}
        if not all(len(positions) for positions in mine.values()):
            return
        file, cube = list(self.parts.items())[index]
        with reading(file):
            given = self._read(cube, mine)
        check_statuses(file, given["status"])
        box = np.ix_(*(at[dim][mine[dim]] - s.start for dim, s in zip(at, slab, strict=True)))
        there = values["status"][box] != Status.NOT_RUN
        new = ~there & (given["status"] != Status.NOT_RUN)
        both = there & (given["status"] != Status.NOT_RUN)
        self.found.overlapping += int(both.sum())
        if both.any():
            before = {name: values[name][box] for name in self.names}
            self._compare(before, given, both, origin[box], file, box, slab)
        for name in self.names:
            held = values[name][box]
            held[new] = given[name][new]
            values[name][box] = held
        held = origin[box]
        held[new] = index
        origin[box] = held

    def _read(self, cube: xr.Dataset, mine: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the values of a part at rising places on its axes, as they are stored."""
        if CASE not in mine:
            return self._values(cube.isel(mine))
        pieces = []  # cases may lie anywhere, and would be read one by one: what is between them is read, too
        cuts = np.flatnonzero(np.diff(mine[CASE] // self.slab[0])) + 1
        for some in np.split(mine[CASE], cuts):
            first, last = some[0], some[-1]
            whole = self._values(cube.isel(case=slice(first, last + 1)))
            pieces.append({name: array[some - first] for name, array in whole.items()})
        return {name: np.concatenate([piece[name] for piece in pieces]) for name in self.names}

    def _values(self, part: xr.Dataset) -> dict[str, np.ndarray]:
        return {
            name: as_stored(name, part[name].transpose(*self.axes, *VARIABLES[name].dims).values) for name in self.names
        }

    def _compare(
        self,
        before: Mapping[str, np.ndarray],
        given: Mapping[str, np.ndarray],
        both: np.ndarray,
        origin: np.ndarray,
        file: str,
        box: tuple[np.ndarray, ...],
        slab: tuple[slice, ...],
    ) -> None:
        """Note the scenarios of which two parts have different results."""
        told = np.zeros(both.shape, bool)
        for name in self.names:
            a, b = before[name], given[name]
            inner = tuple(range(both.ndim, a.ndim))
            differs = a != b
            if VARIABLES[name].dtype == "f8":
                differs &= ~(np.isnan(a) & np.isnan(b))
                size = np.fmax(np.abs(a), np.abs(b))
                # of ratios, such as the residual of the energies, 1 is the whole
                least = 1.0 if VARIABLES[name].units == "1" else 0.0
                scale = np.fmax.reduce(size, axis=inner, keepdims=True, initial=least)
                with np.errstate(invalid="ignore"):
                    differs &= ~(np.abs(a - b) <= self.tolerance * scale)
            first = differs & both.reshape(*both.shape, *(1,) * len(inner))
            scenarios = first.any(axis=inner) & ~told
            told |= scenarios
            self.n_conflicts += int(scenarios.sum())
            for where in np.argwhere(scenarios)[: NAMED - len(self.conflicts)].tolist():
                place = tuple(where)
                spot = (*place, *np.argwhere(np.atleast_1d(first[place]))[0].tolist()[: len(inner)])
                whole = [int(axis.ravel()[i]) + s.start for axis, i, s in zip(box, where, slab, strict=True)]
                other = list(self.parts)[int(origin[place])]
                self.conflicts.append(
                    f"{self._name(whole)}: {name} {a[spot].item()!r} in {other!r}, {b[spot].item()!r} in {file!r}"
                )

    def _names(self, chosen: np.ndarray, slab: tuple[slice, ...], most: int) -> list[str]:
        found = np.argwhere(chosen)[: max(0, most)] + [part.start for part in slab]
        return [self._name(place) for place in found.tolist()]

    def _name(self, place: Sequence[int]) -> str:
        """Values of the axes at a place, of those that have several; of a listed case also what it differs in."""
        told = [f"{axis}={v[i]}" for (axis, v), i in zip(self.axes.items(), place, strict=True) if len(v) > 1]
        if CASE in self.axes and told:
            told.append(case_name(self.labels, place[0], self.telling))
        return " ".join(told) or "the scenario"
