"""``doctor``: the state of this installation."""

from __future__ import annotations

from pounding_sweep.cli.app import AsJson, app
from pounding_sweep.cli.reporting import reporting
from pounding_sweep.tables import bytes_text, print_json, print_pairs


@app.command("doctor")
def doctor_command(as_json: AsJson = False) -> None:
    """Show versions, processor, kernel cache, problems."""
    with reporting():
        from pounding_sweep.doctor import diagnose

        found = diagnose()
        if as_json:
            print_json(found)
            return
        cpu, cache = found["processor"], found["kernel_cache"]
        bits = cpu["vector_bits"]
        width = f"{bits} bit, {bits // 64} numbers at a time (guessed from the features)" if bits else "unknown"
        folders = found["record_folders"]
        print("Versions")
        print_pairs([(name, text or "not installed") for name, text in found["versions"].items()], indent=2)
        print("Processor")
        print_pairs(
            [
                ("system", found["system"]),
                ("name", cpu["name"]),
                ("vectors", width),
                ("scenarios", f"{cpu['lanes_per_kernel']} side by side in a kernel"),
                ("cores", f"{cpu['cores_usable']} usable of {cpu['cores']}"),
                ("features", " ".join(cpu["features"])),
            ],
            indent=2,
        )
        print("Kernel cache")
        kernels = f"{cache['kernels']}, {bytes_text(cache['bytes'])}"
        print_pairs([("folder", cache["folder"]), ("kernels", kernels)], indent=2)
        print("Record folders")
        print_pairs([(item["folder"], f"{item['files']} record files") for item in folders], indent=2)
        if not folders:
            print("  none (POUNDING_SWEEP_RECORDS is not set); el_centro is always there")
        print("Problems" if found["problems"] else "No problems found")
        for problem in found["problems"]:
            print(f"  {problem}")
