"""Hosts, routers and wrists of a load test."""

import asyncio
import json
import socket
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar, cast

import pytest

from pointit.runtime.errors import ConfigError
from pointit.runtime.router import parse_config
from pointit.runtime.zenoh.declarations import encoding_of
from pointit.schemas import Cursor, ImuSample
from pointit_lab.loadtest import hosts
from pointit_lab.loadtest.hosts import CONTENTS_S, HostsTest
from pointit_lab.loadtest.measuring import secured_site
from pointit_lab.loadtest.network.counters import OUTGOING, Contents, Counters, count
from pointit_lab.loadtest.network.namespaces import NamespaceNetwork, NamespaceTraffic
from pointit_lab.loadtest.network.routers import plain_configuration, router_process, secured_configuration
from pointit_lab.loadtest.network.tree import tree
from pointit_lab.loadtest.sight import DRAIN_S, LoadTestReceiver
from pointit_lab.loadtest.usage import UsageSample
from pointit_lab.loadtest.workers import Group, Worker
from pointit_lab.loadtest.wrist import LoadTestWrist, drive_wrists
from tests.support.bench import in_virtual_time

Report = Callable[[], float]


class Link(NamespaceNetwork):
    """Two machines whose link carries 1000 bytes per second while wrists are driven."""

    driven_s: Report

    def traffic(self) -> dict[int, NamespaceTraffic]:
        up_bytes = round(1000 * self.driven_s())
        return {1: NamespaceTraffic(up_bytes=up_bytes, up_packets=0, down_bytes=0, down_packets=0)}


class Driven(Worker):
    """A worker that answers when it has driven its wrists and waited for what still travels."""

    def __init__(self) -> None:
        self.group = Group(name="people 1")
        self.began_s = self.duration_s = 0.0
        self.sight = LoadTestReceiver(frozenset())

    def send_line(self, message: dict[str, Any]) -> None:
        self.began_s, self.duration_s = asyncio.get_running_loop().time(), message.get("duration_s", 0.0)

    def driven_s(self) -> float:
        return min(asyncio.get_running_loop().time() - self.began_s, self.duration_s)

    async def answer(self) -> dict[str, Any]:
        await asyncio.sleep(self.duration_s + DRAIN_S)
        cpu = {"lasted_s": self.duration_s, "cpu_s": 0.5 * self.duration_s, "memory_mb": 1.0}
        return {"sent": 1, "sight": self.sight.dump(), **cpu}


@in_virtual_time
async def test_routers_and_links_are_read_while_wrists_are_driven() -> None:
    worker = Driven()
    network = Link(tree(2, 2, 2), "tcp", lacking="a real one")
    network.driven_s = worker.driven_s

    async def started(*_: Any) -> Driven:
        return worker

    async def ready(_: NamespaceNetwork) -> Counters:
        return Counters({})

    async def counted(_self: Counters, duration_s: float) -> dict[int, Contents]:
        return {1: Contents(lasted_s=duration_s, counts={"Cursor": [8, 0]})}

    def used(_pid: int | None) -> UsageSample:
        return UsageSample(cpu_s=0.25 * worker.driven_s(), memory_mb=1.0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Worker, "start", started)
        patch.setattr(Counters, "start", ready)
        patch.setattr(Counters, "count", counted)
        patch.setattr(hosts, "read_usage", used)
        test = HostsTest(network, {0: [worker.group]}, {0: 1})
        await test.start("lab")
        result = await test.measure(100.0, 1.0, "")
    (link,) = result.links
    assert link.up_bytes_hz == pytest.approx(1000.0)
    assert (link.up_hz, link.counted_s) == ({"Cursor": 8 / CONTENTS_S}, CONTENTS_S)
    assert [usage.cpu for usage in result.processes] == pytest.approx([0.5, 0.25])


def test_a_plain_router_joins_the_one_above(tmp_path: Path) -> None:
    made = plain_configuration("tcp/127.0.0.1:7447", ["tcp/198.18.0.2:7447"])
    config = parse_config(json.dumps(made), tmp_path)
    assert json.loads(config.get_json("connect/endpoints")) == ["tcp/198.18.0.2:7447"]


def test_secured_load_router_has_site_rules_at_its_own_port(tmp_path: Path) -> None:
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


class Links(NamespaceNetwork):
    """One link, whose counter is a command of the test."""

    program: Sequence[str] = ("false",)

    def traffic(self) -> dict[int, NamespaceTraffic]:
        return {1: NamespaceTraffic(up_bytes=0, up_packets=0, down_bytes=0, down_packets=0)}

    def arguments(self, index: int, *command: str) -> list[str]:
        return [*self.program, f"{index}", *command]


async def test_failing_counter_is_an_error_instead_of_an_empty_link() -> None:
    with pytest.raises(ConfigError, match=r"link of host 2 could not be counted, .* exit code 1: see"):
        await Counters.start(Links(tree(2, 2, 2), "tcp"))


async def test_a_counter_that_ends_while_it_counts_is_an_error() -> None:
    links = Links(tree(2, 2, 2), "tcp")
    links.program = ("sh", "-c", "echo; read line; exit 3")
    counters = await Counters.start(links)
    with pytest.raises(ConfigError, match="exit code 3"):
        await counters.count(0.1)


async def test_counters_are_ready_before_they_count_and_report_their_duration() -> None:
    links = Links(tree(2, 2, 2), "tcp")
    told = '{"lasted_s": 0.2, "counts": {"Cursor": [3, 0]}}'
    links.program = ("sh", "-c", f"echo; read line; test $line = 0.1 && echo '{told}'")
    counted = await (await Counters.start(links)).count(0.1)
    assert counted == {1: Contents(lasted_s=0.2, counts={"Cursor": [3, 0]})}


def test_outgoing_and_incoming_messages_are_counted_separately() -> None:
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


class Sent:
    """Takes samples; the first takes long."""

    def __init__(self, stall_s: float = 0.0) -> None:
        self.samples: list[ImuSample] = []
        self._stall_s = stall_s

    def put(self, message: ImuSample) -> None:
        if not self.samples:
            time.sleep(self._stall_s)
        self.samples.append(message)

    def close(self) -> None: ...
    def close_nowait(self) -> None: ...


async def test_each_wrist_puts_what_its_rate_says_and_never_more() -> None:
    sent = [Sent(), Sent(), Sent()]
    began_s = time.monotonic()
    await drive_wrists([LoadTestWrist(one) for one in sent], 50.0, 1.0)
    assert time.monotonic() - began_s >= 0.95
    assert all(10 < len(one.samples) <= 50 for one in sent), "fewer on a busy machine"
    assert [sample.seq for sample in sent[0].samples] == list(range(1, len(sent[0].samples) + 1))


async def test_late_samples_are_dropped_instead_of_sent_in_a_burst() -> None:
    sent = Sent(stall_s=0.5)
    await drive_wrists([LoadTestWrist(sent)], 100.0, 1.0)
    assert len(sent.samples) <= 52
