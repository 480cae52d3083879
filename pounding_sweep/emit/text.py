"""Writing kernel source: lines, lane loops, and where a quantity lives.

No fast-math flag is ever set. Products that the hardware can fuse are written
as ``fma``, so a lane's arithmetic is fixed by the source: the flight step and
the contact step of a lane that touches nothing give the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from pounding_sweep.emit.spec import LANES, Floors, KernelSpec, Neighbours, Slots, property_slots


class Source:
    """Indented lines of one function."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._depth = 0

    def __call__(self, line: str) -> None:
        """Append a line at the present depth."""
        self.lines.append("    " * self._depth + line)

    @contextmanager
    def block(self, head: str) -> Iterator[None]:
        """Write `head` and indent what follows."""
        self(head)
        self._depth += 1
        yield
        self._depth -= 1

    def function(self, head: str) -> None:
        """Begin a compiled function."""
        self._depth = 0
        self("")
        self("")
        self("@njit(**OPTIONS)")
        self(f"def {head}:")
        self._depth = 1

    def __str__(self) -> str:
        return "\n".join(self.lines) + "\n"


#: What each building of a longer row has a copy of, in the slot of its lowest floor: values of the step, of the run.
OF_STEP = {"OWN_H": "HL", "OWN_G0": "G0", "OWN_G1": "G1"}
OF_RUN = {"OWN_ALPHA": "alpha", "OWN_BETA": "beta", "OWN_K": "k", "OWN_GAP": "gap"}


class StepText:
    """Where the quantities of one step live: locals in a fused step, slots otherwise."""

    def __init__(self, shape: KernelSpec, slots: Slots, in_memory: bool) -> None:
        self.shape, self.slots, self.props = shape, slots, property_slots(shape)
        self.in_memory = in_memory
        self.moves = False
        self.contacts_of: list[list[tuple[int, str]]] = [[] for _ in range(shape.n_dof)]
        for j, (left, right, _) in enumerate(shape.contacts):
            if left >= 0:
                self.contacts_of[left].append((j, "-"))
            if right >= 0:
                self.contacts_of[right].append((j, "+"))

    def ref(self, kind: str, i: int) -> str:
        """Text of quantity `kind` of degree of freedom (or contact) `i` inside a lane loop."""
        if not self.in_memory:
            return f"{kind}{i}"
        return self.floor({"u": "UO", "v": "VO"}.get(kind, f"_{kind}"), i)

    def floor(self, name: str, i: int) -> str:
        """Text of slot `name` of floor `i`."""
        text = self.slots.at(name, i)
        return text.replace("S[", "S[o + ", 1) if self.moves else text

    def building(self, name: str, b: int) -> str:
        """Text of slot `name` of building `b`."""
        return self.slots.at(name, b) if self.shape.fused else self.floor(name, self.shape.home(b))

    def own(self, name: str, home: int) -> str:
        """Text of a value of the step or the run in a lane loop of the building whose lowest floor is `home`."""
        return self.floor(name, home) if self.moves else self.slots.at((OF_STEP | OF_RUN)[name])

    def gap(self, pair: Neighbours) -> str:
        """Text of the gap of a pair of a longer row."""
        return self.floor("OWN_GAP", pair.home) if self.moves else self.slots.at("gap", pair.pair)

    def prop(self, name: str, i: int) -> str:
        """Text of a constant of floor `i`."""
        return f"props[P_{name.upper()} + {i}{' + d' if self.moves else ''}]"

    def function(self, src: Source, head: str, members: Sequence[Floors | Neighbours]) -> None:
        """Begin a function for buildings or pairs that are alike, written for the first of them."""
        src.function(f"{head}, d)")
        self.moves = len(members) > 1
        if self.moves:
            src("o = d * L")

    def call(self, src: Source, head: str, members: Sequence[Floors | Neighbours]) -> None:
        """Call such a function for all of them."""
        first = members[0].home
        with src.block(f"for d in {tuple(each.home - first for each in members)!r}:"):
            src(f"{head}, d)")

    def load_constants(self, src: Source, dofs: list[int]) -> None:
        """Scene constants of these floors (and of the storeys above them), before a lane loop."""
        shape = self.shape
        for i in dofs:
            src(f"im{i} = {self.prop('im', i)}; k{i} = {self.prop('k', i)}; m{i} = {self.prop('m', i)}")
            if not shape.top[i] and i + 1 not in dofs:
                src(f"k{i + 1} = {self.prop('k', i + 1)}")
        for b in sorted({shape.building_of[i] for i in dofs}) if not self.moves else ():
            src(f"al{b} = props[P_ALPHA + {b}]; be{b} = props[P_BETA + {b}]")

    def load_own(self, src: Source, dofs: list[int]) -> None:
        """Rayleigh factors of a building that shares its function, in a lane loop."""
        if self.moves:
            b = self.shape.building_of[dofs[0]]
            src(f"al{b} = {self.building('OWN_ALPHA', b)}; be{b} = {self.building('OWN_BETA', b)}")

    def storey_forces(self, src: Source, dofs: list[int], x: str, y: str) -> None:
        """Storey forces f = k (w_i - w_(i-1)), w = x + beta y, of these floors and the storeys above them."""
        shape = self.shape
        need = set(dofs)
        for i in dofs:
            if not shape.bottom[i]:
                need.add(i - 1)
            if not shape.top[i]:
                need.add(i + 1)
        for i in sorted(need):
            b = shape.building_of[i]
            if shape.storeys[b] > 1:
                src(f"w{i} = fma(be{b}, {self.ref(y, i)}, {self.ref(x, i)})")
            else:
                src(f"w{i} = {self.ref(x, i)}")
        for i in sorted(need):
            if i in dofs or (i - 1 in dofs and not shape.bottom[i]):
                src(f"f{i} = k{i} * w{i}" if shape.bottom[i] else f"f{i} = k{i} * (w{i} - w{i - 1})")

    def net_force(self, i: int, contact: str | None) -> str:
        """Force on floor `i` from its storeys and, where `contact` names it, its contacts (a longer row: PUSH)."""
        text = f"-f{i}" if self.shape.top[i] else f"(f{i + 1} - f{i})"
        if contact is not None and self.in_memory:
            return f"({text} + {self.floor('PUSH', i)})"
        if contact is not None:
            for j, sign in self.contacts_of[i]:
                text = f"({text} {sign} {self.ref(contact, j)})"
        return text

    def rates(self, src: Source, dofs: list[int], y: str, ground: str, weight: str, first: bool) -> None:
        """Add the powers of ground input and damping at this stage to the step's increments."""
        shape = self.shape
        for b in sorted({shape.building_of[i] for i in dofs}):
            mine = [i for i in dofs if shape.building_of[i] == b]
            begins = first and shape.bottom[mine[0]]
            momentum = " + ".join(f"m{i} * {self.ref(y, i)}" for i in mine)
            mass = " + ".join(f"m{i} * {self.ref(y, i)} * {self.ref(y, i)}" for i in mine)
            stiff = []
            for i in mine:
                dv = self.ref(y, i) if shape.bottom[i] else f"({self.ref(y, i)} - {self.ref(y, i - 1)})"
                stiff.append(f"k{i} * {dv} * {dv}")
            for name, value in (
                ("DIN", f"-{ground} * ({momentum})"),
                ("DDAMP", f"al{b} * ({mass}) + be{b} * ({' + '.join(stiff)})"),
            ):
                slot = self.building(name, b)
                old = "" if begins else f"{slot} + "
                src(f"{slot} = {old}{weight} * ({value})")


def emit_spread(shape: KernelSpec, slots: Slots) -> str:
    """Write ``spread(S)``, which gives the buildings of a longer row their copies of the step's length and ground."""
    src = Source()
    src.function("spread(S)")
    with src.block("for l in range(L):"):
        for own, name in OF_STEP.items():
            src(f"x = {slots.at(name)}")
            for b in range(shape.n_buildings):
                src(f"{slots.at(own, shape.home(b))} = x")
    return str(src)


#: Text that addresses a slot, by its name, of a floor or a contact, by its number, in lane ``l``.
Address = Callable[[str, int], str]
#: Writes one contact in a lane loop: text of left minus right in a slot, address of its gap, its first lane, its mass.
ContactBody = Callable[[Callable[[str], str], str, str, str], None]


def over_contacts(src: Source, shape: KernelSpec, slots: Slots, body: ContactBody) -> None:
    """Write `body` for every contact, in lane loops."""
    if shape.fused:
        with src.block("for l in range(L):"):
            for j, (left, right, pair) in enumerate(shape.contacts):
                ends = [None if i < 0 else f"S[{{0}} + {i * LANES} + l]" for i in (left, right)]
                body(_between(ends), slots.at("gap", pair), str(j * LANES), f"props[P_REDUCED + {j}]")
        return
    with src.block("for j in range(NC):"):
        src("left = LEFT[j] * L; right = RIGHT[j] * L; gap = GAP + PAIR[j] * L; j0 = j * L")
        sides: list[tuple[str, list[str | None]]] = [
            ("if left >= 0 and right >= 0:", ["S[{0} + left + l]", "S[{0} + right + l]"]),
            ("elif left >= 0:", ["S[{0} + left + l]", None]),
            ("else:", [None, "S[{0} + right + l]"]),
        ]
        for head, ends in sides:
            with src.block(head), src.block("for l in range(L):"):
                body(_between(ends), "S[gap + l]", "j0", "props[P_REDUCED + j]")


def _between(ends: list[str | None]) -> Callable[[str], str]:
    """Return what writes left minus right of the motion in a slot."""
    return lambda slot: relative(*(None if end is None else end.format(slot) for end in ends))


def relative(ref_left: str | None, ref_right: str | None) -> str:
    """Text of left minus right, a wall being at rest."""
    if ref_left is None:
        return f"(-{ref_right})"
    return ref_left if ref_right is None else f"({ref_left} - {ref_right})"
