"""The registry of outputs: every one that a sweep can report, and every reducer of the compiled loop.

They are declared in `motion`, `contact`, `energy` and `status`; kernels, planner, cube, command line and documentation
read them here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from pounding_sweep.base.errors import InputError, unknown
from pounding_sweep.kernel.spec import KernelSpec, Slots, result_slots
from pounding_sweep.model.scene import Scene
from pounding_sweep.outputs import contact, energy, motion
from pounding_sweep.outputs.declare import ERROR_CLASSES, INNER_DIMS, INTEGER_FILL, Reducer, Variable
from pounding_sweep.outputs.status import OK_CLAIM, RUNS, SETTLED, STATUS, Status

__all__ = [
    "CLASSES",
    "DEFAULT_OUTPUTS",
    "INNER_DIMS",
    "INTEGER_FILL",
    "OK_CLAIM",
    "REDUCERS",
    "SETTLED",
    "STATUS",
    "VARIABLES",
    "Status",
    "Variable",
    "check_outputs",
    "cube_variables",
    "get_variable",
    "inner_shape",
    "mask_invalid",
    "output_slots",
    "reducers_for",
    "reducers_of",
]

#: Every reducer by name, in the order in which their slots lie.
REDUCERS: dict[str, Reducer] = {
    reducer.name: reducer for reducer in (*motion.REDUCERS, *contact.REDUCERS, *energy.REDUCERS)
}
_REDUCER_OF = {slot.name: reducer.name for reducer in REDUCERS.values() for slot in reducer.slots}
#: Every output by name, in the order in which cubes and tables list them, with the reducer of its slot among its needs.
VARIABLES: dict[str, Variable] = {
    variable.name: replace(variable, needs=variable.needs | {*filter(None, [_REDUCER_OF.get(str(variable.source))])})
    for variable in (
        *motion.MOTIONS,
        *motion.YIELDS,
        *contact.CONTACTS,
        *motion.LINKS,
        *motion.FOUNDATIONS,
        *energy.ENERGIES,
        *motion.CLOSINGS,
        *RUNS,
    )
}

#: What a sweep reports where its ``outputs`` are not given.
DEFAULT_OUTPUTS: tuple[str, ...] = tuple(name for name, variable in VARIABLES.items() if variable.default)

#: Outputs that have one measured error together: the largest among them.
CLASSES: dict[str, tuple[str, ...]] = {
    kind: tuple(name for name, variable in VARIABLES.items() if variable.error == kind) for kind in ERROR_CLASSES
}


def get_variable(name: str | Variable) -> Variable:
    """Return the declared output of that name; a `Variable` is returned as it is."""
    if isinstance(name, Variable):
        return name
    try:
        return VARIABLES[name]
    except (KeyError, TypeError):
        raise InputError(unknown("output", name, VARIABLES)) from None


def check_outputs(names: Iterable[str]) -> tuple[str, ...]:
    """Check the names of outputs, drop repeated ones and put them into the order of the registry."""
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise InputError(f"outputs must be a list of names, not {names!r}; write [{names!r}] for a single one")
    asked = {get_variable(name).name for name in names}
    return tuple(name for name in VARIABLES if name in asked)


def cube_variables(names: Iterable[str]) -> tuple[str, ...]:
    """Return the variables of a cube with those outputs: they and the ones that are in every cube."""
    asked = check_outputs(names)
    return tuple(name for name, variable in VARIABLES.items() if variable.always or name in asked)


def reducers_for(names: Iterable[str]) -> frozenset[str]:
    """Return the reducers that the compiled loop must run for those outputs."""
    return frozenset().union(*(VARIABLES[name].needs for name in check_outputs(names)))


def reducers_of(shape: KernelSpec) -> list[Reducer]:
    """Return the reducers of a kernel."""
    return [reducer for name, reducer in REDUCERS.items() if name in shape.reducers]


@lru_cache(maxsize=64)
def output_slots(shape: KernelSpec) -> Slots:
    """Layout of a scenario's results: each chunk asks for it."""
    return result_slots(shape, reducers_of(shape))


def inner_shape(variable: str | Variable, scene: Scene) -> tuple[int, ...]:
    """Return the shape of one scenario's values of `variable`."""
    sizes = {"building": len(scene.buildings), "pair": len(scene.pair_labels), "storey": scene.n_storeys}
    return tuple(sizes[dim] for dim in get_variable(variable).dims)


def mask_invalid(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Remove the values of scenarios that have none: diverged, refused or not run."""
    if "status" not in arrays:
        raise InputError(f"the results have no 'status', only {', '.join(sorted(arrays)) or 'nothing'}")
    status = np.asarray(arrays["status"])
    bad = np.isin(status, [int(s) for s in STATUS if not s.has_values])
    result: dict[str, np.ndarray] = {}
    for name, given in arrays.items():
        values = np.asarray(given)
        fill = get_variable(name).fill
        if fill is not None and bad.any():
            values = values.copy()
            values[bad] = fill
        result[name] = values
    return result
