"""The page of a run: its address, its viewers, and changes of the run by it."""

import signal
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest

from pointit.schemas import Deployment
from pointit.schemas.topics import DEPLOYMENT, STOP_ROBOT
from tests.e2e.run.visitor import entered, looking_on
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.commands import Command, Commands, onlooker
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


@pytest.mark.parametrize("number", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.long)])
async def test_ctrl_c_ends_it_with_a_page_open(commands: Commands, endpoint: str, number: int) -> None:
    command = run(commands, endpoint, "scenario_2")
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
    start = ("run", "scenario_2", "--no-view", "--duration", "600", "--web-port", port, "--listen", endpoint)
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


async def test_a_dashboard_beside_a_run_with_a_page(commands: Commands, endpoint: str) -> None:
    commands.start(
        "run", "scenario_2", "--no-view", "--duration", "600", "--web-port", "0", "--listen", endpoint
    )
    async with onlooker(endpoint) as seen:
        await until(lambda: "web" in seen.present, CHANGE_S, "the page, loaded beside a run that has begun")
    dashboard = commands.start("dashboard", "--connect", endpoint, "--port", "0")
    url = await address_of(dashboard)
    printed = dashboard.out
    instance = "web.2"
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


async def test_a_link_for_who_may_only_look_on(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_2", "--no-view", "--duration", "600", "--listen", endpoint)
    dashboard = commands.start("dashboard", "--connect", endpoint, "--port", "0", "--view-only")
    async with looking_on(await address_of(dashboard)) as (_, hello):
        assert (hello["role"], hello["requests"]) == ("viewer", [STOP_ROBOT.key])
