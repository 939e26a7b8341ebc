"""A fault, as one line of text."""

from dataclasses import dataclass

from pointit.runtime.errors import PointItError

FIELDS = ("at_s", "kind", "target", "number", "duration_s", "detail")


class FaultFormatError(PointItError):
    """A fault is not written as it should be."""


@dataclass(frozen=True)
class Fault:
    """One fault: its time, its kind and its parameters."""

    at_s: float
    kind: str
    target: str = ""
    number: float = 0.0
    """Quantity of the kind: a delay, an offset or the time until a restart, s, a share, a count."""
    duration_s: float = 0.0
    detail: str = ""

    def __str__(self) -> str:
        """Return it as a sentence for people."""
        parts = [f"{self.at_s:.3f} s: {self.kind} {self.target}"]
        if self.detail:
            parts.append(self.detail)
        if self.number:
            parts.append(f"{self.number:g}")
        if self.duration_s:
            parts.append(f"for {self.duration_s:g} s")
        return " ".join(parts)

    def line(self) -> str:
        """Return it as `parse_fault` reads it."""
        values = (self.at_s, self.kind, self.target, self.number, self.duration_s, self.detail)
        return ",".join(f"{value:g}" if isinstance(value, float) else value for value in values)


def parse_fault(line: str) -> Fault:
    """Return the fault of a line such as `8,kill at,selector,2,1,after selection/events`.

    Raises:
        FaultFormatError: A field is missing or no number.
    """
    parts = line.split(",")
    if len(parts) != len(FIELDS):
        raise FaultFormatError(f"{line!r} has {len(parts)} fields, not these: {', '.join(FIELDS)}")
    at_s, kind, target, number, duration_s, detail = parts
    try:
        return Fault(float(at_s), kind, target, float(number), float(duration_s), detail)
    except ValueError as error:
        raise FaultFormatError(f"{line!r}: {error}") from error
