"""What finished chunks are known by: the sweep they belong to, and all else that decides their bits."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pounding_sweep.output.dataset import package_version
from pounding_sweep.output.source import libraries, package_digest
from pounding_sweep.spec.spec import to_json

if TYPE_CHECKING:
    from pounding_sweep.plan.plan import Plan

#: What stands for the whole; the rest of the details are parts of the sweep, to name what changed.
WHOLE = ("sweep", "package", "source", "libraries")
#: Longest text (characters) that is told as it is.
_LONGEST = 60


def identity_of(plan: Plan) -> tuple[str, dict[str, str]]:
    """Return what the chunks of a sweep are known by.

    Parameters
    ----------
    plan : Plan
        The sweep.

    Returns
    -------
    identity : str
        SHA-256 (hex) of the details.
    details : dict of str to str
        Digest of the sweep and of the package's source, versions of the package and of the libraries
        that compute (`WHOLE`), and each part of the sweep, in short.

    Examples
    --------
    >>> import pounding_sweep as ps
    >>> identity, details = identity_of(ps.Sweep("mate2015", "el_centro", "linear", gaps=[0.01, 0.02]).plan())
    >>> details["gaps"], details["dt"]
    ('[0.01, 0.02]', '0.001')
    """
    whole = (plan.digest, package_version(), package_digest(), libraries())
    details = {**dict(zip(WHOLE, whole, strict=True)), **_parts(json.loads(to_json(plan.spec)))}
    return hashlib.sha256(json.dumps(details, sort_keys=True).encode()).hexdigest(), details


def differences(there: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """Return in what two details differ, the parts of the sweep before what stands for the whole.

    Examples
    --------
    >>> differences({"dt": "0.001", "sweep": "3f2a"}, {"dt": "0.002", "sweep": "91bc"})
    ['dt (0.001 there, 0.002 here)', 'sweep (3f2a there, 91bc here)']
    """
    keys = sorted({*there, *here}, key=lambda key: (key in WHOLE, key))
    return [
        f"{key} ({_short(there.get(key, 'none'))} there, {_short(here.get(key, 'none'))} here)"
        for key in keys
        if there.get(key) != here.get(key)
    ]


def _parts(sweep: dict[str, Any]) -> dict[str, str]:
    """Return each part of a described sweep as a short text that is another one where the part is."""
    records = {f"record {record['name']}": record["sha256"] for record in sweep["records"]}
    rest = {**sweep, "records": [{**record, "sha256": ""} for record in sweep["records"]]}
    return {**records, **{key: _digest(json.dumps(value, sort_keys=True)) for key, value in rest.items()}}


def _digest(text: str) -> str:
    return text if len(text) <= _LONGEST else hashlib.sha256(text.encode()).hexdigest()


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:12]}..."
