"""Checks: what must hold, what to do if it does not, and the function that finds out."""

from collections.abc import Callable, Coroutine, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

from pointit.testing.own_loop import run_in_own_loop

H = TypeVar("H")

AT_ONCE = 16
"""Checks that run at the same time: most of them wait."""

CheckFunction = Callable[[H], Coroutine[Any, Any, None]]


@dataclass(frozen=True, kw_only=True)
class Check:
    """One check of one plug-in."""

    name: str
    promise: str
    """Clause about the plug-in that must hold: `ends within 1 s of being cancelled`."""
    remedy: str
    """Change that helps if it does not hold, in one sentence."""
    alone: bool
    """True if it measures the whole process, so that no other check may run meanwhile."""
    function: Callable[[], None]

    def __str__(self) -> str:
        """Return the name, which makes a readable `ids=str` of pytest."""
        return self.name

    def run(self) -> None:
        """Run it, in an event loop and a thread of its own, so that nothing of it can hang the caller.

        Raises:
            CheckFailedError: If the promise does not hold. Says what happened, and what to do.
        """
        try:
            self.function()
        except CheckFailedError as error:
            raise CheckFailedError(f"{self.name}: {error}. {self.remedy}") from error.__cause__


class CheckFailedError(AssertionError):
    """A plug-in does not keep a promise; the message says which, what happened, and what to do."""


def run_checks(checks: Sequence[Check]) -> Iterator[tuple[Check, str]]:
    """Run `checks`, most of them at the same time. Yield each with its error message, or `""`."""
    with ThreadPoolExecutor(max_workers=AT_ONCE) as pool:
        found = {check.name: pool.submit(problem, check) for check in checks if not check.alone}
    for check in checks:
        yield check, found[check.name].result() if check.name in found else problem(check)


def problem(check: Check) -> str:
    """Run `check`. Return its error message, or `""` if the promise holds."""
    try:
        check.run()
    except CheckFailedError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001 - of a harness, which is code of others, too
        return f"{check.name}: the harness raised {type(error).__name__}: {error}. Correct it"
    return ""


@dataclass(frozen=True)
class _Definition(Generic[H]):
    function: CheckFunction[H]
    remedy: str
    applies: Callable[[H], bool]
    alone: bool

    @property
    def promise(self) -> str:
        sentence = self.function.__doc__ or ""
        return f"{sentence[:1].lower()}{sentence[1:].removesuffix('.')}"


class Suite(Generic[H]):
    """The checks of one kind of plug-in, each a function of its harness."""

    def __init__(self) -> None:
        self._definitions: list[_Definition[H]] = []

    def add(
        self, remedy: str, applies: Callable[[H], bool] = lambda _harness: True, *, alone: bool = False
    ) -> Callable[[CheckFunction[H]], CheckFunction[H]]:
        """Add the decorated function as a check of its name. Its docstring is the promise.

        Args:
            remedy: what to do if it does not hold.
            applies: returns False for a harness with which it cannot be found out.
            alone: True if it measures the whole process.
        """

        def added(function: CheckFunction[H]) -> CheckFunction[H]:
            self._definitions.append(_Definition(function, remedy, applies, alone))
            return function

        return added

    def checks(self, harness: H, *, limit_s: float, virtual_time: bool = False) -> list[Check]:
        """Return the checks that apply to `harness`; each fails after `limit_s` of wall time."""
        return [
            Check(
                name=each.function.__name__,
                promise=each.promise,
                remedy=each.remedy,
                alone=each.alone,
                function=partial(_run, each.function, harness, limit_s, virtual_time=virtual_time),
            )
            for each in self._definitions
            if each.applies(harness)
        ]


def _run(function: CheckFunction[H], harness: H, limit_s: float, *, virtual_time: bool) -> None:
    hung = run_in_own_loop(lambda: function(harness), limit_s=limit_s, virtual_time=virtual_time)
    if hung:
        raise CheckFailedError(f"did not come to an end within {limit_s:g} s: {hung}")
