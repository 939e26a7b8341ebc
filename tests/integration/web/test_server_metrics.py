"""Metrics at the page's server, and at a server of their own: real requests to a real port."""

import asyncio

import httpx
import pytest

from pointit.bridges.web.metrics.door import PATH, MetricsServer
from pointit.bridges.web.metrics.site_metrics import SiteMetrics
from pointit.bridges.web.server import access, exposure_check
from pointit.runtime.errors import ConfigError, ListenError
from pointit.schemas.topics import SERVICE_ALIVE
from tests.integration.web.pages import OPERATOR, VIEWER, Server, serving
from tests.support.bench import memory_bench


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


@pytest.mark.parametrize("token", [OPERATOR, VIEWER])
async def test_the_page_shows_metrics_to_who_has_a_token(token: str) -> None:
    async with memory_bench() as bench, serving(bench) as server, server.client(**bearer(token)) as client:
        bench.bus.announce(SERVICE_ALIVE, "pui")
        answer = await client.get(PATH)
        while (
            'pointit_service_present{name="",service="pui"} 1.0' not in answer.text
        ):  # the test's time limit
            answer = await client.get(PATH)
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("text/plain")
        assert 'pointit_site_info{site="' in answer.text


async def test_the_cookie_of_a_page_shows_metrics_too(server: Server, client: httpx.AsyncClient) -> None:
    answer = await client.get(PATH, headers={"Cookie": await server.cookie(VIEWER)})
    assert answer.status_code == 200


@pytest.mark.parametrize("headers", [{}, bearer("wrong"), {"Authorization": f"Basic {VIEWER}"}])
async def test_without_a_token_there_are_no_metrics(headers: dict[str, str]) -> None:
    async with memory_bench() as bench, serving(bench) as server, server.client(**headers) as client:
        answer = await client.get(PATH)
        assert answer.status_code == 401
        assert answer.headers["www-authenticate"] == "Bearer"
        assert "pointit_" not in answer.text


async def test_wrong_tokens_of_a_scrape_count_as_guesses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pointit.bridges.web.metrics.door.REFUSAL_S", 0.0)
    async with memory_bench() as bench, serving(bench) as server, server.client() as client:
        for guess in range(access.MAX_GUESSES):
            await client.get(PATH, headers=bearer(f"guess {guess}"))
        assert (await client.get("/", params={"token": "one more"})).status_code == 429
        assert (await client.get(PATH, headers=bearer(VIEWER))).status_code == 200


async def test_a_server_of_its_own_answers_this_machine_without_a_token() -> None:
    server = MetricsServer(SiteMetrics("hall", "1"), "127.0.0.1", 0)
    serving_it = asyncio.create_task(server.run())
    try:
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{server.port}") as client:
            answer = await client.get(PATH)
            assert answer.status_code == 200
            assert 'pointit_site_info{site="hall",version="1"} 1.0' in answer.text
            assert (await client.get(PATH, headers={"Host": "evil.example"})).status_code == 403
    finally:
        serving_it.cancel()
        await asyncio.gather(serving_it, return_exceptions=True)


async def test_a_server_of_its_own_is_not_open_to_other_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(exposure_check.CONTAINER, "oci")  # many containers share the network of their host
    with pytest.raises(ConfigError, match=r"listen at 127\.0\.0\.1"):
        MetricsServer(SiteMetrics("lab", "1"), "0.0.0.0", 0)  # noqa: S104 - refused


async def test_a_port_that_is_taken_is_an_error_with_a_remedy() -> None:
    first = MetricsServer(SiteMetrics("lab", "1"), "127.0.0.1", 0)
    task = asyncio.create_task(first.run())
    await asyncio.sleep(0)  # it begins
    try:
        with pytest.raises(ListenError, match="--listen"):
            MetricsServer(SiteMetrics("lab", "1"), "127.0.0.1", first.port)
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
