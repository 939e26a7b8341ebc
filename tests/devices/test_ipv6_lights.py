"""Lights in networks without IPv4: every output that sends datagrams, at each spelling of its address."""

import asyncio
import contextlib
import socket
from collections.abc import AsyncGenerator, Callable
from pathlib import Path
from typing import Any

import pytest
from zeroconf import IPVersion
from zeroconf.asyncio import AsyncServiceInfo, AsyncZeroconf

from pointit.plugins.device_search import HOME_ASSISTANTS
from pointit.runtime.clock import WallClock
from pointit.runtime.host import name_lookup
from pointit.runtime.host.name_lookup import resolve
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import Strip
from pointit.services.led_driver.output.udp_output import UdpOutput
from pointit.services.led_driver.outputs import OUTPUTS
from tests.support.bench import background, until
from tests.support.running_source import Health

STRIP = Strip(id="a", line_m=((0, 0, 0), (1, 0, 0)), pixels=2)
MARKS = {"ddp": b"\x41", "artnet": b"Art-Net\0", "e131": b"\0\x10\0\0ASC-E1.17\0\0\0", "spotlight": b"\0\x10"}
"""First bytes of each output's datagrams."""
DGRAM = socket.SOCK_DGRAM


class Light(asyncio.DatagramProtocol):
    """A receiver of datagrams."""

    def __init__(self) -> None:
        self.datagrams: list[bytes] = []

    def datagram_received(self, data: bytes, addr: tuple[Any, ...]) -> None:
        del addr
        self.datagrams.append(data)


@contextlib.asynccontextmanager
async def light(host: str) -> AsyncGenerator[tuple[Light, int]]:
    transport, one = await asyncio.get_running_loop().create_datagram_endpoint(Light, local_addr=(host, 0))
    yield one, transport.get_extra_info("sockname")[1]
    transport.abort()


@contextlib.asynccontextmanager
async def shown(text: str) -> AsyncGenerator[Health]:
    """Run the output of `--output TEXT`."""
    health = Health()
    name, values = OUTPUTS.choose(text)
    config = OUTPUTS.validate(name, {"kind": name, **values})
    around = Surroundings(clock=WallClock(), health=health, folder=Path("unused"))
    output = OUTPUTS.get(name).make(config, around)
    if isinstance(output, UdpOutput):
        output.set_strips([STRIP])
    async with background(output.run()):
        yield health


@pytest.mark.parametrize(
    ("kind", "spelling"),
    [
        *((kind, "[::1]:{port}") for kind in MARKS),
        ("ddp", "[0:0::1]:{port}"),
        ("ddp", "strip.example:{port}"),
    ],
)
async def test_frames_arrive_in_a_network_without_ipv4(
    monkeypatch: pytest.MonkeyPatch, kind: str, spelling: str
) -> None:
    know(monkeypatch, "strip.example", "::1")
    async with light("::1") as (receiver, port), shown(f"{kind}:{spelling.format(port=port)}") as health:
        await until(lambda: len(receiver.datagrams) > 2, what="the datagrams")
        assert all(each.startswith(MARKS[kind]) for each in receiver.datagrams)
        assert not health.warnings


async def test_name_of_both_kinds_is_sent_to_by_ipv4_first(monkeypatch: pytest.MonkeyPatch) -> None:
    know(monkeypatch, "strip.example", "::1", "127.0.0.1")
    async with light("127.0.0.1") as (receiver, port), shown(f"ddp:strip.example:{port}"):
        await until(lambda: bool(receiver.datagrams), what="the datagrams")


async def test_address_to_which_no_network_leads_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    know(monkeypatch, "strip.example", "255.255.255.255", "::1")  # the first: only for broadcasts
    async with light("::1") as (receiver, port), shown(f"ddp:strip.example:{port}") as health:
        await until(lambda: bool(receiver.datagrams), what="the datagrams")
        assert not health.warnings


def test_scope_of_a_link_local_address_is_kept() -> None:
    ((family, address),) = set(resolve("fe80::1%lo", 4048, DGRAM))
    assert family == socket.AF_INET6
    assert address == ("fe80::1", 4048, 0, socket.if_nametoindex("lo"))


@pytest.mark.parametrize("kind", ["e131", "spotlight"])
def test_multicast_needs_ipv4_and_says_so(kind: str) -> None:
    values = {"kind": kind, "host": "multicast", "interface": "fe80::1%lo"}
    with pytest.raises(ValueError, match="is not an IPv4 address of this machine, which multicast needs"):
        OUTPUTS.validate(kind, values)


def know(monkeypatch: pytest.MonkeyPatch, name: str, *addresses: str) -> None:
    """Make the resolver of this machine answer `addresses` for `name`."""
    original: Callable[..., list[Any]] = socket.getaddrinfo

    def answer(host: Any, *arguments: Any, **options: Any) -> list[Any]:
        if host != name:
            return original(host, *arguments, **options)
        family = arguments[1] if len(arguments) > 1 else options.get("family", 0)
        found = [each for host in addresses for each in original(host, *arguments[:1], type=DGRAM)]
        wanted = [each for each in found if family in (0, each[0])]
        if not wanted:
            raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
        return wanted

    monkeypatch.setattr(socket, "getaddrinfo", answer)


@pytest.mark.skipif(not name_lookup.found_addresses(socket.AF_INET6), reason="no IPv6 here")
async def test_light_announced_in_a_network_without_ipv4_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def addresses(family: socket.AddressFamily = socket.AF_INET) -> list[str]:
        return [] if family == socket.AF_INET else ["fd00::2"]

    monkeypatch.setattr(name_lookup, "found_addresses", addresses)
    light = AsyncServiceInfo(
        "_wled._tcp.local.",
        "desk-v6._wled._tcp.local.",
        addresses=[socket.inet_pton(socket.AF_INET6, "fd00::5")],
        port=80,
        server="desk-v6.local.",
    )
    async with AsyncZeroconf(ip_version=IPVersion.V6Only) as announcer:
        await (await announcer.async_register_service(light))
        found = {(each.name, each.address) for each in await name_lookup.browse("_wled._tcp", 4.0)}
    assert ("desk-v6", "fd00::5") in found


@pytest.mark.skipif(not name_lookup.found_addresses(socket.AF_INET6), reason="no IPv6 here")
@pytest.mark.parametrize("version", [IPVersion.V4Only, IPVersion.All])
async def test_home_assistant_that_announces_an_ipv6_address_alone_is_found(version: IPVersion) -> None:
    home = AsyncServiceInfo(
        "_home-assistant._tcp.local.",
        "Home of IPv6._home-assistant._tcp.local.",
        addresses=[socket.inet_pton(socket.AF_INET6, "fd00::7")],
        port=8123,
        properties={"location_name": "Home of IPv6", "version": "2026.11.1", "internal_url": ""},
        server="home-v6.local.",
    )
    plugin = HOME_ASSISTANTS.get("home-assistant")
    assert plugin.discover is not None
    async with AsyncZeroconf(ip_version=version) as announcer:
        await (await announcer.async_register_service(home))
        found = {each.address: each.label for each in await plugin.discover(4.0)}
    assert found["http://[fd00::7]:8123"] == "Home of IPv6, 2026.11.1, announced by fd00::7"
