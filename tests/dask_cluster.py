"""A dask cluster of real processes, whose parts can be killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

#: A dead neighbour is noticed within seconds, and no dashboard is loaded.
SETTINGS = {
    "DASK_DISTRIBUTED__COMM__TIMEOUTS__TCP": "12s",
    "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "5s",
    "DASK_DISTRIBUTED__DIAGNOSTICS__NVML": "False",
    "PYTHONWARNINGS": "ignore",
}


class DaskCluster:
    """A scheduler and workers, each in a process of its own, as a user starts them."""

    def __init__(self, folder: Path, env=None):
        self.folder = folder
        self._workers, self._file = {}, folder / "scheduler.json"
        where = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--dashboard-address", "127.0.0.1:0")
        self._scheduler = self._start("scheduler", *where, "--scheduler-file", self._file, env=env)
        self.address = self._wait(lambda: json.loads(self._file.read_text())["address"])

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in [*self._workers.values(), self._scheduler]:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()

    def _start(self, *arguments, env=None):
        command = [sys.executable, "-m", "dask", *map(str, arguments)]
        with (self.folder / "dask.log").open("ab") as log:
            return subprocess.Popen(
                command,
                cwd=self.folder,
                env={**os.environ, **SETTINGS, **(env or {})},
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def _wait(self, look, seconds=300.0):
        limit = time.monotonic() + seconds
        while True:
            try:
                found = look()
            except (OSError, ValueError):
                found = None
            if found:
                return found
            assert time.monotonic() < limit, (self.folder / "dask.log").read_text()[-4000:]
            time.sleep(0.1)

    def add(self, name, wait=True, env=None):
        """Start a worker of one thread; waits until it runs."""
        options = ("--name", name, "--nthreads", 1, "--no-dashboard", "--no-nanny", "--local-directory", self.folder)
        self._workers[name] = self._start("worker", "--scheduler-file", self._file, *options, env=env)
        if wait:
            self._wait(lambda: self._has(name))
        return self

    def _has(self, name):
        from distributed import Client

        with Client(self.address, set_as_default=False) as client:
            return name in {worker["name"] for worker in client.scheduler_info()["workers"].values()}

    def kill(self, name):
        """End a worker as a power cut would."""
        process = self._workers.pop(name)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def kill_scheduler(self):
        """End the scheduler."""
        self._scheduler.kill()
        self._scheduler.wait()
