"""Old names of public arguments: they work with a warning, as documents of the last version say."""

from collections.abc import Callable
from typing import Any

import pytest

import pointit
from pointit import testing
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.config.nearest_name import accept_old_names
from pointit.runtime.errors import ConfigError
from pointit.schemas import Cursor, topics
from pointit.testing import memory_bench, until
from pointit.testing.templates.selection_method import METHOD


@accept_old_names(before="after")
def double(number: int = 1, *, after: int = 0) -> int:
    """Return twice the sum."""
    return 2 * (number + after)


def test_old_name_works_with_a_warning_at_the_callers_line() -> None:
    old: Callable[..., int] = double
    with pytest.warns(DeprecationWarning, match=r"double\(before=\) is now after=; the next minor") as caught:
        assert old(1, before=2) == double(1, after=2) == 6
    assert [warning.filename for warning in caught] == [__file__]
    assert double.__doc__ == "Return twice the sum."


def test_both_names_at_once_are_refused() -> None:
    old: Callable[..., int] = double
    with pytest.raises(TypeError, match=r"double\(\) got after= and its old name before=: leave out before="):
        old(before=1, after=1)


def test_old_timeout_of_joining_a_site_is_accepted() -> None:
    connect: Callable[..., Any] = pointit.connect
    with pytest.warns(DeprecationWarning, match=r"connect\(patience_s=\) is now timeout_s="):
        connect(patience_s=1.0)
    open_site: Callable[..., Any] = pointit.open
    with (
        pytest.warns(DeprecationWarning, match=r"open\(patience_s=\) is now timeout_s="),
        pytest.raises(ConfigError, match="no address"),
    ):
        open_site("no address", patience_s=1.0)


async def test_deprecated_subscription_options_do_the_same_as_new_ones() -> None:
    async with memory_bench() as bench:
        bus = ServiceBus(bench.bus, bench.clock, "counter", "counter")
        subscribe: Callable[..., Any] = bus.subscribe
        received: dict[str, list[int]] = {"old": [], "new": [], "newest": []}

        def note(kind: str) -> Callable[[Cursor, str], None]:
            return lambda cursor, _name: received[kind].append(cursor.seq)

        with pytest.warns(DeprecationWarning, match=r"subscribe\((kept|every)=\) is now") as caught:
            subscribe(topics.CURSOR, note("old"), kept=False, every=True)
        assert len(caught) == 2
        bus.subscribe(topics.CURSOR, note("new"), retained=False, queue_all=True)
        bus.subscribe(topics.CURSOR, note("newest"))
        publisher = bench.bus.publisher(topics.CURSOR, "anna")
        for seq in (1, 2, 3):
            publisher.put(Cursor(stamp_ns=bench.clock.now_ns(), seq=seq))
        await until(lambda: received["newest"] == [3])
        assert received["old"] == received["new"] == [1, 2, 3]


def test_old_timeout_of_waiting_for_a_message_is_accepted() -> None:
    with pointit.run("scenario_3", virtual=True) as site:
        wait: Callable[..., Any] = site.latest.cursor.wait
        with pytest.warns(DeprecationWarning, match=r"SyncNewest.wait\(patience_s=\) is now timeout_s="):
            assert wait("user1", patience_s=30.0).stamp_ns > 0


def test_harness_of_old_names_makes_a_contract() -> None:
    harness: Callable[..., Any] = testing.MethodHarness
    with pytest.warns(DeprecationWarning, match="MethodHarness is now SelectionMethodContract"):
        contract = harness(plugin=METHOD, wrong_parameters=({"dwell_s": 0.0},), patience_s=3.0)
    assert contract.timeout_s == 3.0
    assert issubclass(contract, testing.SelectionMethodContract)
    checks = [check for check in testing.checks(contract) if str(check) == "parameters"]
    assert [problem for _, problem in testing.run_checks(checks)] == [""]


def test_functions_of_an_old_harness_are_methods_of_the_contract() -> None:
    harness: Callable[..., Any] = testing.ImuHarness
    with pytest.warns(DeprecationWarning, match="ImuHarness is now ImuSourceContract"):
        contract = harness(plugin=None, parameters=dict, encode=bytes)()
    assert contract.sends
    assert contract.parameters([("port", 7)]) == {"port": 7}
    assert contract.encode((1, 2, 3, 4)) == b"\x01\x02\x03\x04"
