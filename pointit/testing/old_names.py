"""Old names of the contracts, until the next minor version: harnesses, whose fields were functions."""

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from unittest import SkipTest

from pointit.testing.contract import CheckFailedError, Contract


def harness(name: str, contract: type[Contract]) -> Callable[..., type[Contract]]:
    """Return a function that makes a class of `contract` of the fields of the harness `name`."""

    def make(**fields: Any) -> type[Contract]:
        sentence = f"{name} is now {contract.__name__}, to be inherited; the next minor version has that only"
        warnings.warn(sentence, DeprecationWarning, stacklevel=2)
        if "patience_s" in fields:
            fields["timeout_s"] = fields.pop("patience_s")
        methods = {key: staticmethod(value) for key, value in fields.items() if callable(value)}
        has_motion = {"shows_motion": "is_moving" in fields, "sends": fields.get("encode") is not None}
        return type("TestPlugin", (contract,), has_motion | fields | methods)

    return make


@dataclass(frozen=True)
class Check:
    """One test of a contract."""

    contract: type[Contract]
    name: str

    def __str__(self) -> str:
        """Return the name, which makes a readable `ids=str` of pytest."""
        return self.name

    def run(self) -> None:
        """Run it. Raises CheckFailedError if the promise does not hold."""
        getattr(self.contract(), f"test_{self.name}")()


def checks(contract: type[Contract]) -> list[Check]:
    """Return the tests of `contract`."""
    names = [name for name in dir(contract) if name.startswith("test_")]
    return [Check(contract, name.removeprefix("test_")) for name in names]


def run_checks(checks: Sequence[Check]) -> Iterator[tuple[Check, str]]:
    """Run `checks`. Yield each with its error message, or `""`."""
    for check in checks:
        try:
            check.run()
        except SkipTest:
            continue
        except CheckFailedError as error:
            yield check, str(error)
        else:
            yield check, ""
