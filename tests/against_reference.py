"""Small rows beside `reference.py`, every variable of both and how far they differ; materials of OpenSees."""

from __future__ import annotations

from copy import copy
from dataclasses import fields
from functools import lru_cache

import numpy as np
import pytest
import reference
from reference import WALL, ShearBuilding
from scipy.optimize import brentq

import pounding_sweep as ps
from pounding_sweep.engine.postprocess import variables_of
from pounding_sweep.engine.row_kernel import RowKernel
from pounding_sweep.model.variants import variants_of
from pounding_sweep.run.cyclic import imposed_spring
from pounding_sweep.schemes import SCHEMES
from pounding_sweep.variables.registry import VARIABLES, Status, reducers_for


@lru_cache
def motion(points, scale=1.0):
    el_centro = ps.find_record("el_centro")
    return ps.Record("cut", el_centro.dt, scale * el_centro.acceleration[50 : 50 + points])


#: Fields of buildings that the reference knows.
KNOWN = (
    *("name", "masses", "stiffnesses", "damping_ratio", "storey_heights", "slab_depths", "column_stiffnesses"),
    *("yield_strengths", "hardening", "damping_stiffness", "hysteresis", "p_delta", "dashpots", "foundation"),
    *("stiffness_matrix", "damping_matrix", "modal_damping", "infill"),
)


def parameters_of_bouc_wen(building):
    """n, beta and gamma; None of another law."""
    law, *others = building.elements
    return (law.n, law.beta, law.gamma) if law.law == "bouc_wen" and not others else None


class LawSpring:
    """A spring of the reference: branches of a law of the package, which are judged without dynamics."""

    def __init__(self, scene, e):
        row = variants_of(scene)
        self.numbers, self.share = row.spring_numbers[e], row.spring_numbers[e].stiffness[0]
        self.share /= row.stiffnesses[0, scene.springs[e].floor]
        self.spring, _ = imposed_spring(row, e, 1)
        self._note()

    def _note(self):
        """Keep what is frozen until the next event: the line, and numbers of the gauges."""
        kt, ct = self.spring.law.line(self.spring)
        self._line = (kt + self.numbers.geometric).item(), np.asarray(ct).item()
        self._gauges = []
        for gauge in self.spring.law.gauges(self.spring):
            numbers = gauge.low, gauge.high, gauge.below, gauge.above, gauge.way, gauge.turned
            self._gauges.append((bool(np.all(gauge.ranged)), *(np.asarray(x).item() for x in numbers)))

    def _at(self, d):
        other, d = copy(self.spring), np.atleast_1d(d)
        arrays = {name: x for name, x in vars(other).items() if isinstance(x, np.ndarray)}
        vars(other).update({name: x.repeat(d.size) for name, x in arrays.items()}, imposed=d)
        other.group = other.spec = other
        other.law.follow(other)
        return other

    def line(self):
        return self._line

    def gauges(self, d, w):
        for ranged, low, high, below, above, way, turned in self._gauges:
            if ranged:
                yield from ((above, d - high), (below, low - d))
            if way:
                yield turned, -way * w

    def enter(self, phase, d):
        self.spring = self._at(d)
        self.spring.then = np.array([phase])
        self.spring.law.switch(self.spring, np.array([True]))
        self._note()

    def stored(self, d):
        energy = self.spring.law.stored(self._at(d), d) + 0.5 * self.numbers.geometric * np.square(d)
        return energy if np.ndim(d) else energy.item()

    def slip(self, d):
        return self.share * (self._at(d).slip if np.ndim(d) else self._at(d).slip.item())

    def rest(self, d):
        """Where the shear is zero that the storey has as it unloads, NaN where it never is."""

        def shear(x):
            other = self._at(d)
            other.impose(np.atleast_1d(x))
            return other.shear()[0].item()

        leans = self.spring.law.can_fail and self.numbers.geometric.any()  # it may run away, which no law tells
        for size in np.array([1.0, 3.0, 10.0, 30.0, 100.0]) * (np.nan if leans else self.numbers.yield_drift[0]):
            far = d - np.sign(shear(d)) * size
            if shear(d) * shear(far) < 0.0:
                return round(brentq(shear, d, far, xtol=1e-15 * size), 15)
        return np.nan


def stiffnesses_and_strengths(building):
    """Those of storeys with their infill, ductilities still being over the yield drift of the storey's own."""
    if building.infill is None:
        return building.stiffnesses, building.yield_strengths
    k = np.add(building.stiffnesses, building.infill_stiffnesses)
    strengths = building.yield_strengths or np.full(len(k), np.inf)
    return k.tolist(), (strengths * k / building.stiffnesses).tolist()


def springs_of(scene, building):
    """Springs of a building's storeys by laws that the reference itself does not know."""
    known = len(building.elements) == 1 and building.elements[0].law in ("bilinear", "bouc_wen")
    fails = any(law.can_fail for storey in range(building.n_storeys) for law, *_ in building.springs_of(storey))
    if known and building.infill is None and not fails:
        return None
    first, springs = scene.offsets[scene.buildings.index(building)], {}
    for e, spring in enumerate(scene.springs):
        if 0 <= (storey := spring.floor - first) < building.n_storeys:
            springs.setdefault(storey, []).append(LawSpring(scene, e))
    return springs


def buildings_of(scene):
    """The buildings of the reference; refuses a row with anything that it does not know."""
    for b in scene.buildings:
        for each in fields(b):
            if each.name not in KNOWN and each.init and getattr(b, each.name) != each.default:
                raise ValueError(f"tests/reference.py knows no {each.name} of buildings; add it there")
    return [
        WALL
        if isinstance(b, ps.Wall)
        else ShearBuilding(
            list(b.masses),
            stiffnesses_and_strengths(b)[0],
            b.damping_ratio,
            stiffness_matrix=b.stiffness_matrix,
            damping_matrix=b.damping_matrix,
            modal_damping=b.modal_damping,
            storey_heights=list(b.storey_heights),
            slab_depths=b.slab_depths,
            column_stiffnesses=b.column_stiffnesses,
            yield_strengths=stiffnesses_and_strengths(b)[1],
            hardening=b.hardening,
            tangent_damping=b.damping_stiffness == "tangent",
            bouc_wen=parameters_of_bouc_wen(b),
            springs=springs_of(scene, b),
            p_delta=b.p_delta,
            dashpots=b.dashpots,
            foundation=None if b.foundation is None else tuple(vars(b.foundation).values()),
        )
        for b in scene.row
    ]


def number_of(e):
    """D of a restitution, by another root finder."""
    return brentq(lambda x: x * x - 2.0 * e * e * (-x - np.log1p(-x)), 1e-6, 1.0 - 1e-14) / e


def truth(scene, law, points=101, scale=1.5, stop=1.0):
    """The reference of a row, links and bumpers among it, under a law of the scene's own stiffness and restitution."""
    return _truth(scene, law, points, scale, stop)


def law_of(law, stop=1.0):
    """A law as the reference knows it: by its key, or of a rubber bumper its numbers."""
    if not getattr(law, "thickness", 0.0):
        return getattr(law, "key", law)
    flat = 0.8 * law.thickness
    return reference.Law(2.65, "proportional", rebound_only=True, published=number_of, flat=flat, stop=stop)


@lru_cache
def _truth(scene, law, points, scale, stop):
    record, ends = motion(points, scale), [floors for link in scene.links for floors in link.floors]
    links = [
        (link.pair, link.storey, right, link.stiffness, link.damping)
        for link, (_, right) in zip(scene.linked_floors, ends, strict=True)
    ]
    bumpers = [
        (scene.pair_names.index(b.pair), b.storeys or None, law_of(b.law), b.stiffness, b.restitution, b.thickness)
        for b in scene.bumpers
    ]
    whole, e = ps.get_law(law), scene.contact.restitution
    k = whole.reference_stiffness or scene.contact.reference(whole.exponent)
    gaps = [gap - whole.thickness for gap in scene.gaps]
    more = {"links": links, "bumpers": bumpers, "columns": scene.contacts.kind == "floors and columns"}
    only = {scene.pair_names.index(pair): list(storeys) for pair, storeys in scene.storeys}
    ground = record.acceleration, record.dt
    found = reference.run(buildings_of(scene), gaps, *ground, law_of(law, stop), k, e, only=only, rtol=1e-11, **more)
    return {**found, "law": whole.key}


def simulate(scene, law, points=101, scale=1.5, **options):
    return ps.simulate(scene, motion(points, scale), law=law, **{"rest": 0.0, **options})


FLOOR, CONTACT = (
    tuple(
        name
        for name, variable in VARIABLES.items()
        if variable.dims == dims and name != "closing_max" and variable.only not in ("columns", "links", "fails")
    )
    for dims in (("building", "storey"), ("pair", "storey"))
)
BUILDING = {
    "roof_drift_ratio_max": "roof_drift_ratio_max",
    "energy_input": "energy_input",
    "energy_damping": "energy_damping",
    "energy_kinetic": "kinetic_final",
    "energy_strain": "strain_final",
    "hysteretic_energy": "energy_hysteretic",
    "energy_links": "energy_links",
    "energy_transfer_max": "energy_transfer_max",
    "energy_transfer_min": "energy_transfer_min",
}


def both(got, want, scene):
    """Every variable of a Dataset and of the reference as flat arrays, NaN where missing: {name: (got, want)}."""
    real = [i for i, b in enumerate(scene.row) if not isinstance(b, ps.Wall)]
    floors = {name: name for name in FLOOR if name in got}
    if "plastic_drift" in got:
        got, floors["plastic_drift_end"] = got.assign(plastic_drift_end=got.plastic_drift[-1]), "plastic_drift_final"
    result = {}
    for name, other in floors.items():
        mine = [got[name].sel(building=scene.row[i].name).values[: scene.row[i].n_storeys] for i in real]
        result[name] = np.concatenate(mine), np.concatenate([want[other][i] for i in real])
    every = round((len(got.time) - 1) / (len(want["displacement"][real[0]]) - 1))
    moved = [(got.displacement[::every, j, : scene.row[i].n_storeys].values, i) for j, i in enumerate(real)]
    result["displacement"] = tuple(
        np.concatenate([np.ravel(x) for x in part])
        for part in ([mine for mine, _ in moved], [want["displacement"][i] for _, i in moved])
    )
    places = [{"pair": scene.pair_labels[contact.place], "storey": contact.storey} for contact in scene.contacts]
    for name in CONTACT:
        theirs = [x for pair in want[name] for x in pair]
        if want["law"] == "stereomechanical" and VARIABLES[name].of_force:
            theirs = [None if count else 0.0 for pair in want["impact_count"] for count in pair]
        mine = [float(got[name].sel(place)) for place in places]
        result[name] = np.array(mine), np.array([np.nan if x is None else x for x in theirs], dtype=float)
    for end, name in enumerate(("column_shear_bottom_max", "column_shear_top_max")):
        if name in got:
            mine = [float(got[name].sel(place)) for place in places]
            result[name] = np.array(mine), np.concatenate(want["column_shear_max"])[:, end]
    for name, other in ((name, other) for name, other in BUILDING.items() if name in got):
        result[name] = got[name].values, np.asarray(want[other])[real]
    work = np.bincount([c.place for c in scene.contacts], np.concatenate(want["contact_work"]), len(got.pair))
    result["contact_work"] = got["contact_work"].values, work
    return result


def errors(got, want, scene):
    """Largest error of each variable, over its largest absolute value (works and transfers share one)."""
    values = both(got, want, scene)
    size = {name: np.max(np.abs(theirs), initial=0.0, where=~np.isnan(theirs)) for name, (_, theirs) in values.items()}
    exchanged = ("contact_work", "energy_transfer_max", "energy_transfer_min")
    size |= dict.fromkeys(exchanged, max(1e-4 * size["energy_input"], *(size[name] for name in exchanged)))
    result = {}
    for name, (mine, theirs) in values.items():
        assert mine.shape == theirs.shape, name
        assert np.array_equal(np.isnan(mine), np.isnan(theirs)), name
        error = np.max(np.abs(mine - theirs), initial=0.0, where=~np.isnan(theirs))
        result[name] = float(error / (size[name] or 1.0))
    return result | (_of_links(got, want, scene) if scene.links else {}) | _of_foundations(got, want, scene)


def _of_links(got, want, scene):
    mine = [float(got.link_force_max.sel(pair=scene.pair_names[x.pair], storey=x.storey)) for x in scene.linked_floors]
    theirs = [want["link_force"][x.pair][x.storey - 1] for x in scene.linked_floors]
    assert np.isfinite(got.link_force_max).sum() == len(mine)
    energy = abs(float(got.energy_links.sum()) / want["energy_of_links"] - 1.0)
    return {"link_force_max": np.abs(np.array(mine) - theirs).max() / max(theirs), "energy_of_links": energy}


def _of_foundations(got, want, scene):
    found, based = {}, list(scene.foundations)
    for side, name in enumerate(("foundation_sway_max", "foundation_rotation_max") if based else ()):
        theirs = np.array([want["foundation"][b][side] for b in based])
        found[name] = np.abs(got[name].values[based] / theirs - 1.0).max()
        assert np.isfinite(got[name]).sum() == len(theirs)
    return found


def check_reference(scene, law, bound, points=101, scale=1.5, loose=(), **options):
    """Run a row; all variables must be those of the reference, `loose` ones to fifty times the bound. The Dataset."""
    got = simulate(scene, law, points, scale, **options)
    assert int(got.status) == Status.OK
    found = errors(got, truth(scene, law, points, scale), scene)
    for name in loose:
        found[name] /= 50.0
    assert found["impact_count"] == 0.0
    assert max(found.values()) < bound, found
    return got


def error_by_step(scene, law, method, names, steps, points=101, **options):
    """Mean errors of these variables at each of the steps, and the slope of their logarithms."""
    total = []
    for dt in steps:
        got = simulate(scene, law, points, method=method, dt=dt, **options)
        found = errors(got, truth(scene, law, points), scene)
        total.append(np.sqrt(np.mean([found[name] ** 2 for name in names])))
    return np.polyfit(np.log(steps), np.log(total), 1)[0], total


def check_order(scene, method, names, law="kelvin_voigt"):
    """Errors of these variables fall with the step at the scheme's own order."""
    scheme, (slope, total) = SCHEMES[method], error_by_step(scene, law, method, names, [2e-3, 1e-3, 5e-4, 2.5e-4])
    if scheme.flies_exactly:  # its series have no error that a step could make smaller
        assert max(total) < 1e-9, total
        return
    assert 0.9 * scheme.order - 0.1 <= slope < scheme.order + 1.5, (slope, total)


def lanes(*given, **more):
    """Raw results of scenarios beside each other; what is one number is that of all of them."""
    return _lanes(*given, **more)[0]


def lane_values(scene, law, outputs, record, numerics, **given):
    """Raw results, and the variables that they are."""
    raw, kernel = _lanes(scene, law, outputs, record, numerics, **given)
    return raw, variables_of(kernel, raw, outputs, record)


def _lanes(scene, law, outputs, record, numerics, *, variants=None, history=False, twin=False, **given):
    varied = variants is not None
    kernel = RowKernel(scene, ps.get_law(law), numerics, reducers_for(outputs), varied=varied, history=history)
    values = {"scale": 1.0, "gaps": [scene.gaps], "stiffness": 8e5, "restitution": 0.6} | given
    n = max(len(np.atleast_1d(x)) for x in values.values())
    gaps = np.array(np.broadcast_to(values.pop("gaps"), (n, len(scene.gaps))), dtype=float)
    values = {name: np.array(np.broadcast_to(x, n), dtype=float) for name, x in values.items()}
    room = np.zeros(((record.n_points - 1) * numerics.steps(record) + 1, 100)) if history else None
    return kernel.run(record, gaps=gaps, variants=variants, history=room, twin=twin, **values), kernel


def apart(one, other, *, by_lane=False):
    """How far results are from the others, over the largest of these, of all lanes or of each."""
    size = np.abs(other).max(axis=tuple(range(1, other.ndim)) if by_lane else None, keepdims=True)
    return np.abs(one - other) / np.where(size > 0.0, size, 1.0)


def check_energy(scene, method, *stores, law="kelvin_voigt"):
    """The balance, with what else than the usual holds or loses energy, closes at the scheme's order; all runs."""
    scheme, steps, runs = SCHEMES[method], (2e-3, 1e-3, 5e-4), []
    for dt in steps:
        one = simulate(scene, law, 151, method=method, dt=dt)
        rest = one.input - one.transfer - sum(one[name] for name in ("damping", "strain", "kinetic", *stores))
        assert np.abs(rest).max() < 1e-9
        runs.append(one)
    left = [float(one.energy_residual) for one in runs]
    if scheme.flies_exactly:
        assert max(left) < 1e-11, left
        return runs
    assert np.polyfit(np.log(steps), np.log(left), 1)[0] > scheme.order - 0.8, left
    assert left[-1] < {4: 1e-7, 2: 2e-4}[scheme.order]
    return runs


def random_drifts(seed, reach, points=60, histories=50, between=4, corners=()):
    """Return histories between random turns within a reach (m), shape (points, histories), which begin at zero.

    Each goes from turn to turn in `between` steps, and stops at those of the `corners` (m) that it passes.
    """
    rng, rising, rows = np.random.default_rng(seed), sorted(corners), [np.zeros(histories)]
    for turn in rng.uniform(-1.0, 1.0, (points // between, histories)) * rng.uniform(0.1, 1.0, histories) * reach:
        for end in np.linspace(rows[-1], turn, between + 1)[1:]:
            start = rows[-1]
            for up, down in zip(rising, rising[::-1], strict=True):
                corner = np.where(end >= start, up, down)
                rows.append(np.clip(corner, np.minimum(start, end), np.maximum(start, end)))
            rows.append(end)
    return np.array(rows)


def opensees_shears(material, arguments, drifts):
    """Return forces of a uniaxial material along each history, by OpenSees's material tester."""
    ops = pytest.importorskip("openseespy.opensees")
    shears = np.empty_like(drifts)
    for history, column in enumerate(drifts.T.tolist()):
        ops.wipe()
        ops.uniaxialMaterial(material, 1, *arguments)
        ops.testUniaxialMaterial(1)
        for point, drift in enumerate(column):
            ops.setStrain(drift)
            shears[point, history] = ops.getStress()
    ops.wipe()
    return shears


def check_against_opensees(building, material, arguments, drifts, near=1e-9):
    """Check the shears of a building's first storey at every point, to a share of its yield strength; the test."""
    test = ps.cyclic_test(building, drifts)
    error = np.abs(test.shear.values - opensees_shears(material, arguments, drifts)) / building.yield_strengths[0]
    assert error.max() < near, f"{error.max():.3g} at point and history {np.unravel_index(error.argmax(), error.shape)}"
    return test
