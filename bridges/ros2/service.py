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
from pointit.bridges.ros2.routing.site import Site
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
        for name, why in unusable.items():
            left_out = ", ".join(route.name for route in self._table.all if route.type == name)
            sentence = f"without {left_out}: type {name} cannot be used: {why}"
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
        backend = await opened(self.config.backend, self.bus, is_bridge=True)
        log.info(
            "ROS 2 node %s, domain %d, %s",
            backend.node,
            self.config.backend.domain_id,
            self.config.backend.distro,
        )
        async with contextlib.AsyncExitStack() as stack:
            stack.push_async_callback(backend.close)
            site = Site(bus=self.bus, clock=self.clock, backend=backend, state=self._state)
            outbox = Outbox(self._table.outward, site)
            stack.callback(outbox.close)
            inbox = Inbox(self._table.inward, self._table.served, site)
            stack.callback(inbox.close)
            ros_users = RosUsers(self.config.people, self._table.inward, site, inbox, outbox)
            stack.callback(ros_users.close)
            backend.watch(functools.partial(self._look, outbox, inbox, ros_users))
            site_state = SiteState(
                functools.partial(self._show, outbox),
                on_person=functools.partial(self._on_person, outbox, inbox),
                on_service=functools.partial(self._on_service, outbox, ros_users),
            )
            now_s = asyncio.get_running_loop().time
            topics = dict.fromkeys((*outbox.topics, *INPUT_TOPICS, OUTCOMES))
            for watch in follow_site(site_state, self.bus, now_s, topics):
                stack.callback(watch.close)  # before leaving the graph, which takes a while
            self.bus.call_later(NOTED_S, functools.partial(_note, backend))
            await asyncio.Event().wait()

    def _look(self, outbox: Outbox, inbox: Inbox, ros_users: RosUsers, graph: Graph) -> None:
        here = graph.within(self.config.backend.domain_id)
        others = {each.node for each in here.endpoints if not each.is_ours}
        self.bus.set_metric("ROS nodes", len(others))
        outbox.look(here)
        inbox.on_graph(here)
        ros_users.on_graph(here)

    def _show(self, outbox: Outbox, change: Change) -> None:
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


def _note(backend: Backend) -> None:
    for note in backend.notes:
        log.info("%s", note)


def _unusable(table: Routes, types: Types) -> dict[str, str]:
    """Return the problems of unusable types of `table`, by name. One disables its routes, not the bridge."""
    unusable: dict[str, str] = {}
    for name in dict.fromkeys(route.type for route in table.all):
        try:
            types.prepare(name)
        except Exception as error:  # noqa: BLE001 - whatever the library makes of one definition
            unusable[name] = " ".join(str(each) for each in error.args) or type(error).__name__
    return unusable


def _only(table: Routes, condition: Callable[[OutboundRoute | InboundRoute | ServiceRoute], bool]) -> Routes:
    return Routes(
        tuple(route for route in table.outward if condition(route)),
        tuple(route for route in table.inward if condition(route)),
        tuple(route for route in table.served if condition(route)),
        table.file,
    )


SERVICE = Ros2
