"""What storeys that degrade have in common: a backbone with a cap, a residual and an end, and cyclic deterioration.

A spring is on one straight line at a time, ``V = slope d + force``, its rows with the drifts at which that ends. Events
enter the next: a turn of the drift unloads, the end of a line goes on. They are written of a point (x, f), drift and
shear with the sign of the direction in which the spring goes on, or from which it turns.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Annotated, Any

import numpy as np
from pydantic import Discriminator, Tag

from pounding_sweep.base.errors import SceneError
from pounding_sweep.lanes import maximum, minimum, size, where
from pounding_sweep.model.faults import Finite, Positive, checked, one_or_several, schema
from pounding_sweep.model.storeys.base import FAILED, DriftGauge, Numbers, Shares, StoreyLaw, with_values

#: Events: a drift turns, or a line ends to the positive or the negative side (1, -1).
TURNED = 0.0
#: Phases, with the sign of the direction: elastic at first (0), unloading, on the way to the pinching point, to the
#: last and to the largest drift that was left, and on the backbone, which hardens, falls, and is flat.
UNLOADING, PINCHED, TO_LAST, TO_LARGEST, HARDENING, FALLING, FLAT = map(float, range(1, 8))
#: Rows of each direction: factors left of its strength and of its post-cap line, the points left last and farthest.
_LEFT = ("strength", "cap", "last", "last_force", "largest", "largest_force")
#: Constants of each direction.
_SIDE = ("soft_stiffness", "cap_line", "residual", "ultimate")
#: Inverse reference drifts of deterioration (1/m).
_RATES = ("strength_rate", "cap_rate", "unload_rate", "reload_rate")
#: A drift (m) that no spring reaches.
FAR = 1e6
#: A number of all storeys, or one per storey.
OfStoreys = Annotated[float | Sequence[float], one_or_several(Finite, Sequence[Finite])]
PositiveOfStoreys = Annotated[float | Sequence[float], one_or_several(Positive, Sequence[Positive])]


@checked
class Directions:
    """A number of each direction, of all storeys or one per storey.

    Parameters
    ----------
    positive, negative : float or sequence of float
        That of positive and of negative drifts, both with the sign of the one for both directions.
    """

    positive: OfStoreys
    negative: OfStoreys


_TAGS = Discriminator(lambda value: "|both" if isinstance(value, (dict, Directions)) else "|one")
_EITHER = Annotated[Annotated[Directions, Tag("|both")] | Annotated[OfStoreys, Tag("|one")], _TAGS]
#: The same, or a table of both directions.
OfDirections = Annotated[Any, schema(_EITHER)]


@checked
class Deterioration:
    """Reference drifts of cyclic deterioration; a mode that has none does not deteriorate.

    A mode has lost everything once a spring has taken its strength times the reference drift as energy.

    Parameters
    ----------
    strength : float or sequence of float
        Reference drift (m) of the yield strength and the hardening.
    post_cap : float or sequence of float
        That of the post-cap branch.
    unloading : float or sequence of float
        That of the unloading stiffness.
    reloading : float or sequence of float
        That of the drift that reloading goes to; `bilinear` has none.
    """

    strength: PositiveOfStoreys | None = None
    post_cap: PositiveOfStoreys | None = None
    unloading: PositiveOfStoreys | None = None
    reloading: PositiveOfStoreys | None = None


def by_direction(value: Any) -> tuple[Any, Any]:
    """Return a number of the negative and the positive direction."""
    return (value.negative, value.positive) if isinstance(value, Directions) else (value, value)


#: By field: whether a value is allowed, and what is.
_ALLOWED = {
    "cap_drift": (lambda x: x > 0.0, "above 0 m"),
    "post_cap": (lambda x: x < 0.0, "below 0"),
    "residual": (lambda x: 0.0 <= x < 1.0, "at least 0 and below 1"),
    "ultimate_drift": (lambda x: x > 0.0, "above 0 m"),
}


@checked
class Backbone(Shares):
    """Backbone beyond yield: a cap, a falling branch, a residual, and an end.

    Parameters
    ----------
    cap_drift : float, mapping or sequence of float, optional
        Drift (m) from which the shear falls, of all storeys, one per storey, or a table of ``positive`` and
        ``negative``; here and below. It never falls where there is none, and not before it yields.
    post_cap : float, mapping or sequence of float
        Stiffness of the falling branch over the elastic one, below 0.
    residual : float, mapping or sequence of float
        Share of the yield strength at which it stays.
    ultimate_drift : float, mapping or sequence of float, optional
        Drift (m) at which the spring fails for good.
    deterioration : mapping, optional
        Reference drifts (m) of cyclic deterioration: ``strength``, ``post_cap``, ``unloading``, ``reloading``, each of
        all storeys or one per storey.
    """

    cap_drift: OfDirections | None = None
    post_cap: OfDirections = -0.1
    residual: OfDirections = 0.0
    ultimate_drift: OfDirections | None = None
    deterioration: Deterioration | None = None

    def __post_init__(self) -> None:
        for name, (is_allowed, words) in _ALLOWED.items():
            for value in by_direction(getattr(self, name)):
                for x in value if isinstance(value, tuple) else () if value is None else (value,):
                    if not is_allowed(x):
                        raise SceneError(f"is {x:g}; it must be {words}", (name,))
        for name, default in (("post_cap", -0.1), ("residual", 0.0)):
            if self.cap_drift is None and getattr(self, name) != default:
                raise SceneError("is that beyond a cap; give cap_drift too, or leave it out", (name,))

    def with_factors(self, capacity: float, deterioration: float) -> Backbone:
        """Return the same, with factors on the drifts at which strength is lost and on those of deterioration."""
        factors = {"cap_drift": capacity, "ultimate_drift": capacity, "deterioration": deterioration}

        def change(name: str, x: Any) -> Any:
            factor = factors.get(name.split(".", maxsplit=1)[0])
            if factor is None or x is None:
                return x
            return tuple(factor * value for value in x) if isinstance(x, tuple) else factor * x

        return with_values(self, change)


class BackboneLaw(StoreyLaw):
    """A law with such a backbone."""

    bounds_drifts, softens, can_fail = False, True, True
    constants = (
        *("shear_stiffness", "geometric_stiffness", "yield_force", "hard_stiffness"),
        *(f"{name}_{side}" for side in ("neg", "pos") for name in _SIDE),
        *_RATES,
    )
    rows = (
        *("phase", "slip", "unload", "dissipated", "work_before"),
        *("borne", "slope", "offset", "branch_low", "branch_high"),
        *(f"{name}_{side}" for side in ("neg", "pos") for name in _LEFT),
    )

    def compiled(self, parameters: Backbone) -> tuple[float, ...]:
        """Return whether it deteriorates."""
        return (1.0,) if parameters.deterioration else (0.0,)

    def values(self, parameters: Backbone, numbers: Numbers) -> dict[str, Any]:
        """Return its `constants`: those of the storey without P-Delta."""
        k, dy = numbers.stiffness + numbers.geometric, numbers.yield_drift
        hard = numbers.hardening * numbers.stiffness + numbers.geometric
        values = {"shear_stiffness": k, "geometric_stiffness": numbers.geometric, "yield_force": k * dy}
        values["hard_stiffness"] = hard
        pairs = [by_direction(getattr(parameters, name)) for name in ("cap_drift", "post_cap", "residual")]
        limits = self.ultimate_drifts(parameters, numbers)
        for side, cap, falls, rest, limit in zip(("neg", "pos"), *pairs, limits, strict=True):
            x = FAR if cap is None else np.maximum(cap * numbers.capacity, dy)
            values[f"soft_stiffness_{side}"] = soft = falls * k
            values[f"cap_line_{side}"] = k * dy + hard * (x - dy) - soft * x
            values[f"residual_{side}"] = rest * k * dy
            values[f"ultimate_{side}"] = np.minimum(limit, FAR)
        modes = parameters.deterioration or Deterioration()
        drifts = modes.strength, modes.post_cap, modes.unloading, modes.reloading
        for name, drift in zip(_RATES, drifts, strict=True):
            values[name] = 0.0 if drift is None else 1.0 / (drift * numbers.deterioration)
        return values

    def ultimate_drifts(self, parameters: Backbone, numbers: Numbers) -> tuple[Any, Any]:
        """Return those of the backbone."""
        if parameters.ultimate_drift is None:
            return super().ultimate_drifts(parameters, numbers)
        negative, positive = by_direction(parameters.ultimate_drift)
        return negative * numbers.capacity, positive * numbers.capacity

    # branches --------------------------------------------------------------------------------------------------------

    def begin(self, spring: Any, lanes: Any) -> None:
        """Be elastic, with the yield points as those that were left."""
        k, force = spring.shear_stiffness, spring.yield_force
        first = {"slope": k, "unload": k, "branch_low": -minimum(force / k, spring.ultimate_neg)}
        first |= {"branch_high": minimum(force / k, spring.ultimate_pos)}
        for side in ("neg", "pos"):
            first |= {f"strength_{side}": 1.0, f"cap_{side}": 1.0}
            for name in ("last", "largest"):
                first |= {f"{name}_{side}": force / k, f"{name}_force_{side}": force}
        zero = dict.fromkeys(("phase", "slip", "dissipated", "work_before", "borne", "offset"), 0.0)
        spring.put(lanes, **{name: spring.group.full(x) for name, x in (first | zero).items()})

    def line(self, spring: Any) -> tuple[Any, Any]:
        """Return that of the branch, less what the weights take."""
        first, slope = spring.shear_stiffness, spring.slope
        return where(slope == first, spring.stiffness, slope - spring.geometric_stiffness), spring.offset

    def gauges(self, spring: Any) -> Sequence[DriftGauge]:
        """Return the ends of the line, and the turn of a drift that does not unload."""
        low, high, phase = spring.branch_low, spring.branch_high, spring.phase
        above = where(high >= spring.ultimate_pos, FAILED, 1.0)
        below = where(low <= -spring.ultimate_neg, FAILED, -1.0)
        ranged = high - low < FAR
        middle, reach = where(ranged, 0.5 * (low + high), 0.0), where(ranged, 0.5 * (high - low), 0.0)
        way = where(size(phase) > UNLOADING, where(phase < 0.0, -1.0, 1.0), 0.0)
        way = where(size(phase) == FAILED, 0.0, way)
        return [DriftGauge(ranged, low, high, below, above, middle, reach, way, TURNED)]

    def follow(self, spring: Any) -> None:
        """Let the drift without shear follow, and what is lost."""
        d, was, before = spring.drift(), spring.slip, spring.borne
        borne = spring.slope * d + spring.offset
        slip = d - borne / spring.unload
        spring.slip, spring.borne = slip, borne
        spring.dissipated += 0.5 * (before + borne) * (slip - was)
        if "hysteretic" in spring.group.requested:
            spring.travel = spring.dissipated

    def stored(self, spring: Any, d: Any) -> Any:
        """Energy of the spring as it unloads, less that of the weights."""
        z = d - spring.slip
        return 0.5 * (spring.unload * z * z - spring.geometric_stiffness * d * d)

    def loss(self, numbers: Numbers) -> Any:
        """Return one: what is lost is an energy already."""
        return np.ones_like(numbers.stiffness)

    def strength_left(self, spring: Any) -> Any:
        """Return what backbones still reach beyond their largest drifts, over their shears at the cap at first."""
        left, one, d = spring.group.full(1.0), spring.group.full(1.0), spring.drift()
        for sign in (1.0, -1.0):
            p = self._side(spring, spring.group.full(sign > 0.0))
            self._backbone(p)
            reached = self._at(p, maximum(maximum(p.largest, sign * d), p.cap_drift))
            p.strength, p.cap = one, one
            self._backbone(p)
            left = minimum(left, reached / self._at(p, p.cap_drift))
        return where(spring.phase == FAILED, 0.0, left)

    def residual(self, spring: Any) -> Any:
        """Return the drift to which it unloads; missing with P-Delta, where it may run away."""
        return np.where(spring.geometric_stiffness == 0.0, spring.slip, np.nan)

    # events ----------------------------------------------------------------------------------------------------------

    def switch(self, spring: Any, lanes: Any) -> None:
        """Turn back, or go on beyond the end of a line."""
        self.follow(spring)
        phase, then = spring.phase, spring.then
        turned, failed = then == TURNED, then == FAILED
        side = where(where(turned, phase, then) < 0.0, -1.0, 1.0)
        p = self._side(spring, side > 0.0)
        p.x, p.f, p.now, p.turned, p.lanes = side * spring.drift(), side * spring.borne, size(phase), turned, lanes
        p.crosses = ~turned & (p.now == UNLOADING) & (side * phase < 0.0)
        p.last, p.last_force = where(turned, p.x, p.last), where(turned, p.f, p.last_force)
        grows = turned & (p.x > p.largest)
        p.largest, p.largest_force = where(grows, p.x, p.largest), where(grows, p.f, p.largest_force)
        unload = p.unload = spring.unload
        if spring.compiled[0]:
            failed = failed | self._deteriorate(p)
        self._backbone(p)
        rank, slope, offset, low, high = self._go_on(p)
        gone = (rank == FLAT) & (p.residual <= 0.0) & (p.x >= p.cap_drift)
        failed = failed | (gone & ~turned) | (p.crosses & (p.largest_force <= 0.0))
        back = self._unload_to(p)
        unloads = UNLOADING, p.unload, p.f - p.unload * p.x, back, p.x
        went = zip(unloads, (rank, slope, offset, low, high), strict=True)
        rank, slope, offset, low, high = (where(turned, new, old) for new, old in went)
        low, high = maximum(low, -self._side(spring, ~p.up).ultimate), minimum(high, p.ultimate)
        low, high = where(p.up, low, -high), where(p.up, high, -low)
        for name in _LEFT:
            for mask, where_to in ((p.up, "pos"), (~p.up, "neg")):
                spring.put(lanes & mask, **{f"{name}_{where_to}": getattr(p, name)})
        spring.put(lanes, phase=where(failed, FAILED, side * rank), unload=p.unload)
        spring.put(lanes, slope=where(failed, 0.0, slope), offset=where(failed, 0.0, side * offset))
        spring.put(lanes, branch_low=where(failed, -FAR, low), branch_high=where(failed, FAR, high))
        spring.put(lanes & failed, strength_pos=0.0, strength_neg=0.0)
        # what unloading gives back is another energy where its stiffness changes, and none where it fails
        now, work = where(failed, 0.0, p.f), 0.5 * (p.f * p.f / unload)
        d = spring.drift()
        spring.put(lanes, dissipated=spring.dissipated + (work - 0.5 * (now * now / p.unload)))
        spring.put(lanes, borne=side * now, slip=d - side * now / p.unload)
        if "hysteretic" in spring.group.requested:
            spring.travel = spring.dissipated

    def _side(self, spring: Any, up: Any) -> SimpleNamespace:
        """Return rows and constants of a direction."""
        values = {
            name: where(up, getattr(spring, f"{name}_pos"), getattr(spring, f"{name}_neg")) for name in (*_LEFT, *_SIDE)
        }
        return SimpleNamespace(spring=spring, up=up, **values)

    def _deteriorate(self, p: Any) -> Any:
        """Let unloading soften at a turn, and the other modes as the shear changes its sign; where nothing is left."""
        spring, spent = p.spring, p.turned & False
        energy, since = spring.dissipated, maximum(spring.dissipated - spring.work_before, 0.0)

        def share(name: str, lanes: Any) -> Any:
            nonlocal spent
            rate = getattr(spring, name)
            left = spring.yield_force - rate * energy
            over = lanes & (rate * since >= left)
            spent = spent | over
            return where(lanes & ~over, rate * since / where(over, 1.0, left), 0.0)

        p.unload = p.unload * (1.0 - share("unload_rate", p.turned))
        p.strength = p.strength * (1.0 - share("strength_rate", p.crosses))
        p.cap = p.cap * (1.0 - share("cap_rate", p.crosses))
        p.largest = p.largest * (1.0 + share("reload_rate", p.crosses))
        spring.put(p.crosses & p.lanes, work_before=energy)
        return spent

    def _backbone(self, p: Any) -> None:
        """Find the hardening and the falling line of a side, and the drift at which they meet."""
        force = p.strength * p.spring.yield_force
        p.hard = p.strength * p.spring.hard_stiffness
        p.hard_line = force - p.hard * (force / p.spring.shear_stiffness)
        p.soft_line = p.cap * p.cap_line
        p.cap_drift = (p.soft_line - p.hard_line) / (p.hard - p.soft_stiffness)

    def _at(self, p: Any, x: Any) -> Any:
        """Shear of the backbone."""
        return maximum(minimum(p.hard_line + p.hard * x, p.soft_line + p.soft_stiffness * x), p.residual)

    def _on_backbone(self, p: Any) -> tuple[Any, ...]:
        """Go on along the backbone: phase, line, and its end."""
        x, rest, now = p.x, p.residual, p.now
        before = (x < p.cap_drift) & ~((now == HARDENING) | (now == FALLING))
        rises = before & ((p.hard_line + p.hard * x >= rest) | (now == FLAT))
        falls = ~before & ~(now == FALLING) & (p.soft_line + p.soft_stiffness * x > rest)
        low = before & (p.hard > 0.0) & (p.hard_line + p.hard * p.cap_drift > rest)  # it is below the residual at first
        to_rise = where(low, (rest - p.hard_line) / where(low, p.hard, 1.0), FAR)
        rank = where(rises, HARDENING, where(falls, FALLING, FLAT))
        slope = where(rises, p.hard, where(falls, p.soft_stiffness, 0.0))
        offset = where(rises, p.hard_line, where(falls, p.soft_line, rest))
        end = where(rises, p.cap_drift, where(falls, (rest - p.soft_line) / p.soft_stiffness, to_rise))
        return rank, slope, offset, x - (end - x), end

    def _unload_to(self, p: Any) -> Any:
        """Return where unloading ends: without shear."""
        return p.x - p.f / p.unload

    @abstractmethod
    def _go_on(self, p: Any) -> tuple[Any, ...]:
        """Return phase, line and its ends beyond the end of a line."""
