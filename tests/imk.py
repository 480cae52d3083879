"""Springs of Ibarra, Medina & Krawinkler as a walk from branch to branch: what the tests hold storey laws against.

A branch is a line through a point, with an end and what follows to each side. It shares no code with the package.
"""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

import numpy as np

NEAR = 1e-9


class Spring:
    """One spring, of elastic stiffness k, yield drift dy and hardening r; `lambdas` are reference drifts by mode."""

    def __init__(
        self, k, dy, r, cap=np.inf, post_cap=-0.1, residual=0.0, ultimate=np.inf, pinch=None, bilinear=False, lambdas=()
    ):
        self.k, self.dy, self.strength, self.r, self.pinch, self.bilinear = k, dy, k * dy, r, pinch, bilinear
        self.post_cap, self.rest, self.ultimate = post_cap * k, residual * k * dy, ultimate
        cap = min(max(cap, dy), 1e6)
        self.falling = self.strength + r * k * (cap - dy) - self.post_cap * cap  # of the post-cap line at no drift
        point = (dy, self.strength)
        self.sides = {s: SimpleNamespace(q=1.0, c=1.0, last=point, largest=point, pinch=(0.0, 0.0)) for s in (1, -1)}
        self.lambdas, self.work, self.before, self.unload = dict(lambdas), 0.0, 0.0, k
        self.d = self.f = 0.0
        self.failed = False
        self.branch(k, 0, {s: (s * dy, partial(self.along_backbone, s)) for s in (1, -1)})

    # branches

    def branch(self, slope, way, ends):
        """Be on a line through the present point, that goes one way (0: both), with its ends by side."""
        self.line, self.way = (slope, self.d, self.f), way
        self.ends = {
            s: min((end, s), (s * self.ultimate, 0), key=lambda e, s=s: s * e[0]) for s, (end, _) in ends.items()
        }
        self.ends = {s: (end, ends[s][1] if which else self.fail) for s, (end, which) in self.ends.items()}

    def force(self, d):
        return self.line[2] + self.line[0] * (d - self.line[1])

    def move(self, d):
        """Go along the branch."""
        f = self.force(d)
        self.work += 0.5 * (f + self.f) * (d - self.d)
        self.d, self.f = d, f

    @property
    def stored(self):
        return 0.5 * self.f**2 / self.unload

    @property
    def lost(self):
        return self.work - self.stored

    def walk(self, d):
        """Go to a drift, from branch to branch."""
        way = np.sign(d - self.d)
        if self.way and way == -self.way:
            self.turn()
        while way in self.ends and way * (d - self.ends[way][0]) > 0.0:
            end, follows = self.ends[way]
            self.move(end)
            follows()
        self.move(d)
        return self.f

    def fail(self):
        self.failed, self.f = True, 0.0
        self.branch(0.0, 0, {})

    def share(self, mode):
        """Share that a mode loses; fails where there is no energy left for it."""
        capacity = self.lambdas.get(mode, np.inf) * self.strength
        taken, left = max(self.lost - self.before, 0.0), capacity - self.lost
        self.exhausted |= np.isfinite(capacity) and taken >= left
        return taken / left if taken < left else 0.0

    def backbone(self, s):
        """Lines of the backbone at a side: hardening and falling, each slope and force at no drift."""
        q, c = self.sides[s].q, self.sides[s].c
        return (q * self.r * self.k, q * self.strength * (1.0 - q * self.r)), (self.post_cap, c * self.falling)

    def bears(self, s, x):
        return max(min(slope * x + force for slope, force in self.backbone(s)), self.rest)

    def along_backbone(self, s):
        (hard, at_hard), (soft, at_soft) = self.backbone(s)
        x = s * self.d + NEAR * self.dy
        peak = (at_soft - at_hard) / (hard - soft)
        if x < peak and hard * x + at_hard >= self.rest:
            slope, at, end = hard, at_hard, peak
        elif x >= peak and soft * x + at_soft > self.rest:
            slope, at, end = soft, at_soft, (self.rest - at_soft) / soft
        elif x >= peak and self.rest == 0.0:
            return self.fail()
        else:
            rises = x < peak and hard * peak + at_hard > self.rest
            slope, at, end = 0.0, self.rest, (self.rest - at_hard) / hard if rises else np.inf
        self.f = s * (slope * s * self.d + at)  # to the last bit: of equal forces the last and the largest are one
        self.branch(slope, s, {s: (s * end, partial(self.along_backbone, s))})

    def turn(self):
        s, side, self.exhausted = self.way, self.sides[self.way], False
        side.last = s * self.d, s * self.f
        side.largest = max(side.largest, side.last, key=lambda point: point[0])
        self.unload *= 1.0 - self.share("unloading")
        if self.exhausted:
            return self.fail()
        back, follows = self.d - self.f / self.unload, partial(self.cross, -s)
        if self.bilinear and not self.lambdas:
            back, follows = self.meet(-s), partial(self.along_backbone, -s)
        again = partial(self.along_backbone if self.bilinear else self.reload, s)
        self.branch(self.unload, 0, {s: (self.d, again), -s: (back, follows)})

    def meet(self, s):
        """Drift at which unloading meets the backbone of a side."""
        x, f, k = s * self.d, s * self.f, self.unload
        hard, soft = (x + (slope * x + at - f) / (k - slope) if k > slope else np.inf for slope, at in self.backbone(s))
        return s * max(min(hard, soft), x + (self.rest - f) / k)

    def cross(self, s):
        """Go on to side s as the force changes its sign."""
        side, x, self.exhausted = self.sides[s], s * self.d, False
        side.q *= 1.0 - self.share("strength")
        side.c *= 1.0 - self.share("post_cap")
        to = side.largest[0] * (1.0 + self.share("reloading"))
        self.before = self.lost
        if self.bilinear and not self.exhausted:
            ends = {s: (self.meet(s), partial(self.along_backbone, s)), -s: (self.d, partial(self.cross, -s))}
            return self.branch(self.unload, 0, ends)
        side.largest = to, self.bears(s, to) if self.lambdas else side.largest[1]
        if self.exhausted or side.largest[1] <= 0.0:
            return self.fail()
        if self.pinch:
            share, short = self.pinch
            at = (1.0 - short) * (to - side.largest[1] / self.unload)
            side.pinch = at, share * side.largest[1] * (at - x) / (to - x)
            if x < at:
                return self.go(s, side.pinch, partial(self.to_peaks, s, True))
        self.to_peaks(s, True)

    def go(self, s, point, follows):
        """Go straight to a point."""
        slope = (point[1] - s * self.f) / (point[0] - s * self.d)
        self.branch(slope, s, {s: (s * point[0], follows)})

    def steepness(self, s, point):
        return (point[1] - s * self.f) / (point[0] - s * self.d)

    def reload(self, s):
        """Go on beyond the drift from which it unloaded."""
        side, here = self.sides[s], (s * self.d, s * self.f)
        before = all(a < b < c for a, b, c in zip(here, side.pinch, side.largest, strict=True))
        if self.pinch and before and self.steepness(s, side.pinch) < self.steepness(s, side.largest):
            return self.go(s, side.pinch, partial(self.to_peaks, s, True))
        self.to_peaks(s, False)

    def to_peaks(self, s, last):
        side, x, f = self.sides[s], s * self.d, s * self.f
        ahead = last and x < side.last[0] and f < side.last[1] < side.largest[1]
        if ahead and self.steepness(s, side.last) > self.steepness(s, side.largest):
            self.go(s, side.last, partial(self.to_peaks, s, False))
        elif x < side.largest[0]:
            self.go(s, side.largest, partial(self.along_backbone, s))
        else:
            self.along_backbone(s)


def shears(drifts, *numbers, **parameters):
    """Forces along a history of drifts."""
    spring = Spring(*numbers, **parameters)
    return np.array([spring.walk(d) for d in drifts])
