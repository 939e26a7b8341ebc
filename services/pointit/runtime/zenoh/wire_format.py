"""Encoding of messages and keys on Zenoh."""

from typing import Any

import zenoh

from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas import DecodeError, Message, Query, decode
from pointit.schemas.codec import MEDIA_TYPE
from pointit.schemas.topics import Presence, Request, check_name

PRIORITY = zenoh.Priority.DATA_HIGH
"""Priority of published states and events. Those fetched again from a writer's cache have another one."""


def encoding_of(kind: type[Message] | type[Query]) -> zenoh.Encoding:
    """Return the encoding with the name and the version of the message."""
    return zenoh.Encoding(MEDIA_TYPE).with_schema(kind.schema_name())


def decoded(kind: type[Any], payload: zenoh.ZBytes | None, encoding: zenoh.Encoding | None) -> Any:
    """Return the message of `kind` in an untrusted payload. Raises `DecodeError` if it is none."""
    check_size(kind, payload)
    schema = "" if encoding is None else str(encoding).partition(";")[2]
    return decode(kind, b"" if payload is None else payload.to_bytes(), schema)


def check_size(kind: type[Any], payload: zenoh.ZBytes | None) -> None:
    """Check the length of a payload before decoding. Raises `DecodeError` if it is too long for a `kind`."""
    if payload is not None and len(payload) > kind.max_bytes:
        raise DecodeError(f"{kind.__name__}: has {len(payload)} bytes, at most {kind.max_bytes} are taken")


def name_from_key(row: AnyTopic | Request[Any, Any] | Presence, key: str) -> str:
    """Return the name in an untrusted key. Raises `SchemaError` if it is invalid."""
    name = row.name_in(key)
    if row.placeholder:
        check_name(name, row.placeholder)
    return name
