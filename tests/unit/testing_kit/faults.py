"""Seeded faults: plug-ins made from a template with one fault each, and the test that must catch it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from pointit.testing import Contract

C = TypeVar("C", bound=Callable[..., Any])
TIMEOUT_S = 3.0
"""Time that a faulty plug-in may take, s. A template connects again after one second."""


@dataclass(frozen=True)
class Fault:
    """The contract of a faulty plug-in, the test that catches it, and words of its error."""

    test: str
    words: str
    contract: type[Contract]


FAULTS: dict[str, Fault] = {}


class CaughtBy:
    """Decorators of the faulty plug-ins of one kind."""

    def __init__(self, template: type[Contract]) -> None:
        self._template = template

    def __call__(self, check: str, words: str, /, **changes: Any) -> Callable[[C], C]:
        """Return a decorator for what makes the plug-in, which says that `check` reports `words` of it."""

        def seeded(make: C) -> C:
            plugin = replace(self._template.plugin, make=make, **changes)
            name = f"{type(plugin).__name__}-{make.__name__}-{check}-{words}"
            assert name not in FAULTS
            contract = type(make.__name__, (self._template,), {"plugin": plugin, "timeout_s": TIMEOUT_S})
            FAULTS[name] = Fault(f"test_{check}", words, contract)
            return make

        return seeded
