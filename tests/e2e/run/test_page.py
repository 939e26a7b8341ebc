"""A run's page and metrics."""

import shutil
import signal
import subprocess
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import httpx
import psutil
import pytest
from prometheus_client.parser import text_string_to_metric_families

from pointit.schemas.topics import STOP_ROBOT
from tests.e2e.run.visitor import entered, looking_on
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.commands import Command, Commands, onlooker
from tests.support.links import link_in
from tests.support.pace import Patience, within
from tests.unit.deploy.stack import DEPLOY

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


async def test_ctrl_c_ends_it_with_a_page_open(commands: Commands, endpoint: str) -> None:
    command = run(commands, endpoint, "scenario_2")
    url = await address_of(command)
    async with onlooker(endpoint) as seen:
        await until(lambda: "web" in seen.present, CHANGE_S, "the page")
        async with looking_on(url), looking_on(url):
            await seen.sees_cursors("user1")
            ended = await command.stop(signal.SIGINT)
    assert ended.code == 0, ended.err
    assert within(ended.took_s, END_S)
    assert "Traceback" not in ended.err


LAN = ("scenario_2", "--lan", "--set", "web.lan_port=0")


async def test_page_for_this_machine_stays_in_the_runs_process(commands: Commands, endpoint: str) -> None:
    command = run(commands, endpoint, "scenario_2")
    await address_of(command)
    assert len(command.family()) == 1


async def test_page_for_others_returns_when_its_process_is_killed(commands: Commands, endpoint: str) -> None:
    command = run(commands, endpoint, *LAN)
    url = await address_of(command)
    cookie, _ = await entered(url)
    async with onlooker(endpoint) as seen:
        await until(lambda: "web" in seen.present, CHANGE_S, "the page")
        _, server = command.family()

        server.kill()
        await until(lambda: "web" not in seen.present, CHANGE_S, "its end")
        await seen.sees_more(seen.cursors["user1"], "cursors without the page")
        await until(lambda: "web" in seen.present, CHANGE_S, "the page again")

        async with httpx.AsyncClient(transport=httpx.AsyncHTTPTransport(retries=20)) as client:
            answer = await client.get(url.partition("?")[0], headers={"Cookie": cookie})
        assert answer.status_code == 200
        family = command.family()
        ended = await command.stop(signal.SIGINT, code=0)
    assert within(ended.took_s, END_S)
    assert "web was ended by SIGKILL; it will be restarted in 1 s" in ended.err
    assert not psutil.wait_procs(family, timeout=60)[1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
async def test_process_of_the_page_ends_with_its_run_at_once(
    commands: Commands, endpoint: str, number: signal.Signals
) -> None:
    command = run(commands, endpoint, *LAN)
    await until(lambda: len(command.family()) == 2, CHANGE_S, "the process of the page")
    family = command.family()

    ended = await command.stop(number)

    assert within(ended.took_s, END_S)
    assert "Traceback" not in ended.err
    assert not psutil.wait_procs(family, timeout=60)[1]


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


async def test_second_dashboard_and_a_view_only_one_join_a_run(commands: Commands, endpoint: str) -> None:
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
    dashboard = commands.start("dashboard", "--connect", endpoint, "--port", "0", "--view-only")
    async with looking_on(await address_of(dashboard)) as (_, hello):
        assert (hello["role"], hello["requests"]) == ("viewer", [STOP_ROBOT.key])


OBSERVE = DEPLOY / "observe"
SHIPPED = "127.0.0.1:9464"
"""Address in the shipped configuration."""


class Prometheus:
    """A Prometheus at a port of this machine."""

    def __init__(self, port: int) -> None:
        self._url = f"http://127.0.0.1:{port}/api/v1"

    def value(self, expression: str) -> float | None:
        """Return the value of an expression with one result, or None without one."""
        try:
            answer = httpx.get(f"{self._url}/query", params={"query": expression}, timeout=60.0)
        except httpx.TransportError:
            return None  # it has not started yet
        if not answer.is_success:
            return None
        result = answer.json()["data"]["result"]
        return float(result[0]["value"][1]) if result else None

    async def says(self, expression: str, holds: Callable[[float], bool]) -> None:
        def is_said() -> bool:
            value = self.value(expression)
            return value is not None and holds(value)

        await until(is_said, START_S, expression)

    def faults(self) -> list[str]:
        groups = httpx.get(f"{self._url}/rules", timeout=60.0).json()["data"]["groups"]
        return [
            rule.get("lastError", "")
            for group in groups
            for rule in group["rules"]
            if rule["health"] == "err"
        ]


@contextmanager
def prometheus(folder: Path, target: str) -> Generator[Prometheus]:
    """Run Prometheus with the shipped configuration, but for the address that it reads."""
    program = shutil.which("prometheus")
    if program is None:
        pytest.skip("prometheus is not installed")
    text = (OBSERVE / "prometheus.yml").read_text(encoding="utf-8")
    assert SHIPPED in text
    text = text.replace(SHIPPED, target).replace("_interval: 5s", "_interval: 1s")
    (folder / "prometheus.yml").write_text(text, encoding="utf-8")
    shutil.copy(OBSERVE / "rules.yml", folder)
    port = free_port()
    words = [
        f"--config.file={folder / 'prometheus.yml'}",
        f"--storage.tsdb.path={folder / 'data'}",
        f"--web.listen-address=127.0.0.1:{port}",
    ]
    with (folder / "prometheus.log").open("wb") as log:
        process = subprocess.Popen([program, *words], stdout=log, stderr=log)
        try:
            yield Prometheus(port)
        finally:
            process.terminate()
            process.wait(30)


@pytest.mark.slow
async def test_prometheus_reads_figures_of_a_run(commands: Commands, endpoint: str, tmp_path: Path) -> None:
    commands.start("run", "scenario_3", "--no-view", "--duration", "600", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.sees_cursors("user1", patience_s=START_S)
    target = f"127.0.0.1:{free_port()}"
    serving = commands.start("metrics", "--listen", target, "--connect", endpoint)
    await serving.says(f"http://{target}/metrics")
    with prometheus(tmp_path, target) as server:
        rays = 'sum(increase(pointit_messages_total{service="pointing",topic="users/{user}/ray"}[10s]))'
        await server.says(rays, lambda count: count > 10.0)
        # a busy machine misses a scrape now and then, which makes every series stale for a second
        await server.says('up{job="pointit"}', lambda up: up == 1)
        await server.says("sum(1 - pointit_service_present)", lambda missing: missing == 0)
        await server.says("pointit_people", lambda people: people == 1)

        late = 'histogram_quantile(0.99, pointit_latency_seconds_bucket{service="led-driver"})'
        await server.says(late, lambda wrist_to_light_s: 0.0 < wrist_to_light_s < 5.0)
        assert server.faults() == []
    await serving.stop(code=0)


async def test_once_prints_the_metrics_of_a_site(commands: Commands, endpoint: str) -> None:
    commands.start("run", "scenario_2", "--no-view", "--duration", "600", "--listen", endpoint)
    async with onlooker(endpoint) as seen:
        await seen.sees_cursors("user1", patience_s=START_S)
    patience = Patience(START_S)
    while True:  # it listens for a fixed time, in which a busy machine may tell it little
        ended = await commands.pointit("metrics", "--once", "--connect", endpoint)
        families = {family.name: family for family in text_string_to_metric_families(ended.out)}
        present = families["pointit_service_present"].samples if ended.code == 0 else []
        if {sample.labels["service"]: sample.value for sample in present}.get("pui") == 1:
            return
        assert not patience.is_over(), (ended.code, ended.out, ended.err)
