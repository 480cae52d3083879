"""Scenarios in steps of another length, scheme or precision: what long steps must not miss, against short ones."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from against_reference import apart, lanes, motion
from kernels_used import LINKED
from kinds import ALONE, YIELDS
from scenes import EVERY, motions, pair
from test_kernels import PAIR, PAPER, ROWS

import pounding_sweep as ps
from benchmarks.drawn_rows import draw, earthquakes
from pounding_sweep.engine.row_kernel import Numerics
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.variants import Variants
from pounding_sweep.variables.registry import DEFAULT_OUTPUTS

EL_CENTRO = ps.find_record("el_centro")


def exact(dt, refinement=1.0, precision="float64"):
    return Numerics("exact", dt, refinement=refinement, precision=precision)


def rk4(dt, precision="float64"):
    return Numerics("rk4", dt, precision=precision)


@dataclass(frozen=True)
class Case:
    scene: ps.Scene
    law: str
    record: ps.Record
    #: The numerics that are judged, and those that are right.
    one: Numerics
    other: Numerics
    #: Largest difference of results, over the largest of all lanes.
    near: dict
    given: dict = field(default_factory=dict)
    outputs: tuple = ("displacement_max", "impact_force_max", "impact_count")
    #: Differences are over the largest of each lane, and those of a quantile of lanes count.
    by_lane: bool = False
    quantile: float = 1.0
    least_touches: int = 20


def drawn(seed, n, low, high):
    """Random gaps, restitutions and stiffnesses; the last by powers of ten."""
    rng = np.random.default_rng(seed)
    given = {"gaps": rng.uniform(0.004, 0.02, (n, 1)), "restitution": rng.uniform(0.2, 0.9, n)}
    return given | {"stiffness": 7.52e6 * 10.0 ** rng.uniform(low, high, n)}


def some(n, gaps, pairs=1, seed=5):
    rng = np.random.default_rng(seed)
    return {
        "scale": rng.choice([-1.5, -1.0, 0.3, 0.7, 1.0, 1.3, 2.0], n),
        "gaps": rng.choice(gaps, (n, pairs)),
        "stiffness": 8e5 * 10.0 ** rng.uniform(-1.0, 1.0, n),
        "restitution": rng.uniform(0.2, 1.0, n),
    }


def product(gaps, restitutions, scales):
    gaps, restitution, scale = (x.ravel() for x in np.meshgrid(gaps, restitutions, scales, indexing="ij"))
    return {"gaps": gaps[:, None], "restitution": restitution, "scale": scale}


def resting():
    """Two of random scenarios."""
    rng, n = np.random.default_rng(5), 512
    given = {"scale": rng.uniform(0.3, 3.0, n), "gaps": rng.uniform(0.0, 0.01, (n, 1))}
    given |= {"stiffness": 2e5 * np.exp(rng.uniform(-2.0, 2.0, n)), "restitution": rng.uniform(0.1, 0.98, n)}
    return {name: values[[33, 118]] for name, values in given.items()}


def linked(n):
    rng = np.random.default_rng(6)
    factors = rng.uniform(0.7, 1.4, (n, 2)), rng.uniform(0.5, 2.0, (n, 2)), rng.choice([0.02, np.nan], n)
    return {**some(n, [0.001, 0.004, 0.05]), "variants": Variants(LINKED, *factors)}


def stiffer(factor):
    return replace(pair(), row=[replace(b, stiffnesses=[factor * k for k in b.stiffnesses]) for b in pair().row])


#: Two buildings all but level with each other, whose floors strike each other's columns 2 mm beside them.
TWICE = ps.Scene(
    [
        ps.Building("a", [40.0] * 2, [2e4] * 2, 0.05, [3.0, 3.0]),
        ps.Building("b", [60.0] * 2, [9e4] * 2, 0.05, [3.002, 3]),
    ],
    gaps=[0.01],
    contacts="floors and columns",
)
ONE_STOREY = [ps.Building("a", [630.0], [1.5e4]), ps.Building("b", [147.0, 145.0], [4460.0, 3420.0], 0.01)]
ONE_STOREY += [ps.Building("c", [147.0], [2.04e4], 0.01), ps.Building("d", [269.0, 224.0], [2.53e5, 1.71e5], 0.01)]
FOUR = [
    ps.Building("a", [120.0735], [19008.455], 0.05),
    ps.Building("b", [43.88994, 60.60579], [5016.0765, 4832.2155], 0.05),
    ps.Building("c", [63.43119], [3002.8039], 0.1),
    ps.Building("d", [120.7586, 67.86361], [69836.485, 50960.255], 0.05),
]
_T = 0.02 * np.arange(100)
SWAYS = ps.Building("a", [120.0, 90.0], [1.5e4, 1.2e4]), ps.Building("b", [80.0, 110.0], [1.4e4, 1.0e4])
COUNTS = {"count": 0.0}
FAST = {
    "several events in one step": Case(
        pair(), "kelvin_voigt", EL_CENTRO, exact(0.02), exact(0.0025, 8.0),
        COUNTS | {"impulse": 1e-11, "work": 1e-8, "tmax": 1e-8, "fmax": 1e-8},
        {"gaps": np.linspace(2e-4, 6e-3, 400)[:, None], "stiffness": 2e6}, tuple(EVERY), least_touches=100,
    ),
    **{
        f"a contact that turns twice, {factor} {seed}": Case(
            stiffer(factor), "kelvin_voigt", ps.synthetic_record(seed, duration=20.0, dt=0.02, pga=3.0),
            exact(0.02, 0.35), exact(0.0025, 8.0), COUNTS,
            {"gaps": np.geomspace(1e-4, 6e-3, 400)[:, None], "stiffness": 2e6}, tuple(EVERY),
        )
        for factor, seed in ((0.7, 1), (0.7, 2), (1.3, 2))
    },
}  # fmt: skip
SLOW = {
    **{
        f"sub-steps beside flight, {law}": Case(
            PAIR, law, motion(600), exact(5e-3), exact(5e-3, 12.0), {"umax": 6e-6, "umin": 6e-6, "fmax": 2e-4},
            drawn(4, 48, -0.6, 0.6), by_lane=True,
        )
        for law in ("hertz_damped", "nonlinear_viscoelastic")
    },
    **{
        f"forces in single precision, {law}": Case(
            PAIR, law, motion(600), exact(5e-3, precision="float32"), exact(5e-3), {"fmax": most},
            drawn(5, 96, 0.0, 3.0), by_lane=True, quantile=quantile,
        )
        for law in ("hertz_damped", "nonlinear_viscoelastic")
        for quantile, most in ((0.9, 1e-5), (1.0, 1e-4))
    },
    **{
        f"long steps of flight, {row}": Case(
            ROWS[row], "hertz_damped", motion(251, 1.0), exact(1e-3), rk4(2.5e-4),
            COUNTS | dict.fromkeys(("umax", "umin", "drift", "fmax", "e_in", "e_damp", "tmax", "work"), 2e-4),
            {"gaps": [[0.004], [0.006], [0.05]], "stiffness": ROWS[row].contact.hertz_stiffness},
            (*DEFAULT_OUTPUTS, "energy_input", "energy_damping", "contact_work", "energy_transfer_max"),
        )
        for row in ("paper", "four")
    },
    "a slow touch is one": Case(
        ps.Scene([ps.Building("b", [200.0], [450e3], 0.02), ps.Wall()], [0.002]), "nonlinear_viscoelastic",
        ps.synthetic_record(102, duration=10.0, dt=0.02, pga=3.0, ground_frequency=8.0), rk4(1e-3), rk4(1e-4), COUNTS,
        {"gaps": np.repeat([5e-4, 1e-3], 4)[:, None], "stiffness": np.tile([1e6, 1e7], 4),
         "restitution": np.tile([0.2, 0.2, 0.8, 0.8], 2)}, ("impact_count",), least_touches=100,
    ),
    "a force that is cut before its contact ends": Case(
        PAPER, "ye_hertz", EL_CENTRO, exact(5e-3), exact(2.5e-4, 8.0), {"umax": 3e-5},
        {"gaps": np.linspace(8.31e-3, 8.33e-3, 16)[:, None], "stiffness": 6.39e7, "restitution": 0.45},
    ),
    "floors at rest that are damped hard": Case(
        ps.Scene([ps.Building("a", [50.0, 34.0], [6.5e4, 3.1e4], 0.0), ps.Building("b", [216.0], [1.6e4], 0.0)], [0.0]),
        "hertz_damped", ps.Record("sine", 0.01, 8.0 * np.sin(8.0 * np.arange(60) * 0.01)), exact(0.01, 8.0), rk4(2e-4),
        COUNTS | {"fmax": 1e-6, "flags": 0.0}, {"stiffness": [2e8, 2e9], "restitution": [0.2, 0.5]}, least_touches=1,
    ),
    "forces that turn twice": Case(
        ps.Scene(ONE_STOREY, [0.0] * 3), "kelvin_voigt",
        ps.Record("cut", EL_CENTRO.dt, 1.2511315668464715 * EL_CENTRO.acceleration[104:224]), exact(5e-3),
        exact(5e-3, 4.0), {"fmax": 1e-5, "acc": 1e-5},
        {"scale": np.geomspace(0.6625, 0.9937, 200), "gaps": [(0.00036, 0.00318, 0.00672)], "stiffness": 1417790.0,
         "restitution": 0.28495}, ("impact_force_max", "acceleration_max", "impact_count"), by_lane=True,
    ),
    "displacements that turn twice": Case(
        ps.Scene(FOUR, [0.0] * 3), "kelvin_voigt",
        ps.Record("jump", 0.02, 5.841946823 * np.cos(19.39907072 * _T) * np.exp(-0.5 * _T)), exact(5e-3),
        exact(5e-3, 4.0), {"umax": 1e-5, "umin": 1e-5, "drift": 1e-5},
        {"scale": np.geomspace(1.6, 1.7, 200), "gaps": [(0.0, 0.00430913, 0.00625996)], "stiffness": 610750.7,
         "restitution": 0.23324}, ("displacement_max", "displacement_min", "drift_max", "impact_count"), by_lane=True,
    ),
    # a strong damper has the force of a light contact rise at once, and fall through most of a long step
    "a graze soon after its touch": Case(
        ps.get_preset("mate2015"), "modified_kelvin", EL_CENTRO, exact(5e-3), rk4(5e-4), {"fmax": 1e-5},
        {"gaps": [[5.80405e-3] * 2], "stiffness": 1.29644e6, "restitution": 0.478414}, least_touches=4,
    ),
    **{
        f"links, {name}": Case(
            scene, law, motion(121, 1.5), one, other, {"link_force": near},
            {"scale": np.linspace(0.3, 2.0, 64), "stiffness": np.geomspace(low, high, 64), "gaps": gaps,
             "restitution": np.linspace(0.3, 0.9, 64)},
            ("link_force_max", "impact_count"), by_lane=True, quantile=quantile,
        )
        for name, scene, law, one, other, near, gaps, low, high, quantile in [
            # a link's force is largest where that quintic of the motion turns which other peaks are read from
            ("turns", ps.Scene(SWAYS, [0.05], links=[ps.Link("a-b", [2], damping=50.0)]), "hertz_damped", exact(5e-4),
             exact(1.25e-4), 2e-10, 0.05 * np.linspace(0.2, 1.0, 64)[:, None], 1e6, 2e7, 0.95),
            ("single precision", ps.Scene([SWAYS[0], pair().row[1]], [0.0],
             links=[ps.Link("a-b", [1], stiffness=100.0, damping=200.0)]), "nonlinear_viscoelastic",
             rk4(1e-3, "float32"), rk4(1e-3), 1e-3,
             np.where(np.arange(64) % 4, 0.003 * np.linspace(0.0, 1.0, 64), 0.0)[:, None], 1e7, 1e9, 1.0),
            *(
                (f"velocity jumps {one.method}", ps.Scene([*SWAYS, ps.Wall()], [0.5, 0.0],
                 links=[ps.Link("a-b", [2], damping=50.0)]), "stereomechanical", one, rk4(1e-4), 1e-6,
                 np.stack([np.full(64, 0.5), 0.05 * np.linspace(0.1, 1.0, 64)], axis=1), 1e7, 1e9, 1.0)
                for one in (exact(5e-3), rk4(1e-3))
            ),
        ]
    },
    **{
        f"linked, {precision}, {len(outputs)}": Case(
            LINKED, "kelvin_voigt", motion(151), exact(1e-3, 4.0, precision), rk4(1e-4),
            COUNTS | {"": 2e-5 if precision == "float64" else 5e-3}, some(40, [0.001, 0.004, 0.05]), outputs,
            least_touches=100,
        )
        for precision in ("float64", "float32")
        for outputs in (tuple(EVERY), ("impact_force_max", "impact_count", "link_force_max", "displacement_max"))
    },
    **{
        f"the pair, {len(outputs)}": Case(
            pair(), "kelvin_voigt", motions()[0], exact(1e-3, 4.0), rk4(1e-4), COUNTS | {"": 2e-5},
            some(70, [0.0005, 0.001, 0.002, 0.004, 0.02]), outputs,
        )
        for outputs in (tuple(EVERY), ("impact_force_max", "impact_count"))
    },
    **{
        f"yielding, {law}, {len(scene.row)}": Case(
            scene, law, motion(101), exact(5e-4, 4.0), rk4(1e-4), {"": 5e-5},
            some(70, [0.0005, 0.001, 0.002, 0.004, 0.02], len(scene.gaps), 3), tuple(EVERY), least_touches=0,
        )
        for law, scene in [
            *((law, YIELDS) for law in ("none", "hertz_damped", "hysteretic", "stereomechanical")),
            ("kelvin_voigt", ALONE),
        ]
    },
    **{
        f"single precision, {law} {method}": Case(
            PAIR, law, motion(126, 1.5), Numerics(method, 1e-3, precision="float32"), Numerics(method, 1e-3),
            COUNTS | {"flags": 0.0} | dict.fromkeys(("umax", "umin", "drift", "fmax", "impulse", "vmax", "acc"), near),
            {"scale": [1.0, 0.7], "gaps": [[0.006], [0.004]], "stiffness": 7.52e6}, tuple(EVERY), least_touches=1,
        )
        # displacements of 0.1 m are known to 1e-8 m, within which a force like d**(1/4) rises to percents of its peak
        for method, law, near in (
            ("rk4", "nonlinear_viscoelastic", 3e-2),
            ("rk4", "stereomechanical", 2e-4),
            ("newmark", "hertz_damped", 2e-4),
        )
    },
    "jumps of small motions": Case(  # hops of less than a micrometre are told from rounding by how far floors are
        ps.Scene([ps.Building("a", [200.0] * 2, [4e5, 3.5e5], 0.02), ps.Building("b", [230.0], [2.8e5], 0.02)], [0.0]),
        "stereomechanical", EL_CENTRO, exact(1e-3, precision="float32"), exact(1e-3),
        COUNTS | {"umax": 1e-4, "impulse": 1e-4}, product(np.geomspace(2e-5, 2e-4, 8), [0.6, 0.9], [0.02, 0.05]),
        ("displacement_max", "impact_count", "impulse"), least_touches=1000,
    ),
    **{
        f"jumps, {one.method}, {other.dt}": Case(
            ps.get_preset("mate2015"), "stereomechanical", EL_CENTRO, one, other, COUNTS,
            product([5e-4, 2e-3, 1e-2], [0.2, 0.35, 0.5, 0.7, 0.9], [1.0]), ("impact_count",), least_touches=1000,
        )
        for make in (rk4, exact)
        for one, other in ((make(1e-3), make(5e-4)), (make(1e-3), make(2.5e-4)))
    },
    # the rate of a floor is nearly zero all along a step, and changes its sign three times: Newton's method goes astray
    "a floor that all but rests in a contact": Case(
        ps.Scene([ps.Wall(), pair().row[0], replace(pair().row[1], damping_ratio=0.03), ps.Wall("right")],
                 gaps=[0.004, 0.006, 0.005]),
        "kelvin_voigt_tension", ps.Record("start", EL_CENTRO.dt, EL_CENTRO.acceleration[:600]), exact(2.5e-3),
        rk4(5e-4), COUNTS | {"umax": 1e-4, "umin": 1e-4}, resting(), tuple(EVERY), by_lane=True, least_touches=1,
    ),
    "variants of a linked row": Case(
        LINKED, "kelvin_voigt", motion(101), exact(1e-3, 4.0), rk4(2e-4), COUNTS | {"": 2e-5}, linked(30),
        tuple(EVERY), least_touches=0,
    ),
    "two contacts that end all but at once": Case(
        TWICE, "linear", EL_CENTRO, exact(0.02, precision="float32"), exact(0.02), COUNTS,
        {"gaps": np.linspace(1e-3, 2e-2, 64)[:, None], "stiffness": 5e5}, ("impact_count",), least_touches=1000,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", [*FAST, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_other_steps_find_the_same(name):
    case = (FAST | SLOW)[name]
    found, right = (
        lanes(case.scene, case.law, case.outputs, case.record, numerics, **case.given)
        for numerics in (case.one, case.other)
    )
    assert "count" not in right or right["count"].sum() >= case.least_touches
    default = case.near.get("")
    for each in right.keys() - {"shortest"} if default else case.near:
        off = apart(found[each], right[each], by_lane=case.by_lane).max(axis=tuple(range(1, right[each].ndim)))
        assert np.quantile(off, case.quantile) <= case.near.get(each, default), each
    assert (
        case.one.precision == case.other.precision
        or case.near == COUNTS
        or any((found[each] != right[each]).any() for each in found if each != "count")
    )  # it was not run in double


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("law", ["nonlinear_viscoelastic", "ye_hertz", "gonthier", "modified_kelvin"])
def test_contacts_that_hardly_rebound_change_their_mode_once(law, precision):
    """Where a rate or a force is zero at an event, and goes the other way first, the event is not found again."""
    rng, n = np.random.default_rng(3), 256
    stiffness = 2e6 if LAWS[law].exponent == 1.0 else 1.88e7
    given = {"gaps": rng.uniform(0.002, 0.02, (n, 1)), "stiffness": stiffness * np.exp(rng.uniform(-1.4, 1.4, n))}
    given["restitution"] = rng.uniform(0.05, 0.3, n)
    outputs = ["displacement_max", "impact_force_max", "impact_count"]
    found, right = (
        lanes(PAPER, law, outputs, EL_CENTRO, numerics, **given)
        for numerics in (exact(5e-3, precision=precision), rk4(5e-4))
    )
    assert not found["flags"].any()
    same = (found["count"] == right["count"]).all(axis=1)
    assert same.mean() > 0.95
    assert apart(found["umax"], right["umax"], by_lane=True)[same].max() < 1e-3


@pytest.mark.slow
def test_floors_that_part_and_touch_again_within_a_step_are_counted():
    """Roofs that part by 0.3 nm, and again 2 ms later: within one long step of open contacts, away at both its ends."""
    spec = draw(11, 29, [law for law in LAWS if LAWS[law].has_contact], earthquakes())
    case, record = spec.cases[2], spec.records[0]
    record = ps.Record("short", record.dt, record.acceleration[:887])
    given = {"scale": case.scale, "gaps": [case.gap], "stiffness": case.stiffness, "restitution": case.restitution}
    counts = [
        lanes(spec.scene, case.law, ["impact_count"], record, numerics, **given)["count"][0]
        for numerics in (exact(record.dt), rk4(1e-4))
    ]
    np.testing.assert_array_equal(*counts)
    assert counts[0][3] == 78
