"""Denied rights are tested again: a busy router answers late, and rules change."""

import asyncio
import contextlib
import datetime as dt
from collections.abc import AsyncGenerator, Callable
from pathlib import Path
from typing import Any, cast

import pytest
import zenoh

from pointit.runtime.link.link import Credentials, LinkFile
from pointit.runtime.zenoh import restricted_bus
from pointit.runtime.zenoh.restricted_bus import PermissionProbe
from tests.support.bench import until


class TimedOut:
    """Zenoh's own reply to a question without an end."""

    def __init__(self) -> None:
        self.ok: None = None
        self.err = Sample("", b"Timeout")


class Router:
    """Forwards messages from one session to the other, except `denied` ones."""

    def __init__(self) -> None:
        self.denied: Callable[[str], bool] = lambda _key: False
        self.tests = self.messages = self.questions = 0
        self.is_busy = False
        self.asked = asyncio.Event()
        self._hear: Callable[[Any], None] = lambda _sample: None

    def declare_subscriber(self, _key: str, callback: Callable[[Any], None]) -> None:
        self._hear = callback

    def put(self, key: str, payload: bytes) -> None:
        self.asked.set()
        if not self.denied(key):
            self._hear(Sample(key, payload))

    def get(self, _key: str, callback: Any, **_: Any) -> None:
        """End a question, as a router does whatever the rights, unless it is busy."""
        self.questions += 1
        if not self.is_busy:
            callback.drop()
            return
        callback(TimedOut())
        callback.drop()

    @contextlib.asynccontextmanager
    async def second(self) -> AsyncGenerator[zenoh.Session]:
        self.tests += 1
        yield cast("zenoh.Session", self)


class Sample:
    def __init__(self, key: str, payload: bytes) -> None:
        self.key_expr = key
        self.payload = zenoh.ZBytes(payload)


class SlowRouter(Router):
    """Forwards the messages of a first test half at a time, as a busy machine may."""

    def put(self, key: str, payload: bytes) -> None:
        self.messages += 1
        if self.tests > 1 or (self.messages > 3 and "imu" not in key and "joins" not in key):
            super().put(key, payload)


class SharedRouter(Router):
    """Forwards all tests of another process of this identity before the first messages of this one."""

    def put(self, key: str, payload: bytes) -> None:
        self.messages += 1
        if key.endswith("joins"):
            for number in range(4):
                self._hear(Sample(key, payload[:-1][::-1] + bytes([number])))
        if self.messages > 6:
            super().put(key, payload)


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(restricted_bus, "SETTLE_S", 0.001)
    monkeypatch.setattr(restricted_bus, "WAITS_S", (0.005, 0.005, 0.005, 0.005))
    monkeypatch.setattr(restricted_bus, "RETRY_S", (0.02, 0.03))


def self_test_at(router: Router) -> PermissionProbe:
    day = dt.datetime(2026, 1, 1, tzinfo=dt.UTC)
    link = LinkFile(
        site="lab",
        name="anna",
        role="user",
        generation=1,
        endpoints=("tls/127.0.0.1:7447",),
        valid_from=day,
        valid_until=day + dt.timedelta(days=365),
    )
    credentials = Credentials(folder=Path(), link=link)
    return PermissionProbe(cast("zenoh.Session", router), credentials, router.second, lambda: True)


@pytest.mark.parametrize("what", ["@may", "users/anna/imu"])
async def test_a_late_answer_ends_the_denial(what: str) -> None:
    router = Router()
    router.denied = lambda key: what in key
    test = self_test_at(router)
    try:
        test.add("writes", "users/anna/imu")
        test.add("reads", "map")
        await until(lambda: bool(test.problems), what="it to be denied")
        assert ("may do nothing" in test.problems[0].sentence) == (what == "@may")
        router.denied = lambda _key: False
        await until(lambda: not test.problems, what="it to be granted")
        done = router.tests
        await asyncio.sleep(3 * max(restricted_bus.RETRY_S))
        assert router.tests == done, "it is tested on"
    finally:
        await test.close()


@pytest.mark.parametrize("kind", [SlowRouter, SharedRouter])
async def test_messages_that_are_late_are_no_denial(
    kind: type[Router], caplog: pytest.LogCaptureFixture
) -> None:
    router = kind()
    test = self_test_at(router)
    try:
        test.add("writes", "users/anna/imu")
        test.add("reads", "map")
        async with asyncio.timeout(30):
            assert await test.denial_reason("writes", "users/anna/imu") == ""
        await until(lambda: router.tests >= 1, what="a test")
        assert await test.denial_reason("writes", "users/anna/imu") == ""
        assert "may not" not in caplog.text
    finally:
        await test.close()


async def test_rights_that_were_added_are_answered_by_the_common_test() -> None:
    router = Router()
    router.denied = lambda key: "ben" in key
    test = self_test_at(router)
    try:
        keys = [f"users/{user}/cursor" for user in ("anna", "ben", "cleo")]
        for key in keys:
            test.add("reads", key)
        async with asyncio.timeout(30):
            reasons = await asyncio.gather(*(test.denial_reason("reads", key) for key in keys))
            assert [bool(reason) for reason in reasons] == [False, True, False]
            assert "may not read users/ben/cursor" in reasons[1]
            done = router.tests
            assert done <= 2  # not one each
            router.denied = lambda _key: True
            assert await test.denial_reason("reads", keys[0]) == ""  # it is known
            assert "may do nothing here" in await test.denial_reason("asks", "leds/brightness")  # it is not
    finally:
        await test.close()


async def test_right_is_tested_until_the_probe_is_closed() -> None:
    router = Router()
    router.denied = lambda key: "imu" in key
    test = self_test_at(router)
    test.add("writes", "users/anna/imu")
    await until(lambda: router.tests >= 4, what="more tests")
    assert "may not write users/anna/imu" in test.problems[0].sentence
    await test.close()
    done = router.tests
    await asyncio.sleep(3 * max(restricted_bus.RETRY_S))
    assert router.tests == done


@pytest.mark.parametrize("turns", range(8))
async def test_probe_closes_while_answers_arrive(turns: int) -> None:
    router = Router()
    test = self_test_at(router)
    test.add("writes", "users/anna/imu")
    await router.asked.wait()
    for _ in range(turns):
        await asyncio.sleep(0)
    async with asyncio.timeout(60.0):
        await test.close()


async def test_right_that_a_busy_router_did_not_test_is_unknown(caplog: pytest.LogCaptureFixture) -> None:
    router = Router()
    router.denied = lambda _key: True
    router.is_busy = True
    test = self_test_at(router)
    try:
        test.add("writes", "users/anna/imu")
        await until(lambda: router.questions >= 2, what="two questions without an end")
        assert not test.problems
        assert not caplog.records
        router.is_busy = False
        await until(lambda: bool(test.problems), what="it to be denied")
        assert "may do nothing here" in test.problems[0].sentence
    finally:
        await test.close()
