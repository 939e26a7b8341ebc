"""A node in a ROS 2 graph: people, pointing and objects under names and types of ROS."""

import asyncio
import contextlib
import dataclasses
import functools
import logging
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

from pointit.bridges.ros2.config import Ros2Config
from pointit.bridges.ros2.graph.backend import Backend, Graph
from pointit.bridges.ros2.graph.backends import check_endpoint, opened
from pointit.bridges.ros2.graph.router_address import check_apart
from pointit.bridges.ros2.routing.conversion_state import INPUT_TOPICS, ConversionState
from pointit.bridges.ros2.routing.inbox import Inbox
from pointit.bridges.ros2.routing.outbox import Outbox
from pointit.bridges.ros2.routing.ros_users import RosUsers
from pointit.bridges.ros2.routing.route_types import InboundRoute, OutboundRoute, ServiceRoute
from pointit.bridges.ros2.routing.routes import Routes, routes
from pointit.bridges.ros2.routing.site import RosSite
from pointit.bridges.ros2.trackers import tracker_routes
from pointit.bridges.ros2.types.types import Types
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas.topics import OUTCOMES
from pointit.site.following import follow_site
from pointit.site.site_state import Change, SiteState

log = logging.getLogger(__name__)


NOTED_S = 4.0
"""Delay (s) of the note about missing nodes, for new users who wonder why nothing happens."""


class Ros2(Service[Ros2Config]):
    """Mirrors topics and services both ways by the route table; the site does not depend on it."""

    NAME: ClassVar[str] = "ros2"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = Ros2Config
    TIME_MAY_STEP: ClassVar[bool] = True

    def __init__(self, config: Ros2Config, context: Context) -> None:
        super().__init__(config, context)
        table = _only(routes(config.routes, ros4hri=config.ros4hri), lambda route: route.enabled)
        inward = (*table.inward, *tracker_routes(config.trackers))
        self._table = dataclasses.replace(table, inward=inward)
        types = Types(config.backend.distro)
        self._leave_out(_unusable(self._table, types))
        self._state = ConversionState(types, world=self._table.file.world)

    def _leave_out(self, unusable: Mapping[str, str]) -> None:
        """Disable the routes of the types `unusable`, whose values are the problems, with a warning each."""
        for name, problem in unusable.items():
            left_out = [route.name for route in self._table.all if route.type == name]
            sentence = f"without {', '.join(left_out)}: type {name} cannot be used: {problem}"
            self.bus.warn("type", sentence, name)
            log.warning("%s", sentence)
        self._table = _only(self._table, lambda route: route.type not in unusable)

    @classmethod
    def validate_config(cls, config: Ros2Config) -> None:
        """Check the file of routes and the router's address.

        Raises:
            ConfigError: If one cannot be used. The message has its name, the value and the remedy.
        """
        check_endpoint(config.backend.endpoint)
        routes(config.routes)

    @classmethod
    def validate_link(cls, config: Ros2Config, addresses: Sequence[str]) -> None:
        """Check that ROS's router has not PointIt's address, since no node would report that mistake.

        Raises:
            ConfigError: If it has. The message has both addresses and the remedy.
        """
        if config.backend.kind != "dds":
            check_apart(config.backend.endpoint, addresses)

    async def run(self) -> None:
        """Stay in the graph until cancelled.

        Raises:
            ListenError: If the address to be the ROS router at is taken.
        """
        ros = self.config.backend
        backend = await opened(ros, self.bus, is_bridge=True)
        log.info("ROS 2 node %s, domain %d, %s", backend.node, ros.domain_id, ros.distro)
        async with contextlib.AsyncExitStack() as stack:
            stack.push_async_callback(backend.close)

            # Routes in ROS. The stack closes the newest part first, so before those that it uses
            site = RosSite(bus=self.bus, clock=self.clock, backend=backend, state=self._state)
            outbox = Outbox(self._table.outward, site)
            stack.callback(outbox.close)
            inbox = Inbox(self._table.inward, self._table.served, site)
            stack.callback(inbox.close)
            ros_users = RosUsers(self.config.people, self._table.inward, site, inbox, outbox)
            stack.callback(ros_users.close)
            on_graph = functools.partial(self._on_graph, outbox, inbox, ros_users)
            backend.watch(on_graph)

            # State of the site, by the topics of the routes
            on_change = functools.partial(self._on_change, outbox)
            on_person = functools.partial(self._on_person, outbox, inbox)
            on_service = functools.partial(self._on_service, outbox, ros_users)
            site_state = SiteState(on_change, on_person=on_person, on_service=on_service)
            now_s = asyncio.get_running_loop().time
            topics = dict.fromkeys((*outbox.topics, *INPUT_TOPICS, OUTCOMES))
            for watch in follow_site(site_state, self.bus, now_s, topics):
                stack.callback(watch.close)  # before leaving the graph, which takes a while

            note_missing_nodes = functools.partial(_log_notes, backend)
            self.bus.call_later(NOTED_S, note_missing_nodes)
            await asyncio.Event().wait()

    def _on_graph(self, outbox: Outbox, inbox: Inbox, ros_users: RosUsers, graph: Graph) -> None:
        visible = graph.within(self.config.backend.domain_id)
        other_nodes = {endpoint.node for endpoint in visible.endpoints if not endpoint.is_ours}
        self.bus.set_metric("ROS nodes", len(other_nodes))
        outbox.look(visible)
        inbox.on_graph(visible)
        ros_users.on_graph(visible)

    def _on_change(self, outbox: Outbox, change: Change) -> None:
        if change.message is not None:
            self._state.take(change.name, change.message, self.clock.now_ns())
            outbox.take(change.topic, change.message, change.name)
        elif change.previous is not None:
            self._state.end(change.name, change.previous)

    def _on_person(self, outbox: Outbox, inbox: Inbox, user: str, present: bool) -> None:
        if present:
            self._state.person(user).is_here = True  # their frame is known from now on
            outbox.join(user)
            inbox.join(user)
        else:
            outbox.leave(user)
            inbox.leave(user)
            self._state.forget(user)

    def _on_service(self, outbox: Outbox, ros_users: RosUsers, instance: str, present: bool) -> None:
        ros_users.on_presence(instance, present=present)
        if not present:
            outbox.end(instance)


def _log_notes(backend: Backend) -> None:
    for note in backend.notes:
        log.info("%s", note)


def _unusable(table: Routes, types: Types) -> dict[str, str]:
    """Return the problems of unusable types of `table`, by name. One disables its routes, not the bridge."""
    unusable: dict[str, str] = {}
    for name in dict.fromkeys(route.type for route in table.all):
        try:
            types.prepare(name)
        except Exception as error:  # noqa: BLE001 - whatever the library makes of one definition
            sentence = " ".join(str(argument) for argument in error.args)
            unusable[name] = sentence or type(error).__name__
    return unusable


def _only(table: Routes, condition: Callable[[OutboundRoute | InboundRoute | ServiceRoute], bool]) -> Routes:
    """Return `table` with the routes that meet `condition`."""
    return Routes(
        outward=tuple(filter(condition, table.outward)),
        inward=tuple(filter(condition, table.inward)),
        served=tuple(filter(condition, table.served)),
        file=table.file,
    )


SERVICE = Ros2
