"""Messages to bytes and back: msgpack maps with the field names; the only importer of msgpack."""

import reprlib
from typing import Any, TypeVar

import msgpack
from pydantic import BaseModel, ValidationError

from pointit.schemas.base import DecodeError, Message, Query, SchemaModel
from pointit.schemas.text import describe_mistake

P = TypeVar("P", bound=SchemaModel)

MAX_FIELDS = 256
"""No map of a message has more, of whatever version; what claims to have is refused before it is read."""

_REPR = reprlib.Repr()
_REPR.maxstring = _REPR.maxother = _REPR.maxlong = 60
_REPR.maxlevel = 2

MEDIA_TYPE = "application/msgpack"
"""The Zenoh encoding; the message's name and version follow as its schema."""


def _fields(part: object) -> dict[str, Any]:
    if isinstance(part, BaseModel):
        return vars(part)
    raise TypeError(f"cannot travel: {type(part).__name__}")


def encode(part: SchemaModel) -> bytes:
    """Return `part` as a msgpack map of its fields."""
    return msgpack.Packer(default=_fields).pack(part.__dict__)


def pack(value: object) -> bytes:
    """Return plain values as msgpack: numbers, text, bytes, lists and maps of them."""
    packed: bytes = msgpack.packb(value)
    return packed


def decode(kind: type[P], payload: bytes, schema: str = "") -> P:
    """Return the message of `kind` in `payload`.

    Args:
        kind: the message the key carries.
        payload: a msgpack map of its fields.
        schema: the sender's `Name.vN` where known; fields of a newer version that we do not know are
            ignored, because messages only grow.

    Raises:
        DecodeError: in one sentence, what is wrong with which field.
    """
    if len(payload) > kind.max_bytes:
        size = len(payload)
        raise DecodeError(f"{kind.__name__}: has {size} bytes, at most {kind.max_bytes} are taken")
    # From an unknown sender: each step may fail, with the field in the message
    try:
        data = msgpack.unpackb(payload, use_list=False, strict_map_key=True, max_map_len=MAX_FIELDS)
    except (ValueError, msgpack.exceptions.UnpackException, RecursionError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise DecodeError(f"{kind.__name__}: not msgpack ({reason})") from error
    if not isinstance(data, dict):
        raise DecodeError(f"{kind.__name__}: a msgpack map was expected, got {type(data).__name__}")
    try:
        return kind.model_validate(data, extra="ignore" if _is_newer(kind, schema) else None)
    except ValidationError as error:
        raise DecodeError(f"{kind.__name__}: {summarize_validation_error(error)}") from error


def summarize_validation_error(error: ValidationError) -> str:
    """Return the first complaint of `error` as `field: what (value), and how many more there are`."""
    details = error.errors(include_url=False)
    first = details[0]
    field = ".".join(str(part) for part in first["loc"]) or "(whole)"
    value = _REPR.repr(first["input"])  # the whole of it may be a million numbers
    if len(value) > 60:
        value = value[:57] + "..."
    more = ""
    if len(details) > 1:
        more = f", and {len(details) - 1} more"
    return f"{field}: {describe_mistake(first)} (got {value}){more}"


def _is_newer(kind: type[SchemaModel], schema: str) -> bool:
    name, _, version = schema.rpartition(".v")
    if name != kind.__name__:
        return False
    own = kind.version if issubclass(kind, Message | Query) else 0
    # nine digits at most: int() refuses thousands of them, and the sender may be anybody
    is_number = version.isdecimal() and len(version) < 10
    return is_number and int(version) > own
