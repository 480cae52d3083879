"""What a sweep is: the validated description that everything else starts from.

`pounding_sweep.request.build.build_spec` makes it of what a user gave.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import numpy as np

from pounding_sweep.base.errors import SceneError, SweepError
from pounding_sweep.model.building import Building
from pounding_sweep.model.faults import number_check
from pounding_sweep.model.laws import LAWS, Law, get_law
from pounding_sweep.model.meeting import Contacts
from pounding_sweep.model.scene import Restrainer, Scene
from pounding_sweep.model.variants import Variants, variants_of
from pounding_sweep.records import STANDARD_GRAVITY, Record
from pounding_sweep.request.axes import BUILDING_DEFAULTS, NAMED_KINDS, Axis, AxisValues, Case, as_tuples, case_of
from pounding_sweep.request.design import Design, Distribution
from pounding_sweep.schemes import SCHEMES

#: Time-stepping schemes by name.
METHODS = tuple(SCHEMES)
#: Number formats of the kernels.
PRECISIONS = ("float64", "float32")
#: Range of the relative error that ``accuracy`` may ask for, and that of sweeps which name no scheme and no step.
ACCURACY_RANGE, DEFAULT_ACCURACY = (1e-6, 1e-1), 1e-3
#: Time step (s) where neither a step nor an accuracy is given, or no accuracy can be kept.
DEFAULT_STEP = 1e-3
#: Share of a sweep's own cost that its audit may take, by default.
AUDIT_SHARE = 0.05
#: More scenarios than this are refused.
MAX_SCENARIOS = 1_000_000_000
#: Longest rest (s) that may be given.
MOST_REST = 1e4
#: What a sweep's JSON tells of each record.
_OF_RECORD = ("name", "sha256", "pga", "dt", "n_points", "scale", "source")
#: Problems that one message tells.
MOST_PROBLEMS = 40


@dataclass(frozen=True, kw_only=True)
class SweepSpec(AxisValues):
    """A valid sweep; made by `build_spec` or `load_spec`, which check it.

    Axes (see `AxisValues`) keep the order in which the user gave their values. Without `cases`, one axis of each
    column is set, but for gaps: without them the scene's own are taken. Restitutions are (1.0,) where none was
    given and no law takes one.
    """

    scene: Scene  # the row (kN, t, m, s)
    records: tuple[Record, ...]  # ground motions (m/s2), names all different
    laws: tuple[str, ...]  # keys of contact laws; with `cases`, those that the cases use
    #: listed scenarios instead of the product, in which all that they need is filled in; factors of 1 are left out
    cases: tuple[Case, ...] | None
    method: str | None  # time-stepping scheme; None: chosen by the plan
    dt: float | None  # time step (s); None: chosen by the plan
    locate: bool  # whether steps are split where a pair touches or separates
    outputs: tuple[str, ...]  # variables of the cube
    rest: float | str = "auto"  # time (s) after the record; "auto": until nothing changes any more
    #: parameters of Newmark's method
    beta: float = 0.25
    gamma: float = 0.5
    force_unstable: bool = False  # run even beyond the stability limit
    title: str = ""
    #: number format of the kernels, "float64" or "float32"; None: chosen by the plan
    precision: str | None = "float64"
    #: what damping follows from: the law's formula ("published"), or the rebound of two free masses ("realised")
    restitution_basis: str = "published"
    accuracy: float | None = None  # relative error asked for; the engine then chooses scheme and step
    audit: float = AUDIT_SHARE  # share of the cost at a fixed step spent on comparing a sample; 0: none
    #: records asked for that are missing, where going on without them was allowed
    records_left_out: tuple[str, ...] = ()
    user_laws: tuple[Law, ...] = ()  # those laws that are not in the registry
    sa_period: float | None = None  # period (s) of the axis `sas`
    design: Design | None = None  # what the cases were drawn by

    def scale(self, axis: Axis, value: float, record: Record) -> float:
        """Return the factor on a record that a value of an axis means."""
        return axis.value(value, scene=self.scene, record=record, sa_period=self.sa_period)

    def law(self, key: str) -> Law:
        """Return a law of the sweep by its key."""
        return next((law for law in self.user_laws if law.key == key), None) or get_law(key)

    @property
    def axes(self) -> dict[str, Sequence[Any]]:
        """Values by dimension, in the order of the cube; empty for listed cases."""
        if self.cases is not None:
            return {}
        return self.along(self.laws, tuple(record.name for record in self.records))

    @property
    def n_scenarios(self) -> int:
        """Number of scenarios asked for."""
        return len(self.cases) if self.cases is not None else math.prod(len(v) for v in self.axes.values())

    def case_value(self, case: Case, column: str) -> float:
        """Return the scale or the contact stiffness (kN/m**exponent) of a case; 0 where it has none."""
        axis = case.axis(column)
        if axis is None:
            return 0.0
        if column == "scale":
            return self.scale(*axis, self.record(case.record or self.records[0].name))
        return axis[0].value(axis[1], scene=self.scene, law=self.law(case.law))

    def record(self, name: str) -> Record:
        """Return the record of that name; KeyError if the sweep has none."""
        return {record.name: record for record in self.records}[name]


def check_rest(rest: Any) -> float | str:
    """Return a rest that is valid: "auto" or a number of seconds."""
    is_auto = isinstance(rest, str) and rest == "auto"
    return rest if is_auto else number_check('"auto" or a rest after the record in s', ge=0.0, le=MOST_REST)(rest)


def seconds_of_rest(rest: Any) -> float:
    """Return the time (s) of a valid rest; infinite if it lasts until nothing changes any more."""
    return math.inf if rest == "auto" else float(rest)


def case_variants(scene: Scene, cases: Sequence[Case]) -> tuple[Variants, np.ndarray]:
    """Return the scene as given and behind it what cases make of it, each once; and the row of each case."""
    ratios = [np.nan if case.damping_ratio is None else case.damping_ratio for case in cases]
    settings: list[tuple[str, str | None, np.ndarray]] = [("damping_ratio", None, np.array(ratios, float))]
    for argument, kind in NAMED_KINDS["building"].items():
        factors = [dict(getattr(case, argument)) for case in cases]
        for name in {name for by_name in factors for name in by_name}:
            settings.append((kind, name, np.array([by_name.get(name, BUILDING_DEFAULTS[kind]) for by_name in factors])))
    table, rows = scene_variants(scene, len(cases), settings), dict[bytes, int]()
    index = [rows.setdefault(row.tobytes(), len(rows)) for row in np.column_stack(table.columns)]
    return table[np.unique(index, return_index=True)[1]], np.array(index[1:], np.int32)


def scene_variants(scene: Scene, n: int, settings: Iterable[tuple[str, str | None, np.ndarray]]) -> Variants:
    """Return the scene and behind it `n` variants: values of a property of a building, or of all; NaN: the scene's."""
    names = [building.name for building in scene.buildings]
    kinds = NAMED_KINDS["building"].values()
    columns = {kind: np.full((n + 1, len(names)), BUILDING_DEFAULTS[kind]) for kind in kinds}
    ratio = np.full(n + 1, math.nan)
    for kind, name, values in settings:
        if name is None:
            ratios = {
                None if building.modal_damping is not None else building.damping_ratio for building in scene.buildings
            }
            common = ratios.pop() if len(ratios) == 1 else None
            ratio[1:] = np.where(values == common, math.nan, values) if isinstance(common, float) else values
        else:
            columns[kind][1:, names.index(name)] = values
    hardening = columns["hardening"]
    hardening[hardening == [building.uniform_hardening for building in scene.buildings]] = math.nan
    return Variants(scene, damping_ratio=ratio, **columns)


def with_default_scheme(spec: SweepSpec) -> SweepSpec:
    """Return a sweep at a fixed step, by a scheme that flies exactly where the row and the settings allow one."""
    precision = spec.precision or "float64"
    able = [name for name, scheme in SCHEMES.items() if scheme.refuses(spec.scene, precision) is None]
    exact = [name for name in able if SCHEMES[name].flies_exactly and spec.locate]
    dt = spec.dt or DEFAULT_STEP
    for record in spec.records:
        if fault := step_fault(record, record.dt / dt):
            raise SweepError(f"dt: {dt:g} s is too small: {fault}; give a larger dt, or cut the record")
    return replace(spec, method=(exact or able or METHODS)[0], dt=dt, precision=precision)


def with_accuracy(spec: SweepSpec, accuracy: float) -> SweepSpec:
    """Return a sweep that asks for a relative error in place of its own step; a scheme that it names is kept."""
    low, high = ACCURACY_RANGE
    if not low <= accuracy <= high:
        raise SweepError(f"accuracy is {accuracy!r}; it must be in [{low:g}, {high:g}], the range that was measured")
    return replace(spec, accuracy=accuracy, dt=None)


def sweep_error(problems: Sequence[str], owner: str = "sweep") -> SweepError:
    """Make one error of all problems (texts with their places); of very many, the message has the first ones."""
    if len(problems) == 1:
        return SweepError(problems[0], problems)
    lines = [f"{owner}: {len(problems)} problems", *problems[:MOST_PROBLEMS]]
    if len(problems) > MOST_PROBLEMS:
        lines.append(f"and {len(problems) - MOST_PROBLEMS} more")
    return SweepError("\n  ".join(lines), problems)


def json_data(value: Any) -> Any:
    """Return a sweep, a row or a part of them as JSON holds it: arguments by name, null for what is infinite."""
    match value:
        case Law():
            return value.key if LAWS.get(value.key) is value else value.described
        case Record():
            return {name: getattr(value, name) for name in _OF_RECORD}
        case Case():
            return {name: json_data(item) for name, item in vars(value).items() if item not in (None, ())}
        case Contacts():
            return value.kind
        case tuple() | list():
            return [json_data(item) for item in value]
        case Distribution():
            return value.model_dump(exclude_none=True)
        case _ if is_dataclass(value):
            return {item.name: json_data(getattr(value, item.name)) for item in fields(value) if item.init}
    return None if value == math.inf else value


def scene_of(data: Mapping[str, Any]) -> Scene:
    """Return the row that JSON describes."""
    return Scene(**data)


def laws_of(data: Mapping[str, Any]) -> dict[str, Law]:
    """Return the laws by key that a sweep has beside those of the registry, as JSON describes them."""
    described = data.get("user_laws", {}).items()
    return {key: Law(**{name: value for name, value in law.items() if name != "sha256"}) for key, law in described}


def spec_of(data: Mapping[str, Any], records: Iterable[Record]) -> SweepSpec:
    """Return the sweep that `to_json` wrote, over these records; one that a design drew has its cases alone."""
    read: dict[str, Any] = {name: as_tuples(data[name]) for name in SweepSpec.__dataclass_fields__ if name in data}
    read |= {"scene": scene_of(data["scene"]), "records": tuple(records), "design": None}
    read |= {"cases": data["cases"] and tuple(map(case_of, data["cases"])), "user_laws": tuple(laws_of(data).values())}
    return SweepSpec(**read)


def to_json(spec: SweepSpec) -> str:
    """Write a sweep as canonical JSON: the same sweep gives the same text."""
    laws = {law.key: {**law.described, "sha256": law.sha256} for law in spec.user_laws}
    return canonical({"format": 1, **json_data(spec), "user_laws": laws})


def canonical(data: Any) -> str:
    """Write JSON: the same data give the same text."""
    return json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)


def digest(spec: SweepSpec) -> str:
    """SHA-256 (hex) of `to_json`."""
    return hashlib.sha256(to_json(spec).encode()).hexdigest()


#: Kernels count steps with 32 bits; so many are far beyond any use.
MAX_STEPS = 2**31 - 1


def step_fault(record: Record, per_interval: float) -> str:
    """Say that a record would take too many steps; "" where it won't."""
    steps = per_interval * max(1, record.n_points - 1)
    if steps <= MAX_STEPS:
        return ""
    return f"record {record.name!r} would take {steps:.3g} steps; at most {MAX_STEPS} are possible"


def overview(scene: Scene) -> list[tuple[str, str]]:
    """Describe a row: names of buildings and pairs, and of each what is to be known before anything is run."""
    lines = [(item.name, _building(item)) for item in scene.buildings]
    systems = zip(scene.linked_buildings, variants_of(scene).systems, strict=True) if scene.links else ()
    for group, (frequencies, _) in systems:
        if len(group) > 1:
            periods = ", ".join(f"{2.0 * math.pi / w:.3g}" for w in frequencies[0, :4])
            lines.append((" + ".join(scene.buildings[b].name for b in group), f"linked, periods as one {periods} s"))
    return lines + [(name, _pair(scene, index)) for index, name in enumerate(scene.pair_names)]


def overview_of(attributes: Mapping[Any, Any]) -> list[tuple[str, str]]:
    """Describe the row of a file by its attributes (a sweep, or the row itself, as JSON); nothing if it has none."""
    try:
        stored = json.loads(attributes["sweep"])["scene"] if "sweep" in attributes else json.loads(attributes["scene"])
        return overview(scene_of(stored))
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError, SceneError):  # a file may hold anything
        return []


def _building(item: Building) -> str:
    first, fixed = (
        ", ".join(f"{period:.3g}" for period in building.periods[:2]) for building in (item, item.on_fixed_base)
    )
    plural = "s" * (item.n_storeys > 1)
    weight = f"weight {sum(item.masses) * STANDARD_GRAVITY:.0f} kN"
    if item.p_delta:
        weight += " with P-Delta"
        if item.stiffnesses:
            weight += f", stability coefficients up to {max(item.stability_coefficients):.2g}"
    if item.on_isolators and item.yields[0]:
        soft = replace(
            item, stiffnesses=[item.hardenings[0] * item.storey_stiffnesses[0], *item.storey_stiffnesses[1:]]
        )
        first += f" s before its isolators yield, {', '.join(f'{period:.3g}' for period in soft.periods[:2])} s after,"
    else:
        first += " s,"
    if item.foundation is not None:
        weight += f", on a foundation (on a fixed base {fixed} s)"
    return f"{item.n_storeys} storey{plural}, {item.elevations[-1]:g} m high, period{plural} {first} {weight}"


def _pair(scene: Scene, pair: int) -> str:
    left, right = scene.row[pair : pair + 2]
    elevations = [z for item in scene.buildings for z in item.levels]
    contacts = [contact for contact in scene.contacts if contact.pair == pair]
    meets = [elevations[c.right if c.left < 0 else c.left] for c in contacts if c.struck < 0 and not c.restrainer]
    limited = " (limited by the scene)" if scene.pair_names[pair] in dict(scene.storeys) else ""
    parts = [f"floors meet at {_listed(sorted(meets))} m{limited}" if meets else f"no floors meet{limited}"]
    for bumper in (bumper for bumper in scene.fittings if bumper.pair == scene.pair_names[pair]):
        places = zip(scene.contacts, scene.bumper_of, strict=True)
        storeys = _listed(sorted({contact.storey for contact, other in places if other is bumper}))
        thick = f"{1e3 * bumper.thickness:g} mm, " if bumper.thickness else ""
        text = f"{thick}k = {bumper.stiffness:.4g} {bumper.law.stiffness_unit}"
        text += f", e = {bumper.restitution:g}" if bumper.restitution is not None else ""
        if isinstance(bumper, Restrainer):
            closing = "" if bumper.closing_slack is None else f", {1e3 * bumper.closing_slack:g} mm together"
            text = f"slack {1e3 * bumper.slack:g} mm apart{closing}, {text}"
        kind = "restrainers" if isinstance(bumper, Restrainer) else "bumpers"
        parts.append(f"storeys {storeys} with {kind} {bumper.law.key!r}: {text}")
    for side, facing in enumerate(scene.faced(pair)):
        item, other = (left, right)[:: 1 - 2 * side]
        struck = {contact.storey for contact in contacts if contact.struck == 1 - side}
        for does in ("strikes", "passes through"):
            floors = [f.floor for f in facing if (f.floor + 1 in struck) is (does == "strikes")]
            if floors and isinstance(item, Building):
                levels = _listed(sorted(item.levels[floors]))
                parts.append(f"{item.name} {does} columns of {other.name} at {levels} m")
    return "; ".join(parts)


def _listed(values: Sequence[float]) -> str:
    """List numbers; of more than eight the first and the last, and how many they are."""
    if len(values) <= 8:
        return ", ".join(f"{value:g}" for value in values)
    return f"{values[0]:g} to {values[-1]:g} ({len(values)})"
