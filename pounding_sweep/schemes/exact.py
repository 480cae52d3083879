"""Exact flight between contacts, each building by its own transition matrix; beside contacts, Runge-Kutta.

Between impacts a building is linear, and the ground acceleration is linear between
record points; over a step h its state x = (u, v) then moves by

    x' = A x + s (p g0 + q g1),    A = exp(F h),  F = [[0, I], [-M^-1 K, -M^-1 C]]

without error at any h (Nigam & Jennings 1969, here for a whole building at once).
A, p and q are constants of the scene and the step.
"""

from __future__ import annotations

from pounding_sweep.emit.spec import LANES, KernelSpec, Slots
from pounding_sweep.emit.text import Source
from pounding_sweep.emit.watch import watch
from pounding_sweep.schemes.rk4 import Rk4


class Exact(Rk4):
    """Exact flight; a step with contact is one of `Rk4`."""

    name = "exact"
    title = "exact flight between contacts in long steps, `rk4` in short ones beside them"
    source = "Nigam & Jennings 1969"
    flies_exactly = True
    step_cost = 0.8
    ladder = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)
    finest_float32 = 2.0

    def flight(self, shape: KernelSpec, slots: Slots) -> str:
        """Text of the exact step."""
        return emit_flight(shape, slots)

    def motion_slots(self, shape: KernelSpec) -> dict[str, int]:
        """Also what energies of flight are made from."""
        energies = {"PASSED": 1, "GIVEN": 1, "GAINED": 1, "PULL": shape.n_dof} if "energy" in shape.reducers else {}
        return super().motion_slots(shape) | energies


#: Constants of one lane loop: as many as a processor's registers hold beside the motion.
CONSTANTS = 16


def emit_flight(shape: KernelSpec, slots: Slots) -> str:
    """Write ``flight(S, props, h, table)``: an exact step of all buildings, and what it may have met."""
    src = Source()
    first = matrix = 0
    calls = []
    for b, n in enumerate(shape.storeys):
        if shape.fused:
            _straight(src, b, n, first * LANES)
            calls.append(f"glide{b}(S, props, table + {matrix})")
        else:
            calls.append(f"glide_rows(S, {first * LANES} + 0 * table, props, table + {matrix}, {n} + 0 * table)")
        first += n
        matrix += 2 * n * (2 * n + 2)
    if not shape.fused:
        _by_rows(src)
    src.function("flight(S, props, h, table)")
    for call in calls:
        src(call)
    if shape.fused:
        with src.block("for l in range(L):"):
            watch(src, shape, slots, "S[HL + l] > 0.0")
    else:
        src("watch(S, h)")
    return str(src)


def _straight(src: Source, b: int, n: int, at: int) -> None:
    """Write ``glide<b>``: rows of A, p and q as one line of multiply-adds each, at addresses known to differ."""
    src.function(f"glide{b}(S, props, a)")
    width = 2 * n + 2
    before = [f"S[{home} + {at + i * LANES} + l]" for home in ("UO", "VO") for i in range(n)]
    now = [f"S[{home} + {at + i * LANES} + l]" for home in ("U", "V") for i in range(n)]
    together = max(1, CONSTANTS // width)
    for first in range(0, 2 * n, together):
        rows = range(first, min(first + together, 2 * n))
        for row in rows:
            for column in range(width):
                src(f"a{row}_{column} = props[a + {row * width + column}]")
        with src.block("for l in range(L):"):
            src("g0 = S[G0 + l]; g1 = S[G1 + l]")
            for column in range(2 * n):
                src(f"x{column} = {before[column] if first else now[column]}")
                if not first:
                    src(f"{before[column]} = x{column}")
            for row in rows:
                text = f"fma(a{row}_{2 * n}, g0, a{row}_{2 * n + 1} * g1)"
                for column in range(2 * n):
                    text = f"fma(a{row}_{column}, x{column}, {text})"
                src(f"{now[row]} = {text}")


def _by_rows(src: Source) -> None:
    """Write ``glide_rows``: the same in loops, for longer rows."""
    src.function("glide_rows(S, at, props, a, n)")
    with src.block("for i in range(n):"), src.block("for l in range(L):"):
        src("S[UO + at + i * L + l] = S[U + at + i * L + l]; S[VO + at + i * L + l] = S[V + at + i * L + l]")
    with src.block("for row in range(2 * n):"):
        src("here = a + row * (2 * n + 2)")
        src("home = at + row * L if row < n else at + (row - n) * L")
        src("now = U + home if row < n else V + home")
        src("p = props[here + 2 * n]; q = props[here + 2 * n + 1]")
        with src.block("for l in range(L):"):
            src("S[now + l] = p * S[G0 + l] + q * S[G1 + l]")
        with src.block("for i in range(n):"):
            src("b = props[here + i]; c = props[here + n + i]")
            with src.block("for l in range(L):"):
                src("S[now + l] = fma(b, S[UO + at + i * L + l], fma(c, S[VO + at + i * L + l], S[now + l]))")


#: Long steps by which lanes may be ahead of one that waits in contact, so that others join it there.
WINDOW = 8
#: Lanes in contact below which the others go on.
LEAVE = 1
#: What a lane wants to do next (I[KIND + l]).
KINDS = {"GLIDING": 0, "STEPPING": 1, "TOUCHING": 2, "ENDED": 3}


def begin_march(src: Source) -> None:
    """Write what all lane groups share: lengths of steps, and the ground at the ends of all short ones."""
    src("short = steps // flight_substeps; hg = REAL(dtr / flight_substeps); last = (len(ag) - 1) * steps")
    src("motion = np.empty(last + 1, REAL)")
    with src.block("for i in range(len(ag) - 1):"), src.block("for j in range(steps):"):
        src("motion[i * steps + j] = ag[i] + (ag[i + 1] - ag[i]) * (j / steps)")
    src("motion[last] = ag[len(ag) - 1]")
    src("track = pointer(motion)")


def march(src: Source, shape: KernelSpec, contact: bool) -> None:
    """Write the whole motion of one lane group."""
    if shape.history:
        src("row = 0")
    if contact:
        src("inside = False")
        with src.block("for l in range(L):"):
            src("I[KIND + l] = GLIDING if last > 0 else ENDED  # a record of one point has no motion")
    with src.block("while True:"):
        if contact:
            src("ended = 0; touching = 0; limit = last")
            with src.block("for l in range(L):"):
                src("touches = I[KIND + l] == TOUCHING")
                src("touching += 1 if touches else 0; ended += 1 if I[KIND + l] == ENDED else 0")
                src("ahead = I[STEP + l] + WINDOW * short; limit = min(limit, ahead if touches else last)")
            with src.block("if ended == L:"):
                src("break")
            src("gliding = 0; stepping = 0")
            with src.block("for l in range(L):"):
                for count, kind in (("gliding", "GLIDING"), ("stepping", "STEPPING")):
                    src(f"{count} += 1 if (I[KIND + l] == {kind}) & (I[STEP + l] < limit) else 0")
            with src.block("if gliding + stepping == 0 or (inside and touching >= LEAVE):"):
                with src.block("if not inside:"):
                    src("copy(S)")
                src("inside = True")
                src("contact_pass(S, I, W, props, h)")
                src("go_on(S, I, track, short, last, h)")
            with src.block("else:"):
                src("inside = False")
                src("kind = STEPPING if stepping > 0 else GLIDING; stride = 1 if stepping > 0 else short")
                src("hf = h if stepping > 0 else hg; table = P_SHORT if stepping > 0 else P_GLIDE")
                src("fly(S, I, props, track, kind, stride, short, limit, last, hf, h, table)")
        else:
            with src.block("if I[STEP] >= last:"):
                src("break")
            src(
                "kind = GLIDING; table = P_GLIDE; fly(S, I, props, track, kind, short, short, last, last, hg, h, table)"
            )
        if shape.history:
            with src.block("if I[STEP] > row:"):
                src("row = I[STEP]")
                src("note(S, H, row)")


def emit_fly(contact: bool) -> str:
    """Write ``fly``: an exact step of every lane that wants one of this kind; where it may touch it is taken back."""
    src = Source()
    src.function("fly(S, I, props, track, kind, stride, short, limit, last, hf, h, table)")
    with src.block("for l in range(L):"):
        src("at = I[STEP + l]; flies = (I[KIND + l] == kind) & (at < limit); scale = S[SCALE + l]")
        src("S[HL + l] = hf if flies else 0.0")
        src("to = at + (stride if flies else 0)")
        src("S[G0 + l] = scale * track[at]; S[G1 + l] = scale * track[to]")
    src("flight(S, props, hf, table)")
    if contact:
        src("touched = 0; waiting = 0")
        with src.block("for l in range(L):"):
            src("touched += 1 if S[HIT + l] > 0.0 else 0; waiting += 1 if S[HL + l] == 0.0 else 0")
        with src.block("if touched > 0:"):
            src("turn_back(S, I, track, kind, short, h)")
        with src.block("if touched + waiting > 0:"):
            src("stay(S)")
    src("reduce_flight(S, props, hf)")
    with src.block("for l in range(L):"):
        src("at = I[STEP + l] + (stride if S[HL + l] > 0.0 else 0); now = I[KIND + l]")
        src("I[STEP + l] = at; I[KIND + l] = max(now, ENDED if at >= last else 0)")
    if contact:
        with src.block("if kind == STEPPING:"), src.block("for l in range(L):"):
            src("if I[KIND + l] == STEPPING and I[STEP + l] % short == 0: I[KIND + l] = GLIDING")
    return str(src)
