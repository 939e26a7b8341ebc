"""Duration for which a command looks for a site."""

import asyncio
import socket
from typing import Any

import pytest

from pointit.cli.common import site_link
from pointit.cli.common.site_link import CONNECT_TIMEOUT_S, REFUSED_TIMEOUT_S, join_site
from pointit.runtime.errors import ConnectError
from pointit.runtime.virtual_time import run_virtually
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from tests.support.buses import free_port

WRONG_S = 1.5
"""Duration until a router refuses credentials, s."""


def looked_s(monkeypatch: pytest.MonkeyPatch, *connect: str, is_refusing: bool = False) -> float:
    """Return the duration for which `join_site` looks for a site that does not answer at `connect`, s."""

    async def find_nobody(_link: Any, *, patience_s: float) -> ZenohBus:
        await asyncio.sleep(WRONG_S if is_refusing else patience_s)
        raise ConnectError("nobody answers")

    async def run_here(work: Any, _name: str) -> Any:
        return work()  # a thread would not stop the virtual time

    async def look() -> float:
        began_s = asyncio.get_running_loop().time()
        with pytest.raises(ConnectError, match="nobody answers"):
            async with join_site("lab", connect):
                pass
        return asyncio.get_running_loop().time() - began_s

    monkeypatch.setattr(ZenohBus, "open", find_nobody)
    monkeypatch.setattr(site_link, "in_daemon_thread", run_here)
    return run_virtually(look())


@pytest.mark.parametrize("protocol", ["tcp", "tls", "ws"])
def test_it_is_short_where_nobody_listens(monkeypatch: pytest.MonkeyPatch, protocol: str) -> None:
    found_s = looked_s(monkeypatch, f"{protocol}/127.0.0.1:{free_port()}")
    assert found_s == pytest.approx(REFUSED_TIMEOUT_S)


def test_link_timeout_is_long_when_any_address_listens(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        busy = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        dead = f"tcp/127.0.0.1:{free_port()}"
        assert looked_s(monkeypatch, dead, busy) == pytest.approx(CONNECT_TIMEOUT_S)


@pytest.mark.parametrize("endpoint", ["udp/127.0.0.1:9", "quic/127.0.0.1:9", "unixsock-stream//nowhere"])
def test_it_is_long_where_tcp_cannot_tell(monkeypatch: pytest.MonkeyPatch, endpoint: str) -> None:
    assert looked_s(monkeypatch, endpoint) == pytest.approx(CONNECT_TIMEOUT_S)


def test_a_refusal_of_credentials_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        where = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        assert looked_s(monkeypatch, where, is_refusing=True) == pytest.approx(WRONG_S)
