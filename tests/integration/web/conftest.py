"""A web service on a bench with a page to serve, and an operator's page."""

from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest
import pytest_asyncio

from pointit.bridges.web import service
from pointit.bridges.web.server.bundle import Bundle
from tests.integration.web.pages import INDEX, Page, Server, serving
from tests.support.bench import Bench, memory_bench


@pytest.fixture(autouse=True)
def built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "static"
    folder.mkdir()
    (folder / "index.html").write_text(INDEX)
    (folder / "app.js").write_text("export {};")
    (tmp_path / "secret.txt").write_text("secret")
    (folder / "link.txt").symlink_to(tmp_path / "secret.txt")
    monkeypatch.setattr(service, "Bundle", lambda: Bundle(folder))


@pytest_asyncio.fixture
async def bench() -> AsyncIterator[Bench]:
    async with memory_bench() as bench:
        yield bench


@pytest_asyncio.fixture
async def server(bench: Bench) -> AsyncIterator[Server]:
    async with serving(bench) as server:
        yield server


@pytest_asyncio.fixture
async def page(server: Server) -> AsyncIterator[Page]:
    async with server.page() as page:
        yield page


@pytest_asyncio.fixture
async def client(server: Server) -> AsyncIterator[httpx.AsyncClient]:
    async with server.client() as client:
        yield client
