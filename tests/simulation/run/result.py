"""The result of one seed, as JSON between processes."""

import json
from dataclasses import asdict, dataclass, field
from typing import Any

from tests.simulation.promises.breaches import Breach


@dataclass
class Result:
    """Verdict and figures of a seed."""

    seed: int
    breaches: list[Breach] = field(default_factory=list[Breach])
    faults: list[str] = field(default_factory=list[str])
    """Lines as `parse_fault` reads them."""
    plan: dict[str, Any] = field(default_factory=dict[str, Any])
    digest: str = ""
    simulated_s: float = 0.0
    cpu_s: float = 0.0
    counts: dict[str, int] = field(default_factory=dict[str, int])
    error: str = ""
    """Error of the simulation itself, or `""`."""

    @property
    def broken(self) -> list[str]:
        """Return the names of the broken promises."""
        return [breach.promise for breach in self.breaches]

    def to_json(self) -> str:
        """Return it as JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "Result":
        """Return the result of `to_json`."""
        values = json.loads(text)
        values["breaches"] = [Breach(**breach) for breach in values["breaches"]]
        return cls(**values)
