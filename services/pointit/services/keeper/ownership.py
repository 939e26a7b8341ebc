"""Whose a state is, and whether it may be handed out: decided by who is present; pure.

The rules, for a state whose writer is gone:

- `users/{user}/...` is the person's: handed out while anything of theirs runs. Who leaves, on purpose or not,
  takes it along: nobody gets it meanwhile, and after a while it is forgotten.
- `deployment/{name}` says what should run: handed out also when none of it does, so that who looks then is
  told what is missing; forgotten when it was ended on purpose, which its writer says by one without services,
  when another scenario has begun in its place, and a day after the last of its services was present.
- All else is the site's: handed out until somebody replaces it, and forgotten after long without anybody who
  may write it.
- Never kept is what would mislead: the simulated time of a run that ended, an external tracker's pose (such a
  tracker is not present, so nobody can tell whether it left), progress that its localizer's end cut short, a
  deployment of nothing.
"""

from collections.abc import Collection
from typing import Any

from pointit.schemas import Deployment, Localization, Message, UserPose
from pointit.schemas.topics import CLOCK, DEPLOYMENT, TOPICS, Delivery, Topic

KEPT: tuple[Topic[Any], ...] = tuple(
    topic for topic in TOPICS if topic.delivery is Delivery.STATE and topic is not CLOCK
)
"""What is kept."""


def dies_with_writer(message: Message) -> bool:
    """Return True if `message` must not outlive its writer."""
    if isinstance(message, UserPose):
        return message.method == "external"
    if isinstance(message, Deployment):
        return not message.services
    return isinstance(message, Localization) and message.phase == "sampling"


def is_personal(topic: Topic[Any]) -> bool:
    """Return True if `topic` is a person's: handed out to nobody while they are not there."""
    return topic.placeholder == "user"


def is_shared(topic: Topic[Any]) -> bool:
    """Return True if `topic` is the site's, nobody's in particular."""
    return not is_personal(topic) and topic is not DEPLOYMENT


def is_superseded(earlier: Message, later: Message) -> bool:
    """Return True if `later`, under another name, tells that `earlier` runs no more.

    A site runs one scenario at a time; people come and go beside it.
    """
    return (
        isinstance(earlier, Deployment)
        and isinstance(later, Deployment)
        and bool(earlier.scenario and later.scenario)
    )


def has_owner(
    topic: Topic[Any], name: str, message: Message, users: Collection[str], instances: Collection[str]
) -> bool:
    """Return True if somebody is present whose state it is.

    Args:
        topic: its row.
        name: what stands for the row's placeholder.
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
