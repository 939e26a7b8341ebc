"""The door to the local network: which address, which port, and what is said when there is none."""

import hashlib
import socket
import ssl

import httpx
import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from pointit.bridges.web.config import WebConfig
from pointit.bridges.web.lan_address import choose_address
from pointit.bridges.web.server.lan import Lan
from pointit.bridges.web.server.listener import url
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.state_file import site_folder
from tests.unit.web.phone_bench import trust

pytestmark = pytest.mark.wall_time


async def _word(_request: Request) -> PlainTextResponse:
    return PlainTextResponse("here")


APP = Starlette(routes=[Route("/", _word)])


def lan(**fields: object) -> Lan:
    config = WebConfig.model_validate({"lan_port": 0, "lan_address": "127.0.0.1", **fields})
    return Lan(config, "lab", APP, addresses=lambda: ["127.0.0.1"])


async def fetched(url: str) -> str:
    async with httpx.AsyncClient(verify=trust()) as client:
        return (await client.get(url)).text


def test_listening_address_is_chosen() -> None:
    assert choose_address("", ["192.168.1.20", "10.0.0.7"]) == "192.168.1.20"
    assert choose_address("10.0.0.7", ["192.168.1.20"]) == "10.0.0.7"
    assert choose_address("FD00::5", []) == "fd00::5"
    assert choose_address("[fd00::5]", []) == "fd00::5"
    with pytest.raises(ConfigError, match=r"'10\.0\.0\.7:80' has a port; .* lan_port: 80"):
        choose_address("10.0.0.7:80", [])
    with pytest.raises(ConfigError, match=r"no address in a local network.*--set web\.lan_address=192"):
        choose_address("", [])
    with pytest.raises(ConfigError, match=r"lan_address: 'wlan0' is not an address"):
        choose_address("wlan0", [])
    with pytest.raises(ConfigError, match=r"lan_address: 0\.0\.0\.0 is not the address of one machine"):
        choose_address("0.0.0.0", [])  # noqa: S104 - refused


def test_url_writes_ipv6_addresses_in_brackets() -> None:
    assert url("https", "10.0.0.7", 8443) == "https://10.0.0.7:8443"
    assert url("https", "fd00::5", 8443) == "https://[fd00::5]:8443"


async def test_page_is_served_with_its_own_certificate() -> None:
    door = lan()
    try:
        assert door.url == ""
        url = await door.open()
        assert url == door.url
        assert await fetched(url) == "here"
        assert await door.open() == url
        der = ssl.PEM_cert_to_DER_cert((site_folder("lab", "web") / "certificate.pem").read_text())
        assert door.fingerprint.replace(":", "") == hashlib.sha256(der).hexdigest().upper()
        async with httpx.AsyncClient() as stranger:
            with pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
                await stranger.get(url)
    finally:
        await door.close()
    assert door.url == ""
    with pytest.raises(httpx.ConnectError):
        await fetched(url)


async def test_next_port_is_used_and_noted_when_one_is_taken() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        taken = other.getsockname()[1]
        door = lan(lan_port=taken)
        try:
            url = await door.open()
            port = int(url.rpartition(":")[2])
            assert taken < port < taken + 10
            assert f"port {taken} of 127.0.0.1 is taken: the page is at port {port}" in door.note
            assert await fetched(url) == "here"
        finally:
            await door.close()


async def test_page_is_not_opened_when_there_is_no_network() -> None:
    door = Lan(WebConfig(lan_port=0), "lab", APP, addresses=list)
    with pytest.raises(RefusedError, match="no address in a local network"):
        await door.open()
    foreign = Lan(WebConfig(lan_port=0, lan_address="192.0.2.77"), "lab", APP, addresses=list)
    with pytest.raises(RefusedError, match=r"192\.0\.2\.77, which is no address of this machine"):
        await foreign.open()
    assert foreign.url == ""
