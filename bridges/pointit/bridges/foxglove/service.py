"""Reads what onlookers are shown; serves it to Foxglove's and Lichtblick's viewers."""

import asyncio
import contextlib
import functools
import logging
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from foxglove import Channel

from pointit.bridges.foxglove.config import FoxgloveConfig
from pointit.bridges.foxglove.event_log import EventLog, Line
from pointit.bridges.foxglove.scene import PARTS, Scene
from pointit.bridges.foxglove.server import LOG, Server, picture_topic
from pointit.runtime.bus.contract import Subscription
from pointit.runtime.link.addresses import own_address
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import Environment, Message
from pointit.schemas.catalogue.json_channel import JsonChannel, channel_name
from pointit.schemas.topics import HEALTH, SERVICE_ALIVE, USER_ALIVE, Delivery, Topic
from pointit.services.registry import SHOWN

log = logging.getLogger(__name__)

LAYOUT = Path(__file__).with_name("layout.json")
"""Panels to begin with, for both viewers."""

MAX_CHANNELS = 2000
"""Keys that are mirrored; there may be any number of names in them."""

FAST = tuple(topic for topic in SHOWN if topic.delivery is Delivery.LATEST and topic is not HEALTH)
"""What takes time to read; it is left alone while nobody looks on."""

LOOK_S = 3.0
"""So long it is read when a service comes, and when the last viewer has gone."""

LOOPBACK = ("127.0.0.1", "::1", "localhost")

EVERYWHERE = ("0.0.0.0", "::")  # noqa: S104 - told apart
"""Hosts that stand for all addresses of this machine, and that no viewer can open."""


@dataclass(slots=True)
class _Mirrored:
    """The newest message of one key, on its way to viewers."""

    channel: Channel
    plain: JsonChannel
    topic: Topic[Any]
    name: str
    message: Message
    is_new: bool = True


class Foxglove(Service[FoxgloveConfig]):
    """Shows the scene, every topic and the log in Foxglove's or Lichtblick's viewer; it controls nothing."""

    NAME: ClassVar[str] = "foxglove"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = FoxgloveConfig

    def __init__(self, config: FoxgloveConfig, context: Context) -> None:
        """Listen to the site; viewers are let in when it runs."""
        super().__init__(config, context)
        self._scene = Scene(config.kind_colors, config.forget_s)
        self._chronicle = EventLog()
        self._loop = asyncio.get_running_loop()
        self._plains = {topic.key: JsonChannel(topic.message) for topic in SHOWN}
        self._mirrored: dict[str, _Mirrored] = {}
        self._server = Server(self._hand_over, self._on_viewer)
        self._timer: asyncio.TimerHandle | None = None
        self._fading: asyncio.TimerHandle | None = None
        self._sent_s = 0.0
        self._fast: list[Subscription] = []
        self._rest_timer: asyncio.TimerHandle | None = None
        for topic in SHOWN:
            if topic not in FAST:
                self._subscribe(topic)
        self._look()
        self.bus.watch(USER_ALIVE, self._on_person)
        self.bus.watch(SERVICE_ALIVE, self._on_service)

    async def run(self) -> None:
        """Serve viewers until cancelled.

        Raises:
            ListenError: the address is taken, or not ours.
        """
        config = self.config
        address = self._server.open(f"PointIt {self.bus.site}", config.host, config.port)
        if config.host in EVERYWHERE:
            address = f"ws://{own_address(socket.gethostname())}:{address.rpartition(':')[2]}"
        try:
            log.info("open a connection to %s in Foxglove or Lichtblick, and import %s", address, LAYOUT)
            if config.host not in LOOPBACK:
                log.warning("whoever reaches %s sees everything that happens at this site", address)
            await asyncio.Event().wait()
        finally:
            self._server.close()

    def _subscribe(self, topic: Topic[Any]) -> Subscription:
        return self.bus.subscribe(topic, functools.partial(self._on_message, topic))

    def _look(self) -> None:
        """Read the fast topics as long as anybody looks on, or long enough to learn which keys there are."""
        if not self._fast:
            self._fast = [self._subscribe(topic) for topic in FAST]
        if self._rest_timer is not None:
            self._rest_timer.cancel()
        self._rest_timer = self.bus.call_later(LOOK_S, self._rest)

    def _rest(self) -> None:
        if self._server.viewers.any:
            return
        for subscription in self._fast:
            subscription.close()
        self._fast.clear()

    def _hand_over(self, call: Callable[[], None]) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended, and the server is about to
            self._loop.call_soon_threadsafe(call)

    def _on_message(self, topic: Topic[Any], message: Message, name: str) -> None:
        self._scene.take(message, name, self._loop.time())
        if isinstance(message, Environment):
            self._complain()
        self._say(self._chronicle.take(message, name, self.clock.now_ns()))
        self._mirror(topic, message, name)
        self._wish()

    def _mirror(self, topic: Topic[Any], message: Message, name: str) -> None:
        key = topic.at(name)
        mirrored = self._mirrored.get(key)
        if mirrored is None:
            if len(self._mirrored) >= MAX_CHANNELS:
                self.bus.warn("keys", f"only {MAX_CHANNELS} keys are shown; end what writes so many")
                return
            plain = self._plains[topic.key]
            channel = self._server.channel(channel_name(key), plain.schema)
            mirrored = _Mirrored(channel, plain, topic, name, message)
            self._mirrored[key] = mirrored
        mirrored.message, mirrored.is_new = message, True
        if topic.delivery is Delivery.EVENT:  # each one counts, the newest of them is not all there is
            self._send(mirrored)

    def _send(self, mirrored: _Mirrored) -> None:
        mirrored.is_new = False
        if mirrored.channel.has_sinks():
            mirrored.channel.log(mirrored.plain.to_json(mirrored.message), log_time=self.clock.now_ns())

    def _complain(self) -> None:
        if complaints := self._scene.problems:
            self.bus.warn("map", "; ".join(complaints[:3]))
        else:
            self.bus.clear("map")

    def _say(self, lines: Sequence[Line]) -> None:
        if self._server.viewers.of(LOG):
            for line in lines:
                self._server.say(line)

    def _on_person(self, user: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        if present:
            self._look()
            return
        self._scene.leave(user)
        self._chronicle.leave(user)
        for key in [
            key
            for key, each in self._mirrored.items()
            if each.topic.placeholder == "user" and each.name == user
        ]:
            self._mirrored.pop(key).channel.close()
        self._wish()

    def _on_service(self, instance: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        if present:
            self._look()
        self._say(self._chronicle.presence(instance, self.clock.now_ns(), present=present))

    def _on_viewer(self, topic: str, *, begins: bool) -> None:
        """Have all of a channel sent, for who has just begun to look at it."""
        self._look()
        if not begins:
            return
        if topic == LOG:
            is_first = self._server.viewers.of(LOG) == 1
            chronicle = self._chronicle
            # others would read the whole history again, so they get what matters of it
            self._say(
                tuple(chronicle.history) if is_first else chronicle.active_warnings(self.clock.now_ns())
            )
            return
        for part in PARTS:
            if topic == picture_topic(part):
                self._scene.changed.add(part)
        for mirrored in self._mirrored.values():
            if mirrored.channel.topic() == topic and mirrored.topic.delivery is not Delivery.EVENT:
                mirrored.is_new = True
        self._wish()

    def _wish(self) -> None:
        """Have what is new sent as soon as the rate allows, if anybody looks on."""
        if self._timer is None and self._server.viewers.any:
            since_s = self._loop.time() - self._sent_s
            self._timer = self.bus.call_later(max(0.0, 1.0 / self.config.rate_hz - since_s), self._show)

    def _show(self) -> None:
        self._timer = None
        now_s, now_ns = self._loop.time(), self.clock.now_ns()
        self._sent_s = now_s
        self._scene.forget(now_s)
        for part in PARTS:
            if part in self._scene.changed and self._server.viewers.of(picture_topic(part)):
                self._server.show(part, self._scene.draw(part, now_ns), now_ns)
        for mirrored in self._mirrored.values():
            if mirrored.is_new:
                self._send(mirrored)
        if self._scene.is_moving and self._fading is None:
            # nothing more may come: then what moved has to vanish
            self._fading = self.bus.call_later(self.config.forget_s, self._fade)

    def _fade(self) -> None:
        self._fading = None
        self._wish()


SERVICE = Foxglove
