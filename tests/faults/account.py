"""The effect of each fault: the table that the suite prints at the end."""

from dataclasses import dataclass, field

HEAD = ("fault", "noticed", "by", "recovered", "lost", "memory")


@dataclass(frozen=True, kw_only=True)
class Fault:
    name: str
    noticed_s: float | None
    """From the fault until an operator could know, s. None if there is nothing to notice."""
    by: str
    """Source of the report: `doctor: absent`, `router: denied` …"""
    recovered_s: float | None
    """From the fault's end until all was as before, s. None if nothing had stopped."""
    lost: str
    """Lost messages: `nothing`, `12 cursors, no event` …"""
    memory_mb: float | None = None
    """Growth of the process that grew most, MB."""


@dataclass
class Account:
    rows: list[Fault] = field(default_factory=list[Fault])

    def add(self, fault: Fault) -> None:
        self.rows.append(fault)

    def lines(self) -> list[str]:
        cells = [HEAD, *(_cells(row) for row in self.rows)]
        widths = [max(len(row[column]) for row in cells) for column in range(len(HEAD))]
        printed = [_line(row, widths) for row in cells]
        return [printed[0], _line(tuple("-" * width for width in widths), widths), *printed[1:]]


def _cells(row: Fault) -> tuple[str, ...]:
    memory = "" if row.memory_mb is None else f"{row.memory_mb:+.0f} MB"
    return (row.name, _seconds(row.noticed_s), row.by, _seconds(row.recovered_s), row.lost, memory)


def _seconds(duration_s: float | None) -> str:
    return "-" if duration_s is None else f"{duration_s:.1f} s"


def _line(cells: tuple[str, ...], widths: list[int]) -> str:
    return "| " + " | ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)) + " |"
