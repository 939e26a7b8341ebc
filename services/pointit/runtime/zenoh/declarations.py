# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Publishers and subscribers that a session declares. Callbacks run on Zenoh's threads."""

from collections.abc import Callable
from typing import Any, Protocol

import zenoh
from zenoh import ext
from zenoh.handlers import Callback


class Declared(Protocol):
    """A declaration in a session."""

    def undeclare(self) -> None:
        """Withdraw the declaration. Callbacks that are already queued still run."""
        ...


def declare_publisher(
    session: zenoh.Session,
    key: str,
    *,
    cache: int = 0,
    missed: ext.MissDetectionConfig | None = None,
    **options: Any,
) -> Any:
    """Return a `zenoh.Publisher` of `key`, or with a cache a `zenoh.ext.AdvancedPublisher`.

    With BLOCK, one stuck reader would stop this process for seconds. Readers fetch messages that DROP has
    lost from the `cache`, which holds that number of messages. `missed`: method by which readers detect that
    they lost the last message.
    """
    options |= {
        "congestion_control": zenoh.CongestionControl.DROP,
        "allowed_destination": zenoh.Locality.REMOTE,
    }
    if not cache:
        return session.declare_publisher(key, **options)
    return ext.declare_advanced_publisher(
        session,
        key,
        cache=ext.CacheConfig(cache),
        sample_miss_detection=missed,
        publisher_detection=True,
        **options,
    )


def declare_subscriber(
    session: zenoh.Session, key: str, on_sample: Callable[[zenoh.Sample], None]
) -> Declared:
    """Call `on_sample` for each put and delete on `key` while there is a route to the writer."""
    remote = zenoh.Locality.REMOTE
    return session.declare_subscriber(key, Callback(on_sample, indirect=False), allowed_origin=remote)


def declare_caching_subscriber(
    session: zenoh.Session,
    key: str,
    on_sample: Callable[[zenoh.Sample], None],
    *,
    history: int,
    recovers: bool = True,
    is_announced: bool = False,
) -> Declared:
    """Call `on_sample` for each put and delete on `key`, and for cached messages of its publishers.

    `history`: number of messages to fetch from each publisher. `recovers`: fetch lost messages again.
    `is_announced`: publishers can detect this subscriber.
    """
    zid = session.info.zid()

    def on_foreign_sample(sample: zenoh.Sample) -> None:
        source = sample.source_info
        if source is None or source.source_id.zid != zid:
            on_sample(sample)
        # otherwise our own messages return from our own cache when a lost router is back

    return ext.declare_advanced_subscriber(
        session,
        key,
        Callback(on_foreign_sample, indirect=False),
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=history) if history else None,
        recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True) if recovers else None,
        subscriber_detection=is_announced,
        allowed_origin=zenoh.Locality.REMOTE,
    )
