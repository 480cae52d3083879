"""The documentation: what it says of the package's names, keys, commands and figures, and that its blocks run."""

from __future__ import annotations

import ast
import json
import re
import sys
from pathlib import Path

import pytest
from PIL import Image

import pounding_sweep as ps
from pounding_sweep import analysis
from pounding_sweep.figures import FIGURES
from pounding_sweep.model.faults import Table
from pounding_sweep.model.laws import LAWS
from pounding_sweep.model.presets import PRESETS
from pounding_sweep.request import design as spec_tables
from pounding_sweep.request.design import Inputs
from pounding_sweep.request.toml import SECTIONS
from pounding_sweep.variables.registry import VARIABLES

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture(scope="module", autouse=True)
def docs_modules():
    """The scripts of the documentation can be imported while this module is tested."""
    pytest.importorskip("numpydoc", reason="the documentation's own requirements are not installed")
    sys.path.insert(0, str(DOCS))
    yield
    sys.path.remove(str(DOCS))


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Text of every generated page, by file name."""
    from generate import write_pages

    folder = tmp_path_factory.mktemp("docs") / "generated"
    write_pages(folder)
    return {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}


def test_every_name_is_documented(pages):
    text = (DOCS / "api.rst").read_text(encoding="utf-8") + pages["analysis_api.txt"] + pages["figures_api.txt"]
    for name in (*ps.__all__, *(n for n in dir(analysis) if not n.isupper())):
        if not name.startswith("__"):
            assert re.search(rf"[.:\s,]{name}\b", text), name
    listed, *_ = text.partition("Every other name")
    assert {*re.findall(r"``(\w+)``", listed), "__version__"} == {"pounding_sweep", *ps.__all__}
    for kind in FIGURES.values():
        assert f"{kind.draw.__module__}.{kind.draw.__name__}" in text
    assert all(f"## `{law}`" in pages["laws.md"] for law in LAWS)
    assert all(f"| `{variable}`" in pages["variables.md"] for variable in VARIABLES)
    for preset, content in PRESETS.items():
        assert f"**`{preset}`**" in pages["presets.txt"]
        for building in content.scene.buildings:
            assert f"{building.periods[0]:.4f}" in pages["presets.txt"]
    for name in ("run", "plot", "simulate", "animate", "laws", "records", "records plot"):
        assert f"## {name}\n" in pages["commands.md"]
        assert f"Usage: pounding-sweep {name} [OPTIONS]" in pages["commands.md"]


def test_every_key_of_a_sweep_file_is_explained(pages):
    """Each table has all keys of its model, with the default that the model gives."""
    text = pages["sweep_keys.txt"]
    models = [model for model in vars(spec_tables).values() if isinstance(model, type) and model is not Table]
    whole = [
        model for model in models if issubclass(model, Table) and not model.__subclasses__() and model is not Inputs
    ]
    wanted = [list(model.model_fields) for model in whole]
    explained = [sorted(re.findall(r"^\| `(\w+)` \|", part, re.MULTILINE)) for part in text.split("### ")]
    for keys in (*wanted, *map(list, SECTIONS.values())):
        assert sorted(keys) in explained
    assert re.search(r"^\| `audit` \|.*\| `0\.05` \| Share of the cost of a sweep at a fixed step", text, re.MULTILINE)
    assert re.search(r"^\| `locate` \| true or false \| `true` \| Split steps", text, re.MULTILINE)
    assert re.search(r"^\| `masses` \|.*\| needed \| Floor masses \(t\)", text, re.MULTILINE)


def test_a_key_that_nothing_explains_is_an_error(monkeypatch):
    import sweep_keys

    monkeypatch.setitem(sweep_keys._TABLES, "[solver]", (sweep_keys._arguments("solver"), None))
    with pytest.raises(KeyError, match="nothing explains 'method'"):
        sweep_keys.key_tables()


def test_the_gallery_has_every_figure(pages):
    from gallery import ENTRIES, SWEEPS

    assert {entry.key for entry in ENTRIES} == {*FIGURES, "animation"}
    for entry in ENTRIES:
        with Image.open(entry.place) as picture:
            assert min(picture.size) > 200
        assert entry.elsewhere or entry.place.stat().st_size < (400_000 if entry.picture.endswith(".gif") else 100_000)
        for command in entry.commands:
            assert f"pounding-sweep {command}\n" in pages["gallery.md"]
    for sweep in (path for path in SWEEPS if path.suffix == ".toml"):
        assert ps.load_sweep(sweep).spec.n_scenarios > 20


def test_links_between_pages_lead_somewhere(pages):
    """Those to pages and pictures, from every page that is not run."""
    run = re.search(r"(?s)_RUN = \((.*?)\)", (DOCS / "conf.py").read_text(encoding="utf-8"))[1]
    known = {f"generated/{name}" for name in (*pages, *re.findall(r"[\w.]+\.md", run.replace(".ipynb", ".md")))}
    known |= {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*") if path.is_file()}
    texts = {f"generated/{name}": text for name, text in pages.items() if name.endswith(".md")}
    texts |= {path.name: path.read_text(encoding="utf-8") for path in DOCS.glob("*.md") if path.name not in run}
    links = {(name, x) for name in texts for x in re.findall(r"\]\(([^)#:]+)\)", re.sub(r"`[^`]*`", "", texts[name]))}
    assert len(links) > len(texts)
    for name, link in links:
        target = (DOCS / Path(name).parent / link).resolve().relative_to(DOCS.resolve()).as_posix()
        assert any(target + suffix in known for suffix in ("", ".md", ".rst")), (name, link)


def write(folder, name, text):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_block_that_fails_ends_the_build(tmp_path):
    from notebook import run_pages

    page = write(tmp_path, "page.md", "text\n\n```sh\necho no >&2\nfalse\n```\n")
    with pytest.raises(RuntimeError, match=r"page\.md, line 4: a command failed:[\s\S]*no"):
        run_pages([page], tmp_path)
    page = write(tmp_path, "page.md", "text\n\n```python\nx = 1\n1 / 0\n```\n")
    with pytest.raises(ZeroDivisionError) as error:
        run_pages([page], tmp_path)
    assert error.traceback[-1].lineno + 1 == 5


def test_cells_of_the_notebook_run(stub_engine):
    """In order, as one program, each showing what it ends with."""
    book = json.loads((DOCS / "pounding.ipynb").read_text(encoding="utf-8"))
    names, shown = {}, []
    for cell in (cell for cell in book["cells"] if cell["cell_type"] == "code"):
        assert not cell["outputs"], "outputs are made when the documentation is built"
        *body, last = ast.parse("".join(cell["source"])).body
        exec(compile(ast.Module(body, []), "pounding.ipynb", "exec"), names)
        shown.append(eval(compile(ast.Expression(last.value), "pounding.ipynb", "eval"), names))
    assert sum(hasattr(each, "_repr_png_") for each in shown) == 3
    assert [type(each).__name__ for each in shown[:2]] == ["Scene", "Plan"]


PAGES = "start.md", "tutorial.md", "reading.md", "own_law.md", *sorted(path.name for path in DOCS.glob("howto_*.md"))


@pytest.mark.slow
def test_a_newcomer_can_follow_the_pages(tmp_path):
    """From an empty folder to a cube, comparisons, figures and an animation of two buildings of one's own."""
    from notebook import run_pages

    run_pages([DOCS / name for name in PAGES], tmp_path)
    made = {path.name for path in tmp_path.iterdir()}
    assert {"force_gap.png", "profiles.png", "row.gif", "tutorial_force_gap.png", "tutorial_profiles.png"} <= made
    texts = [(tmp_path / name).read_text(encoding="utf-8") for name in ("start.md", "tutorial.md", "reading.md")]
    pictures = {picture for text in texts for picture in re.findall(r"!\[[^]]*\]\((\w+\.(?:png|gif))\)", text)}
    assert len(pictures) > 2
    assert pictures <= made
    tutorial = (tmp_path / "tutorial.md").read_text(encoding="utf-8")
    gaps = re.search(r"gap mm  force kN  impacts\n(.*?)```", tutorial, re.DOTALL)[1]
    forces = [float(line.split()[1]) for line in gaps.splitlines()]
    assert forces[0] > 1000.0
    octave = re.findall(r"^ +(\d\.\d{4}e-0\d) +(\S+)$", (DOCS / "reading.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert [float(force) for _, force in octave] == pytest.approx(forces, abs=1.0)
    needed = float(re.search(r"exact +([\d.]+) mm", tutorial)[1])
    touching = [force > 0 for force in forces]
    assert touching == [1e3 * gap < needed for gap in (0.002, 0.005, 0.01, 0.015, 0.02, 0.03, 0.04)]


def test_formulas_are_typeset():
    from typeset import typeset

    assert typeset("D = 3 (1 - e^2) / 4") == r"$D = \dfrac{3\,\left(1 - e^{2}\right)}{4}$"
    assert typeset("F = k d on approach, k d on rebound") == r"$F = k\,d$ on approach, $k\,d$ on rebound"
    assert typeset("slope K1, then K2 d; e itself (1") == "slope $K_1$, then $K_2$ d; e itself (1"
    assert all(typeset(law.formula).startswith("$") or law.yields for law in LAWS.values())


def test_tables_are_whole(pages):
    assert r"\|u_i - u_(i-1)\|" in pages["variables.md"]  # a bar does not break them
    tables = [table for text in pages.values() for table in re.findall(r"(?:^\|.*\|\n)+", text, re.MULTILINE)]
    assert len(tables) > 10
    for table in tables:
        columns = {len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines()}
        assert len(columns) == 1, table.splitlines()[0]
    assert "model - of" not in pages["laws.md"]  # laws outside the paper are not said to be of it
    assert pages["laws.md"].count("of Mate, Bakre & Jaiswal 2015)") == 8
