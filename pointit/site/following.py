"""Following a site on a bus: subscriptions of a `SiteState` to topics and presence."""

import functools
from collections.abc import Callable, Iterable
from typing import Any

from pointit.runtime.bus.contract import AnyTopic, Bus, Closable, Subscription
from pointit.schemas.topics import ANY, CARRIER_ALIVE, SERVICE_ALIVE, USER_ALIVE
from pointit.site.site_state import SiteState


def follow_site(
    state: SiteState, bus: Bus, now_s: Callable[[], float], topics: Iterable[AnyTopic], user: str = ANY
) -> list[Closable]:
    """Subscribe `state` to presence and `topics`: to those of people of `user` only."""
    subscriptions = follow_topics(state, bus, now_s, topics, user)
    return [
        *subscriptions,
        bus.watch(USER_ALIVE, state.set_person),
        bus.watch(SERVICE_ALIVE, state.set_service),
        bus.watch(CARRIER_ALIVE, state.set_carrier),
    ]


def follow_topics(
    state: SiteState, bus: Bus, now_s: Callable[[], float], topics: Iterable[AnyTopic], user: str = ANY
) -> list[Subscription]:
    """Subscribe `state` to `topics` only."""

    def update_state(topic: AnyTopic, message: Any, name: str) -> None:
        state.take(topic, name, message, now_s())

    subscriptions: list[Subscription] = []
    for topic in topics:
        handler = functools.partial(update_state, topic)
        name = user if topic.placeholder == "user" else ANY
        subscriptions.append(bus.subscribe(topic, handler, name))
    return subscriptions
