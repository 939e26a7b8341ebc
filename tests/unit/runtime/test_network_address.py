"""Addresses that are written, and those of this machine."""

import ipaddress
import socket
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, ValidationError

from pointit.runtime.address_config import AddressConfig, format_address, is_loopback, parse_address
from pointit.runtime.host import name_lookup
from pointit.runtime.host.interfaces import interface_addresses
from pointit.runtime.host.name_lookup import found_addresses, lan_addresses, own_address

HOSTS = st.one_of(
    st.ip_addresses().filter(lambda address: not (address.version == 6 and address.is_link_local)).map(str),
    st.from_regex(r"[a-z]([a-z0-9-]{0,20}[a-z])?(\.[a-z]{2,8}){0,3}", fullmatch=True),
    st.ip_addresses(v=6, network="fe80::/10").map(lambda address: f"{address}%eth0"),
)


@given(host=HOSTS, port=st.integers(0, 65535))
def test_formatted_host_and_port_are_parsed_back(host: str, port: int) -> None:
    assert parse_address(format_address(host, port)) == (host, port)
    assert parse_address(host) == (host, None)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("[::1]", ("::1", None)),
        ("0:0:0:0:0:0:0:1", ("::1", None)),
        ("[FE80::a%wlan0]:80", ("fe80::a%wlan0", 80)),
        ("::ffff:10.1.2.3", ("::ffff:a01:203", None)),
        (" strip.local. ", ("strip.local.", None)),
        ("strip_1:4048", ("strip_1", 4048)),
        ("2-strip", ("2-strip", None)),
    ],
)
def test_spellings_of_an_address_are_read(text: str, address: tuple[str, int | None]) -> None:
    host, port = parse_address(text)
    assert port == address[1]
    if ":" in host and "%" not in host:
        assert ipaddress.ip_address(host) == ipaddress.ip_address(address[0])
    else:
        assert host == address[0]


NO_ADDRESSES = [
    *("", ":80", "strip:", "strip:http", "strip:8_0", "strip:+8", "strip:\u0662", "a b"),
    *("strip..local", ".local:80", "..", "strip\0", "a" * 64, f"strip.{'a' * 64}.local:80"),
    *("http://strip", "strip/", "me@strip", "[strip]", "[10.0.0.1]:80", "[::1", "::1]:80", "[::1]80"),
    *("10.0.1", "10.0.0.256", "10.0.0.010", "0x7f.0x1", "4048", "fe80::1%", "::1:99999"),
]
SPELLING = r"is not an address: write HOST or HOST:PORT, for IPv6 ::1 or"
INTERFACE = r"add this machine.s interface, as in fe.+::1%eth0"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        *((text, SPELLING) for text in NO_ADDRESSES),
        ("fe80::1", INTERFACE),
        ("[febf::1]:80", INTERFACE),
        ("strip:65536", "port 65536 is above 65535"),
    ],
)
def test_text_that_is_no_address_is_refused_with_the_remedy(text: str, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        parse_address(text)


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        *((host, True) for host in ("127.0.0.1", "127.8.8.8", "::1", "localhost", "[::1]", "[::1]:80")),
        *((host, True) for host in ("0:0:0:0:0:0:0:1", "LocalHost", "localhost.", " localhost:8090 ")),
        *((host, False) for host in ("0.0.0.0", "::", "192.168.1.5", "plant.local", "127.0.0.1.evil")),  # noqa: S104
        *((host, False) for host in ("localhost.evil", "127.evil", "[::]", "", "[::1", "2001:db8::1")),
    ],
)
def test_loopback_is_this_machine_alone(address: str, *, expected: bool) -> None:
    assert is_loopback(address) is expected


class Device(AddressConfig):
    host: str = ""
    port: int = Field(default=4048, gt=0)


def test_port_of_the_host_sets_the_port() -> None:
    assert Device.model_validate({"host": "[::1]:5"}) == Device(host="::1", port=5)
    assert Device.model_validate({"host": "[::1]"}) == Device(host="::1", port=4048)
    assert Device.model_validate({"host": "::1", "port": "7"}) == Device(host="::1", port=7)
    assert Device.model_validate({"host": "strip:7", "port": "7"}) == Device(host="strip", port=7)
    written = Device(host="fe80::1%eth0", port=9)
    assert Device.model_validate(written.model_dump()) == written


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"host": "strip:5", "port": 6}, "host: strip:5 and port 6 differ: remove one of the ports"),
        ({"host": "http://strip"}, "host: 'http://strip' is not an address"),
        ({"host": "strip:0"}, "greater than 0"),
    ],
)
def test_host_that_cannot_be_used_is_one_sentence(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValidationError, match=sentence):
        Device.model_validate(values)


def route(monkeypatch: pytest.MonkeyPatch, routes: dict[str, str]) -> None:
    """Let the system choose from these of its addresses: by what one goes towards."""
    chosen: dict[int, str] = {}

    def connect(probe: socket.socket, address: tuple[str, int]) -> None:
        if address[0] not in routes:
            raise OSError(101, "Network is unreachable")
        chosen[probe.fileno()] = routes[address[0]]

    def name(probe: socket.socket) -> tuple[str, int]:
        return chosen[probe.fileno()], 9

    monkeypatch.setattr(socket.socket, "connect", connect)
    monkeypatch.setattr(socket.socket, "getsockname", name)


def test_the_default_routes_comes_first_and_none_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    both = {"192.0.2.1": "172.16.0.2", "10.255.255.254": "10.0.0.7", "172.31.255.254": "172.16.0.2"}
    route(monkeypatch, both)
    assert found_addresses() == ["172.16.0.2", "10.0.0.7"]
    assert own_address("here") == "172.16.0.2"


def test_addresses_that_others_cannot_reach_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    route(monkeypatch, {"192.0.2.1": "127.0.0.1", "10.255.255.254": "10.0.0.7"})
    assert found_addresses() == ["10.0.0.7"]
    assert own_address("here") == "10.0.0.7"


def test_a_machine_without_routes_has_the_addresses_of_its_interfaces(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    route(monkeypatch, {})
    monkeypatch.setattr(name_lookup, "interface_addresses", lambda: ["127.0.0.1", "192.168.7.2"])
    assert found_addresses() == ["192.168.7.2"]


def test_interfaces_of_this_machine_have_the_loopback_address() -> None:
    if sys.platform != "linux":
        pytest.skip("asks Linux")
    assert "127.0.0.1" in interface_addresses()


def test_a_machine_without_routes_and_interfaces_has_no_address(monkeypatch: pytest.MonkeyPatch) -> None:
    route(monkeypatch, {})
    monkeypatch.setattr(name_lookup, "interface_addresses", list)
    assert found_addresses() == []
    assert own_address("here") == "here"


def test_page_has_an_ipv6_address_in_a_network_without_ipv4(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(name_lookup, "interface_addresses", list)
    route(monkeypatch, {"2001:db8::1": "fd00::5", "fd00::1": "fe80::5"})
    assert (found_addresses(), lan_addresses()) == ([], ["fd00::5"])
    route(monkeypatch, {"192.0.2.1": "10.0.0.7", "2001:db8::1": "fd00::5"})
    assert lan_addresses() == ["10.0.0.7"]
