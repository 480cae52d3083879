"""What cubes must agree in to be parts of one study."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.errors import InputError, shown
from pounding_sweep.output.audited import AUDIT_DIMS, has_audit
from pounding_sweep.output.dataset import VERSION_ATTRIBUTE, package_version
from pounding_sweep.output.merge_cases import CASE, Parts, check_cases, lists_cases
from pounding_sweep.output.merge_checks import (
    AXES,
    BUILDING_AXES,
    FREE,
    MOTION,
    check_attributes,
    check_axes,
    check_variables,
    load_labels,
    outer_dims,
    told_axes,
    told_sweep,
)
from pounding_sweep.output.provenance import MAKER_ATTRIBUTES, ORIGINS, Maker, makers, plain
from pounding_sweep.outputs.variables import INNER_DIMS, VARIABLES

if TYPE_CHECKING:
    import xarray as xr

#: Global attributes that say how a part came to be, or are made anew.
OWN_ATTRIBUTES = frozenset(
    {
        *("history", "title", "records", "records_left_out", "sweep", "sweep_sha256", "time_step", "accuracy_choice"),
        *("scenarios_asked", "scenarios_run", "scenarios_never_touching", "scenarios_missing"),
        *("audit_scenarios", "audit_touching", "audit_share", "audit_perturbation", "audit_undecided_share"),
        *("source", VERSION_ATTRIBUTE, "xarray_version", *MAKER_ATTRIBUTES, *ORIGINS),
    }
)


def check_parts(parts: Parts, *, mix_sources: bool) -> list[dict[str, Any]]:
    """Return what cubes of one study say of their sweeps.

    Parameters
    ----------
    parts : mapping of str to xarray.Dataset
        The cubes, by the name of their file. Their labels are read.
    mix_sources : bool
        Whether they may be made by several states of the package's source, or versions of the libraries that compute.

    Raises
    ------
    InputError
        They are not of one study, or one is not whole; the message names what differs, and both values.
    OutputError
        Their labels can't be read.
    """
    for name, cube in parts.items():
        if "status" not in cube.data_vars or "sweep" not in cube.attrs:
            msg = f"{name!r} is no cube of a sweep: it has no status, or no attribute 'sweep'; give cubes made by 'run'"
            raise InputError(msg)
        strange = [str(key) for key in scenario_variables(cube) if key not in VARIABLES]
        if strange:
            msg = f"{name!r} has the variables {', '.join(strange)}, which sweeps don't make; give cubes made by 'run'"
            raise InputError(msg)
    sweeps = [_check_whole(name, cube) for name, cube in parts.items()]
    _check_makers(parts, mix_sources=mix_sources)
    (first, base), *others = parts.items()
    for (name, cube), sweep in zip(others, sweeps[1:], strict=True):
        if lists_cases(base) != lists_cases(cube):
            cases, axes = (first, name) if lists_cases(base) else (name, first)
            msg = (
                f"{cases!r} lists its scenarios as cases, {axes!r} has axes. List those scenarios of the second that "
                f"you want as cases, run that sweep with --extend {axes}, which takes their results from it, and merge "
                "the cube so made with the first"
            )
            raise InputError(msg)
        for what, here, there in _differences(base, cube, sweeps[0], sweep):
            msg = (
                f"{first!r} and {name!r} are not parts of one study: {what} is {shown(here)} in the first and "
                f"{shown(there)} in the second; run one of them again with the other's"
            )
            raise InputError(msg)
    if lists_cases(base):
        check_cases(parts, sweeps)
    _check_labels(parts)
    return sweeps


def _check_whole(name: str, cube: xr.Dataset) -> dict[str, Any]:
    """Return what a cube says of its sweep; raise where it can't be what that sweep wrote."""
    told = told_sweep(name, cube)
    check_axes(name, cube, told_axes(cube, told))
    check_variables(name, cube, map(str, scenario_variables(cube)))
    check_attributes(name, cube, told)
    load_labels(name, cube)
    return told


def _check_makers(parts: Parts, *, mix_sources: bool) -> None:
    """Raise `InputError` where cubes were made by other versions of the package or of libraries, or another source."""
    (first, base), *others = parts.items()
    for name, cube in others:
        released = plain(cube.attrs[VERSION_ATTRIBUTE]) == plain(base.attrs[VERSION_ATTRIBUTE])
        both = parts_makers({first: base, name: cube})
        if released and (mix_sources or (len(both) == 1 and all(maker.source is not None for maker in both))):
            continue
        told = [key for key in Maker._fields if key == "source" or len({getattr(maker, key) for maker in both}) > 1]
        msg = (
            f"{first!r} was made by {_made_by(base, told)}, {name!r} by {_made_by(cube, told)}: the same scenario may "
            "have another result in each. Run them again with one of them, such as the installed package (version "
            f"{package_version()})"
        )
        if released:
            msg += (
                "; or, where you know that what changed between them touches no result, allow both: mix_sources=True, "
                "on the command line --mix-sources. The cube then says which file is of which"
            )
        raise InputError(msg)


def parts_makers(parts: Parts) -> set[Maker]:
    """Return what made cubes, or their parts."""
    return set().union(*(makers(cube.attrs) for cube in parts.values()))


def _made_by(cube: xr.Dataset, told: Sequence[str]) -> str:
    """Say what made a cube, by its version and those fields of its makers."""
    found = sorted({", ".join(_named(key, getattr(maker, key)) for key in told) for maker in makers(cube.attrs)})
    return f"version {cube.attrs[VERSION_ATTRIBUTE]} ({'; '.join(found)})"


def _named(key: str, value: str | None) -> str:
    if value is None:
        return f"of a {key} it does not name"
    return f"{key} {value[:12] if key == 'source' else value}"  # of a digest the first digits tell enough


def _check_labels(parts: Parts) -> None:
    """Raise `InputError` where coordinates of cubes, or their audits, are not of one form."""
    (first, base), *others = parts.items()
    for name, cube in others:
        for key in sorted({*map(str, base.coords), *map(str, cube.coords)} - {CASE}):
            here, there = _form(base, key), _form(cube, key)
            if here != there and not _is_audit(base, key) and not _is_audit(cube, key):
                msg = (
                    f"coordinate {key!r} is {here} in {first!r} and {there} in {name!r}; "
                    "cubes of one study have the same, give them as they were made"
                )
                raise InputError(msg)
    audits = [(name, cube) for name, cube in parts.items() if has_audit(cube)]
    for name, cube in audits[1:]:
        first, base = audits[0]
        keys = [str(key) for key in base.variables if key in cube.variables and _is_audit(base, str(key))]
        unlike = [key for key in keys if _form(base, key) != _form(cube, key)]
        if unlike or base["output"].values.tolist() != cube["output"].values.tolist():
            what = unlike[0] if unlike else "output"
            msg = f"the audits of {first!r} and {name!r} differ in {what!r}; run one of the sweeps again"
            raise InputError(msg)


def _is_audit(cube: xr.Dataset, key: str) -> bool:
    """Whether a variable or coordinate belongs to the audit."""
    return key in cube.variables and bool(set(AUDIT_DIMS) & set(cube.variables[key].dims))


def _form(cube: xr.Dataset, key: str) -> str:
    """Say what kind of a coordinate a cube has under a name."""
    if key not in cube.variables:
        return "missing"
    kind = "numbers" if cube[key].dtype.kind in "iuf" else "text"
    return f"{kind} along ({', '.join(map(str, cube[key].dims))})"


def _differences(
    a: xr.Dataset, b: xr.Dataset, one: Mapping[str, Any], two: Mapping[str, Any]
) -> list[tuple[str, Any, Any]]:
    found: list[tuple[str, Any, Any]] = [
        ("the list of axes", outer_dims(a), outer_dims(b)),
        ("the list of variables", scenario_variables(a), scenario_variables(b)),
    ]
    for key in sorted({*one, *two} - AXES - BUILDING_AXES - FREE):
        found.append((f"{key!r} of the sweep", one.get(key), two.get(key)))
    for key in sorted(AXES):
        found.append((f"whether {key!r} are given", one.get(key) is not None, two.get(key) is not None))
    for key in sorted({*a.attrs, *b.attrs} - OWN_ATTRIBUTES):
        found.append((f"attribute {key!r}", plain(a.attrs.get(key)), plain(b.attrs.get(key))))
    for name in INNER_DIMS:
        here, there = (cube[name].values.tolist() if name in cube.dims else [] for cube in (a, b))
        found.append((f"the list of {name}s", here, there))
    motions = {record["name"]: record for record in two["records"]}
    for record in one["records"]:
        if record["name"] in motions:
            other = motions[record["name"]]
            here, there = ([each[key] for key in MOTION] for each in (record, other))
            found.append((f"record {record['name']!r}", here, there))
    return [each for each in found if each[1] != each[2]]


def scenario_variables(cube: xr.Dataset) -> list[Hashable]:
    """Variables of a cube that are not its audit's."""
    return [name for name, array in cube.data_vars.items() if AUDIT_DIMS[0] not in array.dims]
