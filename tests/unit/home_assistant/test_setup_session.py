"""The set-up of a home beside a Home Assistant in memory: lamps that are lit, presses, files."""

import asyncio
import math
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from pointit.bridges.home_assistant import service
from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.connection import HomeAssistantConnection
from pointit.bridges.home_assistant.home_connection import NoHomeAssistantError
from pointit.bridges.home_assistant.setup.home_files import HomeFiles
from pointit.runtime.errors import RefusedError
from pointit.schemas import ButtonEvent, HomeSetup, PointingRay, SetUpHome
from pointit.schemas.topics import BUTTON, RAY, SET_UP_HOME
from tests.support.bench import Bench, memory_bench, repeated, until
from tests.support.home_assistant import (
    TOKEN,
    HomeSite,
    MemoryHome,
    config_of,
    start,
    thing,
    token_file,
)

DESK = "light.desk"
DOOR = "light.door"


def home_of_two() -> MemoryHome:
    return MemoryHome(
        {DESK: ("on", {"brightness": 100}), DOOR: ("off", {}), "light.hall": ("unavailable", {})}
    )


HALL = "light.hall"
HOME_URL = "http://home.local:8123"


def home_of_silent() -> MemoryHome:
    """Return a home with a lamp that reports its state only when it changes."""
    return MemoryHome({HALL: ("unknown", {}), DOOR: ("off", {})})


class Cards:
    """The cards of a page."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    async def act(self, act: Any = "read", **fields: Any) -> HomeSetup:
        return await self._bench.bus.call(SET_UP_HOME, SetUpHome(act=act, **fields))

    async def until(self, step: str) -> HomeSetup:
        async with asyncio.timeout(30):
            while True:
                setup = await self.act()
                if setup.step == step:
                    return setup
                await asyncio.sleep(0.5)


@asynccontextmanager
async def cards(
    home: MemoryHome, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> AsyncGenerator[tuple[Bench, Cards]]:
    monkeypatch.setattr(service, "connected", home.connected)
    async with memory_bench() as bench:
        start(bench, HomeAssistantConfig(setup=str(folder)))
        await asyncio.sleep(1.0)
        yield bench, Cards(bench)


def with_token(folder: Path) -> HomeFiles:
    files = HomeFiles(folder)
    files.create()
    token_file(folder).rename(files.token)
    return files


async def at_place(shown: Cards) -> None:
    await shown.act("connect", url="home.local:8123")
    setup = await shown.until("choose")
    assert setup.is_connected
    await asyncio.sleep(6.0)
    assert {lamp.id for lamp in (await shown.act()).lamps} == {DESK, DOOR, "light.hall"}
    await shown.act("choose", lamps=(DESK, DOOR))
    await shown.act("hand", hand="phone", user="anna")


def pointing(bench: Bench, azimuth_rad: float) -> Any:
    """Publish rays of anna in a direction while the block runs."""

    def ray() -> None:
        direction = (math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0)
        bench.put(
            RAY, PointingRay(stamp_ns=bench.clock.now_ns(), origin_m=(0, 0, 1.6), direction=direction), "anna"
        )

    return repeated(0.05, ray)


async def test_lamp_is_lit_at_its_turn_and_restored_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_two()
    with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (bench, shown):
        await at_place(shown)
        assert (await shown.act()).target == DESK
        levels = set[int]()
        for _ in range(20):
            await shown.act()
            await asyncio.sleep(0.3)
            levels.add(home.states[DESK]["attributes"]["brightness"])
        assert levels == {100, 120}, "it was on: it is brighter, now and then"

        async with pointing(bench, 0.2):
            await asyncio.sleep(1.0)
            bench.put(BUTTON, ButtonEvent(stamp_ns=bench.clock.now_ns()), "anna")
            await asyncio.sleep(0.5)
        assert (await shown.act()).target == DOOR
        await asyncio.sleep(1.0)
        assert home.states[DOOR]["state"] == "on"

        await asyncio.sleep(20.0)  # the page is closed
        assert (home.states[DOOR]["state"], home.states[DESK]["attributes"]["brightness"]) == ("off", 100)


async def press(bench: Bench, azimuth_rad: float) -> None:
    """Press while anna points in a direction."""
    async with pointing(bench, azimuth_rad):
        await asyncio.sleep(1.0)
        bench.put(BUTTON, ButtonEvent(stamp_ns=bench.clock.now_ns()), "anna")
        await asyncio.sleep(0.5)


async def test_placed_lamp_is_not_switched_until_the_person_points_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_two()
    with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (bench, shown):
        await at_place(shown)
        await press(bench, 0.3)
        await press(bench, -0.3)
        await shown.act("stay")
        await shown.until("try")
        site = HomeSite(bench, thing("desk", DESK), thing("door", DOOR))
        await asyncio.sleep(25.0)  # the lamp of the turn is dark again

        async with pointing(bench, -0.35):
            await asyncio.sleep(0.5)
            site.point("door")
            await asyncio.sleep(1.0)
        sentence = "you still point where you pressed: point elsewhere first, and then at it"
        assert site.told == f"refused: {sentence}"
        assert home.states[DOOR]["state"] == "off"
        assert (await shown.act()).problem == sentence, "the card says it, until they do so"
        site.point("door", user="ben")
        await asyncio.sleep(1.0)
        assert home.states[DOOR]["state"] == "on", "others did not press"

        async with pointing(bench, 0.3):
            await asyncio.sleep(0.5)
            site.point("desk", on=False)
            await asyncio.sleep(1.0)
        assert home.states[DESK]["state"] == "off"
        assert (await shown.act()).problem == ""


async def test_lit_lamp_that_somebody_sets_is_left_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_two()
    with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await at_place(shown)
        await shown.act("show", lamps=(DOOR,))
        await asyncio.sleep(1.0)
        assert home.states[DOOR]["state"] == "on"
        home.act("turn_on", DOOR, {"brightness": 30})
        await asyncio.sleep(20.0)
        assert home.states[DOOR]["state"] == "on"


async def test_lamp_that_was_lit_before_a_kill_goes_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_two()
    with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await at_place(shown)
        await shown.act("show", lamps=(DOOR,))
        await asyncio.sleep(1.0)
        home.is_deaf = True  # killed: nothing more comes from it
    home.is_deaf = False
    assert home.states[DOOR]["state"] == "on"
    async with cards(home, tmp_path, monkeypatch):
        await until(lambda: home.states[DOOR]["state"] == "off", what="off again")


async def silent_lamp_at_its_turn(shown: Cards) -> None:
    await shown.act("connect", url=HOME_URL)
    await shown.until("choose")
    await asyncio.sleep(6.0)
    await shown.act("choose", lamps=(HALL, DOOR))
    await shown.act("hand", hand="phone", user="anna")


async def watch(shown: Cards, duration_s: float) -> HomeSetup:
    """Keep the card open for a time, and return what it shows then."""
    for _ in range(round(duration_s / 0.5)):
        await shown.act()
        await asyncio.sleep(0.5)
    return await shown.act()


async def test_silent_lamp_is_lit_at_its_turn_and_off_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_silent()
    with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await silent_lamp_at_its_turn(shown)
        setup = await watch(shown, 3.0)
        assert (home.states[HALL]["state"], setup.is_lit, setup.goes_off) == ("unknown", False, False)
        setup = await watch(shown, 3.0)
        assert (home.states[HALL]["state"], setup.is_lit, setup.goes_off) == ("on", True, True)

        await shown.act("skip")
        setup = await watch(shown, 3.0)
        assert (setup.target, setup.goes_off) == (DOOR, False)
        assert home.states[HALL]["state"] == "off"


async def test_lamp_that_reports_nothing_at_all_is_told_to_go_off_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_silent()
    home.is_deaf = True
    with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await silent_lamp_at_its_turn(shown)
        setup = await watch(shown, 6.0)
        assert (setup.is_lit, setup.goes_off) == (False, True)
        await shown.act("skip")
        await watch(shown, 10.0)
    calls = [action for action, entity, _data in home.calls if entity == HALL]
    assert calls == ["light.turn_on", "light.turn_off"]


async def test_lamp_that_reports_late_is_restored_exactly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_silent()
    with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await silent_lamp_at_its_turn(shown)
        await watch(shown, 2.0)
        home.set(HALL, "on", brightness=70)
        setup = await watch(shown, 6.0)
        assert (setup.is_lit, setup.goes_off) == (True, False)
        await shown.act("skip")
        await asyncio.sleep(20.0)
    assert (home.states[HALL]["state"], home.states[HALL]["attributes"]["brightness"]) == ("on", 70)


async def test_silent_lamp_is_not_lit_for_a_look_at_the_list(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_silent()
    with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await shown.act("connect", url=HOME_URL)
        await shown.until("choose")
        for _ in range(10):
            await shown.act("show", lamps=(HALL,))
            await asyncio.sleep(1.0)
    assert home.calls == []


async def test_silent_lamp_that_was_lit_before_a_kill_goes_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_silent()
    with_token(tmp_path)
    home.is_deaf = True
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await silent_lamp_at_its_turn(shown)
        await watch(shown, 6.0)
    home.calls.clear()
    async with cards(home, tmp_path, monkeypatch):
        await until(lambda: ("light.turn_off", HALL, {}) in home.calls, what="off")


async def test_wrong_token_is_reported_and_another_one_tried_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_two()
    files = with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        with pytest.raises(RefusedError, match="no address of a Home Assistant"):
            await shown.act("connect", url="ftp://home")
        assert (await shown.act()).step == "connect"
        await shown.act("connect", url="http://home.local:8123")
        await shown.until("choose")
    assert "home.local:8123" in files.site.read_text()
    assert TOKEN not in files.site.read_text() + files.state.path.read_text()


async def test_stored_token_is_sent_to_no_other_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = with_token(tmp_path)
    async with cards(home_of_two(), tmp_path, monkeypatch) as (_bench, shown):
        await shown.act("connect", url="http://home.local:8123")
        await shown.until("choose")
        refusal = "is that of http://home.local:8123: give that of the new address"
        with pytest.raises(RefusedError, match=refusal):
            await shown.act("connect", url="http://elsewhere:8123")
        await shown.act("without")
        with pytest.raises(RefusedError, match=refusal):
            await shown.act("connect", url="http://elsewhere:8123")
        assert "elsewhere" not in files.site.read_text()

        # A token that is given again may be for the new address
        files.token.write_text(TOKEN)
        assert (await shown.act("connect", url="http://elsewhere:8123")).url == "http://elsewhere:8123"


NEW = "0123456789abcdef"
NEW_FILE = f"{NEW}.new-secret"


def give_token(folder: Path, token: str) -> str:
    """Write a token as the page does, and return its name."""
    file = folder / NEW_FILE
    file.write_text(token)
    file.chmod(0o600)
    return NEW


async def test_rejected_token_leaves_the_working_one_in_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_two()
    files = with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await shown.act("connect", url=HOME_URL)
        await shown.until("choose")
        site = files.site.read_text()
        await shown.act("connect", url=HOME_URL, secret=give_token(tmp_path, "mistyped"))
        await asyncio.sleep(10.0)

        setup = await shown.act()
        assert "rejects the token" in setup.problem
        assert f"{HOME_URL} is used as before" in setup.problem
        assert (setup.step, setup.url, setup.is_connected) == ("connect", HOME_URL, True)
    assert home.logins == [TOKEN, "mistyped", TOKEN], "a wrong one is sent once"
    assert files.token.read_text().strip() == TOKEN
    assert not (tmp_path / NEW_FILE).exists()
    assert files.site.read_text() == site


async def test_address_without_an_answer_leaves_the_working_one_in_use(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_two()
    files = with_token(tmp_path)

    @asynccontextmanager
    async def connected(config: HomeAssistantConfig) -> AsyncGenerator[Any]:
        if config.url != HOME_URL:
            raise NoHomeAssistantError(f"no Home Assistant answers at {config.url}")
        async with home.connected(config) as connection:
            yield connection

    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        monkeypatch.setattr(service, "connected", connected)
        await shown.act("connect", url=HOME_URL)
        await shown.until("choose")
        await shown.act("connect", url="http://mistyped", secret=give_token(tmp_path, "another"))
        await asyncio.sleep(10.0)

        setup = await shown.act()
        sentence = f"no Home Assistant answers at http://mistyped. {HOME_URL} is used as before"
        assert (setup.problem, setup.url, setup.is_connected) == (sentence, HOME_URL, True)
    assert files.token.read_text().strip() == TOKEN
    assert home.logins == [TOKEN, TOKEN], "the working token is sent to no other address"


async def test_accepted_token_replaces_the_stored_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_two()
    files = with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await shown.act("connect", url=HOME_URL)
        await shown.until("choose")
        home.token = "another"  # noqa: S105 - of a test
        await shown.act("connect", url=HOME_URL, secret=give_token(tmp_path, "another"))
        await shown.until("choose")

        assert (files.token.read_text(), files.token.stat().st_mode & 0o777) == ("another", 0o600)
        assert not (tmp_path / NEW_FILE).exists()
        home.disconnect()
        await asyncio.sleep(5.0)
        assert (await shown.act()).is_connected
    assert home.logins == [TOKEN, "another", "another"]


async def test_first_token_is_tried_until_another_one_is_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = home_of_two()
    files = HomeFiles(tmp_path)
    files.create()
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await shown.act("connect", url=HOME_URL, secret=give_token(tmp_path, "mistyped"))
        await asyncio.sleep(10.0)
        setup = await shown.act()
        assert (setup.step, setup.is_connected, setup.has_token) == ("connect", False, True)
        assert not files.token.exists()
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        assert "rejects the token" in (await shown.act()).problem
        await shown.act("connect", url=HOME_URL, secret=give_token(tmp_path, TOKEN))
        await shown.until("choose")
    assert files.token.read_text() == TOKEN


async def test_address_in_the_parameters_stays_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = home_of_two()
    files = HomeFiles(tmp_path)
    files.create()
    written = f"home_assistant: {{url: '{HOME_URL}', token_file: /token, hover: false}}\n"
    files.site.write_text(written)
    monkeypatch.setattr(service, "connected", home.connected)
    async with memory_bench() as bench:
        start(bench, config_of(tmp_path, 1, setup=str(tmp_path)))
        await asyncio.sleep(1.0)
        shown = Cards(bench)
        await shown.until("choose")
        await shown.act("connect", url=HOME_URL, secret=give_token(tmp_path, "mistyped"))
        await asyncio.sleep(10.0)
        assert "is used as before" in (await shown.act()).problem
    assert files.site.read_text() == written


async def test_sentences_beyond_the_limit_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_token(tmp_path)
    sentences = [f"lamp {number} cannot be used" for number in range(30)]
    monkeypatch.setattr(HomeAssistantConnection, "refusals", sentences)
    async with cards(home_of_two(), tmp_path, monkeypatch) as (_bench, shown):
        await shown.act("connect", url=HOME_URL)
        advice = (await shown.until("choose")).advice
        assert (len(advice), advice[-1]) == (
            20,
            "there are 11 more such sentences: deal with these first",
        )


async def test_press_without_movement_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_token(tmp_path)
    async with cards(home_of_two(), tmp_path, monkeypatch) as (_bench, shown):
        await at_place(shown)
        with pytest.raises(RefusedError, match="no movement of anna arrives"):
            await shown.act("press")


async def test_run_without_a_home_refuses_its_cards(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = home_of_two()
    monkeypatch.setattr(service, "connected", home.connected)
    async with memory_bench() as bench:
        start(bench, config_of(tmp_path, 1))
        await asyncio.sleep(1.0)
        with pytest.raises(RefusedError, match="pointit home"):
            await Cards(bench).act()


async def test_new_lamp_of_home_assistant_is_offered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = home_of_two()
    with_token(tmp_path)
    async with cards(home, tmp_path, monkeypatch) as (_bench, shown):
        await at_place(shown)
        await shown.act("hand", hand="mouse", user="anna")
        await shown.act("finish")
        home.set("light.new", "off")
        await asyncio.sleep(6.0)
        assert [lamp.id for lamp in (await shown.act()).lamps if lamp.is_new] == ["light.new"]


async def test_address_without_a_port_is_that_of_home_assistant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_token(tmp_path)
    async with cards(home_of_two(), tmp_path, monkeypatch) as (_bench, shown):
        setup = await shown.act("connect", url="192.168.77.1")
        assert setup.url == "http://192.168.77.1:8123"
