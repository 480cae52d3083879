"""What is done and what is missing of a sweep that has not been finished.

While a sweep runs, its folder says of which chunks each stage consists; held
against the manifest, that tells what is missing. Which scenarios have to run
is known only after the runs without pounding.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pounding_sweep.base.errors import OutputError
from pounding_sweep.base.files import running
from pounding_sweep.plan.scenarios import Chunk
from pounding_sweep.resume.checkpoint import EXPECTED, IDENTITY, WHOLE, ChunkStore, unreadable

if TYPE_CHECKING:
    from pounding_sweep.plan.plan import Plan


def expect(store: ChunkStore, plan: Plan, stage: str, chunks: Sequence[Chunk]) -> None:
    """Note of which chunks a stage will consist; those noted by a run of the same plan stay. Raises `WriteError`."""
    about = {
        "title": plan.spec.title,
        "asked": plan.n_asked,
        "at_most": plan.n_unique,
        "laws": [law.key for law in plan.laws],
        "records": [record.name for record in plan.spec.records],
    }
    stages: dict[str, Any] = {}
    with suppress(OSError, ValueError, TypeError, KeyError):
        noted = json.loads((store.folder / EXPECTED).read_bytes())
        if noted == {**about, "stages": noted["stages"]}:
            stages = noted["stages"]
    stages[stage] = [[chunk.key, chunk.law, chunk.record, len(chunk.rows)] for chunk in chunks]
    store.expect({**about, "stages": stages})


@dataclass
class Part:
    """Chunks of one stage, law and record.

    Attributes
    ----------
    stage, law, record : str
        What they run.
    chunks, scenarios : int
        How many there are.
    chunks_done, scenarios_done : int
        How many of them are finished.
    """

    stage: str
    law: str
    record: str
    chunks: int = 0
    chunks_done: int = 0
    scenarios: int = 0
    scenarios_done: int = 0


@dataclass
class Survey:
    """An unfinished sweep.

    Attributes
    ----------
    folder : Path
        Where its chunks stand.
    details : dict of str to str
        Digest of the sweep and of the package's source, its version, and those of numba and numpy.
    title : str
        Title of the sweep.
    asked, at_most : int or None
        Scenarios asked for, and those that may have to run; None where no run came as far as its first stage.
    parts : list of Part
        By stage, law and record, as far as planned.
    planned : bool
        Whether all chunks are known.
    now : str or None
        Who runs on it.
    """

    folder: Path
    details: dict[str, str] = field(default_factory=dict)
    title: str = ""
    asked: int | None = None
    at_most: int | None = None
    parts: list[Part] = field(default_factory=list)
    planned: bool = False
    now: str | None = None


def survey(folder: Path) -> Survey:
    """Look at the folder of a sweep that is not finished; nothing is changed.

    Parameters
    ----------
    folder : Path
        ``OUT.nc.parts``.

    Returns
    -------
    Survey
        Chunks count as done when the manifest lists them and their file is there; the
        files are not read.

    Raises
    ------
    OutputError
        The folder does not hold chunks, or what it says of itself is damaged.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> store = ChunkStore(folder, "3f2a", {"package": "0.1.0"}).open()
    >>> found = survey(folder)
    >>> found.details, found.asked, found.now
    ({'package': '0.1.0'}, None, None)
    """
    try:
        identity = json.loads((folder / IDENTITY).read_bytes())
        details = identity["details"]
        found = Survey(folder, {key: str(details[key]) for key in WHOLE if key in details})
        found.now = running(folder)
        if (folder / EXPECTED).exists():
            _count(found, json.loads((folder / EXPECTED).read_bytes()))
    except FileNotFoundError:
        raise OutputError(
            f"{str(folder)!r} is no folder of finished chunks: it has no {IDENTITY}; give OUT.nc.parts of a run"
        ) from None
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(unreadable(folder, error)) from None
    except (ValueError, TypeError, KeyError, AttributeError, IndexError, OverflowError) as error:
        raise OutputError(
            f"what {str(folder)!r} says of itself can't be read ({error}); run the sweep again, or remove the folder"
        ) from None
    return found


def _count(found: Survey, planned: dict[str, Any]) -> None:
    """Hold what was planned against the manifest."""
    done = ChunkStore(found.folder, "").completed()
    found.title, found.asked, found.at_most = str(planned["title"]), int(planned["asked"]), int(planned["at_most"])
    found.planned = "scenarios" in planned["stages"]
    parts: dict[tuple[str, int, int], Part] = {}
    for stage, chunks in planned["stages"].items():
        for key, law, record, scenarios in chunks:
            names = (str(stage), str(planned["laws"][law]), str(planned["records"][record]))
            part = parts.setdefault((stage, law, record), Part(*names))
            part.chunks += 1
            part.scenarios += scenarios
            if key in done:
                part.chunks_done += 1
                part.scenarios_done += scenarios
    found.parts = [parts[key] for key in sorted(parts, key=lambda k: (list(planned["stages"]).index(k[0]), *k[1:]))]
