"""CPU time and memory of a process."""

import os
import resource
import sys
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class UsageSample:
    """Resource usage of a process so far."""

    cpu_s: float
    memory_mb: float


def read_usage(pid: int | None = None) -> UsageSample | None:
    """Return the usage of the process `pid`, or of this one, or None if the system does not report it."""
    folder = Path("/proc") / str(os.getpid() if pid is None else pid)
    try:
        fields = (folder / "stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        pages = int((folder / "statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError, ValueError):
        return _own() if pid is None else None
    ticks = int(fields[11]) + int(fields[12])  # utime and stime, proc(5)
    return UsageSample(
        cpu_s=ticks / os.sysconf("SC_CLK_TCK"), memory_mb=pages * os.sysconf("SC_PAGE_SIZE") / 1e6
    )


def _own() -> UsageSample:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    unit = 1 if sys.platform == "darwin" else 1024  # getrusage(2): the peak, in bytes or in KiB
    return UsageSample(cpu_s=usage.ru_utime + usage.ru_stime, memory_mb=usage.ru_maxrss * unit / 1e6)
