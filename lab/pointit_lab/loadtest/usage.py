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
    number = os.getpid() if pid is None else pid
    folder = Path(f"/proc/{number}")
    try:
        stat = (folder / "stat").read_text(encoding="ascii", errors="replace")
        statm = (folder / "statm").read_text(encoding="ascii")
        pages = int(statm.split()[1])
    except (OSError, IndexError, ValueError):
        return _own() if pid is None else None

    # the name before the last bracket may have blanks; after it come utime and stime, proc(5)
    _, _, numbers = stat.rpartition(")")
    fields = numbers.split()
    ticks = int(fields[11]) + int(fields[12])
    cpu_s = ticks / os.sysconf("SC_CLK_TCK")
    memory_bytes = pages * os.sysconf("SC_PAGE_SIZE")
    return UsageSample(cpu_s=cpu_s, memory_mb=memory_bytes / 1e6)


def _own() -> UsageSample:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    cpu_s = usage.ru_utime + usage.ru_stime
    unit = 1 if sys.platform == "darwin" else 1024  # getrusage(2): the peak, in bytes or in KiB
    return UsageSample(cpu_s=cpu_s, memory_mb=usage.ru_maxrss * unit / 1e6)
