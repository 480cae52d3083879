"""Write the pages that list what the package's registries hold."""

from __future__ import annotations

from pathlib import Path

from pounding_sweep.contact.laws import LAWS, RESTING_SPEED
from pounding_sweep.contact.restitution import RELATIONS
from pounding_sweep.cube.variables import DEFAULT_OUTPUTS, STATUS, VARIABLES
from pounding_sweep.records import KNOWN_RECORDS


def _laws() -> str:
    lines = [
        "# Contact laws",
        "",
        "Force of one pair of floors while their penetration $d$ is positive; $v$ is the rate of $d$, $v_0$ the",
        "approach velocity at the touch, $m = m_1 m_2 / (m_1 + m_2)$. Units kN, t, m, s.",
        f"A touch slower than {RESTING_SPEED:g} m/s is damped as if it came at that speed.",
        "",
    ]
    for law in LAWS.values():
        lines += [f"## `{law.key}`", "", f"{law.title} (model {law.model} of Mate, Bakre & Jaiswal 2015).", ""]
        lines += [f"- force: `{law.formula}`"]
        if law.number_text:
            lines.append(f"- damping number: `{law.number_text}`")
        if law.relation:
            factor = (
                f", with z = {law.relation_factor:.6g} times the damping number" if law.relation_factor != 1 else ""
            )
            lines.append(f"- [restitution it really gives](../restitution): `{RELATIONS[law.relation].text}`{factor}")
        if law.exponent is not None:
            lines.append(f"- contact stiffness in kN/m{'' if law.exponent == 1 else f'^{law.exponent:g}'}")
        lines += [f"- restitution: {law.validity}", f"- source: {law.reference}", ""]
    return "\n".join(lines)


def _variables() -> str:
    lines = [
        "# Variables of a cube",
        "",
        "Dimensions are those inside a scenario; in front of them stand the axes of the sweep.",
        "",
        "| name | dimensions | unit | meaning |",
        "|---|---|---|---|",
    ]
    for variable in VARIABLES.values():
        default = " (default)" if variable.name in DEFAULT_OUTPUTS or variable.always else ""
        dims = ", ".join(variable.dims) or "-"
        lines.append(f"| `{variable.name}`{default} | {dims} | {variable.units} | {variable.definition} |")
    lines += ["", "## Status of a scenario", "", "| value | name | meaning | remedy |", "|---|---|---|---|"]
    lines += [f"| {int(s)} | `{s.label}` | {s.meaning} | {s.remedy or '-'} |" for s in STATUS]
    return "\n".join([*lines, ""])


def _records() -> str:
    lines = ["# Records by name", "", "| name | event | file |", "|---|---|---|"]
    for known in KNOWN_RECORDS.values():
        lines.append(f"| `{known.key}` | {known.event}, {known.component} | {', '.join(known.files)} |")
    return "\n".join([*lines, ""])


def write_pages(folder: Path) -> None:
    """Write all generated pages below `folder`."""
    folder.mkdir(exist_ok=True)
    for name, text in (("laws", _laws()), ("variables", _variables()), ("records", _records())):
        (folder / f"{name}.md").write_text(text, encoding="utf-8")
