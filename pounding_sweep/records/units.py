"""The one place that decides in which unit the accelerations of a file are, and whether they are accelerations."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pounding_sweep.base.errors import RecordError, unknown
from pounding_sweep.base.gravity import STANDARD_GRAVITY

_G = STANDARD_GRAVITY
UNITS: dict[str, float] = {
    **{"g": _G, "m/s2": 1.0, "cm/s2": 0.01},
    **{"mm/s2": 1e-3, "mg": 1e-3 * _G, "%g": 0.01 * _G},
}
"""Acceleration units of files, each with its size in m/s2."""

_ALIASES = {
    **{"gal": "cm/s2", "gals": "cm/s2", "g's": "g", "ms-2": "m/s2", "cms-2": "cm/s2", "mms-2": "mm/s2"},
    **{"ms2": "m/s2", "cms2": "cm/s2", "mms2": "mm/s2", "mps2": "m/s2", "milli-g": "mg", "percentg": "%g"},
}
_SPELLING = {
    "²": "2",
    "⁻": "-",
    "−": "-",
    "**": "",
    "^": "",
    "·": "",
    "*": "",
    "second": "s",
    "sec": "s",
    "/s/s": "/s2",
}
_OTHER_KINDS = {
    **dict.fromkeys(("m/s", "cm/s", "mm/s", "in/s", "ft/s", "ms-1", "cms-1", "mms-1", "mps"), "velocity"),
    **dict.fromkeys(("m", "cm", "mm", "in", "inch", "ft"), "displacement"),
}
_TIMES = ("s", "ms", "min", "h", "hz")

_ACC = r"(?<![^\W_])(?:acc(?:n|l|[eé]l(?:[eé]ration)?s?)?|acel(?:eraci[oó]n)?|accelerazione|beschl(?:eunigung)?|ivme)"
_BRACKET = r"[(\[]\s*([^()\[\]\n]{1,24}?)\s*[)\]]"
#: What stands behind the name of an acceleration: perhaps its component, then the unit and nothing else.
_TAIL = re.compile(
    rf"{_ACC}(?![^\W_])[\s_.,:;/=-]*(?:(?:[xyzhvneu123]|ns|ew|ud|n-s|e-w|u-d|h[12])[\s_.,:;/-]+)?(?:in\s+)?([^\s:=].{{0,15}})$",
    re.IGNORECASE,
)
_BEHIND_ACC = re.compile(rf"{_ACC}\.?(?:[ \t]+[^\W\d_]+){{0,3}}?[ \t]*{_BRACKET}", re.IGNORECASE)
_UNITS = re.compile(
    r"(?:\bin\s+)?\b(?:units?|unidad(?:es)?|einheit(?:en)?|unit[ée]s?)\b\s*"
    r"((?:[:=]|(?:of|in|is|are|en)\b\s*[:=]?)?\s*[(\[]?)([^()\[\]\n]{1,40})",
    re.IGNORECASE,
)
_IN = re.compile(r"\b(?:in|en)\s+([^\s,;()\[\]][^,;()\[\]\n]{0,23})", re.IGNORECASE)
_VALUES = re.compile(rf"{_ACC}|(?:values?|data|amplitudes?|motions?|samples|ordinates|series)\s*$", re.IGNORECASE)
#: Lines that speak of other numbers than the values as they are: peaks, and units that were or will be.
_ASIDE = re.compile(
    r"convert|conversion|umgerechnet|multipl|divide|\bfrom\b.*\bto\b|\bwas\b|original|->|=>|→"
    r"|(?:[x×*/]|\btimes|\bby)\s*(?:9[.,]8|98[01]|386|32[.,][12])|\b(?:peak|max|min|pga|pgv|amax|rms|range|sensitiv|full.?scale|sensor|gain|resol|trigger)",
    re.IGNORECASE,
)
_NAMES = {
    "velocity": re.compile(
        r"(?<![^\W_])(?:v_?g(?![^\W_])|vel(?![^\W_])|veloc|geschw|vitesse|velocidad)", re.IGNORECASE
    ),
    "displacement": re.compile(
        r"(?<![^\W_])(?:[ud]_?g(?![^\W_])|displ?(?![^\W_])|displac|verschieb|d[ée]plac|desplaz)", re.IGNORECASE
    ),
}
_SERIES = re.compile(
    r"(?:^\W*(?:(?:ground|base|input|corrected|filtered|relative|absolute|horizontal|vertical)\s+)*"
    r"(veloc|displac)\w*\s*(?:$|[,;([]|at\b|of\b|record))|(veloc|displac)\w*\s+(?:time|data|histor|in\b)",
    re.IGNORECASE,
)


def match_unit(text: str) -> str | None:
    """Find the unit of `UNITS` that `text` spells, or None."""
    plain = _plain(text)
    return plain if plain in UNITS else None


def _plain(text: str) -> str:
    plain = "".join(text.lower().split()).strip(".,;:")
    for spelled, meant in _SPELLING.items():
        plain = plain.replace(spelled, meant)
    return _ALIASES.get(plain, plain)


def require_unit(text: object) -> str:
    """Find the unit of `UNITS` that `text` spells, or raise `RecordError`."""
    unit = match_unit(text) if isinstance(text, str) else None
    if unit is None:
        msg = unknown("acceleration unit", text, [*UNITS, "gal", "m/s^2", "m/s**2", "cm/s^2", "cm/s/s"])
        raise RecordError(msg)
    return unit


@dataclass(frozen=True)
class StatedUnit:
    """A unit that a file states, as it is written, and where."""

    text: str
    where: str

    @property
    def unit(self) -> str | None:
        """Key of `UNITS`, or None."""
        return match_unit(self.text)

    @property
    def kind(self) -> str | None:
        """The quantity that has this unit, if it is velocity or displacement."""
        return _OTHER_KINDS.get(_plain(self.text))


def _leading_unit(text: str) -> str:
    """Return the first words of a text that are a unit, with nothing but punctuation behind them; else the text."""
    words = text.split()
    for count in range(len(words), 0, -1):
        phrase = " ".join(words[:count])
        if (match_unit(phrase) or _plain(phrase) in _OTHER_KINDS) and (count == len(words) or phrase[-1] in ".,;:"):
            return phrase
    return text.strip()


def _of_heading(line: int, heading: str) -> list[StatedUnit]:
    """Return the unit at a column's heading: in brackets at its end, else behind "in" or the word acceleration."""
    where = f"{heading!r}, line {line}"
    if _ASIDE.search(heading):
        return []
    bracket = re.search(_BRACKET + r"\W*$", heading)
    if bracket and (match_unit(bracket[1]) or _plain(bracket[1]) in _OTHER_KINDS or "/" in bracket[1]):
        return [StatedUnit(bracket[1], where)]
    plain = heading[: bracket.start()] if bracket else heading
    tail = _TAIL.search(plain.strip())
    text = tail[1] if tail else plain
    for spelled in (text, text.replace("_", "/"), text.replace("_", "")):
        if match_unit(spelled) and (tail or _plain(spelled) != "g"):
            return [StatedUnit(spelled, where)]
    return []


def _of_remark(line: int, text: str) -> list[StatedUnit]:
    """Return the units that a line of a header states: after "units", after "in", in brackets behind "acceleration"."""
    if _ASIDE.search(text):
        return []
    found: list[tuple[str, str]] = []
    for match in _UNITS.finditer(text):
        pieces = [_leading_unit(piece) for piece in re.split(r"[,;]", match[2])]
        units = [piece for piece in pieces if match_unit(piece) or _plain(piece) in _OTHER_KINDS]
        units = units or [piece for piece in pieces[:1] if match[1] and piece and _plain(piece) not in _TIMES]
        found += [(unit, match[0][: match[0].index(unit) + len(unit)]) for unit in units]
    if not found:
        found += [(match[1], match[0]) for match in _BEHIND_ACC.finditer(text)]
        for match in _IN.finditer(text):
            unit = _leading_unit(match[1])
            if match_unit(unit) and (_plain(unit) not in ("g", "mg") or _VALUES.search(text[: match.start()])):
                found.append((unit, match[0][: match[0].index(unit) + len(unit)]))
        for piece in re.split(r"[,;|\t]", text):
            found += [(unit.text, piece) for unit in _of_heading(line, piece.strip()) if _TAIL.search(piece.strip())]
    return [StatedUnit(unit, f"{' '.join(phrase.split())!r}, line {line}") for unit, phrase in found]


def stated_units(lines: Iterable[tuple[int, str]], heading: tuple[int, str] | None = None) -> list[StatedUnit]:
    """Collect the units that the lines of a header state for the column with a heading."""
    found = _of_heading(*heading) if heading else []
    return list(dict.fromkeys(found + [unit for line, text in lines for unit in _of_remark(line, text)]))


def other_quantity(lines: Iterable[tuple[int, str]], heading: tuple[int, str] | None = None) -> tuple[str, str] | None:
    """Tell velocity or displacement by the column's heading, or else by a title, with the text that says so."""
    if heading and not re.search(_ACC, heading[1], re.IGNORECASE):
        for kind, name in _NAMES.items():
            if name.search(heading[1]):
                return kind, f"{heading[1]!r}, line {heading[0]}"
    for line, text in lines:
        match = _SERIES.search(text)
        if match and not re.search(r"acc", text, re.IGNORECASE):
            kind = "velocity" if (match[1] or match[2]).lower() == "veloc" else "displacement"
            return kind, f"{text.strip(' #%!/')[:60]!r}, line {line}"
    return None


def choose_unit(
    stated: Sequence[StatedUnit], default: tuple[str, str] | None, wanted: str | None, shown: str
) -> tuple[str, str]:
    """Choose the unit of a file, and say where it is from.

    `default` is the unit of a format that states none, and why; `wanted` what the caller gave, which always wins;
    `shown` what the header has in place of a unit. Raises `RecordError` without the name of the file.
    """
    units: dict[str, StatedUnit] = {}
    for item in stated:
        if item.unit:
            units.setdefault(item.unit, item)
    other = next((item for item in stated if item.kind), None)
    if other and not units:
        msg = f"holds {other.kind}, not acceleration ({other.where}); take the file of the acceleration"
        raise RecordError(msg)
    unreadable = list({item.text: item for item in stated if not item.unit and not item.kind}.values())
    if wanted:
        over = [item.where for unit, item in units.items() if unit != wanted] + [item.where for item in unreadable]
        return wanted, f"given{', in place of ' + ' and '.join(over) if over else ''}"
    remedy = f"give units= one of {', '.join(map(repr, UNITS))}"
    if len(units) > 1 or (units and unreadable):
        both = " and ".join(f"{item.text!r} ({item.where})" for item in (*units.values(), *unreadable))
        msg = f"states several units: {both}; {remedy}"
        raise RecordError(msg)
    if units:
        ((unit, item),) = units.items()
        return unit, item.where
    if default and not unreadable:
        return default
    header = ", ".join(f"{item.text!r} ({item.where})" for item in unreadable) or shown
    msg = f"its units are not known{f'; its header says {header}' if header else ''}; {remedy}"
    raise RecordError(msg)
