"""Ownership of states, which decides by the present users and services whether they are handed out; pure.

The rules, for a state whose writer is gone:

- `users/{user}/...` belongs to the person: handed out while any service of theirs runs. When they leave, on
  purpose or not, it is not handed out, and after a while it is dropped.
- `deployment/{name}` lists what should run: handed out even if none of it does, so that a diagnosis finds
  what is missing. Dropped when it was ended on purpose, which its writer states by one without services, when
  another scenario has replaced it, and a day after its last service has left.
- Everything else belongs to the site: handed out until it is replaced, and dropped after a long time without
  a service that may write it.
- Misleading states are never retained: the simulated time of a run that ended, an external tracker's pose
  (such a tracker has no presence, so its end is unknown), progress of a localizer that ended, the queue for
  lamps of a led-driver that ended, an empty deployment.
"""

from collections.abc import Collection
from typing import Any

from pointit.schemas import Deployment, Localization, Message, UserPose
from pointit.schemas.topics import CLOCK, CONFIGURATION, DEPLOYMENT, LAMP_LEASES, TOPICS, Delivery, Topic

NOT_RETAINED: tuple[Topic[Any], ...] = (CLOCK, LAMP_LEASES, CONFIGURATION)
"""States that end with their writers."""


def retained() -> tuple[Topic[Any], ...]:
    """Return the topics of retained states, with those that services of other packages have added."""
    return tuple(topic for topic in TOPICS if topic.delivery is Delivery.STATE and topic not in NOT_RETAINED)


def dies_with_writer(message: Message) -> bool:
    """Return True if `message` must not outlive its writer."""
    if isinstance(message, UserPose):
        return message.method == "external"
    if isinstance(message, Deployment):
        return not message.services
    return isinstance(message, Localization) and message.phase == "sampling"


def is_personal(topic: Topic[Any]) -> bool:
    """Return True if `topic` belongs to a person and is not handed out while they are absent."""
    return topic.placeholder == "user"


def is_shared(topic: Topic[Any]) -> bool:
    """Return True if `topic` belongs to the site."""
    return not is_personal(topic) and topic is not DEPLOYMENT


def is_superseded(earlier: Message, later: Message) -> bool:
    """Return True if `later`, under another name, means that `earlier` no longer runs.

    A site runs one scenario at a time; people come and go independently.
    """
    return (
        isinstance(earlier, Deployment)
        and isinstance(later, Deployment)
        and bool(earlier.scenario and later.scenario)
    )


def has_owner(
    topic: Topic[Any], name: str, message: Message, users: Collection[str], instances: Collection[str]
) -> bool:
    """Return True if an owner of the state is present.

    Args:
        topic: its topic.
        name: value of the topic's placeholder.
        message: its value.
        users: people who are present.
        instances: services that are present.
    """
    if is_personal(topic):
        return name in users
    if isinstance(message, Deployment):
        return any(
            (f"{service.service}.{service.user}" if service.user else service.service) in instances
            for service in message.services
        )
    return any(instance.partition(".")[0] in topic.writers for instance in instances)
