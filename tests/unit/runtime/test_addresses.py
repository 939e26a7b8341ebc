"""This machine's addresses in its networks, and the substitute where there are none."""

import socket

import pytest

from pointit.runtime.host.name_lookup import found_addresses, is_reachable, lan_addresses, own_address


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


def test_a_machine_without_routes_has_no_address(monkeypatch: pytest.MonkeyPatch) -> None:
    route(monkeypatch, {})
    assert found_addresses() == []
    assert own_address("here") == "here"


def test_in_a_network_of_ipv6_alone_the_page_has_its_address_there(monkeypatch: pytest.MonkeyPatch) -> None:
    route(monkeypatch, {"2001:db8::1": "fd00::5", "fd00::1": "fe80::5"})
    assert (found_addresses(), lan_addresses()) == ([], ["fd00::5"])
    route(monkeypatch, {"192.0.2.1": "10.0.0.7", "2001:db8::1": "fd00::5"})
    assert lan_addresses() == ["10.0.0.7"]


def test_found_addresses_of_this_machine_are_reachable() -> None:
    assert all(is_reachable(address) for address in found_addresses())
    assert not is_reachable("127.0.0.1")
    assert not is_reachable("0.0.0.0")  # noqa: S104 - not listened at
    assert is_reachable("192.168.1.20")
