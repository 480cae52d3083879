"""Buildings from what engineers have: modes of a program, a model of OpenSees, or a period and a number of storeys.

Each becomes a lateral stiffness matrix of the floors, which holds all that a linear building is. Units kN, t, m, s.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from pounding_sweep.base.errors import SceneError, check_choice, repr_short
from pounding_sweep.model.building import DEFAULT_STOREY_HEIGHT, Building
from pounding_sweep.model.faults import Integer, Positive, checked_call, number_check

#: Bending against shear of typical buildings: alpha of Miranda and Taghavi.
KINDS = {"frame": 20.0, "dual": 5.0, "walls": 1.5}
#: Periods of codes by height, coefficient and power of C h**x (s, m): of concrete frames, and of other buildings.
CODE_PERIODS = {
    "asce7": ((0.0466, 0.9), (0.0488, 0.75)),  # ASCE/SEI 7-22, table 12.8-2
    "eurocode8": ((0.075, 0.75), (0.05, 0.75)),  # EN 1998-1:2004, 4.3.3.2.2(3)
}
_alpha = number_check("number alpha, shear against bending", gt=0.0, le=500.0)
#: Largest product of two shapes, by the masses, that counts as rounding of what a program prints.
ORTHOGONAL = 0.01
#: The same, from which on it is said that they are made so.
NOTED = 1e-3
#: Largest share of a model's mass that may lie outside its floors.
OUTSIDE = 0.01


def building_from_modes(
    name: str, masses: Sequence[float], periods: Sequence[float], shapes: Any, **properties: Any
) -> Building:
    """Return the building that has these periods and mode shapes, as programs print them.

    Its stiffness matrix is M Phi Omega^2 Phi' M of mass-normalised shapes Phi.

    Parameters
    ----------
    name : str
        Label of the building.
    masses : sequence of float
        Floor masses (t), bottom first.
    periods : sequence of float
        Periods (s) of all modes, as many as floors.
    shapes : array_like, shape (floors, modes)
        A mode shape in each column, floors bottom first, of any scale.
    **properties
        Other arguments of `Building`.

    Raises
    ------
    SceneError
        There are not as many modes as floors, a period is not positive, or more than 1 % of the product of two shapes
        by the masses is left. Below that they are made orthogonal, slowest first.

    Examples
    --------
    >>> from pounding_sweep import Building, building_from_modes
    >>> chain = Building("a", [100.0, 80.0], [9e4, 6e4])
    >>> frequencies, phi = chain.modes
    >>> same = building_from_modes("a", chain.masses, chain.periods, phi.round(6))
    >>> [round(float(period), 4) for period in same.periods]
    [0.3328, 0.1444]
    """
    mass, period, phi = (np.asarray(values, dtype=float) for values in (masses, periods, shapes))
    n = len(mass)
    if phi.shape != (n, n) or period.shape != (n,):
        raise SceneError(
            f"{period.size} periods and shapes of {' x '.join(map(str, phi.shape))} for {n} floors; export all {n} "
            "modes, or give the floors' stiffness matrix (the inverse of their flexibility) as stiffness_matrix"
        )
    if not (period > 0.0).all():
        raise SceneError(f"period {period[~(period > 0.0)][0]:g} s; periods must be above 0")
    order = np.argsort(-period)
    unit = phi[:, order] * np.sqrt(mass)[:, None]
    unit /= np.linalg.norm(unit, axis=0)
    products = np.abs(np.triu(unit.T @ unit, 1))
    worst = np.unravel_index(np.argmax(products), products.shape)
    if not products[worst] <= ORTHOGONAL:
        i, j = sorted(order[list(worst)] + 1)
        raise SceneError(
            f"shapes {i} and {j} are not orthogonal by the masses: {products[worst]:.3g} of the product of their "
            f"lengths is left, at most {ORTHOGONAL:g} may be; check that masses and shapes are of the same floors, "
            "bottom first"
        )
    if products[worst] > NOTED:
        text = (
            f"shapes of {name!r} are made orthogonal, slowest first: {products[worst]:.2g} of a product of two was left"
        )
        warnings.warn(text, stacklevel=2)
    q, r = np.linalg.qr(unit)
    heavy = np.sqrt(mass)[:, None] * q * np.sign(np.diagonal(r))  # M Phi
    stiffness = (heavy * (2.0 * math.pi / period[order]) ** 2) @ heavy.T
    return Building(name, masses, stiffness_matrix=0.5 * (stiffness + stiffness.T), **properties)


def typical_building(
    name: str,
    storeys: int,
    period: float | str,
    floor_mass: float,
    storey_height: float = DEFAULT_STOREY_HEIGHT,
    kind: str | float = "frame",
    **properties: Any,
) -> Building:
    """Return a building of equal storeys of which little is known: a cantilever that bends and shears.

    Parameters
    ----------
    name : str
        Label of the building.
    storeys : int
        Number of storeys.
    period : float or {"asce7", "eurocode8"}
        First period (s), or the code whose formula gives it by height.
    floor_mass : float
        Mass (t) of each floor.
    storey_height : float
        Height (m) of each storey.
    kind : {"frame", "dual", "walls"} or float
        Shear against bending: alpha = H (GA / EI)^(1/2) of 20, 5 or 1.5, or a number.
    **properties
        Other arguments of `Building`.

    Raises
    ------
    SceneError
        A value is out of range, or the kind or the code is unknown.

    References
    ----------
    Miranda & Taghavi (2005), Approximate floor acceleration demands in multistory buildings I, J. Struct. Eng. 131(2).
    ASCE/SEI 7-22, 12.8.2.1. EN 1998-1:2004, 4.3.3.2.2.

    Examples
    --------
    >>> from pounding_sweep import typical_building
    >>> walls = typical_building("walls", storeys=8, period=0.9, floor_mass=300.0, kind="walls")
    >>> [round(float(period), 3) for period in walls.periods[:2]]
    [0.9, 0.18]
    """
    return Building(name, **typical(storeys, period, floor_mass, storey_height, kind), **properties)


@partial(checked_call, SceneError)
def typical(
    storeys: Annotated[Integer, Field(ge=1, le=200)],
    period: Any,
    floor_mass: Positive,
    storey_height: Positive = DEFAULT_STOREY_HEIGHT,
    kind: Any = "frame",
) -> dict[str, Any]:
    """Return the arguments of `Building` that a typical building has, see `typical_building`."""
    for name, value, valid in (("kind", kind, KINDS), ("period", period, CODE_PERIODS)):
        if isinstance(value, str):
            check_choice(name, value, valid, SceneError)
    alpha = KINDS[kind] if isinstance(kind, str) else _alpha(kind)
    heights = np.arange(1.0, storeys + 1.0) * storey_height
    if isinstance(period, str):
        coefficient, power = CODE_PERIODS[period][0 if kind == "frame" else 1]
        period = coefficient * heights[-1] ** power
    return {
        "masses": (floor_mass,) * storeys,
        "stiffness_matrix": np.linalg.inv(cantilever_flexibility(heights / heights[-1], alpha)),
        "period": period,
        "storey_heights": storey_height,
    }


def cantilever_flexibility(heights: np.ndarray, alpha: float) -> np.ndarray:
    """Return displacements at the heights under unit forces at them, of a cantilever of height and GA 1.

    It bends and shears alike at every height: EI u'''' - GA u'' = p, alpha = (GA / EI)^(1/2).
    """
    z, a = np.minimum.outer(heights, heights), np.maximum.outer(heights, heights)  # it is symmetric
    # slope below the force 1 - cosh(alpha z) + b sinh(alpha z), above it c cosh(alpha (1 - z)), continuous with its own
    c = (np.cosh(alpha * a) - 1.0) / np.cosh(alpha)
    b = (np.sinh(alpha * a) - c * np.sinh(alpha * (1.0 - a))) / np.cosh(alpha * a)
    return z + (b * (np.cosh(alpha * z) - 1.0) - np.sinh(alpha * z)) / alpha


def building_from_opensees(
    ops: Any, floors: Mapping[Any, Any] | Sequence[Any], direction: int = 1, name: str = "building", **properties: Any
) -> Building:
    """Return the building of a model in OpenSees: its floors' masses, heights and lateral stiffness matrix.

    Unit forces on one floor after another give the floors' flexibility. The model must be in kN, t, m and s. Afterwards
    its loads, time and displacements are as before; analysis objects are not (`wipeAnalysis`): define those again.

    Parameters
    ----------
    ops : module
        ``openseespy.opensees`` with the model in it, linear or with its initial stiffness, before any load moved it.
    floors : mapping or sequence
        Node of each floor, or its nodes, bottom first. Several nodes of a floor act by their masses; tie them with
        ``equalDOF`` or ``rigidDiaphragm``.
    direction : int
        Degree of freedom of the lateral motion, 1 or 2.
    name : str
        Label of the building.
    **properties
        Other arguments of `Building`.

    Raises
    ------
    SceneError
        The model has moved, a floor has no mass, more than 1 % of the nodes' mass lies outside `floors`, or an analysis
        under the unit forces fails.

    Examples
    --------
    >>> import openseespy.opensees as ops  # doctest: +SKIP
    >>> building_from_opensees(ops, {1: [11, 12], 2: [21, 22]}, name="frame")  # doctest: +SKIP
    """
    values = floors.values() if isinstance(floors, Mapping) else floors
    nodes = [[item] if isinstance(item, int) else [*item] for item in values]
    everywhere = ops.getNodeTags()
    if absent := sorted({node for floor in nodes for node in floor} - {*everywhere}):
        raise SceneError(f"the model has no nodes {repr_short(absent)}; floors name its nodes, bottom first")
    if any(value != 0.0 for node in everywhere for value in ops.nodeDisp(node)):
        raise SceneError("the model has moved; call building_from_opensees before any analysis, or ops.reset() first")
    masses = [np.array([ops.nodeMass(node, direction) for node in floor]) for floor in nodes]
    sums = np.array([floor.sum() for floor in masses])
    for i, total in enumerate(sums, 1):
        if not total > 0.0:
            raise SceneError(f"floor {i} has no mass in direction {direction}; give its nodes ops.mass(node, ...)")
    outside = 1.0 - sums.sum() / sum(ops.nodeMass(node, direction) for node in everywhere)
    if outside > OUTSIDE:
        raise SceneError(
            f"{outside:.1%} of the nodes' mass lies outside the floors, at most {OUTSIDE:.0%} may: masses at other "
            "nodes move by themselves; add these nodes to their floors"
        )
    shares = [floor / total for floor, total in zip(masses, sums, strict=True)]
    up = -1  # the vertical axis is the last one
    base = min(ops.nodeCoord(node)[up] for node in everywhere)
    levels = [np.mean([ops.nodeCoord(node)[up] for node in floor]) - base for floor in nodes]
    flexibility = _flexibility(ops, nodes, shares, direction)
    stiffness = np.linalg.inv(0.5 * (flexibility + flexibility.T))
    properties = {"storey_heights": np.diff(levels, prepend=0.0).tolist()} | properties
    return Building(name, sums.tolist(), stiffness_matrix=(0.5 * (stiffness + stiffness.T)).tolist(), **properties)


def _flexibility(ops: Any, nodes: list[list[int]], shares: list[np.ndarray], direction: int) -> np.ndarray:
    """Return displacements of floors under unit forces on each, and leave the model as it was."""
    time, patterns = ops.getTime(), ops.getPatterns() or []
    tag = max([0, *patterns]) + 987_001  # tags of time series cannot be asked for
    ops.wipeAnalysis()
    ops.system("UmfPack")
    ops.numberer("RCM")
    ops.constraints("Transformation")
    ops.test("NormUnbalance", 1e300, 1)
    ops.algorithm("Linear")
    ops.integrator("LoadControl", 0.0)
    ops.analysis("Static")
    ops.timeSeries("Constant", tag)
    columns = []
    try:
        for loaded in [None, *range(len(nodes))]:  # before them the loads that stand already
            ops.pattern("Plain", tag, tag)
            for node, share in zip(nodes[loaded], shares[loaded], strict=True) if loaded is not None else ():
                ops.load(node, *(share * (k == direction) for k in range(1, ops.getNDF(node)[0] + 1)))
            if ops.analyze(1) != 0:
                raise SceneError(f"OpenSees could not solve the model under a unit force on floor {(loaded or 0) + 1}")
            pairs = zip(nodes, shares, strict=True)
            columns.append([w @ [ops.nodeDisp(node, direction) for node in floor] for floor, w in pairs])
            ops.remove("loadPattern", tag)
            ops.reset()
    finally:
        ops.remove("timeSeries", tag)
        ops.wipeAnalysis()
        ops.setTime(time)
    return np.array(columns[1:]).T - np.array(columns[0])[:, None]
