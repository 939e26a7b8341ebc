"""One fully filled, always equal message of each kind: the golden samples of the catalogue."""

from collections.abc import Mapping
from typing import Any, TypeVar, cast

from pointit.schemas.base import SchemaModel

P = TypeVar("P", bound=SchemaModel)

_STAMP_NS = 1_700_000_000_000_000_000
_NARROW = 1000.0
"""A range wider than this has room for a number of its own for every field."""
_UNIT = {3: (0.6, 0.0, 0.8), 4: (0.5, -0.5, 0.5, 0.5)}
"""Exact unit vectors by their length."""


def example(kind: type[P]) -> P:
    """Return a message with every field set, optional ones too, no two numbers alike where bounds allow.

    Raises:
        pydantic.ValidationError: `kind` has a rule across fields that no such message meets.
    """
    schema = kind.model_json_schema()
    return kind.model_validate(_Filler(schema.get("$defs", {})).value(schema, kind.__name__))


class _Filler:
    """Makes values for JSON Schemas; counts, so that values differ."""

    def __init__(self, definitions: Mapping[str, Any]) -> None:
        self._definitions = definitions
        self._count = 0

    def value(self, schema: Mapping[str, Any], name: str) -> Any:
        if "$ref" in schema:
            return self.value(self._definitions[schema["$ref"].rpartition("/")[2]], name)
        if "anyOf" in schema:
            return self.value(next(each for each in schema["anyOf"] if each.get("type") != "null"), name)
        self._count += 1
        if "const" in schema:
            return schema["const"]
        if "enum" in schema:
            choices = [each for each in schema["enum"] if each != schema.get("default")]
            return choices[self._count % len(choices)]
        return self._plain(schema, name)

    def _plain(self, schema: Mapping[str, Any], name: str) -> Any:
        match schema.get("type"):
            case "object":
                fields = cast("Mapping[str, Any]", schema.get("properties", {}))
                return {field: self.value(each, field) for field, each in fields.items()}
            case "array":
                return self._array(schema, name)
            case "integer":
                return self._integer(schema, name)
            case "number":
                return self._number(schema)
            case "boolean":
                return not schema.get("default", False)
            case "string":
                return self._string(schema, name)
            case other:
                raise TypeError(f"{name}: no example for a field of type {other!r}")

    def _array(self, schema: Mapping[str, Any], name: str) -> tuple[Any, ...]:
        places: list[Mapping[str, Any]] = schema.get("prefixItems", [])
        if "x-norm" in schema:
            return _UNIT[len(places)]
        if places:
            return tuple(self.value(place, name) for place in places)
        return tuple(self.value(schema["items"], name) for _ in range(max(2, schema.get("minItems", 0))))

    def _integer(self, schema: Mapping[str, Any], name: str) -> int:
        low = int(schema.get("minimum", schema.get("exclusiveMinimum", 0) + 1))
        high = int(schema.get("maximum", schema.get("exclusiveMaximum", 1 << 63) - 1))
        if name.endswith("_ns") and high > _STAMP_NS:
            return _STAMP_NS + self._count
        return low + self._count % (high - low + 1)

    def _number(self, schema: Mapping[str, Any]) -> float:
        low = schema.get("minimum", schema.get("exclusiveMinimum"))
        high = schema.get("maximum", schema.get("exclusiveMaximum"))
        if low is not None and high is not None and high - low <= _NARROW:
            return float(low + (high - low) * (1 + self._count % 7) / 8)
        if high is not None and high <= _NARROW:
            return float(high - self._count / 8)
        return float(max(low or 0, 0)) + self._count / 8

    def _string(self, schema: Mapping[str, Any], name: str) -> str | bytes:
        if schema.get("format") == "binary":
            return bytes((self._count + place) % 256 for place in range(6))
        text = f"{name}-{self._count}".ljust(schema.get("minLength", 0), "x")
        return text[: schema.get("maxLength", len(text))]
