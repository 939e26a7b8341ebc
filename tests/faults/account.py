"""The effect of each fault, the table that the suite prints at the end; memory of processes."""

import contextlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import psutil

HEAD = ("fault", "noticed", "by", "recovered", "lost", "memory")


@dataclass
class Account:
    rows: list[tuple[str, ...]] = field(default_factory=list[tuple[str, ...]])

    def add(
        self,
        name: str,
        noticed_s: float | None,
        by: str,
        recovered_s: float | None,
        lost: str,
        *,
        memory_mb: float | None = None,
    ) -> None:
        """Put down a fault of a running site and its effect.

        Args:
            name: of the fault.
            noticed_s: from the fault until an operator could know. None if there is nothing to notice.
            by: source of the report: `doctor: absent`, `router: denied` …
            recovered_s: from the fault's end until all was as before. None if nothing had stopped.
            lost: lost messages: `nothing`, `12 cursors, no event` …
            memory_mb: growth of the process that grew most.
        """
        memory = "" if memory_mb is None else f"{memory_mb:+.0f} MB"
        self.rows.append((name, _seconds(noticed_s), by, _seconds(recovered_s), lost, memory))

    def lines(self) -> list[str]:
        """Return the table as Markdown."""
        widths = [max(map(len, column)) for column in zip(HEAD, *self.rows, strict=True)]
        rule = tuple("-" * width for width in widths)
        return [_line(row, widths) for row in (HEAD, rule, *self.rows)]


def _seconds(duration_s: float | None) -> str:
    return "-" if duration_s is None else f"{duration_s:.1f} s"


def _line(cells: tuple[str, ...], widths: list[int]) -> str:
    return "| " + " | ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)) + " |"


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
