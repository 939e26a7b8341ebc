"""Addresses that cannot be listened on, and why."""

import socket

import pytest

from pointit.runtime import ListenError
from pointit.runtime.zenoh_bus import ZenohBus
from pointit.runtime.zenoh_session import Link


async def test_an_address_that_is_taken() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        where = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(ListenError) as caught:
            await ZenohBus.open(Link(listen=(where,)))
    assert str(caught.value) == (
        f"cannot listen on {where}: Address already in use; another PointIt may be running there: "
        "join it with --connect, or choose another address with --listen"
    )


async def test_an_address_of_another_machine() -> None:
    foreign = "tcp/192.0.2.1:7447"  # of no machine: reserved for documentation
    with pytest.raises(ListenError) as caught:
        await ZenohBus.open(Link(listen=(foreign,)))
    assert str(caught.value) == (
        f"cannot listen on {foreign}: Cannot assign requested address; choose another address with --listen"
    )
