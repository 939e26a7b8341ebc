"""Users with ROS nodes only, by configuration. They are present while messages of these arrive.

No core: it keeps the times of messages.
"""

import logging
from collections.abc import Iterable

from pointit.bridges.ros2.graph.backend import Graph
from pointit.bridges.ros2.inbound.rays import interaction
from pointit.bridges.ros2.routing.conversion_state import RosUser
from pointit.bridges.ros2.routing.inbox import Inbox
from pointit.bridges.ros2.routing.outbox import Outbox
from pointit.bridges.ros2.routing.route_types import InboundRoute
from pointit.bridges.ros2.routing.site import RosSite
from pointit.runtime.bus.contract import Closable
from pointit.runtime.clock import Timer
from pointit.schemas.topics import INTERACTION, POSE, RAY, USER_ALIVE
from pointit.services.registry import PROCESSES

log = logging.getLogger(__name__)

LOOK_S = 0.25
"""Interval of checking whether a ROS-only user has come or gone."""

SILENT_S = 3.0
"""Time without a message after which a ROS-only user has left, s, unless they want a cursor and their ray is
in the graph."""

LEADERS = tuple(
    row.name for row in PROCESSES if row.scope == "user" and not {RAY, INTERACTION}.isdisjoint(row.writes)
)
"""PointIt services that replace a ROS-only user's nodes: a person with one is no ROS-only user."""


class RosUsers:
    """Announces ROS-only users to the site when they come and go, and yields to PointIt services."""

    def __init__(
        self,
        people: Iterable[str],
        routes: Iterable[InboundRoute],
        site: RosSite,
        inbox: Inbox,
        outbox: Outbox,
    ) -> None:
        """Subscribe for `people` to those of `routes` that are of ROS-only users only."""
        routes = tuple(routes)
        self._routes = tuple(route for route in routes if route.of_ros_users)
        self._lasting: list[InboundRoute] = []
        """Routes whose messages persist, and become invalid when PointIt services publish them."""
        for route in routes:
            if route.of_ros_users or POSE in route.into:
                self._lasting.append(route)
        self._site = site
        self._inbox = inbox
        self._outbox = outbox
        self._instances: dict[str, str] = {}
        """Users by the instances of PointIt services that would replace their nodes."""
        for user in people:
            for leader in LEADERS:
                self._instances[f"{leader}.{user}"] = user
        self._leaders: set[str] = set()
        """Present ones of `_instances`."""
        self._ends: dict[str, list[Closable]] = {}
        """Declared endpoints in ROS, by person."""
        self._received_s: dict[str, float] = {}
        self._tokens: dict[str, Closable] = {}
        self._published: frozenset[str] = frozenset()
        """Names that other nodes publish, without those of other PointIts, which are ignored here."""
        self._now_s = 0.0
        """Time of our checks: while the loop is blocked, nothing is received and no time passes."""
        self._timer = Timer(site.bus.call_later, self._update_presence)

        # All are added before any is announced
        for user in dict.fromkeys(self._instances.values()):
            site.state.names.of(user)  # reserved: another person with the same ROS name gets a different one
            self._add_user(user)
        if self._instances:
            self._update_presence()

    def on_graph(self, graph: Graph) -> None:
        """Update the publishers."""
        names: list[str] = []
        for endpoint in graph.endpoints:
            is_foreign = not endpoint.is_ours and not endpoint.is_bridge
            if endpoint.kind == "publisher" and is_foreign:
                names.append(endpoint.name)
        self._published = frozenset(names)

    def on_presence(self, instance: str, *, present: bool) -> None:
        """Update the presence of a PointIt service."""
        user = self._instances.get(instance)
        if user is None:
            return
        if present:
            self._leaders.add(instance)
        else:
            self._leaders.discard(instance)

        # PointIt services go before ROS nodes, which are heard again after the last of these
        leaders = sorted(leader for leader in self._leaders if self._instances[leader] == user)
        ros_users = self._site.state.ros_users
        if leaders and user in ros_users:
            self._yield_to(leaders[0], user)
        elif not leaders and user not in ros_users:
            self._site.bus.clear("ros-user", user)
            self._add_user(user)

    def close(self) -> None:
        """Remove all ROS-only users."""
        self._timer.cancel()
        for user, ros_user in self._site.state.ros_users.items():
            self._end_presence(user, ros_user, "the bridge has ended")
            for end in self._ends.pop(user):
                end.close()

    def _add_user(self, user: str) -> None:
        self._site.state.ros_users[user] = RosUser()
        own_routes = [route for route in self._routes if "{" in route.ros]
        self._ends[user] = [self._inbox.listen(route, user) for route in own_routes]
        self._join_outbox_again(user)

    def _yield_to(self, leader: str, user: str) -> None:
        """Remove a ROS-only user in favour of PointIt services, which publish the interaction."""
        del self._site.state.ros_users[user]
        for end in self._ends.pop(user):
            end.close()
        for route in self._lasting:
            self._inbox.stop_writing(route, user)
        self._join_outbox_again(user)
        self._withdraw_presence(user)
        sentence = (
            f"{user} is named in `people`, whose nodes are all ROS nodes, and has {leader} here: ROS is not "
            "heard for them; end either of the two"
        )
        self._site.bus.warn("ros-user", sentence, user)

    def _join_outbox_again(self, user: str) -> None:
        if user in self._site.state.people:
            self._outbox.join(user)

    def _update_presence(self) -> None:
        self._timer.start(LOOK_S)  # first, so that it is repeated after an error
        self._now_s += LOOK_S
        for user, ros_user in self._site.state.ros_users.items():
            self._update_user(user, ros_user)

    def _update_user(self, user: str, ros_user: RosUser) -> None:
        if ros_user.has_new_input:
            ros_user.has_new_input = False
            self._received_s[user] = self._now_s
        is_heard = user in self._received_s and self._now_s - self._received_s[user] < SILENT_S
        wants_cursor = ros_user.is_subscribed and self._has_ray(user)
        if is_heard or wants_cursor:
            self._announce_presence(user, ros_user)
        else:
            self._end_presence(user, ros_user, "nothing of theirs comes any more")

    def _has_ray(self, user: str) -> bool:
        state = self._site.state
        own_routes = [route for route in self._routes if "{" in route.ros]
        return any(route.ros_name(state, user) in self._published for route in own_routes)

    def _announce_presence(self, user: str, ros_user: RosUser) -> None:
        if ros_user.is_here:
            return
        state = self._site.state
        bus = self._site.bus
        if not ros_user.is_subscribed:
            now_ns = self._site.clock.now_ns()
            self._inbox.publish(interaction(state, user, now_ns, "they have not asked for a cursor"))
        self._tokens[user] = bus.announce(USER_ALIVE, user)
        ros_user.is_here = True
        log.info("%s is here, as ROS nodes say", user)

    def _end_presence(self, user: str, ros_user: RosUser, reason: str) -> None:
        if ros_user.is_subscribed:
            ros_user.is_subscribed = False
            now_ns = self._site.clock.now_ns()
            self._inbox.publish(interaction(self._site.state, user, now_ns, reason))
        if ros_user.is_here:
            ros_user.is_here = False
            self._withdraw_presence(user)
            log.info("%s has left: %s", user, reason)

    def _withdraw_presence(self, user: str) -> None:
        self._received_s.pop(user, None)
        token = self._tokens.pop(user, None)
        if token is not None:
            token.close()
