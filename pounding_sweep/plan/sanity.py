"""Values that no real building has, and the slip of units that most likely made them.

A sweep may ask for anything that can be computed; what is here is only said. `LIMITS` is the one place of all limits.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import repr_short
from pounding_sweep.base.files import read_data
from pounding_sweep.base.text import comma_hint
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import Law
from pounding_sweep.model.presets import PRESETS
from pounding_sweep.model.variants import Variants
from pounding_sweep.plan.scenarios import requested_scenarios
from pounding_sweep.records import UNITS, Record, record_measures
from pounding_sweep.request.axes import AXES
from pounding_sweep.request.spec import SweepSpec

#: Factors that turn g, m/s2 or cm/s2 into another unit, which records as they are read do not need.
UNIT_FACTORS = (9.81, 9.80665, 981.0, 980.665, 386.4, 386.09, 32.2, 32.174, 0.102, 0.0102, 0.00102)
#: Values that stand for missing ones in files.
MARKS = (-999.0, -9999.0, -99999.0, 9999.0, 99999.0, 999999.0, -32768.0)
#: A shear building whose floors have more mass (t) and period (s) a storey may have its weights (kN) for masses.
WEIGHT_LIKE = (400.0, 0.24)
#: Share of its yield drift that some storey of a row that may yield reaches.
_ELASTIC = 0.01
#: Values that one warning names.
_NAMED = 3


@dataclass(frozen=True)
class Limit:
    """What a quantity of real buildings, and of what is done to them, lies between."""

    what: str  # the quantity
    unit: str
    low: float  # real ones lie between these, ends included
    high: float
    #: slips of units that are common, each with the factor that mends the value
    slips: Mapping[str, float] = field(default_factory=dict)
    #: other quantities that are given for it, each with the range of their values
    mistaken: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    real: str = "real ones"  # what lies between the limits

    def doubt(self, named: Iterable[tuple[str, float]]) -> str:
        """Say which of some values, each with where it stands, are outside, and of what slip; "" where none is."""
        outside = [(place, value) for place, value in named if not self.low <= value <= self.high]
        if not outside:
            return ""
        unit = f" {self.unit}" if self.unit else ""
        values = ", ".join(f"{value:.4g}{unit}{f' ({place})' if place else ''}" for place, value in outside[:_NAMED])
        more = f" and {len(outside) - _NAMED} more" if len(outside) > _NAMED else ""
        span = f"from {self.low:g} to {self.high:.4g}{unit}" if self.low else f"up to {self.high:.4g}{unit}"
        span = span if math.isfinite(self.high) else f"from {self.low:g}{unit} on"
        worst = max((v for _, v in outside), key=lambda value: max(value / self.high, self.low / max(value, 1e-30)))
        mended = {slip: worst * factor for slip, factor in self.slips.items()}
        slips = [f"{slip} ({value:.4g}{unit})" for slip, value in mended.items() if self.low <= value <= self.high]
        slips += [slip for slip, (low, high) in self.mistaken.items() if low <= worst <= high]
        likely = f"; likely {', or '.join(slips)}" if slips else ""
        return f"{self.what} {values}{more}: {self.real} lie {span}{likely}"


LIMITS = {kind: Limit(**entry) for kind, entry in read_data("limits.toml").items()}
"""Limits by quantity."""


def doubts(spec: SweepSpec) -> list[str]:
    """Return what of a sweep is outside any real building, one text each."""
    scene, requested, texts = spec.scene, requested_scenarios(spec), list[str]()
    for name in AXES:
        if hint := comma_hint(getattr(spec, name) or ()):
            texts.append(f"{name} {repr_short(list(getattr(spec, name)))}: {hint}")
    used = requested.variants[np.unique(requested.variant)]

    def check(kind: str, named: Iterable[tuple[str, float]]) -> None:
        if text := LIMITS[kind].doubt(named):
            texts.append(text)

    gaps = np.unique(requested.values["gap"]).tolist()
    # comparisons use the row's own gaps, even where others replace them in every scenario
    places = dict.fromkeys(scene.gaps, "the row's own") | {gap: "" for gap in gaps if gap not in scene.gaps}
    check("gap", ((place, gap) for gap, place in places.items()))
    for building, *factors in zip(scene.buildings, used.mass_factor.T, used.period_factor.T, strict=True):
        name, (masses, periods) = building.name, (np.unique([f.min(), f.max()]).tolist() for f in factors)
        floors, storeys = (
            [f"{name}, {what} {i + 1}" for i in range(building.n_storeys)] for what in ("floor", "storey")
        )
        check("mass", [(at, f * m) for at, m in zip(floors, building.masses, strict=True) for f in masses])
        scales = [f / p**2 for f, p in itertools.product(masses, periods)]
        stiffnesses = zip(storeys, building.stiffnesses or (), strict=False)  # of matrices none
        check("stiffness", [(at, f * k) for at, k in stiffnesses for f in scales])
        check("height", zip(storeys, building.storey_heights or (), strict=True))
        for p in periods if building.p_delta else ():
            shares = zip(storeys, building.lateral_stiffnesses, building.geometric_stiffnesses, strict=True)
            check("stability", [(at, g / (k / p**2 + g)) for at, k, g in shares])
        carried = np.cumsum(building.masses[::-1])[::-1] * STANDARD_GRAVITY
        over = np.divide(building.yield_strengths or np.inf, carried).tolist()
        check("strength", [named for named in zip(storeys, over, strict=True) if math.isfinite(named[1])])
        texts += _weight_like(building)
        check("period", [(name, p * building.periods[0]) for p in periods])
        check("damping", [(name, z) for z in (spec.damping_ratios or np.atleast_1d(building.damping_ratio).tolist())])
    motions = np.broadcast_arrays(requested.record, requested.values["scale"])
    pairs = dict.fromkeys(zip(*(column.ravel().tolist() for column in motions), strict=True))
    scenarios = [(spec.records[i], scale) for i, scale in pairs]
    named = [(f"{record.name}, scale {scale:.4g}", abs(scale) * record.pga) for record, scale in scenarios]
    check("pga", named)
    check("strongest", [max(named, key=lambda item: item[1])])
    texts += [text for record in spec.records for text in record_doubts(record)]
    for odd, why in _ODD_SCALES:
        if scales := [f"{scale:g} ({record.name})" for record, scale in scenarios if odd(scale)]:
            texts.append(f"record scale {', '.join(scales[:_NAMED])} {why}")
    law, stiffness = np.broadcast_arrays(requested.law.T, requested.values["stiffness"].T)
    exponent = np.array([spec.law(key).exponent or 0.0 for key in spec.laws])[law]
    bare = (exponent == 1.0) & np.array([not spec.law(key).thickness for key in spec.laws])[law]
    for kind, power in (("linear_stiffness", 1.0), ("hertz_stiffness", 1.5)):
        check(kind, [("", k) for k in dict.fromkeys(stiffness[exponent == power].tolist())])
    if bare.any() and not any(scene.row == preset.scene.row for preset in PRESETS.values()):
        softest, below = (
            stiffness[bare].min(),
            np.concatenate([b.stiffnesses or b.lateral_stiffnesses for b in scene.buildings]),
        )
        ratios: dict[str, float] = {}  # of floors that meet without bumpers, walls left out
        for contact, bumper in zip(scene.contacts, scene.bumper_of, strict=True):
            if bumper is None and min(contact.left, contact.right) >= 0:
                name, ratio = scene.pair_names[contact.pair], softest / below[[contact.left, contact.right]].min()
                ratios[name] = max(ratio, ratios.get(name, 0.0))
        check("contact", ratios.items())
    return texts


def record_doubts(record: Record) -> list[str]:
    """Return what a motion that was read from a file hardly has, one text each."""
    if record.reading is None:
        return []
    texts = []
    if _converts(record.scale):
        texts.append(f"has scale {record.scale:g}, a factor between units, but is in m/s2 already; leave it out")
    size = UNITS[record.reading.unit] * (record.scale or 1.0)
    marks = [mark for mark in MARKS if np.isclose(record.acceleration, mark * size, rtol=1e-9).any()]
    if marks:
        texts.append(f"has values of {marks[0]:g} {record.reading.unit}, which mark what is missing; cut or mend them")
    if record.duration < 1.0:
        texts.append(f"lasts {record.duration:.3g} s: is it a whole record, and is its step right?")
    measures, mean = record_measures(record), record.acceleration.mean()
    if abs(mean) > 0.05 * record.pga:
        texts.append(f"has a mean of {mean / record.pga:.0%} of its PGA: an offset; take it out")
    elif abs(measures.end_velocity) > 0.5 * measures.pgv:
        share = abs(measures.end_velocity) / measures.pgv
        texts.append(f"ends at {share:.0%} of its PGV: a drift, or cut off; correct its baseline")
    return [f"record {record.name!r} {text}" for text in texts]


def _converts(scale: float) -> bool:
    return bool(np.isclose(abs(scale), UNIT_FACTORS, rtol=1e-3, atol=0.0).any())


#: Scales of records that are hardly meant, and what is odd about them.
_ODD_SCALES: tuple[tuple[Callable[[float], bool], str], ...] = (
    (_converts, "converts units, but records are in m/s2 already; leave it out"),
    (lambda scale: scale < 0.0, "is negative: it turns the ground motion round; was a range or a sign meant?"),
    (lambda scale: not scale, "leaves the ground standing still; decimals have a point, 0.5 for 0,5"),
)


def _weight_like(building: Building) -> list[str]:
    """Say that the masses of a building look like its weights in kN, if they do."""
    mass = np.median(building.masses)
    # A uniform shear building of these medians, which one soft storey of an isolated one does not change.
    storeys = building.n_storeys
    slowness = math.pi / math.sin(0.5 * math.pi / (2 * storeys + 1)) / storeys
    uniform = slowness * math.sqrt(mass / np.median(building.storey_stiffnesses))
    period = np.fmin(building.on_fixed_base.periods[0] / storeys, uniform)
    if storeys < 2 or mass < WEIGHT_LIKE[0] or period < WEIGHT_LIKE[1]:
        return []
    return [
        f"floor masses of {building.name} of about {mass:.4g} t with a first period of {period:.2g} s a storey: are "
        f"they weights in kN? As masses, {mass / STANDARD_GRAVITY:.4g} t, they give "
        f"{period / STANDARD_GRAVITY**0.5:.2g} s"
    ]


def doubts_of(variants: Variants, largest: Mapping[str, np.ndarray], laws: Iterable[Law] = ()) -> Iterator[str]:
    """Say of the largest values of outputs, shape (building or pair, storey), what is outside any real building."""
    scene, drifts = variants.scene, largest.get("drift_max")
    if drifts is not None:
        floors = np.concatenate([d[: b.n_storeys] for b, d in zip(scene.buildings, drifts, strict=True)])
        places = [f"{b.name}, storey {i}" for b in scene.buildings for i in range(1, b.n_storeys + 1)]
        isolators = [i == 0 and b.on_isolators for b in scene.buildings for i in range(b.n_storeys)]
        ratios = np.where(isolators, 0.0, floors / variants.storey_heights)
        if text := LIMITS["drift"].doubt(zip(places, ratios.tolist(), strict=True)):
            yield f"{text}; a linear spring knows nothing of a storey that has failed"
        shares = floors / variants.yield_drifts.min(axis=0)
        if any(scene.yields) and 0.0 < (most := shares.max()) < _ELASTIC:
            yield (
                f"no storey reaches {_ELASTIC:.0%} of its yield drift: the largest share is {most:.2g} "
                f"({places[int(shares.argmax())]}), and the row stays elastic; likely yield_strengths in N given for kN"
            )
    depths = largest.get("penetration_max")
    bare = [contact for contact, bumper in zip(scene.contacts, scene.bumper_of, strict=True) if bumper is None]
    if depths is not None and not any(law.thickness for law in laws):
        named = ((f"{scene.pair_labels[c.place]}, storey {c.storey}", depths[c.place, c.storey - 1]) for c in bare)
        if text := LIMITS["penetration"].doubt(named):
            yield f"{text}; give floors a stiffer contact, or bumpers"
