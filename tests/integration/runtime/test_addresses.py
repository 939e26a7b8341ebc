"""Addresses that cannot be listened on, and why."""

import asyncio
import socket

import pytest

from pointit.runtime.errors import ConnectError, ListenError
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from tests.support.buses import free_port, router_process
from tests.support.pace import within


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


@pytest.mark.parametrize("is_listening", [False, True])
async def test_a_silent_address_does_not_prevent_trying_the_next(is_listening: bool) -> None:
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        if is_listening:  # and says nothing
            mute.listen()
        dead = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        async with router_process() as router:
            link = Link(connect=(dead, dead, router.endpoint))
            began_s = asyncio.get_running_loop().time()
            bus = await ZenohBus.open(link, patience_s=0.0)
            assert within(asyncio.get_running_loop().time() - began_s, 8.0)
            assert bus.connected
            await bus.close()


async def test_silence_at_all_addresses_is_reported_after_trying_each() -> None:
    where = tuple(f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    with pytest.raises(ConnectError, match=f"nobody answers at {where[0]}, {where[1]}"):
        await ZenohBus.open(Link(connect=where), patience_s=0.0)
