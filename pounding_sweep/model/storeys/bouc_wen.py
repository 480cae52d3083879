"""Storeys whose hysteresis is smooth: the law of Bouc and Wen.

    V = r k d + (1 - r) k z,    z = d - p
    p' = |z / dy|^n (GAMMA d' + BETA |d'| sign z)

d is the drift, p its plastic part, r the hardening and dy = Vy / k. The shear is k d - (1 - r) k p, p flowing stage by
stage, or, in an implicit step, by the trapezoid over the drift. Its rate has a kink where the drift turns and where z
changes its sign: sub-steps end there, and are so short that z can't reach its limit from anywhere within one. Between
kinks p' is a polynomial of z and d' where n is whole: `exact` finds p by its series, term by term with the motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field
from typing import Annotated, Any, Literal

from pydantic import Field

from pounding_sweep.base.errors import SceneError
from pounding_sweep.lanes import count_to, fma, maximum, minimum, power_of, size, where
from pounding_sweep.model.faults import Number, checked
from pounding_sweep.model.storeys.base import Numbers, Shares, SignGauge, StoreyLaw

#: Largest exponent, and largest one whose powers are worked out term by term.
MOST_SHARP, MOST_POWER = 100.0, 8
#: Share of its limit, over n, by which a drift may move in a sub-step.
REACH = 0.5


@checked
class BoucWenParameters(Shares):
    """Smooth hysteresis of storeys that yield: the law of Bouc and Wen.

    With the drift d and the yield drift dy = Vy / k, the shear is V = r k d + (1 - r) k z, of the hardening r and::

        z' = d' - |z / dy|^n (beta |d'| sign z + gamma d')

    Parameters
    ----------
    n : float
        How sharply it yields, at least 1: the larger, the nearer to bilinear.
    beta, gamma : float
        Shape of loops, numbers without a unit, -beta < gamma <= beta. At their default z tends to the yield drift,
        and unloading is straight; in general to dy / (beta + gamma)**(1 / n).

    References
    ----------
    Wen (1976), Method for random vibration of hysteretic systems, J. Eng. Mech. Div. ASCE 102(2). Its A is 1, so that k
    is the initial stiffness: another one is the same law with other k, r, beta and gamma (Ma et al. 2004).
    """

    n: Annotated[Number, Field(ge=1.0, le=MOST_SHARP)] = 1.0
    beta: Number = 0.5
    gamma: Number = 0.5
    law: Literal["bouc_wen"] = field(default="bouc_wen", kw_only=True, repr=False)

    def __post_init__(self) -> None:
        if not -self.beta < self.gamma <= self.beta:
            raise SceneError(
                f"gamma is {self.gamma:g} beside beta {self.beta:g}; it must be above -beta, so that z stays bounded, "
                "and at most beta, so that no energy is won"
            )


class BoucWen(StoreyLaw):
    """The plastic drift p flows all along."""

    name = "bouc_wen"
    Parameters = BoucWenParameters
    straight = flies = has_tangent = bounds_drifts = False
    moving = ("slip",)
    constants = ("hardening", "yield_drift", "wen_beta", "wen_gamma", "wen_limit")
    #: the last two of them in steps by series: the signs of the drift's rate and of z
    rows = ("slip", "rate_sign", "z_sign")

    def compiled(self, parameters: BoucWenParameters) -> tuple[float, ...]:
        """Return the exponent."""
        return (parameters.n,)

    def values(self, parameters: BoucWenParameters, numbers: Numbers) -> dict[str, Any]:
        """Return those of bilinear storeys, the shape of loops, and what z tends to over the yield drift."""
        beta, gamma = parameters.beta, parameters.gamma
        limit = (beta + gamma) ** (-1.0 / parameters.n)
        return super().values(parameters, numbers) | {"wen_beta": beta, "wen_gamma": gamma, "wen_limit": limit}

    def is_polynomial(self, compiled: tuple[float, ...]) -> bool:
        """Whether its powers are worked out term by term."""
        return compiled[0] == round(compiled[0]) <= MOST_POWER

    # state and flow --------------------------------------------------------------------------------------------------

    def line(self, spring: Any) -> tuple[Any, Any]:
        """At the present plastic drift."""
        return self.line_at(spring, spring.slip)

    def line_at(self, spring: Any, slip: Any) -> tuple[Any, Any]:
        """At a plastic drift."""
        return spring.group.full(spring.stiffness), -spring.hardened[1] * slip

    def follow(self, spring: Any) -> None:
        """Do nothing: stages and steps leave the plastic drift of their end."""

    def tangent(self, spring: Any, drift: Any, rate: Any, slip: Any) -> tuple[Any, Any]:
        """Tangent and constant of the shear, as it changes at a state."""
        z = drift - slip
        less = spring.hardened[1] * self._share(spring, z, rate)
        return spring.stiffness - less, less * (z + slip) - spring.hardened[1] * slip

    def _share(self, spring: Any, z: Any, v: Any) -> Any:
        """Rate of the plastic drift over that of the drift."""
        beta = spring.wen_beta
        filled = power_of(size(z) / spring.yield_drift, spring.compiled[0])
        return filled * (spring.wen_gamma + where(z * v < 0.0, -beta, beta))

    def flow(self, spring: Any, drift: Any, rate: Any, slip: Any) -> Any:
        """Rate of the plastic drift."""
        return self._share(spring, drift - slip, rate) * rate

    def lost(self, spring: Any, drift: Any, slip: Any, flow: Any) -> Any:
        """Return z / dy times the rate of the plastic drift."""
        return (drift - slip) / spring.yield_drift * flow

    def stored(self, spring: Any, d: Any) -> Any:
        """Energy of the elastic part, and of z."""
        (hard, soft), z = spring.hardened, d - spring.slip
        return 0.5 * (hard * d * d + soft * z * z)

    # events ----------------------------------------------------------------------------------------------------------

    def gauges(self, spring: Any) -> Sequence[SignGauge]:
        """Kinks: the drift turns, z changes its sign."""
        (d0, d1, v0, v1), (p0, p1) = spring.ends(), (spring.slip0, spring.slip)
        z0, z1 = d0 - p0, d1 - p1

        def slopes(h: Any) -> tuple[Any, Any]:
            w0, w1 = (h * (v - self._share(spring, z, v) * v) for z, v in ((z0, v0), (z1, v1)))
            return w0, w1

        # steps by series land on kinks and keep the signs between them, others have those of their start
        by_series = spring.group.spec.series
        way, side = (where(x > 0.0, 1.0, where(x < 0.0, -1.0, 0.0)) for x in (v0, z0))
        return [
            SignGauge("taylor_rate", v0, v1, spring.rate_sign if by_series else way, 1.0),
            SignGauge("taylor_z1", z0, z1, spring.z_sign if by_series else side, 2.0, slopes),
        ]

    def switch(self, spring: Any, lanes: Any) -> None:
        """Change the sign that has a kink."""
        for kink, name in enumerate(("rate_sign", "z_sign"), 1):
            spring.put(lanes & (spring.then == float(kink)), **{name: -getattr(spring, name)})

    def reach(self, spring: Any) -> Any:
        """How far the drift may move in a sub-step."""
        return (REACH / spring.compiled[0]) * (spring.yield_drift * spring.wen_limit)

    # implicit steps --------------------------------------------------------------------------------------------------
    # With the drift's change D = d1 - d0 and the share q of it that flows into p,
    #     p1 = p0 + D (q(z0, D) + q(z1, D)) / 2,
    # of which Newton's method finds p1 and d1 together: p1 = REST + FLOW d1. It loses (p1 - p0) (z0 + z1) / 2. As q
    # does not fall while z is loaded, p1 is the only one, with z1 within what `solve` allows.

    def predict(self, spring: Any) -> Any:
        """Return dp/dd at the start."""
        d0, _, v0, _ = spring.ends()
        return self._share(spring, d0 - spring.slip0, v0)

    def solve(self, spring: Any, d: Any, p: Any) -> tuple[Any, Any]:
        """Return dp/dd at the end of an implicit step whose drift is d, and what Newton's method makes of p there."""
        n, p0, dy, d0 = spring.compiled[0], spring.slip0, spring.yield_drift, spring.drift("u0")
        beta, gamma, change = spring.wen_beta, spring.wen_gamma, 0.5 * (d - d0)
        z0 = d0 - p0
        # the largest |z|: there the share is twice that at which z would stand still
        most = maximum(size(z0), 2.0 ** (1.0 / n) * (dy * spring.wen_limit))
        z = minimum(maximum(d - p, -most), most)
        filled = size(z) / dy
        slope = power_of(filled, n - 1.0) * (gamma + where(z * change < 0.0, -beta, beta))
        shares = self._share(spring, z0, change) + filled * slope
        bends = (n / dy) * change * where(z < 0.0, -slope, slope)
        inverse = 1.0 / (1.0 + bends)
        at = d - z
        return (0.5 * shares + bends) * inverse, at - (at - p0 - change * shares) * inverse

    # steps by series -------------------------------------------------------------------------------------------------

    def series_rows(self, compiled: tuple[float, ...], order: int) -> dict[str, int]:
        """Rates of drifts, powers of z; what flows over its product with the rate."""
        return {"taylor_rate": order, "flow": 1} | {f"taylor_z{k}": order for k in range(1, 1 + int(compiled[0]))}

    def begin_term(self, spring: Any, k: Any, x: Any) -> None:
        """Keep a coefficient of z and of drifts' rates, by that of floors."""
        spring.put_term("taylor_z1", k, spring.drift(x) - spring.term("taylor_slip", k))
        spring.put_term("taylor_rate", k, spring.drift(x.rates))

    def end_term(self, springs: Sequence[Any], k: Any, x: Any, per: Any) -> None:
        """Find coefficient k + 1 of plastic drifts: that of p' = FLOW z^n d', FLOW following the signs of z and d'."""
        for spring in springs if x.constant else ():
            self._begin_signs(spring)

        def products(some: Sequence[Any], names: Sequence[str], other: str) -> Iterator[tuple[Any, Any]]:
            sums = [spring.group.cell(0.0) for spring in some]
            for q in range(k + 1) if isinstance(k, int) else count_to(k + 1):
                for spring, name, total in zip(some, names, sums, strict=True):
                    total.now = fma(spring.term(name, q), spring.term(other, k - q), total.now)
            yield from ((spring, total.now) for spring, total in zip(some, sums, strict=True))

        for power in range(2, 1 + int(max(spring.compiled[0] for spring in springs))):
            some = [spring for spring in springs if spring.compiled[0] >= power]
            for spring, total in products(some, [f"taylor_z{power - 1}"] * len(some), "taylor_z1"):
                spring.put_term(f"taylor_z{power}", k, total)
        names = [f"taylor_z{spring.compiled[0]:.0f}" for spring in springs]
        for spring, total in products(springs, names, "taylor_rate"):
            spring.put_term("taylor_slip", k + 1, per * (spring.flow * total))

    def _begin_signs(self, spring: Any) -> None:
        """Find what flows of z^n d' in the sub-step to come: the signs stay, once it moves, until the next kink."""

        def sign(name: str, change: Any, otherwise: Any) -> Any:
            by_more = size(change) > spring.group.limit.at_rest * spring.drift(name, rounding=True)
            return where(by_more, where(change < 0.0, -1.0, 1.0), otherwise)

        way, side, n = spring.rate_sign, spring.z_sign, spring.compiled[0]
        # at rest the sign of what it begins to do, or none
        starts = sign("v0", spring.drift("v0"), sign("y", spring.drift("y"), 0.0))
        spring.rate_sign = way = where(way == 0.0, starts, way)
        spring.z_sign = side = where(side == 0.0, sign("u0", spring.drift("u0") - spring.slip0, way), side)
        share = (spring.wen_gamma + side * way * spring.wen_beta) / power_of(spring.yield_drift, n)
        spring.flow = share * side if n % 2.0 else share


LAW = BoucWen()
