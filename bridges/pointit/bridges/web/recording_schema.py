"""JSON Schemas of messages as viewers of MCAP files read them: without references, unions and tuples.

Lichtblick refuses a channel whose schema has `$ref`, `anyOf` or arrays of arrays. Fields that cannot be said
without are left out of the schema; the messages have them all the same.
"""

from typing import Any, cast

from pointit.schemas import Message

Schema = dict[str, Any]

_PLAIN = ("boolean", "string", "number", "integer")


def plain_schema(kind: type[Message]) -> Schema:
    """Return the schema of `kind`, plain; byte strings are base64."""
    schema = kind.model_json_schema()
    plain = _plain(schema, schema.get("$defs", {}))
    assert plain is not None  # noqa: S101 - a message is an object
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": kind.__name__, **plain}


def _plain(schema: Schema, parts: dict[str, Schema]) -> Schema | None:
    """Return `schema` without references, or none where it cannot be said plainly."""
    if reference := schema.get("$ref"):
        schema = {**parts[str(reference).rpartition("/")[2]], **_told(schema)}
    told = _told(schema)
    if several := schema.get("anyOf"):
        some = [one for one in several if one.get("type") != "null"]
        plain = _plain(some[0], parts) if len(some) == 1 else None
        return None if plain is None else {**plain, **told}
    if schema.get("format") == "binary":
        return {"type": "string", "contentEncoding": "base64", **told}
    what = schema.get("type")
    if what in _PLAIN:
        return {"type": what, **told}
    if what == "array":
        item = _plain(_item(schema), parts)
        is_plain = (
            item is not None and (item["type"] in (*_PLAIN, "object")) and "contentEncoding" not in item
        )
        return {"type": "array", "items": item, **told} if is_plain else None
    if what == "object" and "properties" in schema:
        fields = {name: _plain(field, parts) for name, field in schema["properties"].items()}
        return {"type": "object", "properties": {n: f for n, f in fields.items() if f is not None}, **told}
    return None


def _item(schema: Schema) -> Schema:
    """Return what an array has; of a tuple its first, as all of ours are of one kind."""
    if fixed := schema.get("prefixItems"):
        return cast("Schema", fixed[0])
    return cast("Schema", schema.get("items", {}))


def _told(schema: Schema) -> Schema:
    text = schema.get("description")
    return {"description": text} if text else {}
