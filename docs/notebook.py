"""Pages and notebooks that are run when the documentation is built, with what they print put under them.

- ``python`` blocks run in order, as one program;
- ``sh`` blocks run in bash, each by itself;
- ``toml`` and ``python`` blocks whose first line is ``# NAME.toml`` or ``# NAME.py`` are written to that file.

Everything happens in one folder, empty at first, which all pages share; pictures and HTML files made there are kept.
Blocks of other languages are only shown. A notebook runs in Jupyter, and becomes a page with what its cells show.
"""

from __future__ import annotations

import base64
import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import chdir, redirect_stdout
from pathlib import Path

_BLOCK = re.compile(r"^```(python|sh|toml)\n(.*?)^```\n", re.DOTALL | re.MULTILINE)
_NAME = re.compile(r"# (\w+\.(?:toml|py))\n")
_PICTURES = (".png", ".svg", ".gif")
#: Where pages of cubes go that are made there, below the folder of the documentation's own pages.
_PAGES = "extra/pages"


def run_pages(sources: Sequence[Path], target: Path) -> None:
    """Run the blocks of pages in order, and write the pages, with what was printed, to the folder `target`."""
    # an error ends the build: a page never shows what its blocks do not do
    (target / _PAGES).mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for source in sources:
            with chdir(folder):
                text = _run_notebook(source) if source.suffix == ".ipynb" else _run(source)
            (target / source.with_suffix(".md").name).write_text(text, encoding="utf-8")
        for made in sorted(Path(folder).iterdir()):
            if made.suffix in (*_PICTURES, ".html"):
                shutil.copy(made, target / _PAGES if made.suffix == ".html" else target)


def _run(source: Path) -> str:
    """Run the blocks of one page in the current folder; return the page with what they printed."""
    text = source.read_text(encoding="utf-8")
    namespace: dict[str, object] = {"__name__": "__main__"}

    def run(block: re.Match[str]) -> str:
        language, code = block.groups()
        name = _NAME.match(code)
        if name:
            Path(name[1]).write_text(code, encoding="utf-8")
        if name or language == "toml":
            return block[0]
        line = text.count("\n", 0, block.start(2))
        said = _python(code, str(source), line, namespace) if language == "python" else _shell(code, str(source), line)
        return block[0] + (f"\n```text\n{said}\n```\n" if said else "")

    return _BLOCK.sub(run, text)


def _run_notebook(source: Path) -> str:
    """Run a notebook in the current folder, its pictures kept there; return it as a page, for download as it is."""
    import nbclient
    import nbformat

    book = nbformat.read(source, as_version=4)
    nbclient.NotebookClient(book, timeout=600).execute()
    parts = []
    for number, cell in enumerate(book.cells, 1):
        if cell.cell_type != "code":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for shown in cell.outputs:
            data = shown.get("data", {"text/plain": shown.get("text", "")})
            if "image/png" in data:
                picture = Path(f"{source.stem}_{number}.png")
                picture.write_bytes(base64.b64decode(data["image/png"]))
                parts.append(f"![What the cell above draws]({picture})")
            elif data.get("text/html") == "":  # the bar of a run that ended
                continue
            elif "text/html" in data:
                parts.append(f"```{{raw}} html\n{data['text/html']}\n```")
            else:
                parts.append(f"```text\n{data['text/plain'].rstrip()}\n```")
    parts.insert(1, f"As a notebook: {{download}}`{source.name} <../{source.name}>`.")
    return "\n\n".join(parts) + "\n"


def _python(code: str, name: str, line: int, namespace: dict[str, object]) -> str:
    """Run Python code that stands below line `line` of a page; return what it printed."""
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile("\n" * line + code, name, "exec"), namespace)
    return printed.getvalue().rstrip()


def _shell(code: str, name: str, line: int) -> str:
    """Run commands with this environment's programs first; return what they printed."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, "PATH": path},
        check=False,
    )
    if done.returncode:
        msg = f"{name}, line {line + 1}: a command failed:\n{code}{done.stderr}"
        raise RuntimeError(msg)
    return done.stdout.rstrip()
