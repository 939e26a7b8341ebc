"""A genuine Prometheus reads `pointit metrics` of a run, by the configuration that is shipped."""

import shutil
import subprocess
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
from prometheus_client.parser import text_string_to_metric_families

from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.commands import Commands, onlooker
from tests.support.pace import Patience
from tests.unit.deploy.stack import DEPLOY

START_S = 60.0
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
