"""A cluster over two machines, imitated by network namespaces: other addresses, other folders, and a cable that is cut.

Needs Linux, root and the command `ip`; skipped elsewhere.
"""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest
from dask_cluster import DaskCluster
from test_distributed import Events, count, small_chunks, whole  # noqa: F401 - fixtures
from test_execute import make

from pounding_sweep.engine.cache import cache_folder

pytestmark = pytest.mark.slow
NET = "10.213.{}.{}"


def ip(*arguments):
    """Run `ip`."""
    subprocess.run(["ip", *map(str, arguments)], check=True, capture_output=True, text=True)


@pytest.fixture
def hosts():
    """A bridge to this machine and two namespaces behind it: their names, and the address of the bridge."""
    if shutil.which("ip") is None or os.geteuid() != 0:
        pytest.skip("network namespaces need root and the command ip")
    number = os.getpid() % 250 + 2
    bridge, names = f"pound{number}", [f"pound{number}{end}" for end in "ab"]
    try:
        ip("link", "add", bridge, "type", "bridge")
    except subprocess.CalledProcessError as error:
        pytest.skip(f"no network bridge can be made here: {error.stderr.strip()}")
    try:
        ip("addr", "add", f"{NET.format(number, 1)}/24", "dev", bridge)
        ip("link", "set", bridge, "up")
        for place, name in enumerate(names, start=2):
            ip("netns", "add", name)
            ip("link", "add", f"{name}0", "type", "veth", "peer", "name", "eth0", "netns", name)
            ip("link", "set", f"{name}0", "master", bridge)
            ip("link", "set", f"{name}0", "up")
            inside = ("netns", "exec", name, "ip")
            ip(*inside, "addr", "add", f"{NET.format(number, place)}/24", "dev", "eth0")
            ip(*inside, "link", "set", "eth0", "up")
            ip(*inside, "link", "set", "lo", "up")
        yield names, NET.format(number, 1)
    finally:
        for name in names:
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)
        subprocess.run(["ip", "link", "del", bridge], check=False, capture_output=True)


def test_two_hosts(tmp_path, hosts, whole, count):  # noqa: F811
    """Each host compiles what it has not; one is cut off, the other does its work; it comes back."""
    names, here = hosts
    axes = {"laws": ["linear"], "gaps": [0.004 + 0.0002 * i for i in range(60)]}
    reference = make(**axes).run(scheduler="synchronous")
    with_kernels, without = tmp_path / "first", tmp_path / "second"
    shutil.copytree(cache_folder(), with_kernels)
    with DaskCluster(tmp_path, host=here) as cluster:
        for name, cache in zip(names, (with_kernels, without), strict=True):
            inside = ("ip", "netns", "exec", name)
            cluster.add(name, nanny=True, before=inside, env={"POUNDING_SWEEP_CACHE": str(cache)})
        sweep = make(**axes)
        whole(sweep.run(scheduler=cluster.address), sweep, reference)
        assert sweep.last_outcome.compiled == 2  # on the second host alone

        cut = Events((8, lambda: ip("link", "set", f"{names[1]}0", "down")))
        sweep = make(**axes)
        whole(sweep.run(scheduler=cluster.address, progress=cut), sweep, reference)
        count("hosts cut off")
        assert not cut.events
        cluster.wait_until_gone(names[1])
        assert sweep.last_outcome.compiled == 0

        ip("link", "set", f"{names[1]}0", "up")  # a worker that was cut off ends itself: another is started
        inside = ("ip", "netns", "exec", names[1])
        cluster.add("again", nanny=True, before=inside, env={"POUNDING_SWEEP_CACHE": str(without)})
        back = Events()
        sweep = make(**axes)
        whole(sweep.run(scheduler=cluster.address, progress=back), sweep, reference)
        assert sum("takes part" in note for note in back.notes) == 2
        assert sweep.last_outcome.compiled == 0
