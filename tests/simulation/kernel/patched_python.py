"""Clocks, identities and random names of this Python, replaced by those of the simulated process that asks.

`install` must be called before any module of PointIt is imported, since some bind `time.time_ns` itself. It
is never called where other tests run.
"""

import itertools
import os
import secrets
import socket
import time

from tests.simulation.kernel.process import PROCESS, START_NS
from tests.simulation.kernel.simulation import Simulation

real_time_s = time.monotonic
"""Time of this machine, s, also after `install`."""
_real_pid = os.getpid
_real_host = socket.gethostname
_names = itertools.count()


def install() -> None:
    """Replace them."""
    time.time_ns = _host_ns
    time.time = _host_s
    time.monotonic = _true_s
    time.monotonic_ns = _true_ns
    time.perf_counter = _work_s
    os.getpid = _pid
    socket.gethostname = _host_name
    secrets.token_hex = _token_hex


def _true_s() -> float:
    simulation = Simulation.current
    return 0.0 if simulation is None else simulation.now_s


def _true_ns() -> int:
    return round(_true_s() * 1e9)


def _host_ns() -> int:
    process = PROCESS.get()
    return START_NS + _true_ns() if process is None else process.now_ns()


def _host_s() -> float:
    return _host_ns() / 1e9


def _work_s() -> float:
    process = PROCESS.get()
    return _true_s() if process is None else _true_s() + process.disk_time_s


def _pid() -> int:
    process = PROCESS.get()
    return _real_pid() if process is None else process.pid


def _host_name() -> str:
    process = PROCESS.get()
    return _real_host() if process is None else process.host.name


def _token_hex(nbytes: int | None = None) -> str:
    return f"{next(_names):0{2 * (nbytes or 16)}x}"
