"""The page of a run: its address, its viewers, and changes of the run by it."""

import asyncio
import signal
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import httpx
import msgpack
import pytest

from pointit.runtime.errors import RefusedError
from pointit.schemas import Deployment, Environment, RunScenario, SelectionEvent
from pointit.schemas.topics import DEPLOYMENT, MAP, RUN_SCENARIO, SELECTION_EVENTS, STOP_ROBOT
from tests.e2e.run.visitor import entered, looking_on, own_scenario
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.commands import Command, Commands, onlooker, summary_of
from tests.support.links import link_in
from tests.support.pace import within

CHANGE_S = 40.0
START_S = 60.0
"""Fourteen processes on a busy machine."""
END_S = 4.0
"""Limit of the time to end on a quiet machine."""
PERSON = ("imu-bridge", "pointing", "localizer", "supervisor", "user-sim")


async def address_of(command: Command) -> str:
    await command.says("its link is in")
    return link_in(command.err + command.out)


def run(commands: Commands, endpoint: str, *arguments: str) -> Command:
    return commands.start("run", *arguments, "--no-view", "--web-port", "0", "--listen", endpoint)


async def test_the_address_opens_with_its_token_and_not_without(commands: Commands, endpoint: str) -> None:
    command = run(commands, endpoint)
    url = await address_of(command)
    async with onlooker(endpoint) as seen:
        await until(lambda: "web" in seen.present, CHANGE_S, "the page")
        _, page = await entered(url)
        assert page.status_code == 200
        assert "text/html" in page.headers["content-type"]
        for wrong in (url.partition("?")[0], url[:-1] + "~"):
            _, refused = await entered(wrong)
            assert refused.status_code == 403
        await seen.sees_more(seen.cursors["user1"], "cursors on the belts")
    ended = await command.stop(code=0)
    assert "scenario_4 ran" in ended.out  # the default scenario
    (token,) = parse_qs(urlsplit(url).query)["token"]
    assert token not in ended.err + ended.out


async def test_the_port_can_be_set_like_any_parameter(commands: Commands, endpoint: str) -> None:
    mine = ("--set", "web.operator_token=a-token-of-mine", "--set", "web.rate_hz=10")
    command = run(commands, endpoint, "scenario_2", *mine)
    url = await address_of(command)
    assert url.endswith("/?token=a-token-of-mine")
    async with onlooker(endpoint) as seen:
        told: list[Deployment] = []
        seen.bus.subscribe(DEPLOYMENT, lambda deployment, _name: told.append(deployment))
        await until(lambda: bool(told), CHANGE_S, "the deployment")
    assert "web" in {service.service for service in told[0].services}
    assert "a-token-of-mine" not in told[0].model_dump_json()  # viewers must not learn to control


@pytest.mark.parametrize("processes", [(), ("--processes",)])
async def test_another_takes_its_place(commands: Commands, endpoint: str, processes: tuple[str, ...]) -> None:
    command = run(commands, endpoint, "scenario_4", "--json", *processes)
    url = await address_of(command)
    async with onlooker(endpoint) as seen:
        rooms: list[str] = []

        def on_map(room: Environment, _name: str) -> None:
            rooms.append(room.name)

        seen.bus.subscribe(MAP, on_map)
        await seen.sees_more(seen.cursors["user1"], "cursors on the belts")
        await seen.hears("web")
        page = seen.health["web"]
        with pytest.raises(RefusedError, match="no scenario 'nope'; there are scenario_1"):
            await seen.bus.call(RUN_SCENARIO, RunScenario(scenario="nope"), timeout_s=CHANGE_S)
        wish = RunScenario(scenario="scenario_2", users=2)
        await seen.bus.call(RUN_SCENARIO, wish, timeout_s=CHANGE_S)
        people = {f"{service}.{user}" for service in PERSON for user in ("user1", "user2")}
        await until(
            lambda: seen.present == {"pui", "led-driver", "keeper", "web", *people},
            START_S,
            "all of the other scenario, and nothing else",
        )
        await seen.sees_cursors("user1", "user2")
        await until(lambda: rooms[-1] == "lab" != rooms[0], what="the other room")
        assert seen.health["web"].pid == page.pid
        await until(lambda: seen.health["web"].uptime_s > page.uptime_s, what="the same page, all the while")
        async with looking_on(url):
            pass
        doctor = await commands.pointit("doctor", "--connect", endpoint)
        assert "selector" not in doctor.out  # nothing of the other scenario is missed
    family = command.family()
    assert len(family) == (15 if processes else 1)
    ended = await command.stop(code=0)
    assert within(ended.took_s, END_S)
    assert "Traceback" not in ended.err
    summary = summary_of(ended)
    assert (summary["scenario"], len(summary["services"])) == ("scenario_2", 14)


async def test_a_run_goes_on_while_a_page_is_open(commands: Commands, endpoint: str, tmp_path: Path) -> None:
    command = run(commands, endpoint, own_scenario(tmp_path, 8), "--json")
    url = await address_of(command)
    async with looking_on(url), onlooker(endpoint) as seen:
        await until(
            lambda: "web" in seen.health and seen.health["web"].uptime_s > 12,
            CHANGE_S,
            "more than its duration",
        )
        assert command.is_running
    ended = await command.end(code=0)
    assert summary_of(ended)["duration_s"] > 12


async def test_a_duration_asked_for_ends_it_whoever_looks_on(commands: Commands, endpoint: str) -> None:
    command = run(commands, endpoint, "scenario_2", "--duration", "8", "--json")
    async with looking_on(await address_of(command)):
        ended = await command.end()
    assert ended.code == 0, ended.err
    assert 8.0 <= summary_of(ended)["duration_s"] + 0.1 < 12.0


@pytest.mark.parametrize(
    ("number", "processes"),
    [
        (signal.SIGTERM, ()),
        pytest.param(signal.SIGINT, ("--processes",), marks=pytest.mark.long),
        pytest.param(signal.SIGTERM, ("--processes",), marks=pytest.mark.long),
        pytest.param(signal.SIGINT, (), marks=pytest.mark.long),
    ],
)
async def test_ctrl_c_ends_it_with_a_page_open(
    commands: Commands, endpoint: str, processes: tuple[str, ...], number: int
) -> None:
    command = run(commands, endpoint, "scenario_2", *processes)
    url = await address_of(command)
    async with onlooker(endpoint) as seen:
        await until(lambda: "web" in seen.present, CHANGE_S, "the page")
        async with looking_on(url), looking_on(url):
            await seen.sees_cursors("user1")
            ended = await command.stop(number)
    assert ended.code == 0, ended.err
    assert within(ended.took_s, END_S)
    assert "Traceback" not in ended.err


async def test_an_open_page_comes_back_after_a_new_start(commands: Commands, endpoint: str) -> None:
    port = str(free_port())
    start = ("run", "scenario_2", "--no-view", "--web-port", port, "--listen", endpoint)
    first = commands.start(*start)
    url = await address_of(first)
    cookie, _ = await entered(url)
    assert (await first.stop()).code == 0
    headers = {"Cookie": cookie}  # the browser's cookies
    for arguments, status in (((), 200), (("--new-link",), 403)):
        command = commands.start(*start, *arguments)
        assert (await address_of(command) == url) == (status == 200)
        async with httpx.AsyncClient(transport=httpx.AsyncHTTPTransport(retries=20)) as client:
            assert (await client.get(url.partition("?")[0], headers=headers)).status_code == status
        assert (await command.stop()).code == 0


@pytest.mark.parametrize("has_page", [False, True])
async def test_a_dashboard_beside_a_run(commands: Commands, endpoint: str, *, has_page: bool) -> None:
    page = ("--web-port", "0") if has_page else ("--no-web",)
    commands.start("run", "scenario_2", "--no-view", *page, "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        there = "web" if has_page else "pui"  # the page is loaded beside a run that has begun
        await until(lambda: there in seen.present, CHANGE_S, there)
    dashboard = commands.start("dashboard", "--connect", endpoint, "--port", "0")
    url = await address_of(dashboard)
    printed = dashboard.out
    instance = "web.2" if has_page else "web"
    async with onlooker(endpoint) as seen:
        await until(lambda: instance in seen.present, CHANGE_S, f"{instance} among {seen.present}")
        async with looking_on(url) as (socket, hello):
            assert hello["role"] == "operator"
            for _ in range(5):  # status, batches of messages
                await socket.recv()
        ended = await dashboard.stop()
        assert (ended.code, ended.err) == (0, "")
        assert within(ended.took_s, END_S)
        assert ended.out == printed
        assert printed.startswith(f"page: {url.partition('?')[0]} (its link is in ")
        assert printed.count("\n") == 1
        await until(lambda: instance not in seen.present, CHANGE_S, "it to be gone")
        await seen.sees_cursors("user1")  # the run goes on
        doctor = await commands.pointit("doctor", "--connect", endpoint)
        assert "twice" not in doctor.out


@pytest.mark.slow
async def test_a_dashboard_started_late_shows_what_was_before(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_4", "--no-view", "--no-web", "--listen", endpoint)
    events: list[SelectionEvent] = []
    async with onlooker(endpoint) as seen:
        seen.bus.subscribe(SELECTION_EVENTS, lambda event, _name: events.append(event))
        await until(lambda: any(each.event == "selected" for each in events), START_S, "a selection")
    first = next(each for each in events if each.event == "selected")
    dashboard = commands.start("dashboard", "--connect", endpoint, "--port", "0")
    async with looking_on(await address_of(dashboard)) as (socket, _), asyncio.timeout(START_S):
        while isinstance(message := await socket.recv(), str):
            pass
    n, _, _, _, told, _ = msgpack.unpackb(message)
    assert n == 1
    selections = [msgpack.unpackb(payload) for topic, _, payload in told if topic == SELECTION_EVENTS.key]
    (same,) = [each for each in selections if each["seq"] == first.seq and each["event"] == "selected"]
    assert (same["stamp_ns"], same["object_id"]) == (first.stamp_ns, first.object_id)


async def test_a_link_for_who_may_only_look_on(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_2", "--no-view", "--listen", endpoint)
    dashboard = commands.start("dashboard", "--connect", endpoint, "--port", "0", "--view-only")
    async with looking_on(await address_of(dashboard)) as (_, hello):
        assert (hello["role"], hello["requests"]) == ("viewer", [STOP_ROBOT.key])


async def test_a_dashboard_waits_for_a_site(commands: Commands, endpoint: str) -> None:
    waiting = commands.start("dashboard", "--connect", endpoint, "--port", "0")
    await waiting.says(f"nobody answers at {endpoint} yet; trying again until somebody does")
    assert (await waiting.stop()).code == 0
