"""The service with a server of QTM's RT protocol, which is our own, and what is no such server."""

import asyncio
import contextlib
import socket
import struct
import sys
import time
from collections.abc import AsyncGenerator, Sequence

import pytest

from pointit.bridges.mocap import qtm_client
from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.mocap_systems import MOCAP_SYSTEMS
from pointit.bridges.mocap.qtm_client import QtmSession
from pointit.bridges.mocap.service import Mocap
from pointit.cli.plugins.devices import rows
from pointit.geometry import rotation
from pointit.plugins.device_search import SearchResult
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, check_launches
from tests.devices.test_mocap import YAW_RAD, arm, check_cup_and_pose, moving_wrist, running
from tests.support.bench import until
from tests.unit.mocap import qtm_server
from tests.unit.mocap.qtm_server import LEVEL, LOST, QtmBody, QtmServer, serving, text
from tests.unit.mocap.test_qtm_session import columns_of

qtm_rt = pytest.importorskip("qtm_rt", reason="qtm-rt is not installed")
NAMES = ("cup", "cap", "cuff", "plate")


def bodies(now_ns: int) -> Sequence[QtmBody]:
    """Return bodies with z up: a cup, a cap at (1, 2), a cuff on the arm, and a plate that is lost."""
    turn = rotation.multiply(rotation.from_yaw(YAW_RAD), arm(now_ns))
    return (
        ((1000.0, 2000.0, 1500.0), LEVEL, 0.4),
        ((1000.0, 2000.0, 1700.0), LEVEL, 0.4),
        ((1200.0, 2000.0, 1200.0), columns_of(turn), 0.4),
        LOST,
    )


def server(**parameters: object) -> QtmServer:
    return QtmServer(NAMES, time.time_ns, bodies, **parameters)  # pyrefly: ignore[bad-argument-type]


async def test_bodies_become_objects_and_a_moving_arm_gives_a_pose() -> None:
    async with serving(server()) as port, running(port, system="qtm") as (watcher, bus), moving_wrist(bus):
        await check_cup_and_pose(watcher)
        assert not watcher.sees("plate"), "it is lost"


async def test_objects_leave_when_the_server_ends_and_return_with_it() -> None:
    async with contextlib.AsyncExitStack() as stack:
        async with serving(server()) as port:
            watcher, _ = await stack.enter_async_context(running(port, system="qtm"))
            await until(lambda: watcher.sees("cup"))
        await until(lambda: not watcher.objects[-1].objects)
        await until(lambda: watcher.warns("start QTM there"))
        again = server()
        again.names = ("plate", "cap", "cuff", "cup")
        await stack.enter_async_context(serving(again, port))
        await until(lambda: watcher.sees("plate"), what="bodies have the names of the new server")
        await until(lambda: not watcher.warns("start QTM there"))


async def test_a_measurement_may_begin_later_and_bodies_may_be_renamed() -> None:
    qtm = server(is_measuring=False)
    async with serving(qtm) as port, running(port, system="qtm") as (watcher, _):
        await until(lambda: watcher.warns("answers, but no frames come: start a measurement in QTM"))
        qtm.is_measuring = True
        await until(lambda: watcher.sees("cup"))
        qtm.names = ("mug", "cap", "cuff", "plate")
        qtm.send(qtm_server.packet(qtm_server.EVENT, b"\x0b"))
        await until(lambda: watcher.sees("mug"))


async def test_a_server_that_waits_for_a_trigger_stays_connected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(qtm_client, "PROBE_S", 1.0)
    qtm = server(is_measuring=False, says_no_data=False)
    async with serving(qtm) as port, running(port, system="qtm") as (watcher, _):
        await until(lambda: qtm.commands.count("qtmversion") > 1, what="it has got the first answer")
        assert qtm.commands.count("version 1.8") == 1, "the connection went on"
        qtm.is_measuring = True
        await until(lambda: watcher.sees("cup"))


async def test_damaged_packets_cost_themselves_only() -> None:
    qtm = server()
    whole = qtm_server.frame(10, bodies(0))
    overrun = bytearray(qtm_server.frame(10, bodies(0)[:3])[8:])
    struct.pack_into("<I", overrun, 12, 2)  # components
    struct.pack_into("<I", overrun, 24, 4)  # bodies: the fourth would be read from the next component
    markers = struct.pack("<IIIHH", 16 + 48, 1, 3, 0, 0) + bytes(48)
    packets = (
        *(b"", whole[8:40], whole[8:24] + b"\xff" * 8, bytes(12) + b"\xff" * 4 + bytes(64)),
        bytes(overrun) + markers,
        qtm_server.frame(10, [LOST] * 4000)[8:],
    )
    async with serving(qtm) as port, running(port, system="qtm") as (watcher, _):
        await until(lambda: watcher.sees("cup"))
        for damaged in packets:
            qtm.send(qtm_server.packet(qtm_server.DATA, damaged))
        qtm.send(qtm_server.packet(qtm_server.EVENT, b"") + qtm_server.packet(9, b"unknown"))
        await until(lambda: watcher.figure("damaged packets") == len(packets) + 1, what="each to be counted")
        assert watcher.warns("packets that cannot be read")

        before = len(watcher.objects)
        await until(lambda: len(watcher.objects) > before + 25)
        assert watcher.sees("cup")
        assert len(qtm.writers) == 1
        assert qtm.commands.count("version 1.8") == 1, "the connection went on"


@pytest.mark.parametrize(
    "flood", [struct.pack("<II", 8, 9), qtm_server.frame(5, bodies(0))], ids=["empty", "frames"]
)
async def test_a_flood_of_packets_leaves_others_their_turn(
    flood: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = qtm_client.QtmClient(QtmSession("qtm-pc", lambda _: None), time.time_ns, lambda _: None)
    calls: list[str] = []

    class Flooded(asyncio.Transport):
        def pause_reading(self) -> None:
            calls.append("pause")

        def resume_reading(self) -> None:
            calls.append("resume")

    client.connection_made(Flooded())
    used: list[int] = []

    def use(kind: int, _packet: bytes) -> None:
        used.append(kind)

    monkeypatch.setattr(client, "_use", use)
    client.data_received(flood * 2000)
    turns = 0
    while calls[-1] == "pause":
        turns += 1
        assert len(used) <= turns * qtm_client.MAX_ROUND_PACKETS
        await asyncio.sleep(0)
    assert (len(used), calls[-1]) == (2000, "resume")
    assert turns >= (7 if len(flood) == 8 else 1999)


@contextlib.asynccontextmanager
async def answering(data: bytes, *, ends: bool = False, echoes: bool = False) -> AsyncGenerator[int]:
    """Run a server of something else, which sends `data`."""

    writers: list[asyncio.StreamWriter] = []

    async def talk(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writers.append(writer)
        writer.write(data)
        if ends:
            writer.close()
        while echoes and (received := await reader.read(4096)):
            writer.write(received)

    listener = await asyncio.start_server(talk, "127.0.0.1", 0)
    try:
        yield int(listener.sockets[0].getsockname()[1])
    finally:
        listener.close()
        for writer in writers:
            writer.transport.abort()
        await asyncio.sleep(0)


REMEDY = "use the little-endian port of QTM's RT output, 22223 by default"


@pytest.mark.parametrize(
    ("data", "ends", "sentences"),
    [
        (b"SSH-2.0-OpenSSH_9.2p1\r\n", False, ("sends no packets of QTM", REMEDY)),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", True, ("sends no packets of QTM", REMEDY)),
        (struct.pack(">II", 35, 1) + b"QTM RT Interface connected\0", False, ("sends no packets", REMEDY)),
        (bytes(64), False, ("sends no packets of QTM", REMEDY)),
        (struct.pack("<II", 7, 4) * 9, False, ("sends no packets of QTM", REMEDY)),
        (struct.pack("<II", 0xFFFFFFFF, 3), False, ("sends no packets of QTM", REMEDY)),
        (b"", True, ("has ended the connection (", "): start QTM there")),
        (text(0, "Max number of clients reached."), True, ("Max number of clients", "end other")),
    ],
    ids=["ssh", "http", "big-endian", "zeros", "small", "huge", "ends", "full"],
)
async def test_server_that_is_no_qtm_is_named_with_the_remedy(
    data: bytes,
    ends: bool,
    sentences: tuple[str, ...],
) -> None:
    async with answering(data, ends=ends) as port, running(port, system="qtm") as (watcher, _):
        await until(lambda: watcher.warns(f"127.0.0.1, port {port},"))
        await until(lambda: all(map(watcher.warns, sentences)), what=lambda: f"{watcher.health}")


async def test_silent_server_closed_port_and_old_version_are_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(qtm_client, "QTM_TIMEOUT_S", 0.5)
    async with answering(b"") as port, running(port, system="qtm") as (watcher, _):
        await until(lambda: watcher.warns("does not answer by QTM's protocol within 0.5 s"))
    async with answering(b"", echoes=True) as port, running(port, system="qtm") as (watcher, _):
        await until(lambda: watcher.warns("its settings are no XML"))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        async with running(free.getsockname()[1], system="qtm") as (watcher, _):
            await until(lambda: watcher.warns("cannot be reached"))
    async with serving(server(versions=("1.0",))) as port, running(port, system="qtm") as (watcher, _):
        await until(lambda: watcher.warns("refuses (Version NOT supported)"))


async def test_the_makers_client_understands_our_server() -> None:
    frames: list[object] = []
    async with serving(server()) as port:
        connection = await qtm_rt.connect("127.0.0.1", port, version="1.8")
        assert b"<Name>cuff</Name>" in await connection.get_parameters(["3d", "6d"])
        assert await connection.stream_frames(components=["6dres"], on_packet=frames.append) == b"Ok"
        await until(lambda: len(frames) > 3)
        connection.disconnect()


class Discovered(asyncio.DatagramProtocol):
    """Answers the search as QTM does."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport: asyncio.DatagramTransport = transport  # pyrefly: ignore[bad-assignment]

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        size, kind, port = *struct.unpack_from("<II", data), struct.unpack_from(">H", data, 8)[0]
        assert (size, kind, len(data)) == (10, 7, 10)
        content = b"LAB-PC, QTM 2.3 (build 464), 5 cameras\0" + struct.pack(">H", 30000)
        for damaged in (b"", b"\0" * 10, content, struct.pack("<II", 99, 1) + content):
            self.transport.sendto(damaged, (addr[0], port))
        self.transport.sendto(struct.pack("<II", 8 + len(content), 1) + content, (addr[0], port))


async def test_search_lists_servers_with_the_options_that_choose_them() -> None:
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(Discovered, local_addr=("127.0.0.1", 0))
    found = await qtm_client.find_servers(3.0, [transport.get_extra_info("sockname")])
    transport.close()
    (device,) = found
    assert (device.label, device.details) == ("LAB-PC, QTM 2.3 (build 464), 5 cameras", {"port": 30001})
    (row,) = rows([SearchResult(kind="mocap", name="qtm", found=(device,))], "mocap")
    assert row["use"] == f"--system qtm --server {device.address} --port 30001"
    assert set(MOCAP_SYSTEMS.names) == {"natnet", "qtm"}


def test_without_qtm_rt_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "qtm_rt", None)
    with pytest.raises(ConfigError, match=r"`system: qtm` needs qtm-rt, which is not installed; run `.*qtm"):
        check_launches([Launch(service=Mocap, config=MocapConfig(server="a", system="qtm"))])
