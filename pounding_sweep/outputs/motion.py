"""Outputs of the motion of floors: displacements, drifts, shears, accelerations, and how near neighbours come."""

from __future__ import annotations

from pounding_sweep.emit.spec import KernelSpec
from pounding_sweep.emit.text import Address, Source, relative
from pounding_sweep.outputs.declare import CONTACT, FLOOR, Reducer, Slot, Variable, needs
from pounding_sweep.outputs.readout import contacts, floors, scatter_dof

#: Of outputs of floors.
MOTIONS = (
    Variable(
        "displacement_max",
        FLOOR,
        "m",
        "largest floor displacement",
        "Largest signed displacement of the floor relative to the ground, positive to the right.",
        needs("displacement"),
        floors("umax"),
        error="motions",
        relative_to=("displacement_min",),
        default=True,
    ),
    Variable(
        "displacement_min",
        FLOOR,
        "m",
        "smallest floor displacement",
        "Smallest signed displacement of the floor relative to the ground, negative to the left.",
        needs("displacement"),
        floors("umin"),
        error="motions",
        relative_to=("displacement_max",),
        default=True,
    ),
    Variable(
        "drift_max",
        FLOOR,
        "m",
        "largest interstorey drift",
        "Largest absolute interstorey displacement |u_i - u_(i-1)|; of storey 1, relative to the ground.",
        needs("drift"),
        floors("drift"),
        error="motions",
        default=True,
    ),
    Variable(
        "storey_shear_max",
        FLOOR,
        "kN",
        "largest storey shear",
        "Largest absolute elastic storey force k |u_i - u_(i-1)|, dampers not included.",
        needs("drift"),
        lambda kept: scatter_dof(kept.slots["drift"] * kept.variants.stiffnesses, kept.scene),
        error="motions",
        default=True,
    ),
    Variable(
        "acceleration_max",
        FLOOR,
        "m s-2",
        "largest total floor acceleration",
        "Largest absolute total acceleration of the floor (relative + ground); where the contact force jumps at a "
        "touch, the limit just after it counts; where velocities jump, the jump itself does not.",
        needs("acceleration"),
        floors("acc"),
        error="contacts",
    ),
)
#: Of outputs of neighbours.
CLOSINGS = (
    Variable(
        "closing_max",
        CONTACT,
        "m",
        "largest closing displacement",
        "Largest u_left - u_right; in a run without pounding, the gap that would just not be touched.",
        needs("closing"),
        contacts("closing"),
        error="motions",
    ),
)


def _turn(src: Source, ends: list[str], most: str, least: str, signed: bool = False) -> None:
    """Write the update of a largest value (of its size, unless `signed`), or of a largest and a `least` one."""
    sized = not least and not signed
    x0, x1, v0, v1 = ends
    src("turned = 0")
    with src.block("for l in range(L):"):
        src(f"x0 = {x0}; x1 = {x1}; v0 = {v0}; v1 = {v1}")
        src("reach = REACH * S[HL + l] * (abs(v0) + abs(v1))")
        src(f"above = max({'abs(x0), abs(x1)' if sized else 'x0, x1'}) + reach - {most}")
        if least:
            src(f"above = max(above, {least} - min(x0, x1) + reach)")
        src("turned += 1 if (v0 * v1 <= 0.0) & (above > 0.0) else 0")
    with src.block("if turned > 0:"), src.block("for l in range(L):"):
        src(f"x0 = {x0}; x1 = {x1}; v0 = {v0}; v1 = {v1}")
        src("p = cubic_extreme(x0, x1, S[HL + l] * v0, S[HL + l] * v1)")
        if sized:
            src(f"{most} = max({most}, max(abs(p), max(abs(x0), abs(x1))))")
        else:
            src(f"{most} = max({most}, max(p, max(x0, x1)))")
        if least:
            src(f"{least} = min({least}, min(p, min(x0, x1)))")


class _Displacement(Reducer):
    def watch_floors(self, src: Source, shape: KernelSpec, at: Address, floors: list[int]) -> None:
        for i in floors:
            src(f"turn = min(turn, {at('VO', i)} * {at('V', i)})")

    def turns(self, src: Source) -> None:
        with src.block("for i in range(N):"):
            ends = [f"S[{slot} + i * L + l]" for slot in ("UO", "U", "VO", "V")]
            _turn(src, ends, "S[UMAX + i * L + l]", "S[UMIN + i * L + l]")

    def sample_floor(self, src: Source, shape: KernelSpec, at: Address, u: list[str], i: int) -> None:
        src(f"x = {u[i]}; {at('umax', i)} = max({at('umax', i)}, x)")
        src(f"{at('umin', i)} = min({at('umin', i)}, x)")

    def sample_loops(self, src: Source) -> None:
        with src.block("for c in range(N * L):"):
            src("S[UMAX + c] = max(S[UMAX + c], S[U + c]); S[UMIN + c] = min(S[UMIN + c], S[U + c])")


class _Drift(Reducer):
    def watch_floors(self, src: Source, shape: KernelSpec, at: Address, floors: list[int]) -> None:
        for i in floors:
            if not shape.bottom[i]:
                src(f"turn = min(turn, ({at('VO', i)} - {at('VO', i - 1)}) * ({at('V', i)} - {at('V', i - 1)}))")
            elif "displacement" not in shape.reducers:  # which looks at the lowest floor already
                src(f"turn = min(turn, {at('VO', i)} * {at('V', i)})")

    def turns(self, src: Source) -> None:
        for first in (True, False):
            floors = "range(FIRST[b], FIRST[b] + 1)" if first else "range(FIRST[b] + 1, FIRST[b + 1])"
            with src.block("for b in range(NB):"), src.block(f"for i in {floors}:"):
                ends = []
                for slot in ("UO", "U", "VO", "V"):
                    ends.append(f"S[{slot} + i * L + l]" + ("" if first else f" - S[{slot} + (i - 1) * L + l]"))
                _turn(src, ends, "S[DRIFT + i * L + l]", "")

    def sample_floor(self, src: Source, shape: KernelSpec, at: Address, u: list[str], i: int) -> None:
        value = u[i] if shape.bottom[i] else f"{u[i]} - {u[i - 1]}"
        src(f"{at('drift', i)} = max({at('drift', i)}, abs({value}))")

    def sample_loops(self, src: Source) -> None:
        with src.block("for b in range(NB):"), src.block("for i in range(FIRST[b], FIRST[b + 1]):"):
            src("low = (i - 1) * L if i > FIRST[b] else i * L; held = 1.0 if i > FIRST[b] else 0.0")
            with src.block("for l in range(L):"):
                src("x = abs(S[U + i * L + l] - held * S[U + low + l])")
                src("S[DRIFT + i * L + l] = max(S[DRIFT + i * L + l], x)")


class _Closing(Reducer):
    def watch_contacts(self, src: Source, at: Address, ends: list[tuple[int, int]]) -> None:
        for pair in ends:
            before, now = (relative(*(at(slot, i) if i >= 0 else None for i in pair)) for slot in ("VO", "V"))
            src(f"turn = min(turn, {before} * {now})")

    def turns(self, src: Source) -> None:
        with src.block("for j in range(NC):"):
            self._sides(src)
            ends = [f"a * S[{slot} + left + l] - b * S[{slot} + right + l]" for slot in ("UO", "U", "VO", "V")]
            _turn(src, ends, "S[CLOSING + j * L + l]", "", signed=True)

    def sample_contacts(self, src: Source, shape: KernelSpec, at: Address, u: list[str]) -> None:
        for j, pair in enumerate(shape.contacts):
            value = relative(*(u[i] if i >= 0 else None for i in pair[:2]))
            src(f"{at('closing', j)} = max({at('closing', j)}, {value})")

    def sample_loops(self, src: Source) -> None:
        with src.block("for j in range(NC):"):
            self._sides(src)
            with src.block("for l in range(L):"):
                src("x = a * S[U + left + l] - b * S[U + right + l]")
                src("S[CLOSING + j * L + l] = max(S[CLOSING + j * L + l], x)")

    @staticmethod
    def _sides(src: Source) -> None:
        src("left = max(LEFT[j], 0) * L; right = max(RIGHT[j], 0) * L")
        src("a = 1.0 if LEFT[j] >= 0 else 0.0; b = 1.0 if RIGHT[j] >= 0 else 0.0")


_STILL = "S[U + i * L + l]"
REDUCERS: tuple[Reducer, ...] = (
    _Displacement("displacement", (Slot("umax", "floor", _STILL), Slot("umin", "floor", _STILL)), peaks="floors"),
    _Drift("drift", (Slot("drift", "floor"),), peaks="floors"),
    Reducer("acceleration", (Slot("acc", "floor"),), looks="ends", quick=True),
    _Closing("closing", (Slot("closing", "contact"),), where="neighbours", peaks="contacts"),
)
