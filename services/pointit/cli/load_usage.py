"""What a process takes: CPU time and memory, from /proc; where there is none, only of this one."""

import os
import resource
import sys
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class Taken:
    """So far."""

    cpu_s: float
    memory_mb: float


def taken(pid: int | None = None) -> Taken | None:
    """Return what the process `pid` has taken, or this one; none when the system does not say."""
    folder = Path("/proc") / str(os.getpid() if pid is None else pid)
    try:
        fields = (folder / "stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        pages = int((folder / "statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError, ValueError):
        return _own() if pid is None else None
    ticks = int(fields[11]) + int(fields[12])  # utime and stime, proc(5)
    return Taken(cpu_s=ticks / os.sysconf("SC_CLK_TCK"), memory_mb=pages * os.sysconf("SC_PAGE_SIZE") / 1e6)


def _own() -> Taken:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    unit = 1 if sys.platform == "darwin" else 1024  # getrusage(2): the peak, in bytes or in KiB
    return Taken(cpu_s=usage.ru_utime + usage.ru_stime, memory_mb=usage.ru_maxrss * unit / 1e6)
