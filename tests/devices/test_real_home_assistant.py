"""The bridge beside a real Home Assistant, at night: import, act, state back, and kills during a hover.

Home Assistant needs an environment of its own, with its Python: `python3.13 -m venv DIR` and
`DIR/bin/pip install homeassistant==2025.4.4`, or `python3.14 -m venv DIR` and `DIR/bin/pip install
homeassistant numpy av`, and what `demo` needs, which Home Assistant else fetches at its first start:
`gazetteer-matcher hassil home-assistant-intents mutagen PyNaCl PyTurboJPEG`, as its manifests have them.
HOME_ASSISTANT_PYTHON=DIR/bin/python scripts/test -m long tests/devices/test_real_home_assistant.py then
starts one with its integration `demo`, and ends it.
"""

import asyncio
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.asyncio.client import connect

from pointit.bridges.home_assistant import hover_feedback
from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.connection import HomeAssistantConnection, connected
from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.cli.maps.home_assistant import entities_of
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import RefusedError
from pointit.schemas.topics import HEALTH
from tests.support.bench import memory_bench, until
from tests.support.buses import free_port
from tests.support.home_assistant import HomeSite, reading, start, thing

PYTHON = os.environ.get("HOME_ASSISTANT_PYTHON", "")
KILLS = int(os.environ.get("HOME_ASSISTANT_KILLS", "200"))
BRIGHTNESS = 100
LAMP = "light.ceiling_lights"  # without an effect, with which a lamp shows no hover
CONFIGURATION = """
http: {{server_host: 127.0.0.1, server_port: {port}}}
config:
websocket_api:
demo:
"""
pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not PYTHON, reason="HOME_ASSISTANT_PYTHON names no Python with Home Assistant"),
]


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Generator[HomeAssistantConfig]:
    """Start a Home Assistant with a user and a token."""
    folder = tmp_path_factory.mktemp("home")
    port = free_port()
    (folder / "configuration.yaml").write_text(CONFIGURATION.format(port=port))
    hass = (PYTHON, "-m", "homeassistant")
    login = ("--script", "auth", "-c", str(folder), "add", "anna", "of a test")
    subprocess.run((*hass, *login), check=True, timeout=300)
    with (
        (folder / "log").open("w") as log,
        subprocess.Popen((*hass, "-c", str(folder)), stdout=log, stderr=log) as process,
    ):
        try:
            fields = {"url": f"http://127.0.0.1:{port}", "token_file": str(folder / "token")}
            (folder / "token").write_text(asyncio.run(token_of(fields["url"])))
            (folder / "token").chmod(0o600)
            config = HomeAssistantConfig.model_validate(fields)
            asyncio.run(prepare(config))
            yield config
        finally:
            process.terminate()


async def token_of(url: str) -> str:
    """Return a long-lived token, as soon as Home Assistant runs."""

    def post(path: str, fields: dict[str, Any], *, is_form: bool = False) -> Any:
        body: dict[str, Any] = {"data" if is_form else "json": fields}
        return httpx.post(url + path, timeout=60.0, **body).raise_for_status().json()

    client = {"client_id": f"{url}/"}
    flow: dict[str, Any] = {}
    for _ in range(300):
        try:
            begin = {**client, "handler": ["homeassistant", None], "redirect_uri": f"{url}/"}
            flow = post("/auth/login_flow", begin)
            break
        except httpx.TransportError:
            await asyncio.sleep(1.0)
    login = {**client, "username": "anna", "password": "of a test"}
    code = post(f"/auth/login_flow/{flow['flow_id']}", login)["result"]
    tokens = post("/auth/token", {**client, "grant_type": "authorization_code", "code": code}, is_form=True)
    async with connect(url.replace("http", "ws") + "/api/websocket") as websocket:
        await websocket.recv()
        await websocket.send(json.dumps({"type": "auth", "access_token": tokens["access_token"]}))
        await websocket.recv()
        wanted = {"id": 1, "type": "auth/long_lived_access_token", "client_name": "PointIt", "lifespan": 1}
        await websocket.send(json.dumps(wanted))
        return str(json.loads(await websocket.recv())["result"])


async def prepare(config: HomeAssistantConfig) -> None:
    """Wait for the lamps of `demo`, and have Home Assistant keep its port."""
    async with connected(config) as connection, reading(connection):
        with contextlib.suppress(RefusedError):  # of versions before 2026, which keep it anyway
            await connection.request("http/config/promote")
        for _ in range(300):
            if LAMP in await connection.states():
                return
            await asyncio.sleep(0.2)
        raise AssertionError(f"{LAMP} is not there: see the log of Home Assistant for what `demo` misses")


async def lamp(connection: HomeAssistantConnection) -> tuple[str, Any]:
    state = (await connection.states())[LAMP]
    return state["state"], state["attributes"].get("brightness")


async def test_lamp_is_imported_switched_and_shows_what_was_switched_there(
    config: HomeAssistantConfig,
) -> None:
    async with connected(config) as connection, reading(connection), memory_bench(WallClock()) as bench:
        assert LAMP in {each.entity for each in await entities_of(connection)}
        await connection.call(ServiceCall(LAMP, "light", "turn_off"))
        site = HomeSite(bench, thing("bed", LAMP), thing("gone", "light.none"))
        start(bench, config)
        await asyncio.sleep(2.0)
        site.point("bed")
        for _ in range(300):
            if (await lamp(connection))[0] == "on":
                break
            await asyncio.sleep(0.1)
        assert (await lamp(connection))[0] == "on"
        await connection.call(ServiceCall(LAMP, "light", "turn_off"))
        await until(lambda: "bed" not in site.selected, what="what was switched there")


async def test_deleted_token_is_reported_and_a_new_one_is_used(
    config: HomeAssistantConfig, tmp_path: Path
) -> None:
    async with connected(config) as connection, reading(connection), memory_bench(WallClock()) as bench:

        async def new_token(name: str) -> str:
            return str(await connection.request("auth/long_lived_access_token", client_name=name, lifespan=1))

        (tmp_path / "token").write_text(await new_token("to be deleted"))
        (tmp_path / "token").chmod(0o600)
        health = bench.collect(HEALTH)
        site = HomeSite(bench, thing("bed", LAMP))
        await connection.call(ServiceCall(LAMP, "light", "turn_on"))
        start(bench, config.model_copy(update={"token_file": str(tmp_path / "token")}))
        await until(lambda: "bed" in site.selected, what="the state of the lamp")
        for token in await connection.request("auth/refresh_tokens"):
            if token["client_name"] == "to be deleted":
                await connection.request("auth/delete_refresh_token", refresh_token_id=token["id"])
        await until(lambda: "rejects the token in" in str(health[-1:]), what="the reason")
        (tmp_path / "token").write_text(await new_token("another"))
        await connection.call(ServiceCall(LAMP, "light", "turn_off"))
        await until(lambda: "bed" not in site.selected, what="what was switched there")


async def hover(config: HomeAssistantConfig) -> None:
    """Run the bridge beside a person who points at the lamp again and again."""
    async with memory_bench(WallClock()) as bench:
        site = HomeSite(bench, thing("bed", LAMP))
        start(bench, config)
        while True:
            async with site.hovering("bed"):
                await asyncio.sleep(0.2)
            await asyncio.sleep(0.2)


async def restored(config: HomeAssistantConfig) -> tuple[str, Any]:
    """Run the bridge beside nobody, and return the state of the lamp."""
    async with connected(config) as connection, reading(connection), memory_bench(WallClock()) as bench:
        HomeSite(bench, thing("bed", LAMP))
        start(bench, config)
        for _ in range(300):
            if (await lamp(connection))[1] == BRIGHTNESS:
                break
            await asyncio.sleep(0.1)
        return await lamp(connection)


@pytest.mark.timeout(3600)
def test_no_lamp_is_left_changed_after_kills_during_hovers(
    config: HomeAssistantConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hover_feedback, "STANDING_S", 0.0)  # each process restores it by a call

    async def set_brightness() -> None:
        async with connected(config) as connection, reading(connection):
            await connection.call(ServiceCall(LAMP, "light", "turn_on", {"brightness": BRIGHTNESS}))

    async def seen() -> Any:
        async with connected(config) as connection, reading(connection):
            return (await lamp(connection))[1]

    asyncio.run(set_brightness())
    changed = 0
    for number in range(KILLS):
        if (child := os.fork()) == 0:
            asyncio.run(hover(config))
        asyncio.run(asyncio.sleep(random.uniform(0.05, 2.0)))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        changed += asyncio.run(seen()) != BRIGHTNESS
        if number % 2 or number == KILLS - 1:  # after the others, the next process hovers at once
            assert asyncio.run(restored(config)) == ("on", BRIGHTNESS), f"after kill {number + 1}"
    sys.stdout.write(f"{KILLS} kills, after {changed} of them the lamp was changed\n")
    assert changed, "some kills have to come while the lamp is changed"
