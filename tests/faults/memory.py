"""Memory use of processes, and its growth."""

import contextlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import psutil


@dataclass(frozen=True)
class Memory:
    of: Mapping[int, int]

    @staticmethod
    def now(pids: Iterable[int]) -> "Memory":
        found: dict[int, int] = {}
        for pid in pids:
            with contextlib.suppress(psutil.NoSuchProcess):
                found[pid] = psutil.Process(pid).memory_info().rss
        return Memory(found)

    def growth_mb(self, since: "Memory") -> float:
        return (
            max((self.of[pid] - before for pid, before in since.of.items() if pid in self.of), default=0)
            / 1e6
        )
