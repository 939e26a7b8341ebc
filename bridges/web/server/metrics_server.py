"""Metrics server: path and server at which Prometheus reads the metrics of a site.

No core: it waits for requests.
"""

import asyncio
import math
import time

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from pointit.bridges.web.server.access import Access, new_token
from pointit.bridges.web.server.app import REFUSAL_S, SecurityMiddleware, info_of
from pointit.bridges.web.server.listener import HttpListener, open_port
from pointit.bridges.web.site_metrics import SiteMetrics
from pointit.runtime.address_config import is_loopback
from pointit.runtime.errors import ConfigError

PATH = "/metrics"
TEXT = "text/plain"
"""Media type of Prometheus' text format."""

NEEDS_TOKEN = (
    "Metrics need the page's token: in Prometheus, `authorization` with `credentials_file`; "  # noqa: S105
    "see docs/how-to/observe.md.\n"
)

CACHE_S = 1.0
"""Time for which metrics are computed once for all who read them, s."""
MAX_MEDIA_TYPES = 8


def exposition(metrics: SiteMetrics, accept: str) -> tuple[bytes, str]:
    """Return the metrics in the format that an Accept header asks for, and its media type."""
    from prometheus_client.exposition import choose_encoder  # noqa: PLC0415 - see SiteMetrics
    from prometheus_client.registry import CollectorRegistry  # noqa: PLC0415

    registry = CollectorRegistry(auto_describe=False)
    registry.register(metrics)
    encode, media_type = choose_encoder(accept)
    return encode(registry), media_type


def media_type_of(accept: str) -> str:
    """Return the media type of `exposition`."""
    from prometheus_client.exposition import choose_encoder  # noqa: PLC0415 - see SiteMetrics

    return choose_encoder(accept)[1]


def metrics_route(metrics: SiteMetrics, access: Access | None) -> Route:
    """Return the route of `PATH`. With `access` it needs one of its tokens, as a cookie or a bearer."""
    computed: dict[str, tuple[float, bytes]] = {}  # time and content by media type

    async def answer(request: Request) -> Response:
        now_s = time.monotonic()
        if access is not None:
            info = info_of(request)
            if access.admit(info, now_s) is None:
                if access.is_rate_limited(info.address, now_s):
                    await asyncio.sleep(REFUSAL_S)
                return PlainTextResponse(NEEDS_TOKEN, 401, headers={"WWW-Authenticate": "Bearer"})

        # Several readers share one computation, each in the format that they accept
        accept = request.headers.get("accept", "")
        media_type = media_type_of(accept)
        computed_s, content = computed.get(media_type, (-math.inf, b""))
        if now_s - computed_s >= CACHE_S:
            content, _ = exposition(metrics, accept)
            if len(computed) >= MAX_MEDIA_TYPES:
                computed.clear()
            computed[media_type] = (now_s, content)
        return Response(content, headers={"Content-Type": media_type, "Cache-Control": "no-store"})

    return Route(PATH, answer, methods=["GET"])


class MetricsServer:
    """Serves metrics without a token, on this machine only."""

    def __init__(self, metrics: SiteMetrics, host: str, port: int) -> None:
        """Bind the port.

        Raises:
            ConfigError: If other machines could reach it.
            ListenError: If the port is taken.
        """
        if not is_loopback(host):
            raise ConfigError(
                f"--listen {host}:{port}: other machines could read the metrics, which are not encrypted; "
                f"listen at 127.0.0.1, and let them read {PATH} of the page, by HTTPS and with its token"
            )
        access = Access(new_token(), new_token())
        access.know_hosts([host])
        routes = [metrics_route(metrics, None)]
        app = SecurityMiddleware(Starlette(routes=routes), access)
        self._listener = HttpListener(app, open_port(host, port, "--listen"))

    @property
    def port(self) -> int:
        """Return the port of the listener."""
        return self._listener.port

    async def run(self) -> None:
        """Serve until cancelled."""
        try:
            await self._listener.start()
            await asyncio.Event().wait()
        finally:
            await self._listener.close()
