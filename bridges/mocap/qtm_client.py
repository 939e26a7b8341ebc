"""Connection to a QTM server by `qtm-rt`: search, session, names of bodies, times of frames.

`qtm-rt` decodes packets and sends commands. Its own `connect` is not used: it returns None for each error and
has no timeout, its receiver never returns from a packet whose size is 0 and collects any size, its frames
count through components of size 0, and commands get no answer after the connection has ended.

No core: it waits for a server.
"""

import asyncio
import contextlib
import importlib
import math
import struct
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from pointit.bridges.mocap.bodies import ARRIVAL_SIGMA_S, BodySample, TimedFrame, body_sample, decode_name
from pointit.bridges.mocap.config import MAX_BODIES
from pointit.geometry.rotation import Quaternion
from pointit.runtime.clock import wait_up_to
from pointit.runtime.config.plugins import FoundDevice
from pointit.runtime.datagram_search import BROADCAST, search_by_datagrams
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.runtime.host.name_lookup import look_up
from pointit.schemas import NS_PER_S

Body6D = tuple[Sequence[float], Sequence[float], float]
"""Position in mm, rotation matrix by columns, and residual in mm."""

SILENCE_NS = 3 * NS_PER_S
"""Time without frames after which that is reported."""
REPORT_NS = 10 * NS_PER_S
"""Time for which a damaged packet is reported."""
WINDOW_NS = 10 * NS_PER_S
"""Time over which the shortest delay between exposure and arrival is taken, ns."""
MAX_LATE_NS = 2 * NS_PER_S
"""Time by which a frame may come later than the fastest one."""
LIVE = frozenset({1, 2, 3, 4, 9, 10})
"""Events after which the cameras may measure."""
PLAYBACK = 8
"""Event after which QTM plays a file."""
SETTINGS_CHANGED = frozenset({1, 3, 8, 11})
"""Events after which bodies may have other names."""
PORT = 22223
DISCOVERY_PORT = 22226
VERSION = "1.8"
"""Version of the protocol since which the frames of `qtm-rt` are the same. Every QTM since 2011 has it."""
RETRY_S = 2.0
"""Wait before the next connection, s."""
QTM_TIMEOUT_S = 5.0
"""Timeout of a connection or an answer, s."""
POLL_S = 1.0
"""Period of requests for settings that have changed, s."""
PROBE_S = 5.0
"""Time without packets after which the server is asked whether it is there, s."""
MAX_PACKET = 1 << 20
"""Limit of the size of a packet. Settings have some hundred kilobytes."""
MAX_COMPONENTS = 32
"""Limit of the components of a frame. One is requested, and QTM has 19 kinds."""
MAX_ROUND_PACKETS = 256
"""Number of packets that are used before others get their turn, at most one frame among them."""
RATE = "frequency:100"
"""Frames that are requested. Cameras with a higher rate would only cost time."""
_HEADER = struct.Struct("<II")
_COMPONENTS_AT = 12
_BODY = struct.Struct("<13f")
_BODIES_AT = 8
_ERROR = 0
_DATA = 3
_NO_DATA = 4
_EVENT = 6
_DISCOVERY = 7
_LAST_TYPE = 9


class QtmSession:
    """Understands the frames and settings of one server."""

    def __init__(self, server: str, on_frame: Callable[[TimedFrame], None]) -> None:
        self.server = server
        """Name of the server in messages."""
        self.damaged = 0
        """Number of packets that could not be read."""
        self.are_settings_stale = True
        """True if the names of the bodies must be requested."""
        self._on_frame = on_frame
        self._names: tuple[str, ...] = ()
        self._up = ""
        self._is_connected = False
        self._is_playback = False
        self._since_ns = 0
        self._arrived_ns = 0
        self._used_ns = 0
        self._damage_ns = 0
        self._last_us = -1
        self._delays: deque[tuple[int, int]] = deque()
        """Arrivals of frames, and their times of arrival less those of exposure, rising."""
        self._frame_fault = ""

    def restart(self, now_ns: int, *, is_connected: bool) -> None:
        """Start or end a connection."""
        self._is_connected = is_connected
        self._is_playback = False
        self._since_ns = now_ns
        self._arrived_ns = 0
        self._used_ns = 0
        self._last_us = -1
        self.are_settings_stale = True
        self._delays.clear()

    def set_parameters(self, text: bytes) -> None:
        """Use the settings of 3D and 6DOF.

        Raises:
            ValueError: If they are no XML that can be read.
        """
        if b"<!DOCTYPE" in text:
            raise ValueError("its settings have a document type")
        xml = decode_name(text.rstrip(b"\0"))
        try:
            root = ET.fromstring(xml)  # noqa: S314 - entities need a document type
        except ET.ParseError as error:
            raise ValueError(f"its settings are no XML ({error})") from error
        names: list[str] = []
        for number, body in enumerate(root.iterfind("The_6D/Body"), start=1):
            name = (body.findtext("Name") or "").strip()
            names.append(name or f"body {number}")
        self._names = tuple(names)
        self._up = (root.findtext("The_3D/AxisUpwards") or "+Z").strip().lower()
        self.are_settings_stale = False

    def set_event(self, event: int) -> None:
        """Follow the state of QTM."""
        if event == PLAYBACK:
            self._is_playback = True
        elif event in LIVE:
            self._is_playback = False
        self.are_settings_stale = self.are_settings_stale or event in SETTINGS_CHANGED

    def note_damage(self, now_ns: int) -> None:
        """Count a packet that could not be read."""
        self.damaged += 1
        self._damage_ns = now_ns

    def problem(self, now_ns: int) -> str:
        """Return a sentence if there is no usable stream, or something is odd, else `""`."""
        if not self._is_connected:
            return ""  # the connection says why
        if now_ns - max(self._arrived_ns, self._since_ns) > SILENCE_NS:
            return (
                f"{self.server} answers, but no frames come: start a measurement in QTM (File, New) and "
                "switch on `Calculate 6DOF` under its real-time actions"
            )
        unused_ns = now_ns - max(self._used_ns, self._since_ns)
        if self._frame_fault and unused_ns > NS_PER_S:
            return f"{self.server}: {self._frame_fault}"
        if self._damage_ns and now_ns - self._damage_ns < REPORT_NS:
            return f"{self.server} sent {self.damaged} packets that cannot be read: update PointIt or QTM"
        return ""

    def clock_sigma_s(self, now_ns: int) -> float | None:  # noqa: ARG002 - as of NatNet
        """Return None: QTM states no clock."""
        return None

    def receive(self, time_us: int, bodies: Sequence[Body6D], now_ns: int) -> None:
        """Use a frame that was exposed `time_us` after the measurement began."""
        self._arrived_ns = now_ns
        is_repeated = time_us == self._last_us
        is_restarted = time_us < self._last_us
        self._last_us = time_us
        if is_restarted:
            self._delays.clear()

        # Delays are updated even while frames are not used
        fault = self._fault(len(bodies), is_repeated=is_repeated)
        stamp_ns, late_ns = self._stamp(time_us, now_ns)
        if not fault and late_ns > MAX_LATE_NS:
            fault = f"its frames come {late_ns / NS_PER_S:.1f} s late: use a cable, or a lower camera rate"
        self._frame_fault = fault
        if fault:
            return

        self._used_ns = now_ns
        named: list[tuple[str, BodySample]] = []
        for number, ((x, y, z), matrix, residual_mm) in enumerate(bodies, start=1):
            position_m = (x / 1000.0, y / 1000.0, z / 1000.0)
            residual_m = max(0.0, residual_mm / 1000.0)
            sample = body_sample(number, position_m, _quaternion(matrix), residual_m)
            named.append((self._names[number - 1], sample))
        self._on_frame(TimedFrame(stamp_ns, ARRIVAL_SIGMA_S, tuple(named), self._up[-1:]))

    def _fault(self, count: int, *, is_repeated: bool) -> str:
        if self._is_playback:
            return "QTM plays a file, whose frames are not used: start a measurement (File, New)"
        if self._up not in ("+y", "+z"):
            return f"its axis {self._up.upper()} points up: choose +Z or +Y under Calibration in QTM"
        if is_repeated:
            return "its frames stand still: end the pause in QTM"
        if count != len(self._names):
            self.are_settings_stale = True
            return (
                f"its frames have {count} bodies, its settings {len(self._names)}: enable all bodies in QTM"
            )
        if self.are_settings_stale:
            return "QTM has not named its bodies yet: start a measurement there (File, New)"
        return ""

    def _stamp(self, time_us: int, now_ns: int) -> tuple[int, int]:
        """Return the site's time of exposure, less the shortest delay, and the delay beyond that, ns."""
        delay_ns = now_ns - 1000 * time_us
        while self._delays and self._delays[-1][1] >= delay_ns:
            self._delays.pop()
        self._delays.append((now_ns, delay_ns))
        while now_ns - self._delays[0][0] > WINDOW_NS:
            self._delays.popleft()
        late_ns = delay_ns - self._delays[0][1]
        return now_ns - late_ns, late_ns


def _quaternion(matrix: Sequence[float]) -> Quaternion:
    """Return the rotation of a matrix that is given by columns. Its length differs from 1 if it is none."""
    a, b, c, d, e, f, g, h, i = matrix
    if a + e + i >= 0.0:
        square = 1.0 + a + e + i
        row = (f - h, g - c, b - d, square)
    elif a >= e and a >= i:
        square = 1.0 + a - e - i
        row = (square, b + d, g + c, f - h)
    elif e >= i:
        square = 1.0 - a + e - i
        row = (b + d, square, f + h, g - c)
    else:
        square = 1.0 - a - e + i
        row = (g + c, f + h, square, b - d)
    if not square > 0.0:  # also NaN
        return (0.0, 0.0, 0.0, 0.0)
    scale = 0.5 / math.sqrt(square)
    x, y, z, w = row
    return (scale * x, scale * y, scale * z, scale * w)


def check_qtm_rt() -> None:
    """Check that `qtm-rt` is installed. Raises: ConfigError: If it is not."""
    try:
        importlib.import_module("qtm_rt")
    except ImportError as error:
        raise ConfigError(
            f"`system: qtm` needs qtm-rt, which is not installed; run {remedy('qtm')}"
        ) from error


class QtmClient(asyncio.Protocol):
    """Keeps a connection to one server."""

    def __init__(
        self,
        session: QtmSession,
        now_ns: Callable[[], int],
        warn: Callable[[str], None],
        *,
        port: int = PORT,
        interface: str = "",
    ) -> None:
        """Prepare; nothing is opened yet.

        Args:
            session: understands frames and settings.
            now_ns: time of the site, ns.
            warn: called with a sentence about the connection, or `""`.
            port: little-endian TCP port of the server.
            interface: address of this machine from which to connect, or `""` for any.
        """
        self._qtm: Any = importlib.import_module("qtm_rt")
        self._commands: Any = importlib.import_module("qtm_rt.protocol")
        self._session = session
        self._now_ns = now_ns
        self._warn = warn
        self._port = port
        self._interface = interface

        # The connection, which is made in `run`
        self._packets = bytearray()
        self._is_waiting = False
        """True if packets have come that the next turn of the loop uses."""
        self._protocol: Any = None
        """Sends commands, and gives their answers."""
        self._transport: Any = None
        self._end = asyncio.Event()
        self._is_starting = False
        """True while frames, or that there are none yet, are the answer to `StreamFrames`."""
        self._end_reason = ""
        self._refusal = ""
        self._has_packets = False
        """True if a packet came since the last probe."""

    async def run(self) -> None:
        """Receive until cancelled."""
        while True:
            try:
                await self._receive()
            except (OSError, TimeoutError, ValueError, self._qtm.QRTCommandException) as error:
                self._warn(self._problem(error))
            finally:
                if self._transport is not None:
                    self._transport.abort()
                self._session.restart(self._now_ns(), is_connected=False)
            await asyncio.sleep(RETRY_S)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Prepare for the packets of a new connection."""
        self._packets = bytearray()
        self._is_waiting = False
        self._transport = transport
        self._end.clear()
        self._protocol = self._commands.QTMProtocol(loop=asyncio.get_running_loop())
        self._protocol.connection_made(transport)

    def data_received(self, data: bytes) -> None:
        """Use the packets that are complete, a round in each turn of the loop."""
        self._packets += data
        self._has_packets = True
        if not self._is_waiting:
            self._use_round()

    def _use_round(self) -> None:
        self._is_waiting = False
        offset = 0
        is_cut = False
        for count in range(MAX_ROUND_PACKETS):
            if is_cut or len(self._packets) - offset < _HEADER.size:
                break
            size, kind = _HEADER.unpack_from(self._packets, offset)
            if not _HEADER.size <= size <= MAX_PACKET or kind > _LAST_TYPE:
                self._end_reason = "sends no packets of QTM"
                self._transport.abort()
                return
            if len(self._packets) - offset < size:
                break
            packet = bytes(self._packets[offset : offset + size])
            offset += size
            self._use(kind, packet)
            is_cut = kind == _DATA or count == MAX_ROUND_PACKETS - 1
        del self._packets[:offset]

        # Others get their turn before the next frame; meanwhile nothing more is read
        self._is_waiting = is_cut and len(self._packets) >= _HEADER.size
        if self._is_waiting:
            self._transport.pause_reading()
            asyncio.get_running_loop().call_soon(self._use_round)
        else:
            self._transport.resume_reading()

    def connection_lost(self, exc: Exception | None) -> None:
        """End the commands that wait."""
        if not self._end_reason:
            reason = exc or self._refusal
            self._end_reason = f"has ended the connection ({reason or 'no reason'})"
        self._protocol.connection_lost(exc)
        while self._protocol.request_queue:
            answer: asyncio.Future[object] = self._protocol.request_queue.popleft()
            if not answer.done():
                answer.set_exception(ConnectionResetError(self._end_reason))
                answer.exception()  # nobody may wait for it
        self._end.set()

    def _use(self, kind: int, packet: bytes) -> None:
        try:
            if kind == _DATA:
                self._use_frame(packet[_HEADER.size :])
            elif kind == _EVENT:
                self._session.set_event(packet[_HEADER.size])
                return
            elif kind == _ERROR:
                self._refusal = _text(packet[_HEADER.size :])
            if self._is_starting or kind not in (_DATA, _NO_DATA):  # else it would answer another command
                self._protocol.data_received(packet)
        except (ValueError, IndexError, struct.error):
            self._session.note_damage(self._now_ns())

    def _use_frame(self, data: bytes) -> None:
        (components,) = struct.unpack_from("<I", data, _COMPONENTS_AT)
        if components > MAX_COMPONENTS:
            raise ValueError(f"{components} components")
        frame = self._qtm.QRTPacket(data)
        position = frame.components.get(self._qtm.packet.QRTComponentType.Component6dRes)
        if position is None:
            return

        # The bodies must be within their component and the packet
        (count,) = struct.unpack_from("<I", data, position)
        begin = position + _BODIES_AT
        end = begin + count * _BODY.size
        (size,) = struct.unpack_from("<I", data, position - _HEADER.size)
        component_end = position - _HEADER.size + size
        if count > MAX_BODIES or end > min(len(data), component_end):
            raise ValueError(f"{count} bodies in a component of {size} bytes")
        bodies: list[Body6D] = []
        for row in _BODY.iter_unpack(data[begin:end]):
            bodies.append((row[:3], row[3:12], row[12]))
        self._session.receive(frame.timestamp, bodies, self._now_ns())

    async def _receive(self) -> None:
        self._transport = None
        self._end_reason = ""
        self._refusal = ""

        # Connect, and agree on the version
        loop = asyncio.get_running_loop()
        addresses = await look_up(self._session.server, self._port)
        local = (self._interface, 0) if self._interface else None
        async with asyncio.timeout(QTM_TIMEOUT_S):
            _, address = addresses[0]
            host = str(address[0])
            await loop.create_connection(lambda: self, host, self._port, local_addr=local)
            await self._protocol.set_version(VERSION)
        connection: Any = self._qtm.QRTConnection(self._protocol, timeout=QTM_TIMEOUT_S)
        self._session.restart(self._now_ns(), is_connected=True)
        self._warn("")

        # State and names come before the first frame, which cannot be used without them
        await self._protocol.send_command("getstate", callback=False)
        await self._update_settings(connection)
        self._is_starting = True
        try:
            await connection.stream_frames(RATE, components=["6dres"], on_packet=_ignore)
        except TimeoutError:  # a QTM that waits for a trigger sends its first frame as the answer
            self._protocol.request_queue.clear()  # else `StreamFrames` would get the next command's answer
        finally:
            self._is_starting = False

        # Frames come by `data_received`. A silent server is probed: TCP does not report a pulled cable
        idle_s = 0.0
        while not self._end.is_set():
            await wait_up_to(self._end, POLL_S)
            idle_s = 0.0 if self._has_packets else idle_s + POLL_S
            self._has_packets = False
            if idle_s >= PROBE_S and not self._end.is_set():
                await connection.qtm_version()
            if self._session.are_settings_stale and not self._end.is_set():
                await self._update_settings(connection)
        raise ConnectionResetError(self._end_reason)

    async def _update_settings(self, connection: Any) -> None:
        with contextlib.suppress(self._qtm.QRTCommandException):  # there is no measurement yet
            self._session.set_parameters(await connection.get_parameters(["3d", "6d"]))

    def _problem(self, error: Exception) -> str:
        server = f"{self._session.server}, port {self._port},"
        remedies = f"use the little-endian port of QTM's RT output, {PORT} by default"
        if isinstance(error, self._qtm.QRTCommandException) and self._refusal:
            return f"{server} refuses ({self._refusal}): {remedies}, update QTM, or end other clients of it"
        if self._end_reason.startswith("has"):
            return f"{server} {self._end_reason}: start QTM there, or end other clients of it"
        if self._transport is not None:
            silence = f"does not answer by QTM's protocol within {QTM_TIMEOUT_S:g} s"
            reason = self._end_reason or str(error)
            return f"{server} {reason or silence}: {remedies}"
        reason = str(error) or "no answer"
        return (
            f"{server} cannot be reached ({reason}): start QTM there, allow it in the "
            "firewalls, and correct `server`, `port` or `interface`; `pointit devices` lists servers"
        )


async def find_servers(
    seconds: float, targets: Sequence[tuple[str, int]] = ((BROADCAST, DISCOVERY_PORT),)
) -> Sequence[FoundDevice]:
    """Return the servers that answer within `seconds` at `targets`. Needs no `qtm-rt`.

    Raises:
        ConfigError: If the question cannot be sent.
    """
    return await search_by_datagrams("QTM servers", seconds, targets, discovery_packet, _read_answer)


def discovery_packet(port: int) -> bytes:
    """Return the request whose answer comes to `port`."""
    request = _HEADER.pack(_HEADER.size + 2, _DISCOVERY)
    return request + port.to_bytes(2, "big")


def _read_answer(data: bytes, address: str) -> FoundDevice | None:
    """Return the server of an answer: name, version and cameras as a text, and its port if it is unusual."""
    if len(data) < _HEADER.size + 3:
        return None
    size, _ = _HEADER.unpack_from(data)
    if size != len(data):
        return None
    base_port = int.from_bytes(data[-2:], "big")
    label = _text(data[_HEADER.size : -2])
    if not label or not base_port:
        return None
    port = base_port + 1  # the little-endian one
    details = {} if port == PORT else {"port": port}
    return FoundDevice(address, label, details)


def _ignore(_frame: object) -> None:
    """Do nothing: frames are used before `qtm-rt` gets them, since a damaged one would stay in its buffer."""


def _text(data: bytes) -> str:
    return decode_name(data.partition(b"\0")[0])
