# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false
# (the stubs of zenoh leave return types out)
"""Presence on a foreign network, when more come and go than can wait for the loop."""

import asyncio
import time
from collections.abc import AsyncIterator, Mapping
from typing import Any

import pytest
import pytest_asyncio
import zenoh

from pointit.runtime.foreign_zenoh import liveliness
from pointit.runtime.foreign_zenoh.raw_session import RawSession, open_raw_session
from pointit.runtime.foreign_zenoh.session_config import RawLink
from tests.support.bench import until

NAMES = {f"@lab/{index}" for index in range(6)}


@pytest_asyncio.fixture
async def pair(endpoint: str) -> AsyncIterator[tuple[RawSession, zenoh.Session]]:
    """Yield a session of ours, which routes, and that of a stranger."""
    ours = await open_raw_session(RawLink(endpoint=endpoint, mode="router"))
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", f'["{endpoint}"]')
    stranger = await asyncio.to_thread(zenoh.open, config)
    try:
        yield ours, stranger
    finally:
        await asyncio.to_thread(stranger.close)
        await ours.close()


class Crowd:
    """Present tokens, as our reader reports them."""

    def __init__(self, ours: RawSession) -> None:
        self.present: set[str] = set()
        self.reader: Any = ours.watch_tokens("@lab/*", self._take)

    def _take(self, changes: Mapping[str, bool]) -> None:
        for token, present in changes.items():
            (self.present.add if present else self.present.discard)(token)

    def hold_up(self, dropped: int) -> None:
        """Keep the loop until so many changes found no room."""
        until_s = time.monotonic() + 15.0
        while self.reader.dropped < dropped and time.monotonic() < until_s:
            time.sleep(0.01)
        assert self.reader.dropped >= dropped


async def test_tokens_changed_during_overflow_are_known_in_the_end(
    pair: tuple[RawSession, zenoh.Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(liveliness, "MAX_WAITING_TOKENS", 2)
    ours, stranger = pair
    crowd = Crowd(ours)
    own = ours.token("@lab/own")
    await until(lambda: crowd.present == {"@lab/own"})
    tokens = [stranger.liveliness().declare_token(name) for name in sorted(NAMES)]
    crowd.hold_up(4)
    await until(lambda: crowd.present == NAMES | {"@lab/own"}, what="those who came to be known")
    for token in tokens:
        token.undeclare()
    crowd.hold_up(8)
    await until(lambda: crowd.present == {"@lab/own"}, what="those who went to be gone")
    own.close()
    await until(lambda: not crowd.present)


async def test_changes_during_a_query_for_all_override_its_answer(
    pair: tuple[RawSession, zenoh.Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(liveliness, "MAX_WAITING_TOKENS", 2)
    ours, stranger = pair
    crowd = Crowd(ours)
    tokens = [stranger.liveliness().declare_token(name) for name in sorted(NAMES)]
    crowd.hold_up(4)
    await until(lambda: crowd.present == NAMES)
    reader = crowd.reader
    reader._since = {"@lab/0", "@lab/9"}
    reader._found = NAMES - {"@lab/0", "@lab/1"} | {"@lab/8", "@lab/9"}
    reader._mark()
    await until(lambda: crowd.present == NAMES - {"@lab/1"} | {"@lab/8"})
    assert len(tokens) == len(NAMES)
