"""Encoding of messages and keys on Zenoh, and the publishers and subscribers that a session declares."""

from collections.abc import Callable
from typing import Any, Protocol

import zenoh
from zenoh import ext
from zenoh.handlers import Callback

from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas import DecodeError, Message, Query, Reply, SchemaError, decode, encode
from pointit.schemas.codec import MEDIA_TYPE
from pointit.schemas.topics import Presence, Request, check_name

PRIORITY = zenoh.Priority.DATA_HIGH
"""Priority of published states and events. Those fetched again from a writer's cache have another one."""


def encoding_of(kind: type[Message] | type[Query]) -> zenoh.Encoding:
    """Return the encoding with the name and the version of the message."""
    return zenoh.Encoding(MEDIA_TYPE).with_schema(kind.schema_name())


def encoded(message: Message | Query | Reply) -> bytes:
    """Return `message` as bytes that each reader takes. Raises `SchemaError` if it is too long."""
    payload = encode(message)
    if len(payload) > message.max_bytes:
        name = type(message).__name__
        raise SchemaError(f"{name}: would have {len(payload)} bytes, and readers take {message.max_bytes}")
    return payload


def decoded(kind: type[Any], payload: zenoh.ZBytes | None, encoding: zenoh.Encoding | None) -> Any:
    """Return the message of `kind` in an untrusted payload. Raises `DecodeError` if it is none."""
    check_size(kind, payload)
    schema = "" if encoding is None else str(encoding).partition(";")[2]
    data = b"" if payload is None else payload.to_bytes()
    return decode(kind, data, schema)


def check_size(kind: type[Any], payload: zenoh.ZBytes | None) -> None:
    """Check the length of a payload before decoding. Raises `DecodeError` if it is too long for a `kind`."""
    if payload is None:
        return
    size = len(payload)
    if size > kind.max_bytes:
        raise DecodeError(f"{kind.__name__}: has {size} bytes, at most {kind.max_bytes} are taken")


def check_writer(message: Message, name: str) -> None:
    """Check that a message under the key of `name` states no other writer. Raises `DecodeError`."""
    contradiction = message.contradiction(name)
    if contradiction:
        raise DecodeError(f"{type(message).__name__}: {contradiction} under the key of {name}")


def name_from_key(row: AnyTopic | Request[Any, Any] | Presence, key: str) -> str:
    """Return the name in an untrusted key. Raises `SchemaError` if it is invalid."""
    name = row.name_in(key)
    if row.placeholder:
        check_name(name, row.placeholder)
    return name


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
    # What needs no cache gets a plain publisher, which costs less per message
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


def declare_retained_subscribers(
    session: zenoh.Session,
    key: str,
    on_sample: Callable[[zenoh.Sample], None],
    on_heartbeat: Callable[[zenoh.Sample], None],
    on_writer: Callable[[zenoh.Sample], None] | None,
) -> list[Declared]:
    """Call the functions for samples on `key`, for heartbeats of its writers, and for writers that come.

    Heartbeats show that a last message was lost. Periodic queries would cost more.
    """
    writers = f"{key}/@adv/pub/**"
    declared = [
        declare_subscriber(session, key, on_sample),
        declare_subscriber(session, writers, on_heartbeat),
    ]
    if on_writer is not None:
        on_token = Callback(on_writer, indirect=False)
        declared.append(session.liveliness().declare_subscriber(writers, on_token))
    return declared


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

    # Heartbeats of a writer show that its last message was lost. Periodic queries would cost more.
    history_config: ext.HistoryConfig | None = None
    if history:
        history_config = ext.HistoryConfig(detect_late_publishers=True, max_samples=history)
    recovery: ext.RecoveryConfig | None = None
    if recovers:
        recovery = ext.RecoveryConfig(periodic_queries=None, heartbeat=True)
    return ext.declare_advanced_subscriber(
        session,
        key,
        Callback(on_foreign_sample, indirect=False),
        history=history_config,
        recovery=recovery,
        subscriber_detection=is_announced,
        allowed_origin=zenoh.Locality.REMOTE,
    )
