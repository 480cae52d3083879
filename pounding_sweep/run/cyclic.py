"""Storeys under imposed drifts, without dynamics: from each drift to the next through the branches of their laws."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.integrate import solve_ivp

from pounding_sweep.base.errors import InputError, RunError
from pounding_sweep.model.building import Building
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.storeys import DriftGauge, Sampled, StoreyLaw
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.request.spec import canonical, json_data

if TYPE_CHECKING:
    import xarray as xr

#: Branches that a law may enter between two drifts.
_MAX_BRANCHES = 100
#: Relative error of what flows between two drifts.
_TOLERANCE = 1e-12
#: Unit of each variable of a test.
_UNITS = {"drift": "m", "shear": "kN", "stiffness": "kN m-1", "energy": "kN m"}
#: Factor between amplitudes of FEMA 461, and the number of amplitudes where none is given to start with.
_GROWTH, _AMPLITUDES = 1.4, 10


class ImposedSpring(Sampled):
    """A spring whose drift is imposed: numbers of histories side by side."""

    law: StoreyLaw
    slip: Any
    travel: Any  # what is lost, over the law's `loss`
    imposed: Any  # drift (m), and the sign of its change
    way: Any

    def __init__(self, law: StoreyLaw, stiffness: Any, constants: dict[str, Any], compiled: Any, n: int) -> None:
        rows = {name: np.zeros(n) for name in (*law.rows, "travel", "then", "imposed", "way")}
        about = {"law": law, "compiled": compiled, "group": self, "spec": self}
        super().__init__(stiffness, rows | constants | about)

    #: What laws ask of the group of a kernel's lanes, and of its spec.
    requested, series = ("hysteretic",), False

    def full(self, x: Any) -> Any:
        """Return a number in all histories."""
        return x + np.zeros_like(self.imposed)

    def put(self, lanes: Any, **rows: Any) -> None:
        """Write rows in some histories (None: all)."""
        for name, x in rows.items():
            setattr(self, name, self.full(x) if lanes is None else np.where(lanes, x, getattr(self, name)))

    def drift(self, x: Any = "u", rounding: bool = False) -> Any:
        """Return the drift (m), or the sign of its rate, by the names of kernels' rows."""
        return self.imposed if x == "u" else self.way

    def impose(self, drift: Any) -> None:
        """Go on to a drift (m), from branch to branch."""
        self.way = np.sign(drift - self.imposed)
        if not self.law.straight:
            self._flow(drift)
            return
        forward = self.way > 0.0
        for _ in range(_MAX_BRANCHES):
            end, length, then = drift, np.full(drift.shape, np.inf), np.full(drift.shape, np.nan)
            for gauge in self.law.gauges(self):
                assert isinstance(gauge, DriftGauge)
                turns, bound = gauge.way * self.way < 0.0, np.where(forward, gauge.high, gauge.low)
                distance = np.where(turns, 0.0, np.maximum(self.way * (bound - self.imposed), 0.0))
                leaves = turns | (gauge.ranged & (self.way * (drift - bound) > 0.0))
                first = leaves & (distance < length)
                end = np.where(first, np.where(distance > 0.0, bound, self.imposed), end)
                length = np.where(first, distance, length)
                beyond = np.where(forward, gauge.above, gauge.below)
                then = np.where(first, np.where(turns, gauge.turned, beyond), then)
            self.imposed, self.then = end, then
            self.law.follow(self)
            ended = ~np.isnan(then)
            if not ended.any():
                return
            self.law.switch(self, ended)
        raise RunError(f"storey law {self.law.name!r} enters more than {_MAX_BRANCHES} branches between two drifts")

    def _flow(self, drift: Any) -> None:
        """Go on to a drift as the plastic drift flows with it."""
        law: Any = self.law
        start, change = self.imposed, drift - self.imposed

        def rates(t: float, y: np.ndarray) -> np.ndarray:
            slip = y[: len(drift)]
            flow = law.flow(self, start + t * change, change, slip)
            return np.concatenate([flow, law.lost(self, start + t * change, slip, flow)])

        begins = np.concatenate([self.slip, self.travel])
        smallest = _TOLERANCE * np.min(law.reach(self))
        path = solve_ivp(rates, (0.0, 1.0), begins, method="DOP853", rtol=_TOLERANCE, atol=smallest)
        self.imposed, (self.slip, self.travel) = drift, np.split(path.y[:, -1], 2)

    def shear(self) -> tuple[Any, Any]:
        """Return shear (kN) and tangent stiffness (kN/m)."""
        law: Any = self.law
        stiffness, constant = law.line(self)
        tangent = stiffness if law.straight else law.tangent(self, self.imposed, self.way, self.slip)[0]
        return stiffness * self.imposed + constant, tangent


def fema_461(target: float, start: float | None = None, *, points: int = 100) -> np.ndarray:
    """Return the drifts (m) of the protocol of FEMA 461: two cycles of each amplitude, each 1.4 times the last.

    Parameters
    ----------
    target : float
        Largest amplitude (m); FEMA 461 recommends 3 % of the storey height.
    start : float, optional
        First amplitude (m), below first damage; by default that of ten amplitudes, 4.8 % of the target.
    points : int, optional
        Drifts from each turn to the next.

    Raises
    ------
    InputError
        The start is not above zero, or beyond the target.

    References
    ----------
    FEMA 461 (2007), Interim testing protocols for determining the seismic performance characteristics of structural and
    nonstructural components, section 2.9.

    Examples
    --------
    >>> fema_461(0.014, 0.01, points=1).round(6).tolist()
    [0.0, 0.01, -0.01, 0.01, -0.01, 0.014, -0.014, 0.014, -0.014, 0.0]
    """
    start = target / _GROWTH ** (_AMPLITUDES - 1) if start is None else start
    if not 0.0 < start <= target < math.inf:
        raise InputError(f"amplitudes go from {start:g} m to {target:g} m; give 0 < start <= target, in metres")
    steps = math.ceil(math.log(target / start) / math.log(_GROWTH) - 1e-9)
    amplitudes = np.minimum(start * _GROWTH ** np.arange(steps + 1), target)
    turns = [0.0, *np.outer(amplitudes, [1.0, -1.0, 1.0, -1.0]).ravel().tolist(), 0.0]
    return np.concatenate([[0.0], *(np.linspace(*ends, points + 1)[1:] for ends in pairwise(turns))])


def imposed_spring(row: Variants, number: int, n: int) -> tuple[ImposedSpring, Any]:
    """Return a spring of a row's scene in its first state, of n histories, and what it loses per unit of ``travel``."""
    element, numbers = row.scene.springs[number], row.spring_numbers[number]
    constants = {name: values[0, number] for name, values in row.spring_constants.items()}
    compiled = element.law.compiled(element.parameters)
    spring = ImposedSpring(element.law, numbers.stiffness[0], constants, compiled, n)
    element.law.begin(spring, None)
    return spring, element.law.loss(numbers)[0]


def cyclic_test(building: Building, drifts: Any, storey: int = 1) -> xr.Dataset:
    """Impose drifts on a storey and return what it resists, without dynamics.

    Between two drifts the storey goes straight from one to the other; branches of its laws end where they end.

    Parameters
    ----------
    building : Building
        Storeys with yield strengths and hysteresis; with P-Delta, shears hold what the weights push.
    drifts : array_like
        Drifts (m) from the undamaged state on, shape (points,), or of several histories (points, histories).
    storey : int, optional
        Number of the storey, from 1 at the bottom.

    Returns
    -------
    xarray.Dataset
        By ``point`` (and ``history``): ``drift`` (m), ``shear`` (kN), ``stiffness`` (kN/m), the tangent of the branch
        on which the point was reached, and ``energy`` (kN m), dissipated so far; with P-Delta missing beyond a drift of
        the storey height. `figures.loops` draws it.

    Raises
    ------
    InputError
        There is no such storey, the building is given by its matrix, or drifts are not finite numbers.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> building = ps.Building("a", [100.0], [4e4], yield_strengths=[200.0], hardening=0.1)
    >>> test = ps.cyclic_test(building, [0.01, -0.01, 0.0])
    >>> test.shear.values.round(6).tolist()
    [220.0, -220.0, 180.0]
    >>> round(float(test.energy[-1]), 6)
    2.7
    """
    import xarray as xr

    if storey not in range(1, len(building.stiffnesses or ()) + 1):
        what = (
            "has no such storey" if building.stiffnesses else "is given by its matrix, without stiffnesses of storeys"
        )
        raise InputError(f"storey is {storey!r}, but building {building.name!r} {what}; they are numbered from 1")
    try:
        path = np.array(drifts, dtype=float)
    except (TypeError, ValueError):
        path = np.empty(0)
    if path.ndim not in (1, 2) or not path.size or not np.isfinite(path).all():
        raise InputError("drifts must be finite numbers (m), shape (points,) or (points, histories)")
    scene, floor = Scene([building]), storey - 1
    row, columns = variants_of(scene), path.reshape(len(path), -1)
    elements = [e for e, spring in enumerate(scene.springs) if spring.floor == floor]
    springs = [imposed_spring(row, e, columns.shape[1]) for e in elements]
    weights = row.geometric_stiffnesses[0, floor]
    bare = weights if elements else row.elastic_stiffnesses[0, floor]  # of what follows no law
    shear, stiffness, energy = bare * columns, np.full(columns.shape, bare), np.zeros(columns.shape)
    for point, drift in enumerate(columns):
        for spring, loss in springs:
            spring.impose(drift)
            borne, tangent = spring.shear()
            shear[point] += borne
            stiffness[point] += tangent
            energy[point] += loss * spring.travel
    fallen = np.maximum.accumulate(np.abs(columns) >= row.drift_limits[floor], axis=0)
    dims, table = ("point", "history")[: path.ndim], np.where(fallen, np.nan, [shear, stiffness, energy])
    variables = {
        name: (dims, values.reshape(path.shape), {"units": units})
        for (name, units), values in zip(_UNITS.items(), (columns, *table), strict=True)
    }
    attributes = {"building": building.name, "storey": storey, "scene": canonical(json_data(scene))}
    return xr.Dataset(variables, attrs=attributes)
