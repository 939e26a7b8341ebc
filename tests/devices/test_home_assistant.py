"""The bridge beside a recorded conversation with a real Home Assistant 2025.4.4, and one in memory."""

import asyncio
import logging
import os
import unicodedata
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from websockets.asyncio.server import ServerConnection, serve

from pointit.bridges.home_assistant.connection import connected
from pointit.cli.maps.exchange import import_
from pointit.cli.maps.home_assistant import HomeEntity, chosen_entities, entities_of, with_things
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import ConfigError
from pointit.schemas.topics import CONFIGURATION, HEALTH
from tests.support.bench import memory_bench, until
from tests.support.buses import free_port
from tests.support.home_assistant import (
    TOKEN,
    HomeSite,
    MemoryHome,
    config_of,
    played,
    reading,
    refusal,
    start,
    thing,
    token_file,
)

RECORDING = Path(__file__).parents[1] / "data/home_assistant_2025_4_4.jsonl"
LAMP = "light.desk"


def lit_home(**attributes: Any) -> MemoryHome:
    return MemoryHome({LAMP: ("on", {"brightness": 100, **attributes}), "switch.fan": ("off", {})})


def brightness(home: MemoryHome) -> Any:
    return home.states[LAMP]["attributes"]["brightness"]


@pytest.fixture
async def home() -> AsyncIterator[tuple[MemoryHome, int]]:
    memory_home = lit_home()
    async with memory_home.serving() as port:
        yield memory_home, port


async def test_recorded_home_assistant_is_switched_and_its_states_come_back(tmp_path: Path) -> None:
    async with played(RECORDING) as port, memory_bench(WallClock()) as bench:
        site = HomeSite(bench, thing("bed", "light.bed_light"), thing("ceiling", "light.ceiling_lights"))
        start(bench, config_of(tmp_path, port, hover=False))
        await until(lambda: site.selected == {"ceiling"}, what="the states of before")
        site.point("bed")
        await until(lambda: len(site.results) == 1, what="the result")
        assert site.selected == {"ceiling", "bed"}
        site.point("bed", on=False)
        await until(lambda: len(site.results) == 2, what="the result")
        assert site.selected == {"ceiling"}
        assert {each.result for each in site.results} == {"done"}


async def test_entities_of_the_recorded_home_assistant_are_listed_by_area(tmp_path: Path) -> None:
    async with (
        played(RECORDING) as port,
        connected(config_of(tmp_path, port)) as connection,
        reading(connection),
    ):
        entities = await entities_of(connection)
    assert [(each.area, each.entity) for each in entities] == [
        ("Bedroom", "light.bed_light"),
        ("Kitchen", "switch.ac"),
        ("Living room", "light.ceiling_lights"),
        ("", "cover.hall_window"),
        ("", "scene.movie"),
    ]
    assert entities[0].name == "Bed Light"


def test_chosen_entities_become_things_of_a_map_whose_text_stays() -> None:
    entities = [
        HomeEntity("Kitchen", "light.desk", "Desk lamp", "on"),
        HomeEntity("Kitchen", "switch.desk", "Desk", "off"),
        HomeEntity("", "light.hall", "hall", "off"),
    ]
    content = b"# mine\nthings:\n  hall: {home_assistant: light.hall}  # known\n"
    chosen = chosen_entities(entities, ["light.*"], ["kitchen"])
    text, names = with_things(content, Path("room.yaml"), chosen)

    assert names == ["desk", "desk_2"]
    assert text.startswith(content)
    assert text.decode().splitlines()[3:] == [
        "  desk: {home_assistant: light.desk, label: Desk lamp}",
        "  desk_2: {home_assistant: switch.desk, label: Desk}",
    ]
    assert with_things(text, Path("room.yaml"), chosen)[1] == [], "again"

    kueche = [HomeEntity("Küche", "light.desk", "Desk lamp", "on")]
    assert chosen_entities(kueche, [], [unicodedata.normalize("NFD", "küche")]) == kueche, "as macOS has it"
    with pytest.raises(ConfigError, match=r"^--area Kitchen: has no entities; there are none$"):
        chosen_entities([], (), ("Kitchen",))
    with pytest.raises(ConfigError, match=r"--entity light\.dsk: fits no entity; did you mean light\.desk"):
        chosen_entities(entities, ["light.dsk"], [])


async def test_selection_acts_newest_wins_and_the_rate_is_limited(
    home: tuple[MemoryHome, int], tmp_path: Path
) -> None:
    memory_home, port = home
    async with memory_bench(WallClock()) as bench:
        site = HomeSite(bench, thing("desk", LAMP), thing("bell", "switch.fan", "button"))
        start(bench, config_of(tmp_path, port))
        await until(lambda: site.selected == {"desk"}, what="the state of the lamp")
        memory_home.latency_s = 0.5
        for on in (False, True, False, True, False):
            site.point("desk", on=on)
        await until(lambda: memory_home.states[LAMP]["state"] == "off", what="the lamp to go off")
        assert len(memory_home.calls) <= 2, "the newest of those that waited"
        site.point("bell")
        await until(lambda: memory_home.states["switch.fan"]["state"] == "on", what="the button to toggle")
        site.point("bell")
        await until(lambda: memory_home.states["switch.fan"]["state"] == "off", what="it to toggle back")


async def test_thing_follows_its_entity_and_failures_have_a_cause(
    home: tuple[MemoryHome, int], tmp_path: Path
) -> None:
    memory_home, port = home
    async with memory_bench(WallClock()) as bench:
        odd = thing("odd", '{"entity": "light.desk", "action": "shell_command.run"}')
        site = HomeSite(
            bench, thing("desk", LAMP), thing("fan", "switch.fan"), thing("typo", "light.dek"), odd
        )
        start(bench, config_of(tmp_path, port, limit_s=2.0))
        await until(lambda: site.selected == {"desk"}, what="the state of the lamp")
        memory_home.set("switch.fan", "on")
        await until(lambda: site.selected == {"desk", "fan"}, what="what was switched there")
        assert memory_home.calls == [], "no echo"

        async def fail(sentence: str, name: str = "desk") -> None:
            known = len(site.results)
            site.point(name, on=False)
            await until(lambda: len(site.results) > known, what=sentence)
            assert sentence in site.told
            assert site.results[-1].result == "failed"

        memory_home.refusal = "the bulb does not answer"
        await fail("refused: Home Assistant refuses light.turn_off on light.desk (the bulb does not answer)")
        memory_home.refusal_code = "unauthorized"
        await fail("refused: this token's user may not switch light.desk in Home Assistant: use another")
        memory_home.refusal_code = "not_found"
        await fail("refused: Home Assistant has no action light.turn_off: correct it in the map")
        memory_home.refusal = ""
        await fail("unavailable: Home Assistant has no light.dek (did you mean light.desk?)", "typo")
        memory_home.is_deaf = True
        await fail("unavailable: shell_command.run on light.desk is not allowed: list it in `home-ass", "odd")
        await fail("no_effect: light.desk did not go off in Home Assistant: is it powered, and in reach?")

        memory_home.set(LAMP, "unavailable")
        await until(lambda: site.states["desk"].state == "unavailable", what="the lamp to have gone")
        await fail("unavailable: light.desk is unavailable in Home Assistant: look into its integration")
        assert site.selected == {"fan"}


async def test_act_after_a_lost_connection_is_refused_with_its_cause(tmp_path: Path) -> None:
    memory_home = lit_home()
    port = free_port()
    async with memory_bench(WallClock()) as bench:
        site = HomeSite(bench, thing("desk", LAMP))
        async with memory_home.serving(port):
            start(bench, config_of(tmp_path, port))
            await until(lambda: site.selected == {"desk"}, what="the state of the lamp")
        await until(lambda: "no Home Assistant answers" in site.states["desk"].reason, what="the cause")
        site.point("desk", on=False)
        await until(lambda: "unavailable: no Home Assistant answers at" in site.told, what="the result")


async def test_lamp_is_restored_after_hover_home_restart_and_service_end(
    tmp_path: Path,
) -> None:
    memory_home = lit_home()
    port = free_port()
    config = config_of(tmp_path, port)
    async with memory_bench(WallClock()) as bench:
        site = HomeSite(bench, thing("desk", LAMP))
        async with memory_home.serving(port):
            launch = start(bench, config)
            await until(lambda: "desk" in site.selected, what="the state of the lamp")
            async with site.hovering("desk"):
                await until(lambda: brightness(memory_home) == 120, what="the hover")
            await until(lambda: brightness(memory_home) == 100, what="the lamp to return")
            async with site.hovering("desk"):
                await until(lambda: brightness(memory_home) == 120, what="the hover")
        async with memory_home.serving(port):
            await until(lambda: brightness(memory_home) == 100, what="the lamp after the restart")
            async with site.hovering("desk"):
                await until(lambda: brightness(memory_home) == 120, what="the hover")
                await bench.end(launch)
            await until(lambda: brightness(memory_home) == 100, what="the lamp after the end")


async def test_wrong_types_from_home_assistant_are_skipped_and_nothing_ends(
    home: tuple[MemoryHome, int], tmp_path: Path
) -> None:
    memory_home, port = home
    memory_home.junk = [7, None, [], {"entity_id": [1], "state": "on"}, {"entity_id": LAMP, "state": {}}]
    async with memory_bench(WallClock()) as bench:
        site = HomeSite(bench, thing("desk", LAMP), thing("fan", "switch.fan"))
        launch = start(bench, config_of(tmp_path, port))
        await until(lambda: "desk" in site.selected, what="the state of the lamp")

        states: list[object] = [
            *(7, "on", {"entity_id": LAMP, "state": ["on"]}),
            {"entity_id": LAMP, "state": "on", "attributes": 1},
        ]
        for state in states:
            memory_home.fire("state_changed", {"entity_id": LAMP, "new_state": state})
        memory_home.fire("state_changed", {"entity_id": [LAMP], "new_state": None})

        memory_home.set("switch.fan", "on")
        await until(lambda: "fan" in site.selected, what="the state of the fan")
        assert not launch.done()


async def test_missing_entity_is_reported_without_naming_other_entities(
    home: tuple[MemoryHome, int], tmp_path: Path
) -> None:
    memory_home, port = home
    memory_home.set("device_tracker.anna", "home")
    async with memory_bench(WallClock()) as bench:
        HomeSite(bench, thing("lock", "lock.qx"))
        warnings: list[str] = []
        bench.bus.subscribe(HEALTH, lambda health, _: warnings.extend(health.warnings), "home-assistant")
        start(bench, config_of(tmp_path, port))
        await until(lambda: any("lock.qx" in each for each in warnings), what="a warning")
    assert "not in Home Assistant: lock.qx of thing lock; correct `home_assistant`" in " ".join(warnings)
    assert "device_tracker" not in " ".join(warnings)


async def test_lamp_that_is_switched_off_while_hovered_keeps_its_brightness(
    home: tuple[MemoryHome, int], tmp_path: Path
) -> None:
    memory_home, port = home
    async with memory_bench(WallClock()) as bench:
        site = HomeSite(bench, thing("desk", LAMP))
        start(bench, config_of(tmp_path, port))
        await until(lambda: "desk" in site.selected, what="the state of the lamp")
        async with site.hovering("desk"):
            await until(lambda: brightness(memory_home) == 120, what="the hover")
            site.point("desk", on=False)
            await until(lambda: memory_home.states[LAMP]["state"] == "off", what="the lamp to go off")
    assert [(call, data) for call, _entity, data in memory_home.calls] == [
        ("light.turn_on", {"brightness": 120}),
        ("light.turn_on", {"brightness": 100}),
        ("light.turn_off", {}),
    ]


async def test_slow_lamp_shows_no_hover_after_two_slow_calls(
    home: tuple[MemoryHome, int], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    memory_home, port = home
    memory_home.latency_s = 0.3
    async with memory_bench(WallClock()) as bench:
        site = HomeSite(bench, thing("desk", LAMP))
        start(bench, config_of(tmp_path, port, max_hover_latency_s=0.1))
        await until(lambda: "desk" in site.selected, what="the state of the lamp")

        for _ in range(2):
            async with site.hovering("desk"):
                await until(lambda: brightness(memory_home) == 120, what="the hover")
            await until(lambda: brightness(memory_home) == 100, what="the lamp to return")
        assert "light.desk takes 0." in caplog.text

        calls = len(memory_home.calls)
        async with site.hovering("desk"):
            await asyncio.sleep(1.5)
        assert len(memory_home.calls) == calls


async def test_rejected_token_is_sent_once_and_reported_until_it_changes(
    home: tuple[MemoryHome, int], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    caplog.set_level(logging.INFO, "websockets.server")  # of the server here
    memory_home, port = home
    memory_home.token = "another"  # noqa: S105 - of a test
    async with memory_bench(WallClock()) as bench:
        health = bench.collect(HEALTH)
        configurations = bench.collect(CONFIGURATION)
        site = HomeSite(bench, thing("desk", LAMP))
        start(bench, config_of(tmp_path, port))
        await until(lambda: bool(health) and "rejects the token in" in str(health[-1]), what="the reason")

        await asyncio.sleep(3.0)
        assert memory_home.logins == [TOKEN], "more would make Home Assistant block this machine"
        token_file(tmp_path, "another")
        await until(lambda: "desk" in site.selected, what="the new token")
        published = f"{health} {configurations} {caplog.text}"
    secret = TOKEN.rpartition(".")[2]

    assert configurations
    assert secret not in published
    assert "another" not in published


async def test_server_that_is_no_home_assistant_gets_no_token(tmp_path: Path) -> None:
    received: list[str | bytes] = []

    async def other(websocket: ServerConnection) -> None:
        await websocket.send('{"hello": 1}')
        received.extend([text async for text in websocket])

    async with serve(other, "127.0.0.1", 0) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        assert "is no Home Assistant (it does not begin as one): correct `url`" in await refusal(
            config_of(tmp_path, port)
        )
    assert received == []


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n", "is no Home Assistant (it answers 404)"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nhi", "is no Home Assistant (it answers 200)"),
        (b"HTTP/1.0 404 File not found\r\n\r\n", "is no Home Assistant (it does not answer as one)"),
        (b"SSH-2.0-OpenSSH_9.2\r\n", "is no Home Assistant (it does not answer as one)"),
        (b"", "is no Home Assistant (it does not answer as one)"),
        (b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\n\r\n", "blocks this machine (403): look for its"),
        (b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n", "(400): add the proxy in front of Home"),
        (
            b"HTTP/1.1 401 Unauthorized\r\nContent-Length: 0\r\n\r\n",
            "a login page is in front of http://127.0.0.1",
        ),
        (b"HTTP/1.1 502 Bad Gateway\r\nContent-Length: 0\r\n\r\n", "does not reach Home Assistant (502)"),
        (
            b"HTTP/1.1 301 Moved\r\nLocation: https://ha.example/api/websocket\r\nContent-Length: 0\r\n\r\n",
            "refers to another address: write https://ha.example as `url`",
        ),
        (
            b"HTTP/1.1 302 Found\r\nLocation: https://auth.example/?rd=%2Fapi%2Fwebsocket\r\n\r\n",
            "(302), and PointIt has no login for it: write the address of Home Assistant itself",
        ),
        (
            b"HTTP/1.1 302 Found\r\nLocation: /auth/login?next=/api/websocket\r\nContent-Length: 0\r\n\r\n",
            "a login page is in front of",
        ),
        (
            b"HTTP/1.1 307 Moved\r\nLocation: http://[bad/api/websocket\r\nContent-Length: 0\r\n\r\n",
            "a login page is in front of",
        ),
    ],
)
async def test_answers_of_other_servers_give_one_sentence(
    answer: bytes, sentence: str, tmp_path: Path
) -> None:
    async def reply(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(100)
        writer.write(answer)
        writer.close()

    async with await asyncio.start_server(reply, "127.0.0.1", 0) as server:
        port = server.sockets[0].getsockname()[1]
        problem = await refusal(config_of(tmp_path, port))
    assert sentence in problem
    assert "auth.example" not in problem


async def test_proxy_path_is_used_and_a_wrong_one_is_named(tmp_path: Path) -> None:
    paths: list[str] = []

    async def reply(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        paths.append((await reader.read(1000)).decode().split()[1])
        writer.write(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n")
        writer.close()

    async with await asyncio.start_server(reply, "127.0.0.1", 0) as server:
        address = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        sentence = f"no Home Assistant is at /lovelace/0 of {address} (404): write {address} as `url`"
        assert sentence in await refusal(config_of(tmp_path, 1, url=f"{address}/lovelace/0/"))
    assert "/lovelace/0/api/websocket" in paths


async def test_name_that_is_not_known_is_named(tmp_path: Path) -> None:
    sentence = "the name hub.invalid in `url` is not known in this network ("
    assert sentence in await refusal(config_of(tmp_path, 1, url="http://hub.invalid:8123"))


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"url": "homeassistant.local:8123"}, "url: write http://HOST:8123"),
        ({"url": "http://me:s3cr3t@hub:8123"}, "url: write http://HOST:8123"),
        ({"url": "ftp://hub"}, "url: write http://HOST:8123"),
        ({"url": "http://fd00::5:8123"}, "url: write an IPv6 address in brackets"),
        ({"url": "http://hub:8123/lovelace/0?edit=1"}, "without the address of a page"),
        ({"url": ""}, "url: is missing"),
        ({"token_file": TOKEN}, "token_file: is a token itself"),
        ({"token_file": f"Bearer {TOKEN}"}, "token_file: is a token itself"),
        ({"token_file": ""}, "token_file: is missing"),
        ({"token_file": "/none"}, "/none does not exist"),
    ],
)
def test_wrong_options_give_one_sentence_without_secrets(
    parameters: dict[str, str], sentence: str, tmp_path: Path
) -> None:
    options = {"url": "http://hub:8123", "token_file": str(token_file(tmp_path)), **parameters}
    arguments = ["home-assistant"]
    for name, value in options.items():
        arguments += [f"--{name.replace('_', '-')}", value]
    result = CliRunner().invoke(import_, arguments)
    assert sentence in str(result.exception)
    assert "s3cr3t" not in str(result.exception) + result.output


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        *(
            (each, "does not hold one token and")
            for each in (b"", b"two words", b"\xff\xfe", b"x" * 5000, b"\xc3\xa4")
        ),
        *((each, "has quotation marks around the token; remove") for each in (b"'eyJ.a.b'", b'"eyJ.a.b"')),
    ],
)
def test_file_without_a_token_is_named_and_not_quoted(content: bytes, sentence: str, tmp_path: Path) -> None:
    config = config_of(tmp_path, 1)
    Path(config.token_file).write_bytes(content)
    with pytest.raises(ConfigError, match=f"token {sentence}"):
        config.read_token()


@pytest.mark.skipif(os.name != "posix", reason="rights of files")
def test_exposed_token_file_is_refused_unless_the_system_provides_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As systemd (`LoadCredential`, 0440 of root), and a container's engine (secrets, 0444) give them."""
    config = config_of(tmp_path, 1)
    path = Path(config.token_file)
    me = os.geteuid()
    path.chmod(0o640)
    with pytest.raises(ConfigError, match=r"token: others can read it; make it yours alone with `chmod 600"):
        config.read_token()

    path.chmod(0o440)
    monkeypatch.setattr(os, "geteuid", lambda: me + 1)
    assert config.read_token()

    path.chmod(0o444)
    with pytest.raises(ConfigError, match="others can read it"):
        config.read_token()

    mount = os.statvfs(path)
    read_only = os.statvfs_result((*mount[:8], mount.f_flag | os.ST_RDONLY, *mount[9:]))

    def look(_path: Path) -> os.statvfs_result:
        return read_only

    monkeypatch.setattr(os, "statvfs", look)
    assert config.read_token()


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("http://[fd00::5]:8123", "ws://[fd00::5]:8123/api/websocket"),
        ("https://home.example/hass/", "wss://home.example/hass/api/websocket"),
        ("http://supervisor/core", "ws://supervisor/core/api/websocket"),
    ],
)
def test_address_of_the_websocket_is_below_the_path(url: str, address: str, tmp_path: Path) -> None:
    assert config_of(tmp_path, 1, url=url).websocket_url == address


async def test_connection_leaves_no_task_if_its_end_is_cancelled(tmp_path: Path) -> None:
    before: set[asyncio.Task[Any]] = set()
    is_open = asyncio.Event()
    is_over = asyncio.Event()

    async def answer(websocket: ServerConnection) -> None:
        before.update(asyncio.all_tasks())  # without that of the client's pings, which is not connected yet
        await websocket.send('{"type": "auth_required"}')
        await websocket.recv()
        await websocket.send('{"type": "auth_ok"}')
        websocket.transport.pause_reading()  # it does not answer to the end
        await is_over.wait()

    async def connect_and_end(port: int) -> None:
        async with connected(config_of(tmp_path, port)):
            is_open.set()

    async with serve(answer, "127.0.0.1", 0, ping_interval=None, close_timeout=0) as server:
        client = asyncio.create_task(connect_and_end(next(iter(server.sockets)).getsockname()[1]))
        await is_open.wait()
        client.cancel()
        await asyncio.wait([client])
        assert client.cancelled()
        left = asyncio.all_tasks() - before
        is_over.set()
    assert not left
