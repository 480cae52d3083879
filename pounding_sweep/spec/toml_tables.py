"""Tables of a sweep file: their keys, types, defaults and what is said of each."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from pounding_sweep.spec.spec import AUDIT_SHARE


class Table(BaseModel):
    """A table of the file: its keys and their types. Other keys are faults."""

    model_config = ConfigDict(extra="forbid", strict=True, title="table")


class FileTable(Table):
    """The whole file."""

    title: str = ""
    scene: dict[str, Any] = Field(description="a table [scene]")
    sweep: dict[str, Any] = Field(description="a table [sweep]")
    solver: dict[str, Any] = Field(default_factory=dict, description="a table [solver]")
    output: dict[str, Any] = Field(default_factory=dict, description="a table [output]")


class SceneTable(Table):
    """[scene]: a preset, or a row of its own."""

    preset: str | None = Field(None, description="name of a preset")
    row: list[dict[str, Any]] | None = Field(None, description="tables [[scene.row]], left to right")
    gaps: list[Any] | None = Field(None, description="a list of numbers, the gap of each pair in m")
    contact: dict[str, Any] | None = Field(None, description="a table [scene.contact]")


class BuildingTable(Table):
    """[[scene.row]]: a building."""

    name: str = Field(description="a text")
    masses: list[Any] = Field(description="a list of numbers, floor masses in t, bottom first")
    stiffnesses: list[Any] = Field(description="a list of numbers, storey stiffnesses in kN/m, bottom first")
    damping_ratio: Any = 0.05
    storey_heights: list[Any] | None = Field(None, description="a list of numbers, storey heights in m, bottom first")


class WallTable(Table):
    """[[scene.row]]: a rigid wall, with ``wall = true``."""

    wall: Literal[True] = Field(description="true")
    name: str = Field("wall", description="a text")


class ContactTable(Table):
    """[scene.contact]: reference contact properties."""

    linear_stiffness: float | None = Field(None, description="a number in kN/m")
    hertz_stiffness: float | None = Field(None, description="a number in kN/m^1.5")
    hertz: dict[str, Any] | None = Field(None, description="a table of material and masses or radii")
    restitution: float | None = Field(None, description="a number")


class HertzTable(Table):
    """scene.contact.hertz: what a Hertz stiffness follows from."""

    young_modulus: float = Field(25.0e6, description="a number in kN/m2")
    poisson_ratio: float = Field(0.2, description="a number")
    density: float = Field(2.5, description="a number in t/m3")
    mass_1: float | None = Field(None, description="a number in t")
    mass_2: float | None = Field(None, description="a number in t")
    radii: list[float] | None = Field(None, min_length=2, max_length=2, description="two numbers in m")


class SweepTable(Table):
    """[sweep]: records, laws and axes, or records and cases."""

    records: list[Any] | str = Field(description="a list of names, files and tables")
    laws: list[Any] | str | None = Field(None, description="a name or a list of names")
    gaps: Any = None
    stiffnesses: Any = None
    stiffness_factors: Any = None
    restitutions: Any = None
    restitution_basis: str = Field("published", description="a text")
    scales: Any = None
    building: dict[str, Any] | None = Field(None, description="tables building.NAME of factors")
    damping_ratios: Any = None
    cases: list[Any] | None = Field(None, description="tables [[sweep.cases]]")


class FactorTable(Table):
    """building.NAME in [sweep] or in a case: factors on its properties."""

    period_factor: Any = None
    mass_factor: Any = None


class RangeTable(Table):
    """An axis as evenly spaced values."""

    start: Any = Field(description="a number, the first value")
    stop: Any = Field(description="a number, the last value")
    count: Any = Field(description="a whole number, how many values")
    spacing: Any = "linear"


class SolverTable(Table):
    """[solver]: scheme and step."""

    method: str | None = Field(None, description="a text")
    dt: float | None = Field(None, description="a number in s")
    accuracy: float | None = Field(None, description="a number, the relative error asked for")
    precision: str | None = Field(None, description="a text")
    locate: bool = Field(True, description="true or false")
    beta: float | None = Field(None, description="a number")
    gamma: float | None = Field(None, description="a number")
    force_unstable: bool = Field(False, description="true or false")
    audit: float = Field(AUDIT_SHARE, description="a number, the share of the cost spent on the audit")


class OutputTable(Table):
    """[output]: variables of the cube."""

    variables: list[Any] | str = Field("default", description="a name or a list of names")


class PathRecord(Table):
    """A record from a file."""

    path: str = Field(description="a text")
    units: str | None = Field(None, description="a text")
    dt: float | None = Field(None, description="a number in s")
    name: str | None = Field(None, description="a text")
    scale: float = Field(1.0, description="a number")
    pga: float | None = Field(None, description="a number in m/s2")


class NamedRecord(Table):
    """A record found by name, scaled or renamed."""

    record: str = Field(description="a text")
    name: str | None = Field(None, description="a text")
    scale: float = Field(1.0, description="a number")
    pga: float | None = Field(None, description="a number in m/s2")


class SyntheticRecord(Table):
    """A synthetic earthquake; ``synthetic`` is the seed."""

    synthetic: int = Field(description="a whole number, the seed")
    duration: float = Field(20.0, description="a number in s")
    dt: float = Field(0.01, description="a number in s")
    pga: float = Field(3.0, description="a number in m/s2")
    ground_frequency: float = Field(15.6, description="a number in rad/s")
    ground_damping: float = Field(0.6, description="a number")
    filter_frequency: float = Field(1.5, description="a number in rad/s")
    filter_damping: float = Field(0.6, description="a number")
    rise: float = Field(0.1, description="a number")
    strong: float = Field(0.4, description="a number")
    end_level: float = Field(0.05, description="a number")
    name: str | None = Field(None, description="a text")


class PulseRecord(Table):
    """A simple pulse; ``pulse`` is its shape."""

    pulse: str = Field(description="a text")
    amplitude: float = Field(description="a number in m/s2")
    period: float = Field(description="a number in s")
    dt: float = Field(description="a number in s")
    duration: float | None = Field(None, description="a number in s")
    name: str | None = Field(None, description="a text")


#: Kinds of record tables, by the key that tells them.
RECORD_TABLES: dict[str, type[Table]] = {
    "path": PathRecord,
    "record": NamedRecord,
    "synthetic": SyntheticRecord,
    "pulse": PulseRecord,
}


#: Tables of settings: a key put into the wrong one is told where it belongs.
SECTIONS: dict[str, type[Table]] = {
    "[scene]": SceneTable,
    "[scene.contact]": ContactTable,
    "[sweep]": SweepTable,
    "[solver]": SolverTable,
    "[output]": OutputTable,
}
