"""The scheme and the steps that reach a relative error, by measurement.

``measured.json`` (made by ``python -m pounding_sweep.accuracy.calibrate``)
holds, for every law, scheme and class of outputs, the relative error against
the number of steps in the shortest time of a scenario, the shorter of its
shortest contact and half the period of the buildings' highest mode. The
advice reads off the largest step that keeps the error within what is asked,
shortens it where stability or a long record of hardly damped buildings needs
it, and takes the scheme whose steps cost least.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from pounding_sweep.accuracy.timescales import approach_speeds, highest_frequency, shortest_contact
from pounding_sweep.contact.laws import Law
from pounding_sweep.cube.variables import check_outputs
from pounding_sweep.errors import SweepError
from pounding_sweep.records import Record
from pounding_sweep.sweep.blocks import Numerics
from pounding_sweep.sweep.resolution import MAX_PHASE_ERROR, MIN_STEPS_PER_CONTACT, loses_ground, phase_error
from pounding_sweep.sweep.stability import largest_step

if TYPE_CHECKING:
    from pounding_sweep.sweep.scenarios import Scenarios
    from pounding_sweep.sweep.spec import SweepSpec

#: File of measured errors beside this module.
MEASURED = "measured.json"
#: Outputs that have one measured error together: the largest among them.
CLASSES: dict[str, tuple[str, ...]] = {
    "motions": ("displacement_max", "displacement_min", "drift_max", "storey_shear_max", "closing_max"),
    "contacts": (
        "acceleration_max",
        "impact_force_max",
        "impact_count",
        "penetration_max",
        "impulse",
        "first_impact_time",
        "approach_speed_max",
    ),
    "energies": (
        "energy_input",
        "energy_damping",
        "energy_kinetic",
        "energy_strain",
        "energy_transfer_max",
        "energy_transfer_min",
        "contact_work",
    ),
}
#: Steps in the shortest contact over those that its status asks for: its speed is an estimate, and three times the
#: speed shortens a Hertz contact by so much.
CONTACT_MARGIN = 1.25
#: Leading digits of the numbers of steps in a record interval: few, so that many scenarios share one.
_STEPS = (10, 12, 16, 20, 25, 30, 40, 50, 60, 80)


@dataclass(frozen=True)
class Curve:
    """Measured error against steps in the shortest time.

    Attributes
    ----------
    steps : tuple of float
        Steps in the shortest time of the scenario, rising.
    error : tuple of float
        Relative error of so many steps, safety factor included.
    """

    steps: tuple[float, ...]
    error: tuple[float, ...]

    def needed(self, accuracy: float) -> float:
        """Return the least steps from which on the error stays within `accuracy`; infinite if that was not reached.

        Interpolated in the logarithms of both.

        Examples
        --------
        >>> round(Curve((1.0, 10.0, 100.0), (1e-1, 1e-3, 1e-5)).needed(1e-4), 1)
        31.6
        """
        log_error = np.log(np.maximum.accumulate(np.asarray(self.error)[::-1])[::-1])  # no use of a lucky coarse step
        within = log_error <= math.log(accuracy) + 1e-12
        if not within[-1]:
            return math.inf
        first = int(np.argmax(within))
        if first == 0:
            return self.steps[0]
        low, high = first - 1, first
        share = (log_error[low] - math.log(accuracy)) / (log_error[low] - log_error[high])
        return float(self.steps[low] * (self.steps[high] / self.steps[low]) ** share)


@dataclass(frozen=True)
class Measured:
    """What was measured: errors and costs.

    Attributes
    ----------
    curves : dict
        (method, precision, law, class of outputs) -> `Curve`.
    cost : dict
        (method, precision) -> ns of one scenario, step and degree of freedom.
    about : dict
        Where the numbers come from: quantile, safety factor, version, date, machine.
    """

    curves: dict[tuple[str, str, str, str], Curve]
    cost: dict[tuple[str, str], float]
    about: dict[str, Any]


@dataclass(frozen=True)
class Advice:
    """What was chosen for a sweep.

    Attributes
    ----------
    method : str
        Scheme.
    steps : ndarray of int, shape (scenarios,)
        Steps per record interval of each scenario.
    still : tuple of int
        Steps per record interval of the run without pounding, one per record.
    sentence : str
        What was chosen, and why.
    """

    method: str
    steps: np.ndarray
    still: tuple[int, ...]
    sentence: str


@lru_cache(maxsize=1)
def load_measured() -> Measured:
    """Read the measured errors and costs of this version of the package."""
    return read_measured(json.loads(files("pounding_sweep.accuracy").joinpath(MEASURED).read_text(encoding="utf-8")))


def read_measured(data: dict[str, Any]) -> Measured:
    """Return what ``measured.json`` holds."""
    curves = {}
    for scheme, laws in data["errors"].items():
        method, precision = scheme.split("/")
        for law, classes in laws.items():
            for kind, points in classes.items():
                curves[method, precision, law, kind] = Curve(*zip(*map(tuple, points), strict=True))
    cost = {}
    for scheme, value in data["cost"].items():
        method, precision = scheme.split("/")
        cost[method, precision] = float(value)
    return Measured(curves, cost, data["about"])


def classes_of(outputs: Iterable[str]) -> tuple[str, ...]:
    """Return the classes that hold any of `outputs`; motions where none does."""
    asked = set(check_outputs(outputs))
    return tuple(kind for kind, names in CLASSES.items() if asked & set(names)) or ("motions",)


def whole_steps(wanted: np.ndarray) -> np.ndarray:
    """Round numbers of steps up to 1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 30, 40, 50, 60, 80, 100, 120 ...

    Examples
    --------
    >>> whole_steps(np.array([0.2, 1.0, 6.2, 130.0])).tolist()
    [1, 1, 8, 160]
    """
    wanted = np.asarray(wanted, dtype=float)
    decades = range(max(0, math.ceil(math.log10(max(1.0, float(wanted.max(initial=1.0)))))) + 1)
    ladder = sorted({1, 2, 3, 4, 5, 6, 8, *(m * 10**d for m in _STEPS for d in decades)})
    return np.asarray(ladder)[np.searchsorted(ladder, wanted * (1.0 - 1e-9))]


def advise(
    spec: SweepSpec,
    laws: Sequence[Law],
    table: Scenarios,
    *,
    initial_speed: float = 0.0,
    measured: Measured | None = None,
) -> Advice:
    """Choose the scheme of a sweep and the steps of each of its scenarios.

    Parameters
    ----------
    spec : SweepSpec
        A sweep with an ``accuracy``; its ``method`` is kept where it names one.
    laws : sequence of Law
        Laws by the index that `table` uses; the last is no pounding.
    table : Scenarios
        Unique scenarios.
    initial_speed : float
        Largest speed (m/s) of approach at the start.
    measured : Measured, optional
        Errors and costs; those of this package by default.

    Returns
    -------
    Advice
        The same for the same sweep, always.

    Raises
    ------
    SweepError
        A law was not measured, or no scheme reached the accuracy.
    """
    assert spec.accuracy is not None
    known = load_measured() if measured is None else measured
    job = _Job(spec, laws, table, initial_speed)
    found: dict[str, tuple[float, np.ndarray, tuple[int, ...], dict[str, float]]] = {}
    reached: dict[str, tuple[float, str]] = {}
    for method in (spec.method,) if spec.method else ("rk4", "newmark"):
        need, best = _needed(known, spec, method, laws)
        if max(need.values()) < math.inf:
            steps, still = job.steps(method, need)
            found[method] = job.cost(known.cost[method, spec.precision], steps), steps, still, need
        else:
            reached[method] = best
    if not found:
        listed = ", ".join(f"{name} reaches {value:.2g} with law {law}" for name, (value, law) in reached.items())
        msg = (
            f"accuracy {spec.accuracy:g} was not reached with precision {spec.precision} when errors were measured "
            f"({listed}); ask for less, for other laws or another method, or give dt and see the cube's audit"
        )
        raise SweepError(msg)
    method = min(found, key=lambda name: found[name][0])
    cost, steps, still, need = found[method]
    others = {name: values[0] / cost for name, values in found.items() if name != method and cost > 0}
    return Advice(method, steps, still, job.sentence(known, method, need, steps, still, others))


def _needed(
    known: Measured, spec: SweepSpec, method: str, laws: Sequence[Law]
) -> tuple[dict[str, float], tuple[float, str]]:
    """Return the steps that each law needs in the shortest time, and the error that the worst of them reached."""
    assert spec.accuracy is not None
    need, best = {}, (0.0, "")
    for law in laws:
        curves = [known.curves.get((method, spec.precision, law.key, kind)) for kind in classes_of(spec.outputs)]
        if None in curves:
            msg = (
                f"accuracy: no errors of law {law.key!r} with {method} and precision {spec.precision} were measured; "
                "give method and dt instead, or measure them: python -m pounding_sweep.accuracy.calibrate"
            )
            raise SweepError(msg)
        need[law.key] = max(curve.needed(spec.accuracy) for curve in curves if curve is not None)
        best = max(best, *((curve.error[-1], law.key) for curve in curves if curve is not None))
    return need, best


class _Job:
    """The times that the scenarios of a sweep must resolve, and what steps then cost."""

    def __init__(self, spec: SweepSpec, laws: Sequence[Law], table: Scenarios, initial_speed: float) -> None:
        self.spec, self.laws, self.table = spec, laws, table
        self.contact = np.full(len(table), np.inf)
        self.mode = math.pi / highest_frequency(spec.scene)
        speeds = [self._speeds(record) for record in spec.records]
        for i, law in enumerate(laws):
            for r in range(len(spec.records)):
                rows = np.flatnonzero((table.law == i) & (table.record == r))
                if len(rows) and law.exponent is not None and spec.scene.contacts:
                    each = np.abs(table.scale[rows])[:, None] * speeds[r][None, :] + initial_speed
                    self.contact[rows] = shortest_contact(
                        spec.scene, law, table.stiffness[rows], table.restitution[rows], each, spec.restitution_basis
                    )

    def _speeds(self, record: Record) -> np.ndarray:
        """Speeds of approach; zeros where no law of the sweep depends on them."""
        if all(law.exponent in (None, 1.0) for law in self.laws):
            return np.zeros(len(self.spec.scene.pair_names))
        return approach_speeds(self.spec.scene, record)

    def steps(self, method: str, need: dict[str, float]) -> tuple[np.ndarray, tuple[int, ...]]:
        """Return steps per record interval of each scenario, and of the run without pounding of each record."""
        spec, table = self.spec, self.table
        interval = np.array([record.dt for record in spec.records])
        wanted = np.array([need[law.key] for law in self.laws])[table.law] / np.minimum(self.contact, self.mode)
        wanted = np.maximum(
            wanted, need["none"] / self.mode
        )  # where contacts are followed with sub-steps, modes decide
        wanted = np.maximum(wanted, CONTACT_MARGIN * MIN_STEPS_PER_CONTACT[method, True] / self.contact)
        for i, law in enumerate(self.laws):
            rows = np.flatnonzero(table.law == i)
            limit = self._limit(method, law, table.stiffness[rows], table.restitution[rows])
            wanted[rows] = np.maximum(wanted[rows], 1.0 / limit)
        least = np.array([self._motion_steps(method, record) for record in spec.records])
        open_limit = float(self._limit(method, self.laws[-1], np.zeros(1), np.ones(1))[0])
        still = np.maximum(whole_steps(max(need["none"] / self.mode, 1.0 / open_limit) * interval), least)
        steps = np.maximum(whole_steps(wanted * interval[table.record]), least[table.record])
        return steps, tuple(still.tolist())

    def _motion_steps(self, method: str, record: Record) -> int:
        """Least steps per interval at which the buildings keep their phase over so long a record.

        The measured records are short and the measured buildings damped; over a
        long record of undamped ones, the lengthening of the period adds up.
        """
        assert self.spec.accuracy is not None
        steps, limit = 1, min(self.spec.accuracy, MAX_PHASE_ERROR)
        while True:
            numerics = Numerics(method, record.dt / steps)
            late = phase_error(self.spec.scene, record, numerics) > limit
            if not late and not loses_ground(record, numerics):
                return steps
            steps = int(whole_steps(np.array([steps + 1.0]))[0])

    def _limit(self, method: str, law: Law, stiffness: np.ndarray, restitution: np.ndarray) -> np.ndarray:
        basis = self.spec.restitution_basis
        limit = largest_step(self.spec.scene, law, stiffness, restitution, method=method, basis=basis)
        return limit * (1.0 - 1e-6)  # the step itself must not exceed the limit by its rounding

    def cost(self, each: float, steps: np.ndarray) -> float:
        """Seconds of all scenarios on one core, by the measured cost of a step."""
        points = np.array([record.n_points - 1 for record in self.spec.records])[self.table.record]
        return float((points * steps).sum()) * self.spec.scene.n_dof * each * 1e-9

    def sentence(
        self,
        known: Measured,
        method: str,
        need: dict[str, float],
        steps: np.ndarray,
        still: tuple[int, ...],
        others: dict[str, float],
    ) -> str:
        """Say what was chosen and why."""
        spec, about = self.spec, known.about
        counts = np.concatenate([steps, still])
        lengths = np.array([r.dt for r in spec.records])[np.append(self.table.record, range(len(still)))] / counts
        named = "as the sweep names it" if spec.method else "the cheapest"
        text = (
            f"for a relative error of {spec.accuracy:g}: {method} ({named}; {spec.precision}, located) with "
            f"{_range(counts, 'd')} steps per record interval, {_range(lengths, '.3g')} s. "
            f"Steps in the shortest contact or half period of the highest mode, as measured in "
            f"{about['quantile']:.0%} of scenarios with a safety factor of {about['safety']:g}: "
            + ", ".join(f"{law} {value:.3g}" for law, value in need.items())
            + f"; at least {CONTACT_MARGIN * MIN_STEPS_PER_CONTACT[method, True]:g} in a contact, for its status. "
            f"Half period of the highest mode: {self.mode:.3g} s"
        )
        lasting = self.contact[np.isfinite(self.contact)]
        if lasting.size:
            text += f"; contacts last {_range(lasting, '.3g')} s"
        text += "".join(f". {name} would cost {ratio:.3g} times as much" for name, ratio in others.items())
        return text


def _range(values: np.ndarray, form: str) -> str:
    low, high = format(values.min(), form), format(values.max(), form)
    return low if low == high else f"{low} to {high}"
