"""Checks: what must hold, what to do if it does not, and the function that finds out."""

import asyncio
import traceback
import warnings
from collections.abc import Callable, Coroutine, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import InitVar, dataclass
from functools import partial
from typing import Any, Generic, TypeVar

from pointit.plugins import Plugin
from pointit.testing.own_loop import run_in_own_loop

P = TypeVar("P", bound=Plugin)
H = TypeVar("H", bound="Harness[Any]")
AT_ONCE = 16
"""Checks that run at the same time: most of them wait."""
TIMEOUT_FACTORS = 6.0
"""A check that has not come to an end within this many times the harness's timeout hangs."""
CheckFunction = Callable[[H], Coroutine[Any, Any, None]]


@dataclass(frozen=True, kw_only=True)
class Harness(Generic[P]):
    """A plug-in with the data that its checks need."""

    plugin: P
    wrong_parameters: tuple[Mapping[str, object], ...] = ()
    """Parameters that the plug-in must refuse."""
    virtual_time: bool = False
    """True if plug-in and device wait for timers of the event loop alone: checks then take no time."""
    timeout_s: float = 10.0
    """Time that the plug-in may take to start, to connect, to notice a loss, and to warn, s."""
    patience_s: InitVar[float | None] = None
    """Old name of `timeout_s`."""

    def __post_init__(self, patience_s: float | None) -> None:
        """Set `timeout_s` from its old name, with a warning."""
        if patience_s is not None:
            sentence = (
                "Harness(patience_s=) is now timeout_s=; the next minor version takes the new name only"
            )
            warnings.warn(sentence, DeprecationWarning, stacklevel=3)
            object.__setattr__(self, "timeout_s", patience_s)


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
        """Run the check in a separate thread and event loop, so that it cannot block the caller.

        Raises:
            CheckFailedError: If the promise does not hold. The message has the observation and the remedy.
        """
        try:
            self.function()
        except CheckFailedError as error:
            raise CheckFailedError(f"{self.name}: {error}. {self.remedy}") from error.__cause__


class CheckFailedError(AssertionError):
    """A plug-in breaks a promise. The message has the promise, the observation and the remedy."""


@contextmanager
def called(function: str) -> Generator[None]:
    """Raise CheckFailedError if `function` of the plug-in, which is called in the block, raises anything."""
    try:
        yield
    except Exception as error:
        raise CheckFailedError(f"`{function}` raised {type(error).__name__}: {error}") from error


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


class Suite(Generic[H]):
    """The checks of one kind of plug-in, each a function of its harness."""

    def __init__(self) -> None:
        self._rows: list[tuple[Callable[[H], bool], Callable[[H], Check]]] = []

    def add(
        self,
        function: CheckFunction[H],
        remedy: str,
        applies: Callable[[H], bool] = lambda _harness: True,
        *,
        alone: bool = False,
    ) -> None:
        """Add `function` as a check of its name. Its docstring is the promise.

        Args:
            function: raises CheckFailedError, with a clause that says what happened, if it does not hold.
            remedy: what to do then.
            applies: returns False for a harness with which it cannot be found out.
            alone: True if it measures the whole process.
        """
        sentence = function.__doc__ or ""
        promise = f"{sentence[:1].lower()}{sentence[1:].removesuffix('.')}"

        def bound(harness: H) -> Check:
            return Check(
                name=function.__name__,
                promise=promise,
                remedy=remedy,
                alone=alone,
                function=partial(_run, function, harness),
            )

        self._rows.append((applies, bound))

    def check(
        self, remedy: str, applies: Callable[[H], bool] = lambda _harness: True, *, alone: bool = False
    ) -> Callable[[CheckFunction[H]], None]:
        """Return a decorator that adds a function, as `add` does."""
        return partial(self.add, remedy=remedy, applies=applies, alone=alone)

    def checks(self, harness: H) -> list[Check]:
        """Return the checks that apply to `harness`."""
        return [bound(harness) for applies, bound in self._rows if applies(harness)]


def _run(function: CheckFunction[H], harness: H) -> None:
    limit_s = TIMEOUT_FACTORS * harness.timeout_s
    raised: list[BaseException] = []

    def on_error(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        # of protocols, timers and readers: asyncio logs it, and nobody awaits them
        if "exception" in context and "future" not in context:
            raised.append(context["exception"])
        else:
            loop.default_exception_handler(context)

    async def main() -> None:
        asyncio.get_running_loop().set_exception_handler(on_error)
        await function(harness)

    hung = run_in_own_loop(main, limit_s=limit_s, virtual_time=harness.virtual_time)
    if hung:
        raise CheckFailedError(f"did not come to an end within {limit_s:g} s: {hung}")
    for error in raised:
        line = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{line.filename}, line {line.lineno}, in {line.name}"
        raise CheckFailedError(f"a callback raised {type(error).__name__}: {error}, in {where}") from error
