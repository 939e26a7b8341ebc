"""Traffic on the link to a site's pui: the rays of people whom no shard serves, and of nobody else."""

import asyncio
import contextlib
import itertools
import math
from collections.abc import AsyncGenerator

from pointit.runtime.clock import WallClock
from pointit.runtime.link.link import Link
from pointit.runtime.router.router import running_router
from pointit.runtime.service.service import Launch, run_service
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Cursor, PointingRay, UserPose
from pointit.schemas.topics import CURSOR, POSE, RAY, SHARD_ALIVE, USER_ALIVE
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui
from tests.support.bench import until
from tests.support.buses import free_port, settled

PEOPLE = ("anna", "ben")
RAYS = 300
LEAST_BYTES = 60
"""A ray takes more of them on the link."""


class MeteredLink:
    """A relay to a router, which counts the bytes that the router sends."""

    def __init__(self, port: int) -> None:
        self.received = 0
        self._port = port
        self._serving: set[asyncio.Task[None]] = set()

    @contextlib.asynccontextmanager
    async def endpoint(self) -> AsyncGenerator[str]:
        def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            self._serving.add(asyncio.create_task(self._serve(reader, writer)))

        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        try:
            yield f"tcp/127.0.0.1:{server.sockets[0].getsockname()[1]}"
        finally:
            server.close()
            for task in self._serving:
                task.cancel()
            await asyncio.gather(*self._serving, return_exceptions=True)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._port)
        try:
            await asyncio.gather(
                self._carry(reader, far_writer), self._carry(far_reader, writer, is_metered=True)
            )
        finally:
            writer.close()
            far_writer.close()

    async def _carry(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *, is_metered: bool = False
    ) -> None:
        with contextlib.suppress(OSError):
            while data := await reader.read(65536):
                self.received += len(data) * is_metered
                writer.write(data)


class Wrists:
    def __init__(self, bus: ZenohBus) -> None:
        self._bus = bus
        self._rays = {user: bus.publisher(RAY, user) for user in PEOPLE}
        self._poses = {user: bus.publisher(POSE, user) for user in PEOPLE}
        self._clock = WallClock()
        for user, publisher in self._poses.items():
            bus.announce(USER_ALIVE, user)
            publisher.put(UserPose(stamp_ns=self._clock.now_ns(), position_m=(0.0, 0.0, 0.0), yaw_rad=0.0))

    async def point(self, user: str) -> None:
        """Point until `RAYS` rays have made cursors."""
        seen: set[int] = set()
        reading = self._bus.subscribe(CURSOR, lambda cursor, _user: self._note(seen, cursor), user)
        for step in itertools.count():
            azimuth_rad = math.radians(step % 90)
            self._rays[user].put(
                PointingRay(
                    stamp_ns=self._clock.now_ns(),
                    seq=step,
                    origin_m=(0.0, 0.0, 1.6),
                    direction=(math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0),
                )
            )
            await asyncio.sleep(0.002)
            if len(seen) >= RAYS:
                break
        reading.close()

    @staticmethod
    def _note(seen: set[int], cursor: Cursor) -> None:
        seen.add(cursor.stamp_ns)


async def test_rays_of_a_shards_person_do_not_cross_the_link_to_the_site() -> None:
    port = free_port()
    router = f"tcp/127.0.0.1:{port}"
    link = MeteredLink(port)
    async with contextlib.AsyncExitStack() as stack:
        await stack.enter_async_context(running_router((router,)))
        far = await stack.enter_async_context(link.endpoint())
        site = await ZenohBus.open(Link(connect=(far,)), patience_s=30)
        stack.push_async_callback(site.close)
        host = await ZenohBus.open(Link(connect=(router,)), patience_s=30)
        stack.push_async_callback(host.close)
        running = [
            asyncio.create_task(run_service(Launch(service=Pui, config=PuiConfig()), site, WallClock()))
        ]
        shard = Launch(service=Pui, config=PuiConfig(people=("anna",)), name="anna")
        running.append(asyncio.create_task(run_service(shard, host, WallClock())))
        try:
            shards: set[str] = set()
            site.watch(SHARD_ALIVE, lambda name, _present: shards.add(name))
            await until(lambda: shards == {"pui.anna"}, what="the shard")
            await settled(site, host)
            wrists = Wrists(host)
            crossed: dict[str, int] = {}
            for user in PEOPLE:
                await wrists.point(user)  # everything is declared everywhere
                before = link.received
                await wrists.point(user)
                await settled(site, host)
                crossed[user] = link.received - before
            assert crossed["ben"] > RAYS * LEAST_BYTES
            assert crossed["anna"] < 0.1 * crossed["ben"], crossed
        finally:
            for task in running:
                task.cancel()
            await asyncio.gather(*running, return_exceptions=True)
