"""Sites that are joined over Zenoh, on this machine's loopback."""

import asyncio
import contextlib
import subprocess
import sys
from collections.abc import AsyncIterator
from functools import partial
from pathlib import Path

import pytest
import pytest_asyncio

import pointit
from pointit.api.inputs import Tracker
from pointit.errors import (
    AccessDeniedError,
    ConfigError,
    ConnectError,
    NoAnswerError,
    VersionError,
    WrongSiteError,
)
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Done, PointingRay, ReleaseObject, SelectionEvent, TrackedObject
from pointit.schemas.topics import CURSOR, RAY, RELEASE_OBJECT, SELECTION_EVENTS, SERVICE_ALIVE, USER_ALIVE
from tests.integration.access.secured import link_of, make_site, routed
from tests.support.bench import PATIENCE_S, repeated, until

PERIOD_S = 0.05

FORGETFUL = """
import sys
import pointit

site = pointit.open(sys.argv[1])
cursors = site.cursors()
print(site.name, sorted(next(site.services())))
"""


READS_A_SITE = """
import sys
import pointit

with pointit.open(sys.argv[1], timeout_s=0.1) as site:
    site.wait()
"""


@pytest_asyncio.fixture
async def home(endpoint: str) -> AsyncIterator[ZenohBus]:
    bus = await ZenohBus.open(Link(listen=(endpoint,)))
    bus.announce(SERVICE_ALIVE, "pui")
    yield bus
    await bus.close()


async def test_a_whole_site_is_joined_and_answers(endpoint: str) -> None:
    async with (
        pointit.run("scenario_2", listen=endpoint),
        pointit.connect(endpoint, timeout_s=PATIENCE_S) as site,
    ):
        assert await anext(site.people()) == {"user1"}
        assert (await anext(site.cursors("user1"))).seq > 0
        assert (await site.leds.brightness(0.5)).message == "the strips' brightness is 50% now"
        with pytest.raises(NoAnswerError, match="conveyor-sim does not answer conveyor/set_speed"):
            await site.conveyor.set_speed(0.2)
        assert site.problem == ""


async def test_loops_go_on_after_the_router_was_lost(home: ZenohBus, endpoint: str) -> None:
    async with pointit.connect(endpoint, timeout_s=PATIENCE_S) as site:
        events = site.selections()
        await home.close()
        await until(lambda: site.problem.startswith("router at "), what="the loss to be known")
        with pytest.raises(NoAnswerError, match=r"selector cannot be asked for .*: router at .* lost"):
            await site.select.undo("anna")
        again = await ZenohBus.open(Link(listen=(endpoint,)), patience_s=30)
        try:
            await until(lambda: site.problem == "", what="the connection to be back")
            event = SelectionEvent(stamp_ns=1, event="selected", object_id="1")
            async with repeated(PERIOD_S, partial(again.publisher(SELECTION_EVENTS).put, event)):
                assert (await anext(events)).object_id == "1"
        finally:
            await again.close()


async def test_connection_without_a_site_gives_one_sentence(endpoint: str) -> None:
    with pytest.raises(ConnectError, match=f"nobody answers at {endpoint}; is `pointit run` or"):
        async with pointit.connect(endpoint, timeout_s=0.0):
            pass
    with pytest.raises(ConnectError, match=f"nobody answers at {endpoint}"):
        await asyncio.to_thread(pointit.open, endpoint, timeout_s=0.0)
    with pytest.raises(ConfigError, match=r"'here' is no address; write one like tcp/127.0.0.1:7447"):
        async with pointit.connect("here"):
            pass


def test_script_without_a_site_ends_with_one_sentence(endpoint: str) -> None:
    script = [sys.executable, "-c", READS_A_SITE, endpoint]
    ended = subprocess.run(script, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert ended.returncode == 1
    *frames, sentence = ended.stderr.strip().splitlines()
    assert f"nobody answers at {endpoint}" in sentence
    assert len(frames) <= 8
    assert "zenoh" not in "".join(frames)


async def test_run_joined_without_an_address_is_named_once(
    home: ZenohBus, endpoint: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("pointit.api.connection.DEFAULT_ENDPOINT", endpoint)
    home.announce(USER_ALIVE, "anna")
    async with pointit.connect(endpoint, timeout_s=PATIENCE_S), pointit.connect(site="lab"):
        assert "joined" not in caplog.text
    for _ in range(2):
        async with pointit.connect(timeout_s=PATIENCE_S):
            pass
    assert (
        caplog.text.count(f"joined site lab at {endpoint}, with anna; to join another run, pass its address")
        == 1
    )


@pytest.mark.usefixtures("home")
async def test_another_site_is_named(endpoint: str) -> None:
    with pytest.raises(WrongSiteError, match=r"nothing runs on site plant at .*; there is site lab"):
        async with pointit.connect(endpoint, site="plant", timeout_s=PATIENCE_S):
            pass


async def test_messages_of_another_version_are_one_sentence(home: ZenohBus, endpoint: str) -> None:
    async with pointit.connect(endpoint, timeout_s=PATIENCE_S) as site:
        cursors = site.cursors("anna")
        async with repeated(PERIOD_S, lambda: home.session.put(CURSOR.at("anna"), b"\x81\xa1x\x01")):
            with pytest.raises(VersionError, match=r"none could be read .*install the same version"):
                await anext(cursors)


@pytest.mark.slow
async def test_denied_call_raises_access_denied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    folder = make_site(tmp_path / "lab", names={"anna": "user", "dashboard1": "dashboard", "guest": "user"})
    with routed(folder):
        monkeypatch.setenv("POINTIT_CREDENTIALS", str(folder.identity_folder("dashboard1")))
        with pytest.raises(ConfigError, match=r"^tcp/host:1: credentials are for encrypted addresses only"):
            await asyncio.to_thread(pointit.open, "tcp/host:1")
        assert "the credentials of dashboard1 end on" in caplog.text

        async with pointit.connect(timeout_s=PATIENCE_S) as site:
            assert site.name == "lab"
            with pytest.raises(AccessDeniedError, match=r"dashboard1.* may not read users/anna/ray"):
                await anext(site.rays("anna"))
            with pytest.raises(AccessDeniedError, match="may not ask leds/door/set_color"):
                await site.lamp("door").set("#ff8800")
            with pytest.raises(AccessDeniedError, match="may not write users/anna/button"):
                await site.press("anna")

            tracker = site.tracker("camera")
            with pytest.raises(AccessDeniedError, match="may not write objects/camera"):
                await until_denied(tracker)
        await asyncio.to_thread(update_twice_without_rights)
        with pytest.raises(ConfigError, match=r"site plant: the credentials in .* are of site lab"):
            async with pointit.connect(site="plant", credentials=folder.identity_folder("anna")):
                pass
        folder.revoke("guest")
    with routed(folder), pytest.raises(AccessDeniedError, match="it was revoked"):
        async with pointit.connect(credentials=folder.identity_folder("guest"), timeout_s=PATIENCE_S):
            pass


async def release(query: ReleaseObject, name: str) -> Done:
    return Done(message=f"{query.object_id} is {name}'s")


async def test_objects_of_others_are_taken_over_by_operators_only(tmp_path: Path) -> None:
    folder = make_site(
        tmp_path / "lab", names={"anna": "user", "services": "services", "operator": "operator"}
    )
    with routed(folder):
        services = await ZenohBus.open(link_of(folder, "services"), patience_s=30)
        try:
            services.serve(RELEASE_OBJECT, release)
            async with pointit.connect(
                credentials=folder.identity_folder("operator"), timeout_s=PATIENCE_S
            ) as site:
                given = await site.select.release("anna", "box", take_over=True)
            assert given.message == "box is anna's"
            async with pointit.connect(
                credentials=folder.identity_folder("anna"), timeout_s=PATIENCE_S
            ) as site:
                with pytest.raises(AccessDeniedError, match=r"anna.* may not ask selector/anna/release"):
                    await site.select.release("anna", "box", take_over=True)
        finally:
            await services.close()


async def test_person_reads_their_own_latest_on_a_secured_site(tmp_path: Path) -> None:
    folder = make_site(tmp_path / "lab", names={"anna": "user"})
    with routed(folder):
        wrist = await ZenohBus.open(link_of(folder, "anna"), patience_s=30)
        ray = PointingRay(stamp_ns=1, origin_m=(0, 0, 1), direction=(1, 0, 0))
        try:
            async with (
                pointit.connect(credentials=folder.identity_folder("anna"), timeout_s=PATIENCE_S) as site,
                repeated(PERIOD_S, partial(wrist.publisher(RAY, "anna").put, ray)),
            ):
                assert await site.latest.ray.wait("anna", timeout_s=60) == site.latest.ray["anna"]
        finally:
            await wrist.close()


def update_twice_without_rights() -> None:
    with pointit.open(timeout_s=PATIENCE_S) as site, contextlib.closing(site.tracker("camera")) as tracker:
        tracker.update([])
        with pytest.raises(AccessDeniedError, match="may not write objects/camera"):
            tracker.update([])


async def until_denied(tracker: Tracker) -> None:
    async with asyncio.timeout(60):
        while True:
            tracker.update([TrackedObject(id="cup", kind="red", position_m=(0.0, 0.0, 0.0))])
            await asyncio.sleep(0.05)


@pytest.mark.usefixtures("home")
async def test_a_script_that_forgets_to_close_ends_without_a_warning(endpoint: str) -> None:
    command = [sys.executable, "-W", "error", "-c", FORGETFUL, endpoint]
    done = await asyncio.to_thread(subprocess.run, command, capture_output=True, text=True, timeout=120)
    assert (done.stdout, done.stderr, done.returncode) == ("lab ['pui']\n", "", 0)
