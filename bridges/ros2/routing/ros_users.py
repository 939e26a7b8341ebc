"""Users with ROS nodes only, by configuration. They are present while messages of these arrive."""

import logging
from collections.abc import Iterable

from pointit.bridges.ros2.graph.backend import Graph
from pointit.bridges.ros2.inbound.rays import interaction
from pointit.bridges.ros2.routing.conversion_state import RosUser
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
        self, people: Iterable[str], routes: Iterable[InboundRoute], site: Site, inbox: Inbox, outbox: Outbox
    ) -> None:
        """Subscribe for `people` to those of `routes` that are of ROS-only users only."""
        routes = tuple(routes)
        self._routes = tuple(route for route in routes if route.of_ros_users)
        self._lasting = tuple(route for route in routes if route.of_ros_users or POSE in route.into)
        """Routes whose messages persist, and become invalid when PointIt services publish them."""
        self._site = site
        self._inbox = inbox
        self._outbox = outbox
        self._instances = {f"{leader}.{user}": user for user in people for leader in LEADERS}
        self._leaders: set[str] = set()
        """Present ones of `_instances`."""
        self._ends: dict[str, list[Closable]] = {}
        """Declared endpoints in ROS, by person."""
        self._received_s: dict[str, float] = {}
        self._tokens: dict[str, Closable] = {}
        self._given: frozenset[str] = frozenset()
        """Names that other nodes publish, without those of other PointIts, which are ignored here."""
        self._now_s = 0.0
        """Time of our checks: while the loop is blocked, nothing is received and no time passes."""
        self._timer = Timer(site.bus.call_later, self._update_presence)
        for user in dict.fromkeys(self._instances.values()):
            site.state.names.of(user)  # reserved: another person with the same ROS name gets a different one
            self._admit(user)
        if self._instances:
            self._update_presence()

    def on_graph(self, graph: Graph) -> None:
        """Update the publishers."""
        self._given = frozenset(
            each.name
            for each in graph.endpoints
            if each.kind == "publisher" and not each.is_ours and not each.is_bridge
        )

    def on_presence(self, instance: str, *, present: bool) -> None:
        """Update the presence of a PointIt service."""
        user = self._instances.get(instance)
        if user is None:
            return
        (self._leaders.add if present else self._leaders.discard)(instance)
        leaders = sorted(each for each in self._leaders if self._instances[each] == user)
        if leaders and user in self._site.state.ros_users:
            self._dismiss(user, leaders[0])
        elif not leaders and user not in self._site.state.ros_users:
            self._site.bus.clear("ros-user", user)
            self._admit(user)

    def close(self) -> None:
        """Remove all ROS-only users."""
        self._timer.cancel()
        for user, ros_user in self._site.state.ros_users.items():
            self._end(user, ros_user, "the bridge has ended")
            for end in self._ends.pop(user):
                end.close()

    def _admit(self, user: str) -> None:
        self._site.state.ros_users[user] = RosUser()
        self._ends[user] = [self._inbox.listen(route, user) for route in self._routes if "{" in route.ros]
        self._show_again(user)

    def _dismiss(self, user: str, leader: str) -> None:
        """Remove a ROS-only user in favour of PointIt services, which publish the interaction."""
        del self._site.state.ros_users[user]
        for end in self._ends.pop(user):
            end.close()
        for route in self._lasting:
            self._inbox.stop_writing(route, user)
        self._show_again(user)
        self._leave(user)
        self._site.bus.warn(
            "ros-user",
            f"{user} is named in `people`, whose nodes are all ROS nodes, and has {leader} here: ROS is not "
            "heard for them; end either of the two",
            user,
        )

    def _show_again(self, user: str) -> None:
        if user in self._site.state.people:
            self._outbox.join(user)

    def _update_presence(self) -> None:
        self._timer.start(LOOK_S)  # first, so that it is repeated after an error
        self._now_s += LOOK_S
        for user, ros_user in self._site.state.ros_users.items():
            self._judge(user, ros_user)

    def _judge(self, user: str, ros_user: RosUser) -> None:
        if ros_user.has_new_input:
            ros_user.has_new_input = False
            self._received_s[user] = self._now_s
        has_new_input = user in self._received_s and self._now_s - self._received_s[user] < SILENT_S
        if has_new_input or (ros_user.is_subscribed and self._has_ray(user)):
            self._come(user, ros_user)
        else:
            self._end(user, ros_user, "nothing of theirs comes any more")

    def _has_ray(self, user: str) -> bool:
        state = self._site.state
        return any("{" in route.ros and route.ros_name(state, user) in self._given for route in self._routes)

    def _come(self, user: str, ros_user: RosUser) -> None:
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

    def _end(self, user: str, ros_user: RosUser, reason: str) -> None:
        if ros_user.is_subscribed:
            ros_user.is_subscribed = False
            self._inbox.publish(interaction(self._site.state, user, self._site.clock.now_ns(), reason))
        if ros_user.is_here:
            ros_user.is_here = False
            self._leave(user)
            log.info("%s has left: %s", user, reason)

    def _leave(self, user: str) -> None:
        self._received_s.pop(user, None)
        token = self._tokens.pop(user, None)
        if token is not None:
            token.close()
