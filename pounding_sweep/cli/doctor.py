"""``doctor``: the state of this installation, and whether it computes what it should."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Annotated, Any

import typer
from typer import Option

from pounding_sweep.base.text import bytes_text, print_json, print_pairs, printable, seconds_text
from pounding_sweep.cli.app import AsJson, command
from pounding_sweep.cli.reporting import FAILED, NAME, reporting, say


@command("doctor")
def doctor_command(
    no_check: Annotated[bool, Option("--no-check", help="Only look; run no scenarios.")] = False,
    as_json: AsJson = False,
) -> None:
    """Show versions, processor, kernel cache, problems, and run a few scenarios whose results are known."""
    with reporting():
        from pounding_sweep.run.diagnosis import diagnose

        state = diagnose()
        if not as_json:
            _print_state(state)
        if not no_check:
            from pounding_sweep.accuracy.self_check import TOLERANCE, self_check, to_compile

            if not as_json:
                missing, seconds = to_compile()
                first = f"; {missing} kernels are compiled first: about {seconds_text(seconds)} of CPU time"
                say(f"running the self-check{first if missing else ''}")
            check = self_check()
            error = check.error_max if math.isfinite(check.error_max) else None
            state["self_check"] = asdict(check) | {"error_max": error, "passed": check.passed, "tolerance": TOLERANCE}
            if not as_json:
                _print_check(state["self_check"])
        if as_json:
            print_json(state)
        if not no_check and not state["self_check"]["passed"]:
            say("failed: this installation does not compute the stored values; install it again, or report this")
            raise typer.Exit(FAILED)


def _print_state(state: dict[str, Any]) -> None:
    cpu, cache, memory, output = (state[name] for name in ("processor", "kernel_cache", "memory", "output"))
    bits, free = cpu["vector_bits"], output["free_bytes"]
    missing = {name: f"not installed; pip install '{NAME}[{extra}]'" for name, extra in state["optional"].items()}
    limits = " ".join(f"{name}={value}" for name, value in state["threads"]["environment"].items())
    default, every = (seconds_text(state["compile_seconds"][name]) for name in ("default", "all"))
    space = "free space unknown" if free is None else f"{bytes_text(free)} free"
    sections = {
        "Versions": [(name, text or missing.get(name, "not installed")) for name, text in state["versions"].items()],
        "Processor": [
            ("system", state["system"]),
            ("name", cpu["name"]),
            (
                "vectors",
                f"{bits} bit, {bits // 64} numbers at a time (guessed from the features)" if bits else "unknown",
            ),
            ("scenarios", f"{cpu['lanes_per_kernel']} side by side in a kernel"),
            ("cores", f"{cpu['cores_usable']} usable of {cpu['cores']}"),
            ("features", " ".join(cpu["features"])),
        ],
        "Threads": [("workers", str(state["threads"]["workers"])), ("limits", limits or "none set")],
        "Memory": [
            (
                "free",
                "unknown"
                if memory["free_bytes"] is None
                else f"{bytes_text(memory['free_bytes'])} ({memory['limit']})",
            )
        ],
        "Kernel cache": [
            ("folder", cache["folder"] or "none"),
            ("kernels", f"{cache['kernels']}, {bytes_text(cache['bytes'])}"),
            (
                "compiling",
                f"about {default} of CPU time each for three 3-storey buildings, {every} with all outputs (estimated)",
            ),
        ],
        "Record folders": [(item["folder"], f"{item['files']} record files") for item in state["record_folders"]]
        or [("none", "POUNDING_SWEEP_RECORDS is not set; el_centro is always there")],
        "Output": [(output["folder"] or "none", space if output["writable"] else "can't be written")],
    }
    for heading, rows in sections.items():
        print(heading)
        print_pairs(rows, indent=2)
    print("Problems" if state["problems"] else "No problems found")
    for problem in state["problems"]:
        print(f"  {printable(problem)}")


def _print_check(check: dict[str, Any]) -> None:
    print("Self-check")
    largest = "infinite" if check["error_max"] is None else f"{check['error_max']:.1e}"
    stored = f"converged values, themselves right to {check['error_stored']:.0e}"
    print_pairs(
        [
            ("compared", f"{check['values']} numbers of {check['scenarios']} scenarios with {stored}"),
            ("largest error", f"{largest} of the largest value; at most {check['tolerance']:g} is right"),
            ("kernels", f"ready after {seconds_text(check['compile_seconds'])}"),
            ("run", seconds_text(check["run_seconds"])),
            ("result", "passed" if check["passed"] else "failed"),
        ],
        indent=2,
    )
    for fault in check["faults"]:
        print(f"  {fault}")
