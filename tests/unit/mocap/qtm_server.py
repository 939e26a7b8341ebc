"""A server of QTM's RT protocol for tests. It is our own; `test_qtm.py` checks it with the maker's client."""

import asyncio
import contextlib
import struct
from collections.abc import AsyncGenerator, Callable, Sequence
from dataclasses import dataclass, field

ERROR = 0
COMMAND = 1
XML = 2
DATA = 3
NO_DATA = 4
EVENT = 6
CONNECTED = 1
PLAYBACK = 8
NAN = float("nan")
LEVEL = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

QtmBody = tuple[tuple[float, float, float], Sequence[float], float]
"""Position, mm; rotation matrix by columns; residual, mm."""
LOST: QtmBody = ((NAN, NAN, NAN), (NAN,) * 9, NAN)


def packet(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", 8 + len(content), kind) + content


def text(kind: int, content: str) -> bytes:
    return packet(kind, content.encode() + b"\0")


def frame(time_us: int, bodies: Sequence[QtmBody], number: int = 1) -> bytes:
    """Return a frame of the component 11: bodies with residuals."""
    content = struct.pack("<IHH", len(bodies), 0, 0)
    content += b"".join(struct.pack("<13f", *place, *turn, error) for place, turn, error in bodies)
    return packet(DATA, struct.pack("<QIIII", time_us, number, 1, 8 + len(content), 11) + content)


def settings(names: Sequence[str], up: str = "+Z") -> str:
    bodies = "".join(
        f"<Body><Name>{name}</Name><RGBColor>255</RGBColor><Point><X>1</X><Y>2</Y><Z>3</Z></Point></Body>"
        for name in names
    )
    return (
        f"<QTM_Parameters_Ver_1.8>\n<The_3D><AxisUpwards>{up}</AxisUpwards><Labels>0</Labels></The_3D>"
        f"<The_6D><Bodies>{len(names)}</Bodies>{bodies}<Euler><First>Roll</First></Euler></The_6D>"
        "</QTM_Parameters_Ver_1.8>"
    )


@dataclass
class QtmServer:
    """Answers commands, and streams to clients that ask for it."""

    names: Sequence[str]
    now_ns: Callable[[], int]
    bodies: Callable[[int], Sequence[QtmBody]]
    state: int = CONNECTED
    is_measuring: bool = True
    says_no_data: bool = True
    """False: it waits for a trigger, and answers `StreamFrames` with the first frame."""
    up: str = "+Z"
    greeting: bytes = text(COMMAND, "QTM RT Interface connected")
    versions: Sequence[str] = ("1.8", "1.25")
    commands: list[str] = field(default_factory=list[str])
    writers: set[asyncio.StreamWriter] = field(default_factory=set[asyncio.StreamWriter])
    streaming: set[asyncio.StreamWriter] = field(default_factory=set[asyncio.StreamWriter])
    began_ns: int = 0
    port: int = 0

    def send(self, data: bytes) -> None:
        """Send to all clients."""
        for writer in self.writers:
            writer.write(data)

    async def talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.writers.add(writer)
        writer.write(self.greeting)
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                size, _kind = struct.unpack("<II", await reader.readexactly(8))
                self._answer((await reader.readexactly(size - 8)).rstrip(b"\0").decode().lower(), writer)
        self.writers.discard(writer)
        self.streaming.discard(writer)
        writer.close()

    def _answer(self, command: str, writer: asyncio.StreamWriter) -> None:
        self.commands.append(command)
        word, _, rest = command.partition(" ")
        if word == "version" and rest not in self.versions:
            writer.write(text(ERROR, "Version NOT supported"))
        elif word == "version":
            writer.write(text(COMMAND, f"Version set to {rest}"))
        elif word == "qtmversion":
            writer.write(text(COMMAND, "QTM Version is 2.3 (build 464)"))
        elif word == "getstate":
            writer.write(packet(EVENT, bytes((self.state,))))
        elif word == "getparameters":
            writer.write(text(XML, settings(self.names, self.up)))
        elif word == "streamframes":
            self.streaming.add(writer)
            if not self.is_measuring and self.says_no_data:
                writer.write(packet(NO_DATA, b""))
        else:
            writer.write(text(ERROR, "Parse error"))

    async def stream(self, period_s: float = 0.01) -> None:
        number = 0
        while True:
            await asyncio.sleep(period_s)
            number += 1
            now_ns = self.now_ns()
            self.began_ns = self.began_ns or now_ns
            data = frame((now_ns - self.began_ns) // 1000, self.bodies(now_ns), number)
            for writer in self.streaming if self.is_measuring else ():
                writer.write(data)


@contextlib.asynccontextmanager
async def serving(server: QtmServer, port: int = 0) -> AsyncGenerator[int]:
    """Run a server at a free port, or again at `port`. Yield the port."""
    listener = await asyncio.start_server(server.talk, "127.0.0.1", port)
    task = asyncio.create_task(server.stream())
    try:
        yield int(listener.sockets[0].getsockname()[1])
    finally:
        task.cancel()
        await asyncio.wait({task})
        listener.close()
        for writer in list(server.writers):
            writer.transport.abort()
        await asyncio.sleep(0)
