"""Guests: users with ROS nodes only, by configuration. They are present while messages of these arrive."""

import logging
from collections.abc import Iterable

from pointit.bridges.ros2.graph.backend import Graph
from pointit.bridges.ros2.inbound.guest import interaction
from pointit.bridges.ros2.routing.conversion_state import Guest
from pointit.bridges.ros2.routing.inbox import Inbox
from pointit.bridges.ros2.routing.outbox import Outbox
from pointit.bridges.ros2.routing.route_types import InboundRoute
from pointit.bridges.ros2.routing.site import Site
from pointit.runtime.bus.contract import Closable
from pointit.runtime.clock import Timer
from pointit.schemas.topics import INTERACTION, POSE, RAY, USER_ALIVE
from pointit.services.registry import PROCESSES

log = logging.getLogger(__name__)

LOOK_S = 0.25
"""Interval of checking whether a guest has come or gone."""

SILENT_S = 3.0
"""A guest without messages for this long (s) has left, unless they want a cursor and their ray is in the
graph."""

LEADERS = tuple(
    row.name for row in PROCESSES if row.scope == "user" and not {RAY, INTERACTION}.isdisjoint(row.writes)
)
"""PointIt services that replace a guest's nodes: a person with one is no guest."""


class Guests:
    """Announces guests to the site when they come and go, and yields to PointIt services."""

    def __init__(
        self, people: Iterable[str], routes: Iterable[InboundRoute], site: Site, inbox: Inbox, outbox: Outbox
    ) -> None:
        """Subscribe for `people` to those of `routes` that are of guests only."""
        routes = tuple(routes)
        self._routes = tuple(route for route in routes if route.of_guests)
        self._lasting = tuple(route for route in routes if route.of_guests or POSE in route.into)
        """Routes whose messages persist, and become invalid when PointIt services publish them."""
        self._site = site
        self._inbox = inbox
        self._outbox = outbox
        self._instances = {f"{leader}.{user}": user for user in people for leader in LEADERS}
        self._leaders: set[str] = set()
        """Present ones of `_instances`."""
        self._ends: dict[str, list[Closable]] = {}
        """Declared endpoints in ROS, by person."""
        self._heard_s: dict[str, float] = {}
        self._tokens: dict[str, Closable] = {}
        self._given: frozenset[str] = frozenset()
        """Names that other nodes publish, without those of other PointIts, which are ignored here."""
        self._now_s = 0.0
        """Time of our checks: while the loop is blocked, nothing is received and no time passes."""
        self._timer = Timer(site.bus.call_later, self._mind)
        for user in dict.fromkeys(self._instances.values()):
            site.state.names.of(user)  # reserved: another person with the same ROS name gets a different one
            self._admit(user)
        if self._instances:
            self._mind()

    def on_graph(self, graph: Graph) -> None:
        """Update the publishers."""
        self._given = frozenset(
            each.name
            for each in graph.endpoints
            if each.kind == "publisher" and not each.is_ours and not each.is_bridge
        )

    def on_presence(self, instance: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        """Update the presence of a PointIt service."""
        user = self._instances.get(instance)
        if user is None:
            return
        (self._leaders.add if present else self._leaders.discard)(instance)
        leaders = sorted(each for each in self._leaders if self._instances[each] == user)
        if leaders and user in self._site.state.guests:
            self._dismiss(user, leaders[0])
        elif not leaders and user not in self._site.state.guests:
            self._site.bus.clear(_context(user))
            self._admit(user)

    def close(self) -> None:
        """Remove all guests."""
        self._timer.cancel()
        for user, guest in self._site.state.guests.items():
            self._end(user, guest, "the bridge has ended")
            for end in self._ends.pop(user):
                end.close()

    def _admit(self, user: str) -> None:
        self._site.state.guests[user] = Guest()
        self._ends[user] = [self._inbox.listen(route, user) for route in self._routes if "{" in route.ros]
        self._show_again(user)

    def _dismiss(self, user: str, leader: str) -> None:
        """Remove a guest in favour of PointIt services, which publish the state of the interaction."""
        del self._site.state.guests[user]
        for end in self._ends.pop(user):
            end.close()
        for route in self._lasting:
            self._inbox.stop_writing(route, user)
        self._show_again(user)
        self._leave(user)
        self._site.bus.warn(
            _context(user),
            f"{user} is named in `people`, whose nodes are all ROS nodes, and has {leader} here: ROS is not "
            "heard for them; end either of the two",
        )

    def _show_again(self, user: str) -> None:
        if user in self._site.state.people:
            self._outbox.join(user)

    def _mind(self) -> None:
        self._timer.start(LOOK_S)  # first, so that it is repeated after an error
        self._now_s += LOOK_S
        for user, guest in self._site.state.guests.items():
            self._judge(user, guest)

    def _judge(self, user: str, guest: Guest) -> None:
        if guest.is_heard:
            guest.is_heard = False
            self._heard_s[user] = self._now_s
        is_heard = user in self._heard_s and self._now_s - self._heard_s[user] < SILENT_S
        if is_heard or (guest.is_subscribed and self._has_ray(user)):
            self._come(user, guest)
        else:
            self._end(user, guest, "nothing of theirs comes any more")

    def _has_ray(self, user: str) -> bool:
        state = self._site.state
        return any("{" in route.ros and route.ros_name(state, user) in self._given for route in self._routes)

    def _come(self, user: str, guest: Guest) -> None:
        if guest.is_here:
            return
        state, bus = self._site.state, self._site.bus
        if not guest.is_subscribed:
            now_ns = self._site.clock.now_ns()
            self._inbox.publish(interaction(state, user, now_ns, "they have not asked for a cursor"))
        self._tokens[user] = bus.announce(USER_ALIVE, user)
        guest.is_here = True
        log.info("%s is here, as ROS nodes say", user)

    def _end(self, user: str, guest: Guest, reason: str) -> None:
        if guest.is_subscribed:
            guest.is_subscribed = False
            self._inbox.publish(interaction(self._site.state, user, self._site.clock.now_ns(), reason))
        if guest.is_here:
            guest.is_here = False
            self._leave(user)
            log.info("%s has left: %s", user, reason)

    def _leave(self, user: str) -> None:
        self._heard_s.pop(user, None)
        token = self._tokens.pop(user, None)
        if token is not None:
            token.close()


def _context(user: str) -> str:
    return f"guest {user}"
