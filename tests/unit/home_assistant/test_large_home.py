"""A home with more lamps than fit anywhere, and with ids of any length: it can be set up, and again."""

import asyncio
from pathlib import Path

import pytest

from pointit.bridges.home_assistant.setup.home_files import HomeFiles
from pointit.bridges.home_assistant.setup.listed_lamps import MAX_OFFERED
from tests.support.home_assistant import MemoryHome
from tests.unit.home_assistant.test_setup_session import cards, with_token

pytestmark = pytest.mark.slow
LONG = f"light.{'x' * 329}"


@pytest.mark.parametrize("count", [1300, MAX_OFFERED + 50])
async def test_large_home_is_chosen_from_again_after_a_restart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    names = [f"switch.{number:0243}" for number in range(count)]
    home = MemoryHome({LONG: ("on", {}), **{name: ("on", {}) for name in names}})
    with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await shown.act("connect", url="home.local:8123")
        await shown.until("choose")
        await asyncio.sleep(6.0)
        listed = (await shown.act()).lamps
        assert LONG not in {lamp.id for lamp in listed}
        assert len(listed) > 1000
        chosen = tuple(lamp.id for lamp in listed[:64])
        await shown.act("choose", lamps=chosen)

    # Another process reads what was written
    stored = HomeFiles(tmp_path).state.read()
    assert stored is not None
    assert len(stored.offered) >= min(count, MAX_OFFERED)
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await shown.act("go", step="choose")
        await asyncio.sleep(6.0)
        reply = await shown.act()
        assert [lamp.id for lamp in reply.lamps if lamp.is_chosen] == list(chosen)
        if count > MAX_OFFERED:
            assert any("more lamps are not listed" in sentence for sentence in reply.advice)
