"""Subscribes to what viewers are shown, and serves it to Foxglove and Lichtblick."""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from foxglove import Channel

from pointit.bridges.foxglove.config import FoxgloveConfig
from pointit.bridges.foxglove.event_log import EventLog, LogLine
from pointit.bridges.foxglove.scene import FORGET_S, PARTS, FoxgloveScene
from pointit.bridges.foxglove.server import LOG, Server, picture_topic
from pointit.plugins import (
    Change,
    Context,
    Scope,
    Service,
    SiteState,
    Subscription,
    Timer,
    follow_site,
    follow_topics,
)
from pointit.runtime.address_config import is_loopback
from pointit.runtime.host.name_lookup import own_address
from pointit.runtime.machine import this_machine
from pointit.schemas import Environment, Message
from pointit.schemas.catalogue.json_channel import JsonChannel, channel_name
from pointit.schemas.topics import HEALTH, Delivery, Topic
from pointit.services.registry import SHOWN

log = logging.getLogger(__name__)

LAYOUT = Path(__file__).with_name("layout.json")
"""Initial panels, for both viewers."""

FAST = tuple(topic for topic in SHOWN if topic.delivery is Delivery.LATEST and topic is not HEALTH)
"""Topics that cost time to decode. They are subscribed to only while a viewer is connected."""

LOOK_S = 3.0
"""Time (s) for which they are read after a service has started or the last viewer has left."""

EVERYWHERE = ("0.0.0.0", "::")  # noqa: S104 - told apart
"""Hosts that stand for all addresses of this machine, and that no viewer can open."""


@dataclass(slots=True)
class _Mirrored:
    channel: Channel
    plain: JsonChannel
    topic: Topic[Any]
    name: str
    message: Message
    is_new: bool = True


class Foxglove(Service[FoxgloveConfig]):
    """Shows the scene, every topic and the log in Foxglove or Lichtblick; read-only."""

    NAME: ClassVar[str] = "foxglove"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = FoxgloveConfig
    TIME_MAY_STEP: ClassVar[bool] = True

    def __init__(self, config: FoxgloveConfig, context: Context) -> None:
        super().__init__(config, context)
        self._site = SiteState(self._on_change, on_person=self._on_person, on_service=self._on_service)
        self._scene = FoxgloveScene(self._site)
        self._event_log = EventLog(self._site)
        self._loop = asyncio.get_running_loop()
        self._plains = {topic.key: JsonChannel(topic.message) for topic in SHOWN}
        self._mirrored: dict[str, _Mirrored] = {}
        self._server = Server(self._hand_over, self._on_viewer)
        self._frame_timer = Timer(self.bus.call_later, self._send_frame)
        self._fade_timer = Timer(self.bus.call_later, self._schedule_frame)
        self._sent_s = 0.0
        self._fast_subscriptions: list[Subscription] = []
        self._rest_timer = Timer(self.bus.call_later, self._rest)
        slow_topics = [topic for topic in SHOWN if topic not in FAST]
        follow_site(self._site, self.bus, self._loop.time, slow_topics)
        self._read_fast_topics()

    async def run(self) -> None:
        """Serve viewers until cancelled.

        Raises:
            ListenError: If the address is taken or not of this machine.
        """
        config = self.config
        try:
            name = f"PointIt {self.bus.site}"
            address = await self._server.open(name, config.host, config.port)
            if config.host in EVERYWHERE:
                host = own_address(this_machine().host_name)
                port = address.rpartition(":")[2]
                address = f"ws://{host}:{port}"
            log.info("open a connection to %s in Foxglove or Lichtblick, and import %s", address, LAYOUT)
            if not is_loopback(config.host):
                log.warning(
                    "every machine that can reach %s sees everything that happens at this site", address
                )
            await asyncio.Event().wait()
        finally:
            await self._server.close()

    def _read_fast_topics(self) -> None:
        """Subscribe to the fast topics while viewers are connected, or long enough to learn the keys."""
        if not self._fast_subscriptions:
            self._fast_subscriptions = follow_topics(self._site, self.bus, self._loop.time, FAST)
        self._rest_timer.cancel()
        self._rest_timer.start(LOOK_S)

    def _rest(self) -> None:
        if self._server.viewers.any:
            return
        for subscription in self._fast_subscriptions:
            subscription.close()
        self._fast_subscriptions.clear()

    def _hand_over(self, call: Callable[[], None]) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended, and the server is about to
            self._loop.call_soon_threadsafe(call)

    def _on_change(self, change: Change) -> None:
        topic = change.topic
        name = change.name
        message = change.message
        self._scene.show(change)
        if message is None:
            mirrored = self._mirrored.pop(topic.at(name), None)
            if mirrored is not None:
                mirrored.channel.close()
            self._schedule_frame()
            return
        if isinstance(message, Environment):
            problems = self._scene.problems[:3]
            self.bus.warn("map", "; ".join(problems))
        now_ns = self.clock.now_ns()
        self._send_log(self._event_log.take(change, now_ns))
        self._mirror(topic, message, name, now_ns)
        self._schedule_frame()

    def _mirror(self, topic: Topic[Any], message: Message, name: str, now_ns: int) -> None:
        key = topic.at(name)
        mirrored = self._mirrored.get(key)
        if mirrored is None:
            json_channel = self._plains[topic.key]
            channel = self._server.channel(channel_name(key), json_channel.schema)
            mirrored = _Mirrored(channel, json_channel, topic, name, message)
            self._mirrored[key] = mirrored
        mirrored.message = message
        mirrored.is_new = True
        if topic.delivery is Delivery.EVENT:  # each event counts, not only the newest
            self._send(mirrored, now_ns)

    def _send(self, mirrored: _Mirrored, now_ns: int) -> None:
        mirrored.is_new = False
        if mirrored.channel.has_sinks():
            text = mirrored.plain.to_json(mirrored.message)
            mirrored.channel.log(text, log_time=now_ns)

    def _send_log(self, lines: Sequence[LogLine]) -> None:
        if self._server.viewers.of(LOG):
            for line in lines:
                self._server.say(line)

    def _on_person(self, user: str, present: bool) -> None:
        if present:
            self._read_fast_topics()
            return
        self._scene.leave(user)
        self._schedule_frame()

    def _on_service(self, instance: str, present: bool) -> None:
        if present:
            self._read_fast_topics()
        now_ns = self.clock.now_ns()
        lines = self._event_log.presence(instance, now_ns, present=present)
        self._send_log(lines)

    def _on_viewer(self, topic: str, begins: bool) -> None:
        """Send a channel's retained values to a viewer that has just subscribed."""
        self._read_fast_topics()
        if not begins:
            return
        if topic == LOG:
            self._send_history()
            return
        for part in PARTS:
            if topic == picture_topic(part):
                self._scene.changed.add(part)
        for mirrored in self._mirrored.values():
            if mirrored.channel.topic() == topic and mirrored.topic.delivery is not Delivery.EVENT:
                mirrored.is_new = True
        self._schedule_frame()

    def _send_history(self) -> None:
        # The history would reach the other viewers again: a further one gets active warnings only
        if self._server.viewers.of(LOG) == 1:
            self._send_log(tuple(self._event_log.history))
        else:
            now_ns = self.clock.now_ns()
            self._send_log(self._event_log.active_warnings(now_ns))

    def _schedule_frame(self) -> None:
        """Schedule the next frame as soon as the rate allows, if a viewer is connected."""
        if not self._frame_timer.is_running and self._server.viewers.any:
            since_s = self._loop.time() - self._sent_s
            period_s = 1.0 / self.config.rate_hz
            self._frame_timer.start(max(0.0, period_s - since_s))

    def _send_frame(self) -> None:
        now_s = self._loop.time()
        now_ns = self.clock.now_ns()
        self._sent_s = now_s
        self._scene.forget(now_s)
        self._site.tick(now_s)
        for part in PARTS:
            has_viewers = self._server.viewers.of(picture_topic(part))
            if part in self._scene.changed and has_viewers:
                picture = self._scene.draw(part, now_ns)
                self._server.show(part, picture, now_ns)
        for mirrored in self._mirrored.values():
            if mirrored.is_new:
                self._send(mirrored, now_ns)
        if self._scene.is_moving:  # without further messages, moving objects have to expire
            self._fade_timer.start(FORGET_S)


SERVICE = Foxglove
