"""Routers of a load test: configurations that Zenoh takes, and what crosses a link."""

import json
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar, cast

import pytest

from pointit.runtime.errors import ConfigError
from pointit.runtime.zenoh.router.router import parse_config
from pointit.runtime.zenoh.wire_format import encoding_of
from pointit.schemas import Cursor, PointingRay
from pointit_lab.loadtest.measuring import secured_site
from pointit_lab.loadtest.network.counters import Contents, Counters
from pointit_lab.loadtest.network.link_contents import KIND, OUTGOING, count
from pointit_lab.loadtest.network.namespaces import Network, Traffic
from pointit_lab.loadtest.network.routers import plain_configuration, router_process, secured_configuration
from pointit_lab.loadtest.network.tree import tree


def test_a_plain_router_joins_the_one_above(tmp_path: Path) -> None:
    made = plain_configuration("tcp/127.0.0.1:7447", ["tcp/198.18.0.2:7447"])
    config = parse_config(json.dumps(made), tmp_path)
    assert json.loads(config.get_json("connect/endpoints")) == ["tcp/198.18.0.2:7447"]


def test_a_secured_router_has_the_sites_rules_at_its_own_port(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    site, credentials = secured_site(tmp_path / "site", "lab", 7447, ["127.0.0.1", "198.18.0.6"])
    made = secured_configuration(site, ["tls/198.18.0.6:7447"], 9000)
    config = parse_config(json.dumps(made), tmp_path)
    (listen,) = json.loads(config.get_json("listen/endpoints"))
    assert listen.startswith("tls/0.0.0.0:9000#")
    (uplink,) = json.loads(config.get_json("connect/endpoints"))
    assert uplink.startswith("tls/198.18.0.6:7447#")
    assert json.loads(config.get_json("access_control/enabled")) is True
    assert credentials.folder.name == "load"


async def test_zenohd_that_is_not_installed_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConfigError, match=r"zenohd is not in PATH; install it .*or use --router pointit"):
        async with router_process(plain_configuration("tcp/127.0.0.1:0", ()), "zenohd", tmp_path):
            pass


def test_messages_name_their_kind_in_clear() -> None:
    packet = b"\x01\x02".join(str(encoding_of(kind)).encode() for kind in (Cursor, PointingRay, Cursor))
    assert KIND.findall(packet) == [b"Cursor", b"PointingRay", b"Cursor"]


class Links(Network):
    """One link, whose counter is a command of the test."""

    program: Sequence[str] = ("false",)

    def traffic(self) -> dict[int, Traffic]:
        return {1: Traffic(up_bytes=0, up_packets=0, down_bytes=0, down_packets=0)}

    def arguments(self, index: int, *command: str) -> list[str]:
        return [*self.program, f"{index}", *command]


async def test_a_counter_that_fails_is_an_error_and_not_an_empty_link() -> None:
    with pytest.raises(ConfigError, match=r"link of host 2 could not be counted, .* exit code 1: see"):
        await Counters.start(Links(tree(2, 2, 2), "tcp"))


async def test_a_counter_that_ends_while_it_counts_is_an_error() -> None:
    links = Links(tree(2, 2, 2), "tcp")
    links.program = ("sh", "-c", "echo; read line; exit 3")
    counters = await Counters.start(links)
    with pytest.raises(ConfigError, match="exit code 3"):
        await counters.count(0.1)


async def test_counters_are_ready_before_they_count_and_say_for_how_long_they_did() -> None:
    links = Links(tree(2, 2, 2), "tcp")
    told = '{"lasted_s": 0.2, "counts": {"Cursor": [3, 0]}}'
    links.program = ("sh", "-c", f"echo; read line; test $line = 0.1 && echo '{told}'")
    counted = await (await Counters.start(links)).count(0.1)
    assert counted == {1: Contents(lasted_s=0.2, counts={"Cursor": [3, 0]})}


def test_what_leaves_and_enters_while_counting_is_told_apart() -> None:
    cursor = str(encoding_of(Cursor)).encode()

    class Wire:
        packets: ClassVar = [(cursor, ("", 0, OUTGOING, 1, b"")), (cursor + cursor, ("", 0, 0, 1, b""))]

        def settimeout(self, _left_s: float) -> None:
            pass

        def recvfrom(self, _most: int) -> Any:
            if not self.packets:
                raise TimeoutError
            return self.packets.pop()

    assert count(cast("socket.socket", Wire()), 60.0)["counts"] == {"Cursor": [1, 2]}
