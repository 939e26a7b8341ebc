"""A router that throws somebody out does not wait for them."""

import asyncio
import contextlib
import json
import socket
import sys
from pathlib import Path

import pytest

from pointit.access.router_configuration import configuration
from pointit.runtime.host.tcp_timeouts import LINGER, tcp_sockets
from pointit.runtime.router.router import Router
from tests.integration.access.secured import Member, make_site
from tests.support.bench import until


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere nobody finds the sockets of Zenoh")
async def test_no_connection_that_was_accepted_lingers(tmp_path: Path) -> None:
    folder = make_site(tmp_path / "lab", password=True)
    port = folder.state().port
    router = Router(lambda: json.dumps(configuration([folder.router_site()], ["127.0.0.1"])), Path(), [])

    def lingering() -> list[bool]:
        found: list[bool] = []
        for each in tcp_sockets():
            with contextlib.suppress(OSError):  # closed meanwhile
                if each.getsockname()[1] == port and not _listens(each):
                    value = each.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER.size)
                    found.append(bool(LINGER.unpack(value)[0]))
        return found

    await router.open()
    following = asyncio.create_task(router.reload_on_change(), name="router")
    try:
        with Member(folder, "anna"):
            assert lingering() == [True], "Zenoh does as it did: else nothing of this is needed"
            await until(lambda: lingering() == [False], what="the router to let go")
    finally:
        following.cancel()
        await router.close()


def _listens(found: socket.socket) -> bool:
    return bool(found.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN))
