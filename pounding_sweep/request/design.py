"""Designs: inputs of a sweep drawn from distributions.

A design becomes listed cases: each of its points with each law, each record and each value of other axes.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import (
    AfterValidator,
    Field,
    PlainValidator,
    ValidationInfo,
    create_model,
    model_validator,
)

from pounding_sweep.base.errors import InputError, SceneError, repr_short, unknown
from pounding_sweep.model.faults import Number, Table, key, number, one_of, schema
from pounding_sweep.model.laws import Law
from pounding_sweep.request.axes import AXES, NAMED_KINDS, AxisValues, Case, plain_name

#: What has values: an argument of `build_spec`, and the building or pair if it is one by name.
Target = tuple[str, str | None]
#: Share of a distribution that must lie between its ends.
_LEAST_WITHIN = 1e-6


class Distribution(Table):
    """What an input is drawn from: a distribution of scipy, cut off at `low` and `high` if they are given."""

    distribution: str = key("a name")
    low: Number | None = number("the lower end", None)
    high: Number | None = number("the upper end", None)

    @property
    def _frozen(self) -> Any:
        from scipy import stats

        return _MADE[self.distribution][0](stats, self)

    @property
    def within(self) -> tuple[float, float]:
        """Shares of the distribution below `low` and below `high`."""
        ends = (-np.inf if self.low is None else self.low, np.inf if self.high is None else self.high)
        return tuple(self._frozen.cdf(ends).tolist())

    def values(self, shares: np.ndarray) -> np.ndarray:
        """Return the values below which the distribution has those shares."""
        first, last = self.within
        return np.clip(self._frozen.ppf(first + shares * (last - first)), self.low, self.high)  # within rounding

    @model_validator(mode="after")
    def _has_width(self) -> Distribution:
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise SceneError(f"is {self.high!r}; it must be above low = {self.low!r}", ("high",))
        first, last = self.within
        if last - first < _LEAST_WITHIN:
            raise InputError(f"has less than {_LEAST_WITHIN:g} of itself between low and high; give wider ends")
        return self


#: Distribution -> what makes it of `scipy.stats`, and its numbers.
_MADE: dict[str, tuple[Callable[[Any, Any], Any], dict[str, Any]]] = {
    "uniform": (
        lambda stats, it: stats.uniform(it.low, it.high - it.low),
        {"low": number("the lower end"), "high": number("the upper end")},
    ),
    "log_uniform": (
        lambda stats, it: stats.loguniform(it.low, it.high),
        {"low": number("the lower end", gt=0.0), "high": number("the upper end", gt=0.0)},
    ),
    "normal": (
        lambda stats, it: stats.norm(it.mean, it.std),
        {"mean": number("the mean"), "std": number("the standard deviation", gt=0.0)},
    ),
    "lognormal": (
        lambda stats, it: stats.lognorm(it.dispersion, scale=it.median),
        {
            "median": number("the median", gt=0.0),
            "dispersion": number("the standard deviation of the logarithm", gt=0.0),
            "low": number("the lower end", None, ge=0.0),
        },
    ),
}
_TYPES: dict[str, dict[str, Any]] = {
    name: {key: (Number | None, field) for key, field in numbers.items()} for name, (_, numbers) in _MADE.items()
}
DISTRIBUTIONS = {name: create_model(name, __base__=Distribution, **fields) for name, fields in _TYPES.items()}


def read_distribution(value: Any) -> Distribution:
    """Check a distribution given as a table."""
    if not isinstance(value, dict):
        raise InputError(f"must be a table of a distribution, not {repr_short(value)}")
    kind, valid = value.get("distribution"), ", ".join(DISTRIBUTIONS)
    if not isinstance(kind, str) or kind not in DISTRIBUTIONS:
        text = unknown("distribution", kind, DISTRIBUTIONS) if kind is not None else f"is missing; give one of {valid}"
        raise SceneError(text, ("distribution",))
    return DISTRIBUTIONS[kind].model_validate(value)


#: Kind of design -> what it is.
KINDS = {
    "latin_hypercube": "one point in each of as many equal shares of every input (McKay, Beckman & Conover 1979)",
    "sobol": "Sobol' sequence, scrambled; as many points as a power of 2",
    "halton": "Halton sequence, scrambled",
    "saltelli": "for Sobol indices: blocks A and B of a Sobol' sequence, and A with each input of B (Saltelli 2010)",
}
#: Kinds whose numbers of points are balanced at powers of 2 only.
POWERS = ("sobol", "saltelli")
#: Shares are kept so far from 0 and 1, where a normal distribution is infinite.
_EDGE = 2.0**-53
#: What of a design stands beside its inputs along the cases of a cube.
SAMPLE, BLOCK = "design_sample", "design_block"
#: The input that no distribution is given for: each record is as likely.
RECORD = "record"


def _read_any_record(value: Any) -> str:
    if value != {"distribution": "any"}:
        raise InputError(f'records have no distribution but {{ distribution = "any" }}, not {repr_short(value)}')
    return RECORD


_DRAWN: Any = Annotated[Any, PlainValidator(read_distribution)]
#: [design.inputs]: distributions by the dimension of an axis, or of axes by name by its argument and the name.
Inputs = create_model(
    "Inputs",
    __base__=Table,
    **{RECORD: (Annotated[Any, PlainValidator(_read_any_record)], None)},
    **{axis.dimension: (_DRAWN, None) for axis in AXES.values() if not axis.by},
    **{
        argument: (dict[str, _DRAWN], key(f"a table by name of the {axis.by}", None))
        for argument, axis in AXES.items()
        if axis.by
    },
    **{by: (dict[str, dict[str, _DRAWN]], key(f"tables {by}.NAME of distributions", None)) for by in NAMED_KINDS},
)  # type: ignore[call-overload]


def _balanced(samples: int, info: ValidationInfo) -> int:
    kind, below = info.data.get("kind"), 1 << (samples.bit_length() - 1)
    if samples != below and kind in POWERS:
        raise InputError(
            f"{kind} points are balanced at powers of 2 only, and {samples} is none; give {below} or {2 * below}"
        )
    return samples


class DesignTable(Table):
    """[design]: inputs that are drawn."""

    kind: Annotated[Any, one_of("kind of design", KINDS)] = key(f"one of {', '.join(KINDS)}")
    samples: Annotated[int, AfterValidator(_balanced)] = Field(ge=1, description="a whole number of points, at least 1")
    seed: int = Field(0, ge=0, description="a whole number, at least 0")
    inputs: Annotated[Table, schema(Inputs)] = key("tables [design.inputs] of distributions by the name of an axis")


@dataclass(frozen=True)
class Input:
    """What a design draws."""

    name: str  # its coordinate in the cube
    argument: str  # the axis, by its argument of `build_spec`; "records" for the record
    building: str | None  # name of the building or pair that it belongs to
    distribution: Distribution | None  # None for the record: each is as likely

    @property
    def target(self) -> Target:
        """What it gives values to."""
        return self.argument, self.building


def named_inputs(drawn: Mapping[Target, Distribution | None]) -> tuple[Input, ...]:
    """Return inputs by what they give values to, in the order of the axes and the row, named as axes are."""
    inputs: dict[str, Input] = {}
    for argument in ("records", *AXES):
        for (name, building), distribution in drawn.items():
            if name == argument:
                stem = RECORD if name == "records" else AXES[name].dimension
                label = stem if building is None else plain_name(f"{stem}_{building}", inputs)
                inputs[label] = Input(label, name, building, distribution)
    return tuple(inputs.values())


@dataclass(frozen=True)
class Design:
    """Points of a sweep's inputs."""

    kind: str  # one of `KINDS`
    samples: int  # points; of "saltelli" those of one block
    seed: int  # of the random numbers: the same seed gives the same points
    inputs: tuple[Input, ...]  # what is drawn

    def __str__(self) -> str:
        inputs = ", ".join(entry.name for entry in self.inputs)
        return f"{self.kind} design, {len(self)} points (seed {self.seed}) of {inputs}"

    @property
    def blocks(self) -> tuple[str, ...]:
        """Blocks of points: "A", "B" and the input of B that A has in each further one; one without a name else."""
        return ("A", "B", *(entry.name for entry in self.inputs)) if self.kind == "saltelli" else ("",)

    def __len__(self) -> int:
        return self.samples * len(self.blocks)

    @cached_property
    def shares(self) -> np.ndarray:
        """Points in the unit cube, shape (points, inputs), block by block."""
        from scipy.stats import qmc

        d, engines = len(self.inputs), {"latin_hypercube": qmc.LatinHypercube, "halton": qmc.Halton}
        if self.kind == "saltelli":
            sobol = qmc.Sobol(2 * d, rng=self.seed).random(self.samples)
            a, b = sobol[:, :d], sobol[:, d:]
            points = np.concatenate([a, b, *(np.where(np.arange(d) == i, b, a) for i in range(d))])
        else:
            points = engines.get(self.kind, qmc.Sobol)(d, rng=self.seed).random(self.samples)
        return np.clip(points, _EDGE, 1.0 - _EDGE)

    def values(self, at: int, records: Sequence[str]) -> list[Any]:
        """Return the values of an input at all points: numbers, or names of records."""
        distribution, shares = self.inputs[at].distribution, self.shares[:, at]
        if distribution is None:
            return [records[int(share * len(records))] for share in shares]
        return distribution.values(shares).tolist()


def design_of(data: Mapping[str, Any]) -> Design:
    """Return a design that JSON describes."""
    inputs = []
    for item in data["inputs"]:
        drawn = item["distribution"]
        inputs.append(Input(**{**item, "distribution": None if drawn is None else read_distribution(drawn)}))
    return Design(**{**data, "inputs": tuple(inputs)})


def product_cases(
    laws: Mapping[str, Law],
    records: Sequence[Any],
    axes: AxisValues,
    names: Sequence[str],
    design: Design | None = None,
) -> tuple[Case, ...]:
    """Return each law, record and value of the axes as a listed case, with every point of a design innermost."""
    steps: list[list[list[tuple[Target, Any]]]] = []
    for name, axis in AXES.items():
        values = getattr(axes, name)
        for building, numbers in values if axis.by else [(None, values)] if values else []:
            steps.append([[((name, building), value)] for value in numbers])
    inputs = design.inputs if design else ()
    columns = [design.values(i, records) for i in range(len(inputs))] if design else []
    targets = [item.target for item in inputs]
    points = [list(zip(targets, row, strict=True)) for row in zip(*columns, strict=True)] or [[]]
    records = [None] if ("records", None) in targets else records
    order, cases = {name: i for i, name in enumerate(names)}, []
    for key_of_law, law in laws.items():
        matters = {"stiffness": law.has_contact, "restitution": law.takes_restitution}
        of_law = [step for step in steps if matters.get(AXES[step[0][0][0][0]].column, True)]
        for record in records:
            for settings in itertools.product(*of_law, points):
                case: dict[str, Any] = {RECORD: record}
                for (argument, building), value in itertools.chain(*settings):
                    if building is None:
                        case[RECORD if argument == "records" else AXES[argument].dimension] = value
                    elif value != AXES[argument].neutral:  # those are left out, as they are of other cases
                        factors = (*case.get(argument, ()), (building, value))
                        case[argument] = tuple(sorted(factors, key=lambda factor: order[factor[0]]))
                cases.append(Case(key_of_law, **case))
    return tuple(cases)
