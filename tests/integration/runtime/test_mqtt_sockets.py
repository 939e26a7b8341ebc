"""Sockets of a client of a broker that goes away: nothing is watched that is closed."""

import asyncio
import socket
from typing import Any

import aiomqtt
import pytest

from pointit.runtime.mqtt import broker

pytestmark = pytest.mark.wall_time
"""A selector in virtual time would not differ, but the sockets are real."""


@pytest.mark.parametrize("is_closed", [True, False])
async def test_socket_that_is_closed_before_it_is_watched_is_ignored(*, is_closed: bool) -> None:
    loop = asyncio.get_running_loop()
    failures: list[dict[str, Any]] = []
    loop.set_exception_handler(lambda _loop, context: failures.append(context))
    client = aiomqtt.Client("127.0.0.1")
    broker.ignore_closed_sockets(client)
    near, far = socket.socketpair()
    number = near.fileno()
    with far:
        client._on_socket_register_write(client._client, None, near)  # as paho does, when it has something
        client._on_socket_open(client._client, None, near)
        if is_closed:
            near.close()
        await asyncio.sleep(0.01)
        is_watched = loop.remove_writer(number) or loop.remove_reader(number)

        assert is_watched is not is_closed
        near.close()
    if client._misc_task is not None:
        client._misc_task.cancel()

    assert not failures
