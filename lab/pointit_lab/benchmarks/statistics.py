"""Statistics of samples, and the state of the machine."""

import os
import platform
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Figures:
    """Quantiles of one measurement, milliseconds."""

    count: int
    p50_ms: float
    p99_ms: float
    max_ms: float

    @classmethod
    def of(cls, values_s: list[float]) -> "Figures":
        """Return the quantiles of `values_s`, seconds, not empty."""
        sorted_ms = [value_s * 1e3 for value_s in sorted(values_s)]
        last = len(sorted_ms) - 1
        p50_ms = sorted_ms[last // 2]
        p99_ms = sorted_ms[int(last * 0.99)]
        return cls(count=len(sorted_ms), p50_ms=p50_ms, p99_ms=p99_ms, max_ms=sorted_ms[-1])

    def ratio_to(self, figures: "Figures") -> dict[str, float]:
        """Return p50 and p99 as multiples of `figures`'s."""
        p50 = self.p50_ms / figures.p50_ms
        p99 = self.p99_ms / figures.p99_ms
        return {"p50": p50, "p99": p99}

    def as_dict(self) -> dict[str, Any]:
        """Return the quantiles for JSON."""
        return asdict(self)


def machine() -> dict[str, Any]:
    """Return the conditions of a measurement: processor count, load, versions."""
    load_average = [round(value, 2) for value in os.getloadavg()]
    system = f"{platform.system()} {platform.machine()}"
    return {
        "cores": os.cpu_count(),
        "load_average": load_average,
        "python": platform.python_version(),
        "system": system,
    }
