"""The one place that decides in which unit the accelerations of a file are, and whether they are accelerations."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from pounding_sweep.base import STANDARD_GRAVITY
from pounding_sweep.base.errors import RecordError, unknown
from pounding_sweep.records.reader import Stated, not_acceleration

UNITS = {"g": STANDARD_GRAVITY, "m/s2": 1.0, "cm/s2": 0.01, "mm/s2": 1e-3}
UNITS |= {"mg": 1e-3 * STANDARD_GRAVITY, "%g": 0.01 * STANDARD_GRAVITY}
"""Acceleration units of files, each with its size in m/s2."""

_QUANTITIES = {
    **dict.fromkeys(UNITS, "acceleration"),
    **dict.fromkeys(("m/s", "cm/s", "mm/s", "in/s", "ft/s", "ms-1", "cms-1", "mms-1", "mps"), "velocity"),
    **dict.fromkeys(("m", "cm", "mm", "in", "inch", "ft"), "displacement"),
}
_ALIASES = {
    **{"gal": "cm/s2", "gals": "cm/s2", "g's": "g", "ms-2": "m/s2", "cms-2": "cm/s2", "mms-2": "mm/s2"},
    **{"ms2": "m/s2", "cms2": "cm/s2", "mms2": "mm/s2", "mps2": "m/s2", "milli-g": "mg", "percentg": "%g"},
}
_SPELLING = (
    *(("²", "2"), ("⁻", "-"), ("−", "-"), ("**", ""), ("^", ""), ("·", ""), ("*", "")),
    *(("second", "s"), ("sec", "s"), ("/s/s", "/s2")),
)
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
_NAMED = re.compile(
    r"(?<![^\W_])(?:(v_?g(?![^\W_])|vel(?![^\W_])|veloc|geschw|vitesse|velocidad)"
    r"|[ud]_?g(?![^\W_])|displ?(?![^\W_])|displac|verschieb|d[ée]plac|desplaz)",
    re.IGNORECASE,
)
_SERIES = re.compile(
    r"(?:^\W*(?:(?:ground|base|input|corrected|filtered|relative|absolute|horizontal|vertical)\s+)*"
    r"(veloc|displac)\w*\s*(?:$|[,;([]|at\b|of\b|record))|(veloc|displac)\w*\s+(?:time|data|histor|in\b)",
    re.IGNORECASE,
)


def _plain(text: str) -> str:
    plain = "".join(text.lower().split()).strip(".,;:")
    for spelled, meant in _SPELLING:
        plain = plain.replace(spelled, meant)
    return _ALIASES.get(plain, plain)


def _quantity(text: str) -> str | None:
    """Return the quantity, acceleration, velocity or displacement, that has the unit which `text` spells."""
    return _QUANTITIES.get(_plain(text))


def match_unit(text: str) -> str | None:
    """Find the unit of `UNITS` that `text` spells, or None."""
    return plain if (plain := _plain(text)) in UNITS else None


def require_unit(text: object) -> str:
    """Find the unit of `UNITS` that `text` spells, or raise `RecordError`."""
    unit = match_unit(text) if isinstance(text, str) else None
    if unit is None:
        raise RecordError(unknown("acceleration unit", text, [*UNITS, "gal", "m/s^2", "m/s**2", "cm/s^2", "cm/s/s"]))
    return unit


def _leading_unit(text: str) -> str:
    """Return the first words of a text that are a unit, with nothing but punctuation behind them; else the text."""
    words = text.split()
    for count in range(len(words), 0, -1):
        phrase = " ".join(words[:count])
        if _quantity(phrase) and (count == len(words) or phrase[-1] in ".,;:"):
            return phrase
    return text.strip()


def _of_heading(line: int, heading: str) -> list[Stated]:
    """Return the unit at a column's heading: in brackets at its end, else behind "in" or the word acceleration."""
    where = f"{heading!r}, line {line}"
    if _ASIDE.search(heading):
        return []
    bracket = re.search(_BRACKET + r"\W*$", heading)
    if bracket and (_quantity(bracket[1]) or "/" in bracket[1]):
        return [Stated(bracket[1], where)]
    plain = heading[: bracket.start()] if bracket else heading
    tail = _TAIL.search(plain.strip())
    text = tail[1] if tail else plain
    for spelled in (text, text.replace("_", "/"), text.replace("_", "")):
        if match_unit(spelled) and (tail or _plain(spelled) != "g"):
            return [Stated(spelled, where)]
    return []


def _of_remark(line: int, text: str) -> list[Stated]:
    """Return the units that a line of a header states: after "units", after "in", in brackets behind "acceleration"."""
    if _ASIDE.search(text):
        return []
    found: list[tuple[str, str]] = []
    for match in _UNITS.finditer(text):
        pieces = [_leading_unit(piece) for piece in re.split(r"[,;]", match[2])]
        units = [piece for piece in pieces if _quantity(piece)]
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
    return [Stated(unit, f"{' '.join(phrase.split())!r}, line {line}") for unit, phrase in found]


def stated_units(lines: Iterable[tuple[int, str]], heading: tuple[int, str] | None = None) -> list[Stated]:
    """Collect the units that the lines of a header state for the column with a heading."""
    found = _of_heading(*heading) if heading else []
    return list(dict.fromkeys(found + [unit for line, text in lines for unit in _of_remark(line, text)]))


def other_quantity(lines: Iterable[tuple[int, str]], heading: tuple[int, str] | None = None) -> tuple[str, str] | None:
    """Tell velocity or displacement by the column's heading, or else by a title, with the text that says so."""
    if heading and not re.search(_ACC, heading[1], re.IGNORECASE) and (match := _NAMED.search(heading[1])):
        return "velocity" if match[1] else "displacement", f"{heading[1]!r}, line {heading[0]}"
    for line, text in lines:
        match = _SERIES.search(text)
        if match and not re.search(r"acc", text, re.IGNORECASE):
            kind = "velocity" if (match[1] or match[2]).lower() == "veloc" else "displacement"
            return kind, f"{text.strip(' #%!/')[:60]!r}, line {line}"
    return None


def choose_unit(
    stated: Sequence[Stated], default: tuple[str, str] | None, wanted: str | None, shown: str
) -> tuple[str, str]:
    """Choose the unit of a file, and say where it is from.

    `default` is the unit of a format that states none, and why; `wanted` what the caller gave, which always wins;
    `shown` what the header has in place of a unit. Raises `RecordError` without the name of the file.
    """
    units: dict[str, Stated] = {}
    unreadable: dict[str, Stated] = {}
    for item in stated:
        if unit := match_unit(item.text):
            units.setdefault(unit, item)
        elif not _quantity(item.text):
            unreadable.setdefault(item.text, item)
    for item in stated:
        if not units and (quantity := _quantity(item.text)):
            raise RecordError(not_acceleration(quantity, item.where))
    if wanted:
        over = [item.where for unit, item in (units | unreadable).items() if unit != wanted]
        return wanted, f"given{', in place of ' + ' and '.join(over) if over else ''}"
    remedy = f"give units= one of {', '.join(map(repr, UNITS))}"
    if len(units) > 1 or (units and unreadable):
        both = " and ".join(f"{item.text!r} ({item.where})" for item in (*units.values(), *unreadable.values()))
        raise RecordError(f"states several units: {both}; {remedy}")
    if units:
        ((unit, item),) = units.items()
        return unit, item.where
    if default and not unreadable:
        return default
    header = ", ".join(f"{item.text!r} ({item.where})" for item in unreadable.values()) or shown
    raise RecordError(f"its units are not known{f'; its header says {header}' if header else ''}; {remedy}")
