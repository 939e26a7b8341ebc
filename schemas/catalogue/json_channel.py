"""Messages as JSON with a JSON Schema, for recordings and for the viewers Foxglove and Lichtblick.

Their parsers know no references, alternatives, nulls and nested arrays: references are resolved, optional
fields are described by their type without null, and all else is left out of the schema, though not of the
message.
"""

import base64
import json
from typing import Any, TypeVar

from pydantic import ValidationError

from pointit.schemas.base import DecodeError, Message, SchemaModel
from pointit.schemas.codec import summarize_validation_error

P = TypeVar("P", bound=SchemaModel)

Schema = dict[str, Any]

JSON_GROWTH = 4
"""A message as JSON has at most this many times the bytes that it has on the bus."""


class JsonChannel:
    """One kind of message."""

    def __init__(self, kind: type[SchemaModel], name: str = "") -> None:
        """Describe what is of `kind`; `name` is the schema's, and may be left out for a message."""
        full = kind.model_json_schema()
        if not name and issubclass(kind, Message):
            name = kind.schema_name()
        properties = _plain(full, full.get("$defs", {}))
        self.schema: Schema = {"title": name, **properties}
        self._has_bytes = '"binary"' in json.dumps(full)

    def to_json(self, message: SchemaModel) -> bytes:
        """Return `message` as JSON; bytes as base64."""
        if self._has_bytes:
            return json.dumps(message.model_dump(), default=_base64).encode()
        return message.model_dump_json().encode()


def from_json(kind: type[P], data: bytes, *, newer: bool = False) -> P:
    """Return the message of `kind` in `data`, which `JsonChannel.to_json` of this or an older version wrote.

    Args:
        kind: what it is.
        data: JSON text.
        newer: True if a newer version wrote it: fields that are unknown here are ignored.

    Raises:
        DecodeError: in one sentence, what is wrong with which field.
    """
    most = JSON_GROWTH * kind.max_bytes
    if len(data) > most:
        size = len(data)
        raise DecodeError(f"{kind.__name__}: has {size} bytes of JSON, at most {most} are taken")
    try:
        return kind.model_validate_json(data, extra="ignore" if newer else None)
    except ValidationError as error:
        raise DecodeError(f"{kind.__name__}: {summarize_validation_error(error)}") from error


def channel_name(key: str) -> str:
    """Return the name of a key's channel: dots would end the name in the paths that panels plot."""
    return "/" + key.replace(".", "/")


def _plain(schema: Schema, definitions: Schema) -> Schema:
    """Return the description of an object with those of its fields that can be described."""
    properties: dict[str, Schema] = {}
    for name, field_schema in schema.get("properties", {}).items():
        field = _field(field_schema, definitions)
        if field is not None:
            properties[name] = field
    plain_schema: Schema = {"type": "object", "properties": properties}
    if "description" in schema:
        plain_schema["description"] = schema["description"]
    return plain_schema


def _field(schema: Schema, definitions: Schema) -> Schema | None:
    description = schema.get("description")
    # an optional field is described as if it were there
    if alternatives := schema.get("anyOf"):
        present = (part for part in alternatives if part.get("type") != "null")
        schema = next(present, schema)
    if reference := schema.get("$ref"):
        schema = definitions[reference.rpartition("/")[2]]
    kind = schema.get("type")
    field: Schema | None = None
    if kind == "object":
        field = _plain(schema, definitions)
    elif kind == "array":
        field = _array(schema, definitions)
    elif kind in ("boolean", "string", "number", "integer"):
        field = {"type": kind}
        if schema.get("format") == "binary":
            field["contentEncoding"] = "base64"
    elif "const" in schema or "enum" in schema:
        field = {"type": "string"}
    if field is not None and description:
        field["description"] = description
    return field


def _array(schema: Schema, definitions: Schema) -> Schema | None:
    """Return the description of a list, or None of one of lists or of bytes."""
    item_schema = schema.get("items") or schema.get("prefixItems", [{}])[0]
    items = _field(item_schema, definitions)
    if items is None or items["type"] == "array":
        return None
    if "contentEncoding" in items:
        return None
    return {"type": "array", "items": items}


def _base64(value: object) -> str:
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    raise TypeError(f"cannot be written as JSON: {type(value).__name__}")
