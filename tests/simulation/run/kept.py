"""Failures that seeds once found, kept as plans and faults: the seed's number draws others after a change."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from tests.simulation.faults.fault import Fault, parse_fault
from tests.simulation.world.world import Plan

KEPT_FOLDER = Path(__file__).parents[1] / "kept"


@dataclass(frozen=True)
class KeptFailure:
    """A plan and faults that once broke a promise."""

    found: str
    """The fault of the product, in one sentence."""
    promise: str
    """Name of the promise that it broke."""
    plan: Plan
    faults: Sequence[Fault]

    def to_yaml(self) -> dict[str, Any]:
        """Return it as `read_kept` reads it."""
        lines = [fault.line() for fault in self.faults]
        return {"found": self.found, "promise": self.promise, "plan": asdict(self.plan), "faults": lines}


def read_kept(path: Path) -> KeptFailure:
    """Read a file of `kept`."""
    values = yaml.safe_load(path.read_text())
    faults = [parse_fault(line) for line in values["faults"]]
    return KeptFailure(values["found"], values["promise"], Plan(**values["plan"]), faults)
