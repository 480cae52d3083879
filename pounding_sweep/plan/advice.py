"""The scheme and the steps that reach a relative error, by measurement.

``measured.json`` (made by ``python -m benchmarks.calibrate``, from a clone) holds, for every law, scheme and class of
outputs, the relative error against the number of steps in the shortest time of a scenario, the shorter of its shortest
contact and half the period of the buildings' highest mode. Scenarios begin with the largest step that keeps most errors
within what is asked, in the scheme whose steps cost least.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from pounding_sweep.base.errors import SweepError
from pounding_sweep.engine.postprocess import MAX_PHASE_ERROR, loses_ground, phase_error
from pounding_sweep.engine.row_kernel import Numerics, RowKernel, flight_refinement, kernel_shape
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import LAWS, RESTING_SPEED, Law, duration_of
from pounding_sweep.model.scene import Scene
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.plan.scenarios import Scenarios, stable_steps
from pounding_sweep.records import Record
from pounding_sweep.request.spec import DEFAULT_ACCURACY, PRECISIONS, SweepSpec, seconds_of_rest, step_fault
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.schemes.stability import largest_step
from pounding_sweep.variables.registry import CLASSES, check_outputs, reducers_for

#: Variants whose motions are estimated at a time, and points of a record times variants.
_BLOCK = 4096
#: Damping ratio at which a first mode is taken that its base damps beyond vibration.
_MOST_DAMPED = 0.999


def elastic_duration(exponent: float, stiffness: np.ndarray | float, mass: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """How long two free masses stay in contact without damping (s)."""
    factor, share = duration_of(exponent)
    slow = np.maximum(speed, RESTING_SPEED) ** ((1.0 - exponent) * share)
    return factor * (np.asarray(mass) / np.asarray(stiffness)) ** share * slow


def highest_frequency(row: Scene | Variants) -> np.ndarray:
    """Highest natural circular frequency of the buildings (rad/s), shape (n,); one number for a scene."""
    return np.max([frequencies[:, -1] for frequencies, _ in variants_of(row).systems], axis=0)


def approach_speeds(row: Scene | Variants, record: Record) -> np.ndarray:
    """Estimate how fast the neighbours of each pair approach each other (m/s), and at most in the rest after a record.

    Of shape (variants, pairs).
    """
    variants = variants_of(row)
    first, which = variants.flights()
    parts = [_pair_speeds(variants[first[k : k + _BLOCK]], record) for k in range(0, len(first), _BLOCK)]
    return np.concatenate(parts, axis=1).T[which]


def _pair_speeds(variants: Variants, record: Record) -> np.ndarray:
    """Largest difference of the roof velocities of neighbours in their first modes (m/s), shape (pairs, n)."""
    scene = variants.scene
    h, ground = record.dt, np.append(record.acceleration, 0.0)  # in one more step the ground comes to rest
    moving = [isinstance(item, Building) for item in scene.row]
    frequency = np.stack([variants.frequencies[b][:, 0] for b in range(len(scene.buildings))])
    damping = np.stack([variants.modal_damping(b)[:, 0] for b in range(len(scene.buildings))])
    damping = np.where(damping < 1.0, damping, _MOST_DAMPED)
    # q'' + 2 zeta w q' + w^2 q = -a_g in the complex root s: z' = s z - a_g, q' = Im(s z) / Im(s)
    root = frequency * (-damping + 1j * np.sqrt(1.0 - damping**2))
    growth = np.exp(root * h)
    late = (growth - 1.0 - root * h) / (root**2 * h)
    early = (growth - 1.0) / root - late
    # velocity of the roof by that of the first mode, as the ground moves the building with all it stands on
    shares = []
    for building in scene.buildings:
        phi, foundation = building.modes[1][:, 0], building.foundation
        moved = building.masses if foundation is None else (*building.masses, foundation.mass)
        shares.append(float(phi[building.n_storeys - 1] * (phi[: len(moved)] @ moved)))
    participation = np.array(shares)[:, None] / root.imag
    fastest = np.zeros((len(moving) - 1, len(variants)))
    state, most = np.zeros(root.shape, complex), 1 + _BLOCK // len(variants)
    for first in range(1, len(ground), most):
        a = ground[first - 1 : first + most, None, None]
        states = -(early * a[:-1] + late * a[1:])
        states[0] += growth * state
        reach, power = 1, growth  # each state then knows of the `reach` points up to its own
        while reach < len(states):
            states[reach:] += power * states[:-reach]
            reach, power = 2 * reach, power * power
        state = states[-1]
        velocities = np.zeros((len(states), len(moving), len(variants)))  # walls stand still
        velocities[:, moving] = (root * states).imag * participation
        fastest = np.maximum(fastest, np.abs(np.diff(velocities, axis=1)).max(axis=0))
    left = np.zeros((len(moving), len(variants)))
    left[moving] = np.abs(root * state * participation)
    return np.maximum(fastest, left[1:] + left[:-1])


def shortest_contact(
    row: Scene | Variants,
    law: Law,
    stiffness: np.ndarray,
    restitution: np.ndarray,
    speeds: np.ndarray,
    basis: str = "published",
) -> np.ndarray:
    """Shortest effective contact duration of each scenario (s); infinite where no contact lasts."""
    shortest = of_bumpers = np.full(len(stiffness), np.inf)
    if law.exponent is None:
        return shortest
    variants = variants_of(row)
    stiffnesses = variants.contact_stiffnesses(stiffness)
    quickening = variants.scene.of_contacts(law.quickening(restitution, basis))
    for j, (contact, bumper) in enumerate(zip(variants.scene.contacts, variants.scene.bumper_of, strict=True)):
        speed, mass = speeds[:, contact.pair], variants.contact_masses[:, j]
        if bumper is not None:
            lasting = elastic_duration(bumper.law.exponent, bumper.stiffness, mass, speed)
            of_bumpers = np.minimum(of_bumpers, lasting / bumper.quickening(basis))
        else:
            lasting = elastic_duration(law.exponent, stiffnesses[:, j], mass, speed)
            shortest = np.minimum(shortest, lasting / quickening[:, j])
    return np.minimum(shortest, of_bumpers)


#: File of measured errors beside this module.
MEASURED = "measured.json"
#: Method and precision.
SchemeAndFormat = tuple[str, ...]
#: Steps in the shortest contact over those that its status asks for: its speed is an estimate, and three times the
#: speed shortens a Hertz contact by so much.
CONTACT_MARGIN = 1.25
#: Short exact steps in half a period of the highest mode where `refinement` is 1: those of Runge-Kutta where floors
#: meet.
EXACT_STEPS = 4.0
#: Relative error beyond which steps are too long for their errors to follow the order of a scheme.
ORDERLY = 2e-3
#: Relative error beyond which steps grow no longer: more scenarios would be refined, at a greater cost.
COARSEST = 1e-2
#: Least long step (s) of exact flight whose cost was measured, most of it that of contacts: where all that is elastic
#: flies, shorter ones cost as much less.
COSTED_STEP = 0.01
#: Part of what is allowed within which measured errors are where one run is enough.
ENOUGH = 0.01
#: Part of what is allowed within which a scenario begins: to begin finer costs less than to be refined.
EARLY = 0.6
#: Relative error below which that of single precision may be one of rounding: penetrations of stiff contacts are small
#: differences of displacements.
ROUNDING = 2e-5
#: The same of schemes that step all along: what is rounded in each step adds up.
ROUNDING_OF_STEPS = 2e-4
#: Numbers of steps that a record interval may have: few, so that many scenarios share one.
_STEPS = np.unique([*range(1, 7), *(m * 10**d for m in (8, 10, 12, 16, 20, 25, 30, 40, 50, 60) for d in range(9))])


@dataclass(frozen=True)
class Curve:
    """Measured error against steps in the shortest time."""

    steps: tuple[float, ...]  # steps in the shortest time of the scenario, rising
    error: tuple[float, ...]  # relative error of so many steps

    def needed(self, accuracy: float) -> float:
        """Return the least steps from which on the error stays within `accuracy`; infinite if that was not reached."""
        # the largest error of so many steps or more, by rising errors: no use of a lucky coarse step
        error = np.log(np.maximum.accumulate(self.error[::-1]))
        if error[0] > math.log(accuracy) + 1e-12:
            return math.inf
        return float(np.exp(np.interp(math.log(accuracy), error, np.log(self.steps[::-1]))))


@dataclass(frozen=True)
class Measured:
    """What was measured: errors and costs."""

    curves: dict[tuple[str, ...], Curve]  # (method, precision, law, class of outputs) -> `Curve`
    #: (method, precision) -> ns of one scenario, step (of exact flight: long step) and degree of freedom
    cost: dict[SchemeAndFormat, float]
    about: dict[str, Any]  # where the numbers come from: quantile, version, date, machine


@lru_cache(maxsize=1)
def load_measured() -> Measured:
    """Read the measured errors and costs of this version of the package."""
    return read_measured(json.loads(files("pounding_sweep").joinpath("data", MEASURED).read_text(encoding="utf-8")))


def measured_schemes() -> tuple[str, ...]:
    """Return the schemes that `accuracy` chooses from."""
    return tuple(dict.fromkeys(method for method, _ in load_measured().cost))


def read_measured(data: dict[str, Any]) -> Measured:
    """Return what ``measured.json`` holds."""
    curves = {
        (*scheme.split("/"), law, kind): Curve(*zip(*points, strict=True))
        for scheme, laws in data["errors"].items()
        for law, classes in laws.items()
        for kind, points in classes.items()
    }
    cost = {tuple(scheme.split("/")): float(value) for scheme, value in data["cost"].items()}
    return Measured(curves, cost, data["about"])


def classes_of(outputs: Iterable[str]) -> tuple[str, ...]:
    """Return the classes that hold any of `outputs`; motions where none does."""
    requested = set(check_outputs(outputs))
    return tuple(kind for kind, names in CLASSES.items() if requested & set(names)) or ("motions",)


def round_up_steps(wanted: np.ndarray) -> np.ndarray:
    """Round numbers of steps up to 1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 30, 40, 50, 60, 80, 100, 120 ..."""
    return _STEPS[np.searchsorted(_STEPS, np.asarray(wanted, float) * (1.0 - 1e-9))]


def rounding(method: str) -> float:
    """Relative error below which that of a scheme in single precision may be one of rounding."""
    return ROUNDING if SCHEMES[method].flies_exactly else ROUNDING_OF_STEPS


def _refinement(method: str, need: dict[str, float]) -> float:
    """Divisor of sub-steps and flight steps: exact flight is refined by it, the other schemes by their steps alone."""
    return max(need.values()) if SCHEMES[method].flies_exactly else 1.0


@dataclass(frozen=True)
class Demand:
    """The times that the scenarios of a sweep must resolve, and what steps then cost."""

    spec: SweepSpec
    accuracy: float  # relative error asked for
    laws: Sequence[Law]  # those that the table counts, the last without contact
    table: Scenarios
    repeats: np.ndarray  # how many scenarios each row of the table stands for
    variants: Variants
    initial_speed: float  # largest speed of approach at the start (m/s)

    @cached_property
    def mode(self) -> np.ndarray:
        """Half the period of the buildings' highest mode of each variant (s)."""
        return math.pi / highest_frequency(self.variants)

    @cached_property
    def contact(self) -> np.ndarray:
        """Shortest contact of each scenario (s)."""
        spec, variants, result = self.spec, self.variants, np.full(len(self.table), np.inf)
        speeds = np.zeros((len(spec.records), len(variants), len(spec.scene.pair_names)))
        # only forces that are not linear make contacts of a duration that depends on the speed
        if any(law.exponent not in (None, 1.0) for law in (*self.laws, *(b.law for b in spec.scene.fittings))):
            speeds = np.stack([approach_speeds(variants, record) for record in spec.records])
        for i, rows in self.table.by_law():
            part = self.table[rows]
            speed = np.abs(part.scale)[:, None] * speeds[part.record, part.variant] + self.initial_speed
            contact = part.stiffness, part.restitution, speed, spec.restitution_basis
            result[rows] = shortest_contact(variants[part.variant], self.laws[i], *contact)
        return result

    def stepless(self, method: str) -> np.ndarray:
        """Whether the steps of a scheme decide nothing under each law: contacts go by series, or there are none."""
        numerics = Numerics(method, 1.0)
        return np.array([kernel_shape(self.spec.scene, law, numerics, ()).stepless for law in self.laws])

    def needs(self, measured: Measured, scheme: SchemeAndFormat) -> tuple[dict[str, float], tuple[float, str]]:
        """Return what laws need, `refinement` of exact flight, else steps in the shortest time, and the worst error."""
        method, precision = scheme
        spec, need, worst, of_bumpers = self.spec, dict[str, float](), (0.0, ""), 0.0
        for law in (*(bumper.law for bumper in spec.scene.fittings), *self.laws):
            # a law of a user's own has no curves: its scenarios begin as those of the law that asks for most
            similar = [law.key] if LAWS.get(law.key) == law else list(LAWS)
            try:
                curves = [measured.curves[(*scheme, key, kind)] for key in similar for kind in classes_of(spec.outputs)]
            except KeyError:
                raise SweepError(
                    f"accuracy: no errors of law {law.key!r} with {' and precision '.join(scheme)} were measured; "
                    "give method and dt instead, or measure them, from a clone: python -m benchmarks.calibrate"
                ) from None
            # the run that is kept has half the step
            ordered = not law.impulsive and self.accuracy <= ORDERLY
            start = EARLY * self.accuracy * (SCHEMES[method].leeway if ordered else 1.0)
            pairs = [(curve.needed(self.accuracy), curve.needed(start)) for curve in curves]
            most = max(pair[0] if math.inf in pair else pair[1] for pair in pairs)
            # steps by series hardly err: it is flight that decides, but the longest lose all digits of single precision
            if kernel_shape(spec.scene, law, Numerics(method, 1.0, precision=precision), ()).series:
                most = max(most, 0.5 * flight_refinement(min(self.accuracy, DEFAULT_ACCURACY)))
            if law in self.laws:
                need[law.key] = max(most, of_bumpers) if law.has_contact else most
            else:
                of_bumpers = max(of_bumpers, most)
            worst = max(worst, *((curve.error[-1], law.key) for curve in curves))
        return need, worst

    def steps(self, method: str, need: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Return steps per record interval of each scenario, and of the run without pounding by record and variant."""
        spec, table, scheme = self.spec, self.table, SCHEMES[method]
        interval, mode = np.array([record.dt for record in spec.records]), self.mode[table.variant]
        # of exact flight contacts have sub-steps of their own: modes decide, and beside series they alone
        of_modes = EXACT_STEPS * _refinement(method, need) if scheme.flies_exactly else need["none"]
        alike = self.stepless(method)[table.law]
        resolved = np.where(alike, np.inf, self.contact)
        wanted = np.maximum(of_modes / mode, CONTACT_MARGIN * scheme.min_steps_located / resolved)
        if not scheme.flies_exactly:
            of_laws = np.array([need[law.key] for law in self.laws])[table.law]
            wanted = np.maximum(wanted, of_laws / np.minimum(self.contact, mode))
        # the step itself must not exceed the limit by its rounding
        wanted = np.maximum(wanted, 1.0 / (stable_steps(spec, self.laws, table, self.variants, method) * (1.0 - 1e-6)))
        most = np.full(len(interval), np.max(of_modes / self.mode))
        np.maximum.at(most, table.record, wanted)
        for record, rate in zip(spec.records, most.tolist(), strict=True):
            if fault := step_fault(record, rate * record.dt):
                raise SweepError(f"accuracy {self.accuracy:g}: {fault}; resample the record at a smaller dt, or cut it")
        least = np.stack([self._motion_steps(method, record) for record in spec.records])
        one = np.ones(len(self.variants))
        limit = largest_step(self.variants, self.laws[-1], 0.0 * one, one, method=method) * (1.0 - 1e-6)
        uncoupled = round_up_steps(np.maximum(of_modes / self.mode, 1.0 / limit) * interval[:, None])
        steps = round_up_steps(wanted * interval[table.record])
        steps = np.maximum(steps, least[table.record, table.variant])
        # beside series a step more costs nothing: few numbers of steps, so that more scenarios run together
        steps = np.where(alike, 2.0 ** np.ceil(np.log2(np.maximum(steps, 2))), steps)
        return steps.astype(np.int32), np.maximum(uncoupled, least).astype(np.int32)

    def _motion_steps(self, method: str, record: Record) -> np.ndarray:
        """Least steps per interval at which the buildings of each variant keep their phase over so long a record."""
        # exact flight keeps the phase, but of storeys that yield and floors that rest on each other
        stepped = any(self.spec.scene.yields) or any(law.impulsive for law in self.laws)
        flies = SCHEMES[method].flies_exactly and not stepped
        limit = MAX_PHASE_ERROR if flies else min(self.accuracy, MAX_PHASE_ERROR)
        result = np.zeros(len(self.variants), dtype=int)
        steps = iter(_STEPS.tolist())
        while not result.all():
            count = next(steps)
            numerics = Numerics(method, record.dt / count, rest=seconds_of_rest(self.spec.rest))
            if not loses_ground(record, numerics):
                result[(result == 0) & (phase_error(self.variants, record, numerics) <= limit)] = count
        return result

    def needs_one_run(self, measured: Measured, scheme: SchemeAndFormat, need: dict[str, float]) -> bool:
        """Whether measured errors are so small that one run in single precision is enough, if a sample agrees.

        What yields, falls, jumps or is stepped by stages magnifies errors more than was measured.
        """
        spec, scene, (method, precision) = self.spec, self.spec.scene, scheme
        steady = all(law in LAWS.values() for law in self.laws) and bool(self.stepless(method).all())
        steady &= not (scene.padded or any(scene.yields) or any(scene.falls))
        if not steady or precision != "float32" or self.accuracy < COARSEST:
            return False
        least = ENOUGH * self.accuracy
        pairs = ((law.key, kind) for law in self.laws for kind in classes_of(spec.outputs))
        return all(measured.curves[(*scheme, key, kind)].needed(least) <= need[key] for key, kind in pairs)

    def cost(self, method: str, nanoseconds: float, steps: np.ndarray, need: dict[str, float]) -> float:
        """Seconds of all scenarios on one core, by the measured cost of a step."""
        total, refinement = 0.0, _refinement(method, need)
        for r, count, rows in self.table.by_step(steps):
            record, interval_steps = self.spec.records[r], np.full(len(rows), float(count))
            if SCHEMES[method].flies_exactly:
                numerics = Numerics(method, record.dt / count, refinement=refinement)
                kernel = RowKernel(self.spec.scene, self.laws[-1], numerics, reducers_for(self.spec.outputs))
                interval_steps = kernel.flight_substeps(record, self.variants[self.table.variant[rows]])
                if not any(self.spec.scene.yields):
                    interval_steps = np.minimum(interval_steps, record.dt / COSTED_STEP)
            total += (record.n_points - 1) * float((interval_steps * self.repeats[rows]).sum())
        return total * self.spec.scene.n_dof * nanoseconds * 1e-9


class Choice(NamedTuple):
    """The scheme of a sweep and the steps of its scenarios."""

    numerics: Numerics  # with the largest step of the runs without pounding
    steps: np.ndarray  # per record interval, of each row of a table; int
    uncoupled_steps: np.ndarray  # those of the runs without pounding, shape (records, variants); int
    text: str = ""  # what was chosen, as a sentence
    numbers: dict[str, Any] | None = None  # those that led to it
    once: bool = False  # whether one run may be enough, by measured errors


def advise(demand: Demand) -> Choice:
    """Choose the scheme of a sweep with an accuracy, and the steps of its scenarios; always the same.

    Raises `SweepError` if a law was not measured, or no scheme reached the accuracy.
    """
    spec, table, measured = demand.spec, demand.table, load_measured()
    candidates, reached = list[tuple[float, SchemeAndFormat, dict[str, float], np.ndarray, np.ndarray]](), list[str]()
    for scheme, cost in measured.cost.items():
        method, precision = scheme
        # small differences of large numbers need the wide format
        wide = "energies" in classes_of(spec.outputs) or demand.accuracy < rounding(method)
        formats = (spec.precision,) if spec.precision else ("float64",) if wide else PRECISIONS
        fits = spec.method in (None, method) and precision in formats
        if not fits or SCHEMES[method].refuses(spec.scene, precision) is not None:
            continue
        need, (error, law) = demand.needs(measured, scheme)
        if max(need.values()) == math.inf:
            reached.append(f"{' '.join(scheme)} reaches {error:.2g} with law {law}")
        else:
            steps, uncoupled = demand.steps(method, need)
            candidates.append((demand.cost(method, cost, steps, need), scheme, need, steps, uncoupled))
    if reached and not candidates:
        raise SweepError(
            f"accuracy {demand.accuracy:g} was not reached when errors were measured ({', '.join(reached)}); ask for "
            "less, for other laws or another method, or give dt and see the audit of the cube"
        )
    if not candidates:
        whose = spec.method or "any scheme that runs this row"
        how = ", or measure them, from a clone: python -m benchmarks.calibrate"
        how *= spec.method is None or bool(SCHEMES[spec.method].ladder)
        raise SweepError(f"accuracy: no errors of {whose} were measured; give dt instead{how}")
    (least, scheme, need, steps, uncoupled), *rest = sorted(candidates, key=lambda candidate: candidate[0])
    (method, precision), quantile = scheme, float(measured.about["quantile"])
    others = {" ".join(name): cost / least for cost, name, *_ in rest if least}
    more = "".join([f" ({name}: {ratio:.2g} times the cost)" for name, ratio in others.items()][:1])
    interval, used = np.array([record.dt for record in spec.records]), uncoupled[:, np.unique(table.variant)]
    counts = np.concatenate([steps, used.ravel()])
    lengths = np.concatenate([interval[table.record] / steps, (interval[:, None] / used).ravel()])
    low, high = int(counts.min()), int(counts.max())
    number = f"{low if low == high else f'{low} to {high}'} step{'s' * (high > 1)}"
    laws = (*spec.user_laws, *(bumper.law for bumper in spec.scene.fittings))
    numbers = {
        "accuracy": spec.accuracy,
        "method": method,
        "precision": precision,
        "steps_per_record_interval": [low, high],
        "step": [float(lengths.min()), float(lengths.max())],
        "quantile": quantile,
        "refinement" if SCHEMES[method].flies_exactly else "steps_in_shortest_time": need,
        "laws_not_measured": list(dict.fromkeys(law.key for law in laws if LAWS.get(law.key) != law)),
        "relative_cost_of_others": others,
    }
    largest = float((interval / uncoupled.min(axis=1)).max())
    settings = (spec.locate, spec.beta, spec.gamma, precision, _refinement(method, need))
    sentence = f"{spec.accuracy:g}: {' '.join(scheme)}, {number} per record interval to begin with{more}"
    numerics = Numerics(method, largest, *settings, seconds_of_rest(demand.spec.rest))
    once = demand.needs_one_run(measured, scheme, need)
    sentence += ", one run of each where a sample of them allows it" * once
    return Choice(numerics, steps, uncoupled, sentence, numbers, once)
