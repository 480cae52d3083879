"""Compiled kernels on disk: never a stale one, never one too many."""

from __future__ import annotations

import hashlib
import shutil
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pounding_sweep as ps
from pounding_sweep import lanes
from pounding_sweep.engine import compile
from pounding_sweep.engine.compile import (
    compile_piece,
    compiling_seconds,
    get_kernel,
    is_cached,
    prepare,
    source_digest,
    still_to_compile,
)
from pounding_sweep.engine.row_kernel import Numerics, RowKernel
from pounding_sweep.model.building import Building
from pounding_sweep.model.laws import get_law
from pounding_sweep.model.scene import Scene, Wall
from pounding_sweep.records import Record
from pounding_sweep.schemes import newmark
from pounding_sweep.variables.registry import Status

LINEAR = get_law("linear")
DOUBLED = replace(LINEAR, elastic="2.0*k*d", elastic_slope="2.0*k")
SCENE = Scene([Building("a", [100.0], [1e4]), Wall()], gaps=[0.005])
RECORD = Record("shake", 0.02, 3.0 * np.sin(0.14 * np.arange(100)))


#: What this process has compiled.
TRACED = []


def kernel_of(law=LINEAR, reducers=("force",), scene=SCENE):
    """A small kernel that compiles at once."""
    return RowKernel(scene, law, Numerics("rk4", 0.005, locate=False), frozenset(reducers))


def peak(law=LINEAR, k=2e5, scale=1.0, gap=0.005):
    one = np.ones(1)
    raw = kernel_of(law).run(RECORD, scale=scale * one, gaps=gap * one[None], stiffness=k * one, restitution=one)
    assert raw["flags"][0, 0] == 0
    return float(raw["fmax"][0, 0])


def forget():
    """Be as a process that has loaded no kernel yet."""
    get_kernel.cache_clear()
    compile._COMPILED.clear()


@pytest.fixture
def forgetful(monkeypatch):
    """A process that has loaded nothing; what it loads is forgotten after the test."""
    compile_library = compile.compile_library
    monkeypatch.setattr(compile, "compile_library", lambda piece: compile_library([piece, TRACED.append(piece)][0]))
    forget()
    yield
    forget()


@pytest.fixture
def folder(tmp_path, monkeypatch, forgetful):
    """An empty cache, in a process that has loaded nothing."""
    monkeypatch.setenv(compile.CACHE_VARIABLE, str(tmp_path / "kernels"))
    return tmp_path / "kernels"


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """A cache of the kernels of both laws, for copies."""
    kept = tmp_path_factory.mktemp("compiled") / "kernels"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(compile.CACHE_VARIABLE, str(kept))
        forget()
        for law in (LINEAR, DOUBLED):
            get_kernel(kernel_of(law).shape)
        forget()
    return kept


@pytest.fixture
def filled(compiled, folder):
    """A cache of one's own that holds the kernels of both laws."""
    shutil.copytree(compiled, folder)
    return folder


def files(folder):
    """Every file, with its content."""
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.rglob("*") if p.is_file()
    }


def compiled_here(shape):
    """Whether this process compiled a kernel since it was last asked, rather than loaded it."""
    get_kernel(shape)
    here = shape in TRACED
    TRACED.clear()
    return here


def test_a_warm_cache_compiles_nothing_and_does_not_grow(folder):
    shape = kernel_of().shape
    assert not is_cached([shape])
    assert not folder.exists()  # asking makes nothing
    assert compiled_here(shape)
    assert is_cached([shape])
    assert not is_cached([kernel_of(DOUBLED).shape])
    assert not is_cached([kernel_of(reducers=("count",)).shape])
    first, value = files(folder), peak()
    assert value > 0
    assert list(first) == [f"{source_digest(shape)}.o"]
    forget()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lanes.Tracer, "__init__", None)  # nothing can be traced
        patch.setitem(sys.modules, "numba", None)  # which takes long to load
        assert not compiled_here(shape)
    assert peak() == value
    assert files(folder) == first


def test_an_edited_law_is_another_kernel(filled):
    before = peak(k=2e5)
    assert peak(DOUBLED, k=1e5) == before  # 2 k d: another kernel, the same numbers
    assert peak(DOUBLED, k=2e5) > 1.1 * before
    names = [source_digest(kernel_of(law).shape) for law in (LINEAR, DOUBLED)]
    assert names[0] != names[1]
    assert {p.stem for p in filled.glob("*.o")} == set(names)
    # what does not change the code changes nothing
    renamed = replace(LINEAR, title="Another title", reference="-")
    assert source_digest(kernel_of(renamed).shape) == names[0]


@pytest.mark.usefixtures("forgetful")
def test_what_a_kernel_is_made_of_is_in_its_name(monkeypatch, tmp_path):
    """Sources that trace it, versions, the processor; and nothing else."""
    shape, package = kernel_of().shape, Path(compile.__file__).parent.parent
    shutil.copytree(package, tmp_path / "copy", ignore=shutil.ignore_patterns("data", "__pycache__"))
    monkeypatch.setattr(compile, "__file__", str(tmp_path / "copy" / "engine" / "compile.py"))

    def name():
        compile._surroundings.cache_clear()
        return source_digest(shape)

    before = name()
    for edited in ("lanes.py", "schemes/exact.py", "variables/registry.py", "engine/kernel.py", "model/laws.py"):
        path = tmp_path / "copy" / edited
        text = path.read_text(encoding="utf-8")
        path.write_text(f"{text}# edited", encoding="utf-8")
        assert name() == name() != before, edited
        path.write_text(text, encoding="utf-8")
        assert name() == before
    (tmp_path / "copy" / "plan" / "plan.py").write_text("")
    assert name() == before
    for owner in ("numba", "llvmlite"):
        with monkeypatch.context() as patch:
            patch.setattr(compile, "version", lambda package, owner=owner: package.replace(owner, "another"))
            assert name() != before, owner
    with monkeypatch.context() as patch:
        patch.setattr("llvmlite.binding.get_host_cpu_name", lambda: "another")
        assert name() != before
    assert name() == before


@pytest.mark.usefixtures("forgetful")
def test_a_folder_that_cannot_be_written_costs_the_cache_not_the_run(tmp_path, monkeypatch):
    regular = tmp_path / "regular"
    regular.write_text("not a folder")
    monkeypatch.setenv(compile.CACHE_VARIABLE, str(regular / "kernels"))
    assert not is_cached([kernel_of().shape])
    with pytest.warns(RuntimeWarning, match=r"can't be kept in '.*regular/kernels' \(Not a directory\)"):
        assert peak() > 0
    assert regular.read_text() == "not a folder"
    get_kernel.cache_clear()
    assert peak() > 0  # and that is said once


@pytest.mark.parametrize("length", [0, 20, 999])
def test_a_cut_kernel_is_compiled_anew(filled, length):
    """As a power cut or a full disk leaves it."""
    shapes = [kernel_of(law).shape for law in (LINEAR, DOUBLED)]
    path = filled / f"{source_digest(shapes[0])}.o"
    path.write_bytes(path.read_bytes()[:length])
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "damaged kernels in '.*kernels' are compiled anew")
        prepare(shapes)
    assert [shape in TRACED for shape in shapes] == [True, False]
    assert peak(k=2e5) == peak(DOUBLED, k=1e5) > 0
    forget()
    TRACED.clear()
    assert not compiled_here(shapes[0])


def test_numbers_of_a_sweep_are_no_part_of_its_kernels():
    """Another step, gap, stiffness, restitution, scale, record or building compiles nothing; another law one kernel.

    What a kernel is compiled for is all that its name, and so its machine code, depends on beside the sources.
    """
    scene = ps.get_preset("mate2015")
    base = {"records": "el_centro", "laws": ["linear", "hertz_damped"], "gaps": [0.01, 0.05], "dt": 1e-3}
    base |= {"stiffness_factors": [1.0], "restitutions": [0.6], "method": "rk4", "scene": scene}

    def kernels(**change):
        return set(map(source_digest, ps.Sweep(**base | change).plan().shapes()))

    def pieces(**change):
        swept = ps.Sweep(**base | {"method": "exact"} | change).plan().shapes()
        return {source_digest(piece) for shape in swept for piece in shape.pieces}

    before = kernels()
    numbers = {"dt": 5e-4, "gaps": [0.002, 0.02], "stiffness_factors": [0.5, 2.0], "restitutions": [0.4, 0.9]}
    numbers |= {"scales": [0.5, 2.0], "records": RECORD, "audit": 0.2}
    b = scene.buildings[0]
    other = Building("other", [2.0 * m for m in b.masses], [3.0 * k for k in b.stiffnesses], 0.02, b.storey_heights)
    numbers["scene"] = Scene([other, *scene.buildings[1:]], gaps=[0.02, 0.03], contact=scene.contact)
    for change in ({name: value} for name, value in numbers.items()):
        assert kernels(**change) == before, change
    assert len(kernels(laws=[*base["laws"], "nonlinear_viscoelastic"]) - before) == 1
    assert len(pieces(laws=[*base["laws"], "nonlinear_viscoelastic"]) - pieces()) == 1


def exact(law):
    return RowKernel(SCENE, get_law(law), Numerics("exact", 0.005), frozenset({"force", "energy", "transfer"})).shape


def test_another_law_compiles_its_contacts_alone(folder):
    """The flight of the scheme `exact` is compiled once for all laws."""
    first, second = exact("hertz_damped"), exact("stereomechanical")
    get_kernel(first)
    before = {path.stem for path in folder.glob("*.o")}
    assert before == {source_digest(piece) for piece in first.pieces}
    assert len(before) == 2
    assert still_to_compile([second])[1] < 0.7 * compiling_seconds(second.pieces)
    compile_piece(second)
    (mine,) = {path.stem for path in folder.glob("*.o")} - before
    assert mine == source_digest(second)
    forget()
    TRACED.clear()
    get_kernel(second)
    assert TRACED == []


def test_kernels_are_compiled_side_by_side(folder, monkeypatch):
    monkeypatch.setattr(compile, "BEGINNING", 0.1)
    shapes = [kernel_of().shape, kernel_of(DOUBLED).shape]
    told = []
    assert prepare([*shapes, shapes[0]], workers=2, advance=told.append) == 2
    assert told == [1, 1]
    assert all(is_cached([shape]) for shape in shapes)
    # the second was compiled by another process and only loaded here
    assert shapes[:1] == TRACED
    assert peak(DOUBLED, k=1e5) == peak(k=2e5) > 0
    before = files(folder)
    forget()
    assert prepare(shapes, workers=2) == 0
    assert files(folder) == before


def test_an_implicit_solution_that_is_given_up_is_told_by_the_status(folder, monkeypatch):
    """With one sweep over the contacts Gauss-Seidel can't be seen to converge; the values stay, the status tells."""
    scene = ps.Scene(
        [ps.Building(name, [m, m], [k, k]) for name, m, k in (("a", 100.0, 4e4), ("b", 80.0, 9e4))], gaps=[0.001]
    )
    record = ps.pulse_record("sine", amplitude=4.0, period=0.5, dt=0.02, duration=1.0)

    monkeypatch.setattr(newmark, "MAX_SWEEPS", 1)
    monkeypatch.setattr(compile, "_surroundings", lambda: "another source")
    one = ps.simulate(scene, record, law="linear", stiffness=2e5, method="newmark", dt=2e-3)
    assert float(one.impact_count.sum()) > 0
    assert int(one.status) == Status.NEWTON_NOT_CONVERGED
