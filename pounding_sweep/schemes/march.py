"""Text of the loop over time of the exact scheme, in which every lane has its own clock.

A lane glides over long exact steps; where one may touch it goes through the same time in
short ones, and the short one in which it does is cut by its contacts. What a lane does
next follows from its own motion alone, so its result does not depend on its neighbours;
only which kind of step is taken next for the lanes that want it is chosen for all.
"""

from __future__ import annotations

from pounding_sweep.emit.spec import KernelShape
from pounding_sweep.emit.text import Source

#: Long steps by which lanes may be ahead of one that waits in contact, so that others join it there.
WINDOW = 8
#: Lanes in contact below which the others go on.
LEAVE = 1
#: What a lane wants to do next (I[KIND + l]).
KINDS = {"GLIDING": 0, "STEPPING": 1, "TOUCHING": 2, "ENDED": 3}


def begin_march(src: Source) -> None:
    """Write what all lane groups share: lengths of steps, and the ground at the ends of all short ones."""
    src("short = steps // glides; hg = REAL(dtr / glides); last = (len(ag) - 1) * steps")
    src("motion = np.empty(last + 1, REAL)")
    with src.block("for i in range(len(ag) - 1):"), src.block("for j in range(steps):"):
        src("motion[i * steps + j] = ag[i] + (ag[i + 1] - ag[i]) * (j / steps)")
    src("motion[last] = ag[len(ag) - 1]")
    src("track = pointer(motion)")


def march(src: Source, shape: KernelShape, contact: bool) -> None:
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
