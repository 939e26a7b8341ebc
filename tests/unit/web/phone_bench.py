"""Phones served by TLS at a port of this machine, with a site that only remembers what it is asked."""

import ssl
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import websockets
from starlette.requests import Request
from starlette.responses import Response
from starlette.websockets import WebSocket

from pointit.bridges.web.config import WebConfig
from pointit.bridges.web.pages.page_requests import hello_of
from pointit.bridges.web.server.access import Access
from pointit.bridges.web.server.app import application
from pointit.bridges.web.server.bundle import Bundle
from pointit.bridges.web.server.lan import Lan
from pointit.bridges.web.wire import Answer, Ask, Role
from pointit.bridges.web.wrists.pairing import Pairing
from pointit.bridges.web.wrists.phone import PhoneHost, Phones
from pointit.bridges.web.wrists.wrist_control import WristControl
from pointit.runtime.host.state_file import site_folder
from pointit.schemas import WristSample
from tests.support.bench import START_NS, ManualClock
from tests.support.running_source import Health


class PhoneBench:
    def __init__(self, folder: Path) -> None:
        (folder / "phone.html").write_text("<!doctype html><title>wrist</title>")
        self.clock = ManualClock(START_NS)
        self.wrists = WristControl(WebConfig())
        self.pairing = Pairing()
        self.health = Health()
        self.sent: list[tuple[str, WristSample]] = []
        self.asked: list[tuple[str, Ask]] = []
        self.error = ""
        host = PhoneHost(
            wrists=self.wrists,
            now_ns=self.clock.now_ns,
            send=lambda user, sample: self.sent.append((user, sample)),
            answer=self._answer,
            changed=lambda: None,
            warnings=self.health,
            greeting=hello_of("wrist", version="1", site="lab"),
        )
        self.phones = Phones(host, self.pairing, Bundle(folder))
        self.doors = Access("operator-token", "viewer-token")
        self.doors.know_hosts(["127.0.0.1"])
        app = application(self.doors, Bundle(folder), self._no_page, self._no_file, self.phones.routes)
        self.lan = Lan(
            WebConfig(lan_port=0, lan_address="127.0.0.1"), "lab", app, addresses=lambda: ["127.0.0.1"]
        )

    def client(self) -> httpx.AsyncClient:
        return httpx.AsyncClient(base_url=self.lan.url, verify=trust(), headers={"Origin": self.lan.url})

    async def pair(self, client: httpx.AsyncClient, user: str = "anna") -> None:
        """Have `client` open what a QR code for `user` says."""
        token, replaced = self.pairing.pair(user, 0.0)
        await self.phones.cut(replaced)
        self.pairing._phones[user].expires_s = float("inf")
        response = await client.get(f"/phone?token={token}")
        assert response.status_code == 303, response.text

    def connect(
        self, client: httpx.AsyncClient, origin: str | None = None, path: str = "/ws/wrist"
    ) -> websockets.connect:
        cookies = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
        return websockets.connect(
            self.lan.url.replace("https", "wss") + path,
            ssl=trust(),
            origin=websockets.Origin(origin or self.lan.url),
            additional_headers={"Cookie": cookies},
            proxy=None,
        )

    async def _answer(self, page: str, ask: Ask) -> Answer:
        self.asked.append((page, ask))
        return Answer(id=ask.id, reply=None if self.error else {"message": "done"}, error=self.error)

    async def _no_page(self, socket: WebSocket, _role: Role) -> None:
        await socket.close()

    async def _no_file(self, _request: Request) -> Response:
        return Response(status_code=404)


def trust(site: str = "lab") -> ssl.SSLContext:
    """Return a context that trusts the certificate of `site` and nothing else."""
    return ssl.create_default_context(cafile=site_folder(site, "web") / "certificate.pem")


@asynccontextmanager
async def phone_bench(folder: Path) -> AsyncGenerator[PhoneBench]:
    bench = PhoneBench(folder)
    await bench.lan.open()
    try:
        yield bench
    finally:
        await bench.phones.close()
        await bench.lan.close()
