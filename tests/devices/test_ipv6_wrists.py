"""Wrists that send to a port at all addresses of IPv6, which also gets datagrams of IPv4."""

import asyncio
import socket

import pytest

from pointit.services.imu_bridge.network.udp import UdpConfig
from pointit.services.imu_bridge.network.udp_server import Address, UdpServer
from tests.support.bench import background, until
from tests.support.buses import free_udp_port
from tests.support.running_source import Health, phone_at


@pytest.mark.parametrize(("host", "family"), [("127.0.0.1", socket.AF_INET), ("::1", socket.AF_INET6)])
async def test_sender_has_the_address_that_people_write_and_gets_answers(
    host: str, family: socket.AddressFamily
) -> None:
    heard: list[Address] = []
    port = free_udp_port()
    health = Health()
    server = UdpServer("::", port, health, lambda _data, address: heard.append(address), remedy="")
    async with background(server.run()):
        with socket.socket(family, socket.SOCK_DGRAM) as wrist:
            wrist.bind((host, 0))
            wrist.settimeout(5.0)
            await until(lambda: bool(wrist.sendto(b"hello", (host, port)) and heard))
            assert set(heard) == {(host, wrist.getsockname()[1])}
            server.send(b"buzz", heard[0])
            assert await asyncio.to_thread(wrist.recv, 100) == b"buzz"
        assert server.place == f"[::]:{port}"
    assert not health.warnings


async def test_shared_port_of_ipv6_answers_a_connected_sender_of_ipv4() -> None:
    heard: list[Address] = []
    port = free_udp_port()
    server = UdpServer("::", port, Health(), lambda _data, one: heard.append(one), remedy="", is_shared=True)
    async with background(server.run()), phone_at(port) as phone:
        await until(phone.saying(b"hello", lambda: bool(heard)))
        server.connect(heard[0])
        server.send(b"pong", heard[0])
        await until(lambda: phone.heard == [b"pong"])
        count = len(heard)
        await until(phone.saying(b"again", lambda: len(heard) > count))
        assert set(heard) == {heard[0]}


def test_host_of_a_wrist_may_have_brackets_and_its_port() -> None:
    assert UdpConfig.model_validate({"host": "[::]", "port": 5555}).host == "::"
    config = UdpConfig.model_validate({"host": "[::1]:5556"})
    assert (config.host, config.port) == ("::1", 5556)
