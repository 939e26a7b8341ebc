"""The cards of a home at the page's server: the token, rights, and the requests that an answer calls for."""

import json
import logging
from pathlib import Path
from typing import Any

import pytest

from pointit.runtime.errors import RefusedError
from pointit.schemas import Done, HomeSetup, SetPose, SetUpHome, ShowPixels, UseMap, UseMapReply
from pointit.schemas.topics import SET_POSE, SET_UP_HOME, SHOW_PIXELS, USE_MAP
from tests.integration.web.pages import VIEWER, serving
from tests.support.bench import Bench, memory_bench

SECRET = "eyJhbGciOiJIUzI1NiJ9.eyJpc3MiOiI4ZGUwIn0.s3cr3t"  # noqa: S105 - of a test


class HomeServer:
    """Answers in place of home-assistant, pui and localizer, and notes what it is asked."""

    def __init__(self, bench: Bench, reply: HomeSetup, refusal: str = "") -> None:
        self.reply = reply
        self.refusal = refusal
        self.acts: list[SetUpHome] = []
        self.maps: list[str] = []
        self.poses: list[tuple[str, SetPose]] = []
        bench.bus.serve(SET_UP_HOME, self._act)
        bench.bus.serve(USE_MAP, self._use)
        bench.bus.serve(SET_POSE, self._pose)
        bench.bus.serve(SHOW_PIXELS, self._show)

    async def _act(self, query: SetUpHome, _name: str) -> HomeSetup:
        self.acts.append(query)
        if self.refusal:
            raise RefusedError(self.refusal)
        return self.reply

    async def _use(self, query: UseMap, _name: str) -> UseMapReply:
        self.maps.append(query.path)
        return UseMapReply(path=query.path)

    async def _pose(self, query: SetPose, name: str) -> Done:
        self.poses.append((name, query))
        return Done()

    async def _show(self, _query: ShowPixels, _name: str) -> Done:
        return Done()


def content_of(folder: Path) -> dict[str, str]:
    """Return the files of a home with their content, none if there is no home."""
    return {file.name: file.read_text() for file in folder.glob("*")}


def act(name: str = "read", token: str | None = None, **fields: Any) -> dict[str, Any]:
    query: dict[str, Any] = {"query": {"act": name, **fields}}
    return {"deed": "set_up_home", "query": query if token is None else query | {"token": token}}


async def test_token_goes_into_a_private_file_and_nowhere_else(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    folder = tmp_path / "home"
    async with (
        memory_bench() as bench,
        serving(bench, home_folder=str(folder)) as server,
        server.page() as page,
    ):
        home = HomeServer(bench, HomeSetup(step="connect"))
        answer = await page.ask(**act("connect", SECRET, url="http://ha:8123"))

        ((file, token),) = content_of(folder).items()
        name = file.removesuffix(".new-secret")
        assert (token, (folder / file).stat().st_mode & 0o777) == (SECRET, 0o600)
        assert home.acts == [SetUpHome(act="connect", url="http://ha:8123", secret=name)]
        refused = [await page.ask(**act("connect", text)) for text in (f"{SECRET} x", SECRET * 100, "")]
        assert all("no access token" in each["error"] for each in refused)
        odd = await page.ask(deed="set_up_home", query={"token": {"a": SECRET}})
        assert "belongs to an address" in (await page.ask(**act("read", SECRET)))["error"]
        assert content_of(folder) == {file: SECRET}
    told = json.dumps([answer, *refused, odd]) + caplog.text
    assert SECRET not in told


async def test_password_of_a_broker_goes_into_a_private_file_as_it_is(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    password = " pass word "  # noqa: S105 - of a test
    folder = tmp_path / "home"
    async with (
        memory_bench() as bench,
        serving(bench, home_folder=str(folder)) as server,
        server.page() as page,
    ):
        home = HomeServer(bench, HomeSetup(step="connect"))
        answer = await page.ask(**act("connect", password, url="mqtt://anna@hub"))

        ((file, secret),) = content_of(folder).items()
        name = file.removesuffix(".new-secret")
        assert (secret, (folder / file).stat().st_mode & 0o777) == (password, 0o600)
        assert home.acts == [SetUpHome(act="connect", url="mqtt://anna@hub", secret=name)]
        for refused in ("", "a\nb", "x" * 2000):
            reply = await page.ask(**act("connect", refused, url="mqtt://anna@hub"))
            assert "no password" in reply["error"]
        assert content_of(folder) == {file: password}
    # the log of the test's own browser has what it sends
    logged = [record.getMessage() for record in caplog.records if record.name.startswith("pointit")]
    assert logged
    assert password not in json.dumps([answer, *logged])


async def test_token_of_a_refused_address_is_not_kept(tmp_path: Path) -> None:
    folder = tmp_path / "home"
    folder.mkdir()
    (folder / "home-assistant.token").write_text("the stored one")
    async with (
        memory_bench() as bench,
        serving(bench, home_folder=str(folder)) as server,
        server.page() as page,
    ):
        HomeServer(bench, HomeSetup(step="connect"), refusal="that is no address")
        reply = await page.ask(**act("connect", SECRET, url="ftp://ha"))
    assert "no address" in reply["error"]
    assert content_of(folder) == {"home-assistant.token": "the stored one"}


async def test_home_is_set_up_only_by_operators_of_a_home(tmp_path: Path) -> None:
    folder = tmp_path / "home"
    async with memory_bench() as bench, serving(bench, home_folder=str(folder)) as server:
        home = HomeServer(bench, HomeSetup(step="connect"))
        async with server.page(VIEWER) as viewer:
            assert viewer.hello is not None
            assert not viewer.hello["home"]
            assert "only looks on" in (await viewer.ask(**act("connect", SECRET)))["error"]
            assert "pages cannot ask" in (await viewer.ask(key="home/set_up"))["error"]
        async with server.page() as page:
            assert page.hello is not None
            assert page.hello["home"]

        assert not home.acts
        assert content_of(folder) == {}
    async with memory_bench() as bench, serving(bench) as server, server.page() as page:
        assert page.hello is not None
        assert not page.hello["home"]
        assert "start `pointit home`" in (await page.ask(**act()))["error"]


async def test_site_uses_map_and_pose_of_an_answer_once(tmp_path: Path) -> None:
    file = tmp_path / "home.yaml"
    file.write_text("paced_from: {A: {position: [0, 0]}}\n")
    reply = HomeSetup(step="try", map=str(file), user="anna", poses=1, pose_m=(0.5, 2.0), pose_yaw_rad=0.3)
    async with (
        memory_bench() as bench,
        serving(bench, home_folder=str(tmp_path)) as server,
        server.page() as page,
    ):
        home = HomeServer(bench, reply)
        for _ in range(3):
            assert not (await page.ask(**act()))["error"]
        assert home.maps == [str(file)]
        assert [(name, pose.position_m, pose.yaw_rad) for name, pose in home.poses] == [
            ("anna", (0.5, 2.0, 0.0), 0.3)
        ]

        file.write_text("paced_from: {A: {position: [0, 0]}, B: {position: [0, 2]}}\n")
        home.reply = reply.model_copy(update={"poses": 2})
        await page.ask(**act())
        assert (len(home.maps), len(home.poses)) == (2, 2)
