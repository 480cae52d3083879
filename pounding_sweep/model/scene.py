"""A row of buildings and walls, the gaps between them, and the links and bumpers there.

Units kN, t, m, s: consistent as they stand (1 kN = 1 t m/s2).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property, partial
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, ValidationInfo

from pounding_sweep.base.errors import InputError, SceneError, unknown
from pounding_sweep.base.text import html_table
from pounding_sweep.model import faults as model_faults
from pounding_sweep.model.building import Building, Label, OfStoreysOrZero
from pounding_sweep.model.faults import Integer, Listed, NotNegative, Positive, as_mapping, checked, derived, set_fields
from pounding_sweep.model.laws import LAWS, RUBBER, Law, find_law, names_file, rubber_bumper
from pounding_sweep.model.meeting import (
    CONTACTS,
    FLOOR_TOLERANCE,
    Contact,
    Contacts,
    Facing,
    contacts_of,
    effective_mass,
    meetings,
)
from pounding_sweep.model.storeys import StoreyLaw


@checked
class Wall:
    """A rigid wall (moat wall, barrier) at an end of the row; it moves with the ground.

    It meets every floor of its neighbour, unless the scene limits the pair to some storeys.

    Examples
    --------
    >>> tower = Building("tower", masses=[20.0, 18.0], stiffnesses=[3e4, 3e4])
    >>> Scene([Wall(), tower], gaps=[0.02]).pair_labels
    ('wall-tower',)
    """

    name: Label = "wall"
    #: what tells its table from that of a building
    wall: model_faults.Flag = field(default=True, kw_only=True, repr=False)


@checked
class ContactProperties:
    """Reference contact properties of a scene.

    Parameters
    ----------
    linear_stiffness : float, optional
        For laws with force ~ d (kN/m).
    hertz_stiffness : float, optional
        For laws with force ~ d^1.5 (kN/m^1.5); see `pounding_sweep.hertz_stiffness`.
    restitution : float, optional
        Coefficient of restitution where a sweep gives none.

    Examples
    --------
    >>> row = [Building(name, masses=[20.0], stiffnesses=[3e4]) for name in ("left", "right")]
    >>> Scene(row, gaps=[0.02], contact=ContactProperties(linear_stiffness=1e6)).contact.reference(1.0)
    1000000.0
    """

    linear_stiffness: Positive | None = None
    hertz_stiffness: Positive | None = None
    restitution: Annotated[model_faults.Number, Field(ge=0.0, le=1.0)] | None = None
    FILE_KEYS: ClassVar = ("hertz",)  # a sweep file's reader replaces it

    def reference(self, exponent: float) -> float | None:
        """Return the reference stiffness (kN/m**exponent) for laws of that force exponent, or None."""
        return {1.0: self.linear_stiffness, 1.5: self.hertz_stiffness}.get(exponent)


#: A storey of both neighbours, or one of each.
_FLOORS = model_faults.one_or_several(Integer, tuple[Integer, Integer])


@checked
class Link:
    """Springs and dashpots between floors of two neighbours, alike at all the storeys that are named.

    A link's force is stiffness * d + damping * d', d being the displacement of its left floor less that of its
    right one; it acts on both, whatever its sign.

    Parameters
    ----------
    pair : str
        Name of the pair of neighbours, ``"left-right"``.
    storeys : sequence of int or (int, int)
        Storeys of the floors that are linked, 1 at the bottom: one number where it is the same in both buildings,
        otherwise the left building's and the right one's.
    stiffness : float
        Of each link (kN/m).
    damping : float
        Coefficient of each link's dashpot (kN s/m).

    Raises
    ------
    SceneError
        A value is negative, both are zero, or storeys are no whole numbers.

    Examples
    --------
    >>> Link("a-b", [1, (2, 3)], damping=500.0).floors
    ((1, 1), (2, 3))
    """

    pair: str
    storeys: Annotated[Sequence[Annotated[int | Sequence[int], _FLOORS]], Listed, Field(min_length=1)]
    stiffness: NotNegative = 0.0
    damping: NotNegative = 0.0

    #: storeys of the left and of the right building, link by link
    floors: tuple[tuple[int, int], ...] = derived()

    def __post_init__(self) -> None:
        if not (self.stiffness or self.damping):
            raise SceneError("stiffness and damping are zero; give one of them, or leave it out")
        pairs = ((storey, storey) if isinstance(storey, int) else storey for storey in self.storeys)
        set_fields(self, floors=tuple(pairs))


class Spring(NamedTuple):
    """An element of a storey that follows a storey law."""

    floor: int  # degree of freedom above it
    law: StoreyLaw
    parameters: Any  # of the law
    is_infill: bool  # it stands beside the storey's own


class LinkedFloors(NamedTuple):
    """One link of a scene."""

    pair: int  # index of the pair of neighbours
    storey: int  # of its left floor
    #: degrees of freedom
    left: int
    right: int
    stiffness: float  # kN/m
    damping: float  # kN s/m
    place: int  # index of its label along ``pair`` in results


def _read_law(value: Any, info: ValidationInfo) -> Any:
    """Return the law of a bumper by its key or file, from the folder `base` of the context, or as JSON holds it."""
    if isinstance(value, Mapping):
        return Law(**value)
    if value == RUBBER:
        return value
    if isinstance(value, str) and value not in LAWS and not names_file(value):
        raise InputError(unknown("contact law", value, (*LAWS, RUBBER)))
    return find_law(value, (info.context or {}).get("base"))


@checked
class Bumper:
    """What stands between floors of two neighbours, or before a wall, and gives their contacts a law of their own.

    Those contacts keep this law, its stiffness and restitution in every scenario; all others of the row take what
    the sweep gives. Under the law "none", which stands for no pounding, bumpers do not act either.

    Parameters
    ----------
    pair : str
        Name of the pair of neighbours, ``"left-right"``.
    law : str or Law
        Contact law: a key of the registry, ``"rubber_bumper"`` for that of `rubber_bumper`, or a law of one's own. As
        an attribute: the law itself.
    stiffness : float, optional
        Contact stiffness (kN/m**exponent); the law's reference where not given.
    restitution : float, optional
        Coefficient of restitution; needed by a law that takes one.
    thickness : float, optional
        Thickness (m), by which floors meet earlier; the law's where not given.
    storeys : sequence of int
        Storeys that have it, as results number them; all at which floors of the pair meet where not given.

    Raises
    ------
    SceneError
        The law is unknown or has no force, or a number is missing or out of its range.

    Examples
    --------
    >>> pad = Bumper("a-b", "rubber_bumper", stiffness=500 / 0.04**2.65, restitution=0.5, thickness=0.05)
    >>> pad.law.title, pad.law.stiffness_unit
    ('Rubber bumper of 50 mm', 'kN m-2.65')
    """

    pair: str
    law: Annotated[Any, BeforeValidator(_read_law)]
    stiffness: Annotated[float, model_faults.schema(Positive | None)] = None  # type: ignore[assignment]
    restitution: model_faults.Number | None = None
    thickness: Annotated[float, model_faults.schema(NotNegative | None)] = None  # type: ignore[assignment]
    storeys: Annotated[Sequence[Integer], Listed] = ()

    def __post_init__(self) -> None:
        law = self.law
        if law == RUBBER:
            if not self.thickness:
                raise SceneError(f"law {RUBBER!r} needs the thickness of the rubber (m), a positive number")
            law = rubber_bumper(self.thickness)
            set_fields(self, law=law)
        if law.exponent is None:
            raise SceneError(f"law {law.key!r} has no force that a bumper could have; give another law")
        if self.thickness is None:
            set_fields(self, thickness=law.thickness)
        elif law.thickness and self.thickness != law.thickness:
            raise SceneError(
                f"thickness is {self.thickness:g} m beside the {law.thickness:g} m of its law; leave it out"
            )
        if self.stiffness is None:
            set_fields(self, stiffness=law.reference_stiffness)
        if self.stiffness is None:
            raise SceneError(f"law {law.key!r} needs a stiffness ({law.stiffness_unit})")
        if self.restitution is not None and not law.takes_restitution:
            raise SceneError(f"law {law.key!r} takes no restitution; leave it out")
        law.check_restitution(self.restitution)

    def damping_coefficient(self, mass: np.ndarray, basis: str) -> np.ndarray:
        """Coefficient of the damper of contacts of some effective masses (t), see `Law.damping_coefficient`."""
        return self.law.damping_coefficient(self.restitution, self.stiffness, mass, basis)

    def quickening(self, basis: str) -> Any:
        """See `Law.quickening`."""
        return self.law.quickening(self.restitution, basis)


@checked
class Restrainer(Bumper):
    """Links between floors of two neighbours, or a floor and a wall, that act in tension only, beyond a slack.

    Cables of a bridge have a slack in tension, a key in its keyway on both sides: each is a label of its own along
    ``pair``, "NAME in tension" and "NAME in compression", with its force in ``impact_force_max`` and its stretch beyond
    the slack in ``penetration_max``. Like bumpers they keep their law in every scenario, and do not act under the law
    "none".

    Parameters
    ----------
    pair : str
        Name of the pair of neighbours, ``"left-right"``.
    law : str or Law
        Force of a link by its stretch beyond the slack: ``"linear"`` by default, ``"kelvin_voigt"`` with damping.
    stiffness : float
        Of each link (kN/m**exponent).
    restitution : float, optional
        Coefficient of restitution, which the damping follows from; needed by a law that takes one.
    storeys : sequence of int or (int, int)
        Storeys of the floors that are restrained: one number where it is the same in both buildings, or beside a wall,
        otherwise the left building's and the right one's; where floors of the pair meet where not given.
    slack : float
        How far floors move apart (m) until a link is taut.
    closing_slack : float, optional
        How far they move together (m) until it acts in compression; it does not where not given.

    Raises
    ------
    SceneError
        The law is unknown or has no force, or a number is missing or out of its range.

    Examples
    --------
    >>> cables = Restrainer("a-b", stiffness=2e4, slack=0.02)
    >>> cables.law.key, cables.slack
    ('linear', 0.02)
    """

    law: Annotated[Any, BeforeValidator(_read_law), Field(validate_default=True)] = "linear"
    storeys: Annotated[Sequence[Annotated[int | Sequence[int], _FLOORS]], Listed] = ()  # type: ignore[assignment]
    thickness: float = field(default=0.0, init=False)
    slack: NotNegative = 0.0
    closing_slack: NotNegative | None = None


def _kind_of(item: Any) -> str:
    wall = item.get("wall") is True if isinstance(item, dict) else isinstance(item, Wall)
    return "|wall" if wall else "|building"


_Item = Annotated[Annotated[Building, Tag("|building")] | Annotated[Wall, Tag("|wall")], Discriminator(_kind_of)]
#: Storeys by the names of pairs; JSON has them as a list of pairs.
_Limits = Annotated[dict[str, Annotated[Sequence[Integer], Listed, Field(min_length=1)]], BeforeValidator(as_mapping)]


@checked
class Scene:
    """A row of buildings with a gap between each two neighbours.

    Parameters
    ----------
    row : sequence of Building or Wall
        From left to right. A `Wall` may be the first or the last.
    gaps : float or sequence of float
        Gap of each pair of neighbours (m), ``len(row) - 1`` of them, or one number for all.
    contact : ContactProperties, optional
        Reference contact stiffnesses and restitution.
    tolerance : float
        Floors whose slabs miss each other by no more than this in elevation (m) meet.
    contacts : {"floors", "floors and columns"}
        What can meet: level floors, or also a floor and the columns of the neighbour's storey that it
        stands before. As an attribute: all contacts, pair by pair, bottom first.
    storeys : mapping of str to sequence of int, optional
        Pairs, by their names, that meet at these storeys alone, as results number them; of columns, those of the floors
        that strike them.
    allow_unmet : bool
        Accept pairs with no floors that meet, which pass through each other.
    links : sequence of Link, optional
        Springs and dashpots between floors of neighbours.
    bumpers : sequence of Bumper, optional
        Contact laws of some pairs, or of storeys of them; sweeps give that of all other contacts.
    restrainers : sequence of Restrainer, optional
        Links between floors of neighbours that act beyond a slack only.

    Raises
    ------
    SceneError
        No building, a wall inside the row, names that repeat, a wrong number of gaps, a pair with no floors that meet,
        or a part at a floor or storey that is not there.

    Examples
    --------
    >>> a = Building("a", [100.0, 100.0], [1e5, 1e5])
    >>> b = Building("b", [80.0], [2e5])
    >>> scene = Scene([a, b, Wall()], gaps=[0.01, 0.02])
    >>> scene.pair_names
    ('a-b', 'b-wall')
    >>> [(c.pair, c.storey) for c in scene.contacts]
    [(0, 1), (1, 1)]
    """

    row: Annotated[Sequence[_Item], Listed]
    gaps: OfStoreysOrZero = ()
    contact: ContactProperties = field(default_factory=ContactProperties)
    tolerance: NotNegative = field(default=FLOOR_TOLERANCE, kw_only=True)
    contacts: Any = field(default=CONTACTS[0], kw_only=True, repr=False)
    storeys: Annotated[Any, model_faults.schema(_Limits)] = field(default=(), kw_only=True)
    allow_unmet: model_faults.Flag = field(default=False, kw_only=True)
    links: Annotated[Sequence[Link], Listed] = field(default=(), kw_only=True)
    bumpers: Annotated[Sequence[Bumper], Listed] = field(default=(), kw_only=True)
    restrainers: Annotated[Sequence[Restrainer], Listed] = field(default=(), kw_only=True)
    #: the buildings of the row, left to right, without walls, and the name of each pair of neighbours
    buildings: tuple[Building, ...] = derived()
    pair_names: tuple[str, ...] = derived()
    n_storeys: int = derived()  # of the highest building
    n_dof: int = derived()  # floors of all buildings
    n_moving: int = derived()  # the same, and displacements and rotations of bases on foundations
    offsets: tuple[int, ...] = derived()  # first degree of freedom of each building, and the total at the end
    #: whether the storey below each floor may yield, may fall, has a dashpot
    yields: tuple[bool, ...] = derived()
    falls: tuple[bool, ...] = derived()
    dashed: tuple[bool, ...] = derived()
    foundations: tuple[int, ...] = derived()  # buildings that stand on foundations, by their numbers
    #: whether each building moves in modes that damping leaves apart: no dashpots, no links, no foundations
    has_classical_modes: bool = derived()
    #: labels along ``pair`` in results: each pair, and after it the columns of either building that are struck
    pair_labels: tuple[str, ...] = derived()
    pair_of_label: tuple[int, ...] = derived()  # index of the pair of neighbours of each of them
    bumper_of: tuple[Bumper | None, ...] = derived()  # of each contact; None where it takes the law of the sweep
    #: whether all contacts have bumpers, so that a sweep's law, stiffness and restitution matter to none
    padded: bool = derived()
    FILE_KEYS: ClassVar = ("preset",)  # a sweep file's reader replaces it

    def __post_init__(self) -> None:
        row = self.row
        if not any(isinstance(item, Building) for item in row):
            raise SceneError("needs at least one building; give a row, in a file a preset or tables [[scene.row]]")
        for i, item in enumerate(row):
            if isinstance(item, Wall) and 0 < i < len(row) - 1:
                raise SceneError(
                    f"wall {item.name!r} is number {i + 1} of the row; a wall may only be the first or the last"
                )
        if len(row) > 1 and all(isinstance(row[i], Wall) for i in (0, -1)) and row[0].name == row[-1].name:
            row = (Wall(f"left {row[0].name}"), *row[1:-1], Wall(f"right {row[-1].name}"))
        buildings = tuple(item for item in row if isinstance(item, Building))
        set_fields(
            self,
            row=row,
            gaps=(self.gaps,) * (len(row) - 1) if isinstance(self.gaps, float) else self.gaps,
            buildings=buildings,
            pair_names=tuple(f"{a.name}-{b.name}" for a, b in itertools.pairwise(row)),
            n_storeys=max(building.n_storeys for building in buildings),
            n_dof=sum(building.n_storeys for building in buildings),
            n_moving=sum(building.n_storeys + 2 * (building.foundation is not None) for building in buildings),
            offsets=(0, *itertools.accumulate(building.n_storeys for building in buildings)),
            **{
                name: tuple(flag for building in buildings for flag in getattr(building, name))
                for name in ("yields", "falls", "dashed")
            },
            foundations=tuple(b for b, building in enumerate(buildings) if building.foundation is not None),
            has_classical_modes=not (
                self.links
                or any(item.foundation or item.damping_matrix is not None or any(item.dashed) for item in buildings)
            ),
        )
        names = [item.name for item in row]
        if repeated := sorted({n for n in names if names.count(n) > 1}):
            raise SceneError(f"names must differ within a row; repeated: {', '.join(map(repr, repeated))}")
        if len(set(self.pair_names)) < len(self.pair_names):
            raise SceneError(
                f"two pairs of the row have the same name ({', '.join(self.pair_names)}); rename a building"
            )
        if len(self.gaps) != len(row) - 1:
            raise SceneError(
                f"{len(self.gaps)} gaps for a row of {len(row)}; give {len(row) - 1}, one between each two neighbours "
                "(m)",
                ("gaps",),
            )
        self._check_meetings()
        bumper_of: list[Bumper | None] = [contact.restrainer for contact in self.contacts]
        with model_faults.Faults() as faults:
            place = partial(self._place_bumper, bumper_of)
            for name, check in (("links", self._check_link), ("bumpers", place), ("restrainers", lambda _: None)):
                for index, item in enumerate(getattr(self, name)):
                    if item.pair in self.pair_names:
                        faults.attempt((name, index), check, item)
                    else:
                        faults.add((name, index), unknown("pair", item.pair, self.pair_names))
        set_fields(self, bumper_of=tuple(bumper_of), padded=bool(bumper_of) and None not in bumper_of)

    def _place_bumper(self, bumper_of: list[Bumper | None], bumper: Bumper) -> None:
        """Place a bumper at its contacts, one at each."""
        label = self.pair_labels.index(bumper.pair)
        contacts = {contact.storey: j for j, contact in enumerate(self.contacts) if contact.place == label}
        for storey in bumper.storeys or contacts or [1]:
            if storey not in contacts:
                those = ", ".join(map(str, sorted(contacts))) or "none"
                raise SceneError(f"no floors meet at storey {storey}; they do at: {those}")
            if bumper_of[contacts[storey]] is not None:
                raise SceneError(f"storey {storey} of pair {bumper.pair!r} has several bumpers; give one")
            bumper_of[contacts[storey]] = bumper

    def _check_link(self, link: Link) -> None:
        """Check that a link joins floors that are there, each two once."""
        pair = self.pair_names.index(link.pair)
        for side, item in enumerate(self.row[pair : pair + 2]):
            if isinstance(item, Wall):
                raise SceneError(f"pair {link.pair!r} has a wall; links join floors of two buildings")
            for floors in link.floors:
                if not 1 <= floors[side] <= item.n_storeys:
                    raise SceneError(
                        f"there is no storey {floors[side]} of {item.name!r}; give one of 1 to {item.n_storeys}"
                    )
        storeys = [storey for other in self.links if other.pair == link.pair for storey, _ in other.floors]
        for storey, _ in link.floors:
            if storeys.count(storey) > 1:
                raise SceneError(f"storey {storey} has {storeys.count(storey)} links; give one, of their sum")

    def _check_meetings(self) -> None:
        """Check where floors meet; limits become pairs of a name and storeys, so that scenes are values."""
        kind = self.contacts.kind if isinstance(self.contacts, Contacts) else self.contacts
        if kind not in CONTACTS:
            raise SceneError(unknown("kind of contacts", kind, CONTACTS), ("contacts",))
        limits, names = self.storeys or {}, self.pair_names
        for name in limits:
            if name not in names:
                raise SceneError(unknown("pair", name, names), ("storeys",))
        labels: list[tuple[str, int]] = []
        contacts: list[Contact] = []
        masses = [mass for building in self.buildings for mass in building.masses]
        for pair, name in enumerate(names):
            neighbours: Sequence[Any] = self.row[pair : pair + 2]
            starts = self._starts[pair : pair + 2]
            groups = contacts_of(pair, name, neighbours, starts, self.tolerance, columns=kind == CONTACTS[1])
            meeting = {contact.storey for _, group in groups for contact in group}
            for storey in limits.get(name, ()):
                if storey not in meeting:
                    text = f"storey {storey} of pair {name!r} meets nothing; those that do: "
                    raise SceneError(text + (", ".join(map(str, sorted(meeting))) or "none"), ("storeys",))
            if not meeting and not self.allow_unmet:
                where = (f"{b.name!r} has floors at {', '.join(f'{z:g}' for z in b.levels)} m" for b in neighbours)
                tallest = max(building.elevations[0] for building in neighbours)
                likely = "; likely storey_heights in mm given for m" if tallest > 100.0 else ""
                raise SceneError(
                    f"pair {name!r} has no floors that meet: {', '.join(where)}{likely}; give slab_depths by which "
                    'they do, contacts = "floors and columns", or allow_unmet = true where they shall miss each other'
                )
            groups = [(x, [c for c in group if c.storey in limits.get(name, meeting)]) for x, group in groups]
            for label, remaining in (*groups, *self._restrained(pair, starts, groups[0][1])):
                for contact in remaining:
                    mass = effective_mass(contact.ends, masses)
                    contacts.append(replace(contact, place=len(labels), mass=mass))
                labels += [(label, pair)] if remaining or label == name else []
        stories = [(building, storey) for building in self.buildings for storey in range(building.n_storeys)]
        for contact in contacts:
            building, storey = stories[(contact.left, contact.right)[contact.struck]]
            if contact.struck >= 0 and (building.yields[storey] or building.foundation or building.p_delta):
                raise SceneError(
                    f"floors of pair {names[contact.pair]!r} strike columns whose shape is not known: of a storey that "
                    "may yield, or of a building on a foundation or with p_delta; give that storey the strength inf, "
                    'leave out the foundation or p_delta, or give contacts = "floors"'
                )
            if contact.struck >= 0 and building.stiffnesses is None and building.column_stiffnesses is None:
                raise SceneError(
                    f"floors of pair {names[contact.pair]!r} strike columns of {building.name!r}, whose stiffness its "
                    'stiffness_matrix does not tell; give column_stiffnesses, or contacts = "floors"'
                )
        set_fields(
            self,
            storeys=tuple((name, limits[name]) for name in names if name in limits),
            pair_labels=tuple(label for label, _ in labels),
            pair_of_label=tuple(pair for _, pair in labels),
            contacts=Contacts(contacts),
        )
        self.contacts.kind = kind

    def _restrained(
        self, pair: int, starts: Sequence[int], level: Sequence[Contact]
    ) -> Iterator[tuple[str, list[Contact]]]:
        """Return what restrainers hold of a pair, by label; `level` floors meet."""
        name, neighbours = self.pair_names[pair], self.row[pair : pair + 2]
        for tension, sense in ((True, "tension"), (False, "compression")):
            contacts: dict[int, Contact] = {}
            for index, item in enumerate(self.restrainers):
                if item.pair != name or (not tension and item.closing_slack is None):
                    continue
                for floors in item.storeys or [(c.left - starts[0] + 1, c.right - starts[1] + 1) for c in level]:
                    ends = []
                    for storey, other, start in zip(
                        np.broadcast_to(floors, 2).tolist(), neighbours, starts, strict=True
                    ):
                        if isinstance(other, Building) and not 1 <= storey <= other.n_storeys:
                            text = f"there is no storey {storey} of {other.name!r}; give one of 1 to {other.n_storeys}"
                            raise SceneError(text, ("restrainers", index))
                        ends.append(start + storey - 1 if isinstance(other, Building) else -1)
                    storey = (ends[0] - starts[0] if ends[0] >= 0 else ends[1] - starts[1]) + 1
                    if storey in contacts:
                        text = f"storey {storey} of pair {name!r} has several in {sense}; give one, of their sum"
                        raise SceneError(text, ("restrainers", index))
                    contacts[storey] = Contact(pair, storey, ends[0], ends[1], restrainer=item, tension=tension)
            if contacts:
                yield f"{name} in {sense}", list(contacts.values())

    @cached_property
    def _starts(self) -> tuple[int, ...]:
        """First degree of freedom of each of the row; of a wall, of its right neighbour."""
        counts = [item.n_storeys if isinstance(item, Building) else 0 for item in self.row]
        return (0, *itertools.accumulate(counts[:-1]))

    @cached_property
    def springs(self) -> tuple[Spring, ...]:
        """Elements of storeys that follow a storey law, bottom first."""
        return tuple(
            Spring(first + storey, law, parameters, is_infill)
            for building, first in zip(self.buildings, self.offsets, strict=False)
            for storey in np.flatnonzero(building.yields).tolist()
            for law, parameters, is_infill in building.springs_of(storey)
        )

    @cached_property
    def linked_floors(self) -> tuple[LinkedFloors, ...]:
        """All links, each between two floors."""
        links = []
        for link in self.links:
            pair, place = self.pair_names.index(link.pair), self.pair_labels.index(link.pair)
            for s, t in link.floors:
                ends = self._starts[pair] + s - 1, self._starts[pair + 1] + t - 1
                links.append(LinkedFloors(pair, s, *ends, link.stiffness, link.damping, place))
        return tuple(links)

    def of_contacts(self, values: Any) -> np.ndarray:
        """Return values of shape (n,), or of pairs, (n, pairs), for each contact, (n, contacts)."""
        values, pairs = np.asarray(values, float), [contact.pair for contact in self.contacts]
        return values[:, pairs] if values.ndim > 1 else np.repeat(values[:, None], len(pairs), axis=1)

    def clearances(self, gaps: np.ndarray, others: Any) -> np.ndarray:
        """Return how far floors move until each contact acts (m), by gaps of pairs and the thickness of `others`."""
        slack = np.array([contact.slack for contact in self.contacts])
        return np.where(np.isnan(slack), self.of_contacts(gaps) - self.thicknesses(others), slack)

    @property
    def fittings(self) -> tuple[Bumper, ...]:
        """Bumpers and restrainers: what has a law of its own."""
        return *self.bumpers, *self.restrainers

    def thicknesses(self, others: Any = 0.0) -> np.ndarray:
        """Return the thickness (m) at each contact, of its bumper or what all `others` have, shape (..., contacts)."""
        thickness = [math.nan if bumper is None else bumper.thickness for bumper in self.bumper_of]
        return np.where(np.isnan(thickness), np.asarray(others, float)[..., None], thickness)

    @cached_property
    def linked_buildings(self) -> tuple[tuple[int, ...], ...]:
        """Buildings that move as one, by their numbers: those that links join, and each other one alone."""
        first, count = int(isinstance(self.row[0], Wall)), len(self.buildings)
        joined = {self.pair_names.index(link.pair) - first for link in self.links}  # those with a link to the right
        groups = np.split(np.arange(count), [b for b in range(1, count) if b - 1 not in joined])
        return tuple(tuple(map(int, group)) for group in groups)

    def dofs_of(self, group: Sequence[int]) -> np.ndarray:
        """Numbers of what moves in some buildings: their floors, then the displacement and rotation of each base."""
        floors = [i for b in group for i in range(*self.offsets[b : b + 2])]
        bases = [self.n_dof + 2 * self.foundations.index(b) for b in group if b in self.foundations]
        return np.array([*floors, *(i for sway in bases for i in (sway, sway + 1))])

    def of_buildings(self, name: str) -> np.ndarray:
        """Return a property of all buildings, such as "drifts", by what moves in the row, shape (n_dof, n_moving)."""
        result = np.zeros((self.n_dof, self.n_moving))
        for b, building in enumerate(self.buildings):
            dofs = self.dofs_of([b])
            result[np.ix_(dofs[: building.n_storeys], dofs)] = getattr(building, name)
        return result

    def faced(self, pair: int) -> list[list[Facing]]:
        """Floors of the left and of the right neighbour of a pair that stand before columns of the other."""
        left, right = self.row[pair : pair + 2]
        return [] if isinstance(left, Wall) or isinstance(right, Wall) else meetings(left, right, self.tolerance)[1]

    def _repr_html_(self) -> str:
        rows, gaps = [], [f"{1e3 * gap:.4g}" for gap in self.gaps] + [""]
        for item, gap in zip(self.row, gaps, strict=True):
            about = ("wall", "", "")
            if isinstance(item, Building):
                about = str(item.n_storeys), f"{sum(item.masses):.4g}", f"{item.periods[0]:.4g}"
            rows.append((item.name, *about, gap))
        return html_table(rows, ("", "storeys", "mass (t)", "first period (s)", "gap to the right (mm)"))

    def with_gaps(self, gaps: Sequence[float]) -> Scene:
        """Return the same row with other gaps (m)."""
        return replace(self, gaps=gaps)
