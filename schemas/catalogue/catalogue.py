"""The catalogue: everything that travels, as files for others, and the rule that messages only grow.

Files are mappings of relative path to content here; `pointit topic schema` reads and writes the folder.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeGuard, TypeVar, cast

from pointit.schemas.base import SchemaError, SchemaModel
from pointit.schemas.catalogue import asyncapi
from pointit.schemas.catalogue.asyncapi import Kind
from pointit.schemas.codec import encode
from pointit.schemas.text import all_of, first_of
from pointit.schemas.topics import REQUESTS, TOPICS

P = TypeVar("P", bound=SchemaModel)
Files = Mapping[str, bytes]
JsonSchema = dict[str, Any]

_STAMP_NS = 1_700_000_000_000_000_000
_NARROW = 1000.0
"""A range wider than this has room for a number of its own for every field."""
_UNIT = {3: (0.6, 0.0, 0.8), 4: (0.5, -0.5, 0.5, 0.5)}
"""Exact unit vectors by their length."""

WRITE = "`pointit topic schema --write`"
"""The command that brings the catalogue up to date."""

SHIPPED = Path(__file__).with_name("shipped")
"""The committed catalogue, in a checkout and in an installed package."""
_VERSIONED = re.compile(r"(messages|samples)/(\w+)\.v([1-9]\d{0,5})\.(json|msgpack)")
_PROSE = frozenset({"title", "description", "$id", "$schema"})

_MAPS = frozenset({"properties", "$defs"})
"""Keywords whose members have names of our own, which may be `title`."""


def example(kind: type[P]) -> P:
    """Return a message with every field set, optional ones too, no two numbers alike where bounds allow.

    Raises:
        pydantic.ValidationError: `kind` has a rule across fields that no such message meets.
    """
    schema = kind.model_json_schema()
    filler = _Filler(schema.get("$defs", {}))
    return kind.model_validate(filler.value(schema, kind.__name__))


class _Filler:
    """Makes values for JSON Schemas; counts, so that values differ."""

    def __init__(self, definitions: Mapping[str, Any]) -> None:
        self._definitions = definitions
        self._count = 0

    def value(self, schema: Mapping[str, Any], name: str) -> Any:
        if "$ref" in schema:
            definition = schema["$ref"].rpartition("/")[2]
            return self.value(self._definitions[definition], name)
        if "anyOf" in schema:
            parts = (part for part in schema["anyOf"] if part.get("type") != "null")
            return self.value(next(parts), name)
        self._count += 1
        if "const" in schema:
            return schema["const"]
        if "enum" in schema:
            choices = [choice for choice in schema["enum"] if choice != schema.get("default")]
            return choices[self._count % len(choices)]
        return self._plain(schema, name)

    def _plain(self, schema: Mapping[str, Any], name: str) -> Any:
        match schema.get("type"):
            case "object":
                fields = cast("Mapping[str, Any]", schema.get("properties", {}))
                return {field: self.value(part, field) for field, part in fields.items()}
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
        count = max(2, schema.get("minItems", 0))
        return tuple(self.value(schema["items"], name) for _ in range(count))

    def _integer(self, schema: Mapping[str, Any], name: str) -> int:
        next_low = schema.get("exclusiveMinimum", 0) + 1
        next_high = schema.get("exclusiveMaximum", 1 << 63) - 1
        low = int(schema.get("minimum", next_low))
        high = int(schema.get("maximum", next_high))
        if name.endswith("_ns") and high > _STAMP_NS:
            return _STAMP_NS + self._count
        return low + self._count % (high - low + 1)

    def _number(self, schema: Mapping[str, Any]) -> float:
        low = schema.get("minimum", schema.get("exclusiveMinimum"))
        high = schema.get("maximum", schema.get("exclusiveMaximum"))
        if low is not None and high is not None:
            width = high - low
            if width <= _NARROW:
                return float(low + width * (1 + self._count % 7) / 8)
        if high is not None and high <= _NARROW:
            return float(high - self._count / 8)
        return float(max(low or 0, 0)) + self._count / 8

    def _string(self, schema: Mapping[str, Any], name: str) -> str | bytes:
        if schema.get("format") == "binary":
            return bytes((self._count + place) % 256 for place in range(6))
        min_length = schema.get("minLength", 0)
        text = f"{name}-{self._count}".ljust(min_length, "x")
        return text[: schema.get("maxLength", len(text))]


def all_kinds() -> tuple[Kind, ...]:
    """Return every message, query and reply of the topic table, by name.

    Raises:
        SchemaError: two of them have the same name.
    """
    by_name: dict[str, Kind] = {}
    kinds: list[Kind] = [topic.message for topic in TOPICS]
    for request in REQUESTS:
        kinds += [request.query, request.reply]
    for kind in kinds:
        if by_name.setdefault(kind.__name__, kind) is not kind:
            raise SchemaError(f"two messages are called {kind.__name__}: rename one")
    return tuple(by_name[name] for name in sorted(by_name))


def message_path(kind: Kind, version: int | None = None) -> str:
    """Return where the JSON Schema of `kind` is kept, `messages/ImuSample.v1.json`."""
    return f"messages/{kind.__name__}.v{version or kind.version}.json"


def sample_path(kind: Kind, version: int | None = None) -> str:
    """Return where the golden sample of `kind` is kept, `samples/ImuSample.v1.msgpack`."""
    return f"samples/{kind.__name__}.v{version or kind.version}.msgpack"


def message_schema(kind: Kind) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of `kind`; byte strings have the format `binary`."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"{kind.schema_name()}.json",
        **kind.model_json_schema(),
    }


def generate(kinds: Iterable[Kind] | None = None) -> dict[str, bytes]:
    """Return every file of the catalogue as of today; of messages only today's versions."""
    files = {"README.md": asyncapi.readme().encode()}
    files["asyncapi.json"] = _json(asyncapi.document())
    for kind in all_kinds() if kinds is None else kinds:
        files[message_path(kind)] = _json(message_schema(kind))
        files[sample_path(kind)] = encode(example(kind))
    return files


def compatibility_errors(committed: Files, kinds: Iterable[Kind] | None = None) -> list[str]:
    """Return a sentence for each change of today's messages that is not a mere addition."""
    if kinds is None:
        kinds = all_kinds()
    today = {kind.__name__: kind for kind in kinds}
    sentences: list[str] = []
    versions: dict[str, set[int]] = {}
    for path in committed:
        file = _VERSIONED.fullmatch(path)
        if file and file[1] == "messages":
            name = file[2]
            versions.setdefault(name, set()).add(int(file[3]))
    for name in sorted(versions):
        if name in today:
            sentences += _broken(today[name], versions[name], committed)
        else:
            sentences.append(
                f"{name} is in the catalogue and in no row of the topic table: put it back, or delete "
                f"messages/{name}.v*.json and samples/{name}.v*.msgpack if nobody ever sent it"
            )
    return sentences


def updated_files(committed: Files, kinds: Iterable[Kind] | None = None) -> dict[str, bytes]:
    """Return the files to write: new ones, and those with newer descriptions. Samples stay unchanged.

    Raises:
        SchemaError: a message breaks the rule that it only grows.
    """
    kinds = tuple(all_kinds() if kinds is None else kinds)
    if broken := compatibility_errors(committed, kinds):
        raise SchemaError("; ".join(broken))
    files: dict[str, bytes] = {}
    for path, content in generate(kinds).items():
        is_old_sample = path.startswith("samples/") and path in committed
        if committed.get(path) != content and not is_old_sample:
            files[path] = content
    return files


def check_committed(committed: Files, kinds: Iterable[Kind] | None = None) -> list[str]:
    """Return a sentence for each problem of a committed catalogue, with the remedy."""
    kinds = tuple(all_kinds() if kinds is None else kinds)
    if broken := compatibility_errors(committed, kinds):
        return broken
    sentences: list[str] = []
    if stale := sorted(updated_files(committed, kinds)):
        sentences.append(f"missing or out of date: {first_of(stale, 3)}; run {WRITE}")
    for path in sorted(committed):
        if not path.startswith(("messages/", "samples/")):
            continue
        file = _VERSIONED.fullmatch(path)
        if file is None or (file[1] == "messages") != (file[4] == "json"):
            sentences.append(f"{path} is no file of the catalogue: delete it")
            continue
        sample = f"samples/{file[2]}.v{file[3]}.msgpack"
        schema = f"messages/{file[2]}.v{file[3]}.json"
        if sample not in committed:
            sentences.append(f"{path} has lost its sample: restore {sample}")
        elif schema not in committed:
            sentences.append(f"{path} has lost its schema: restore {schema}")
    return sentences


def _broken(kind: Kind, versions: set[int], committed: Files) -> Iterator[str]:
    name = kind.__name__
    newest = max(versions)
    if kind.version < newest:
        problem = f"{name} has version {kind.version}, but {name}.v{newest} is committed"
        yield f"{problem}: versions never go back"
        return
    if kind.version > newest + 1:
        problem = f"{name} has version {kind.version}, but {name}.v{newest} is the newest"
        yield f"{problem}: raise `version` by one"
        return
    now = message_schema(kind)
    for version in sorted(versions):
        committed_schema = _parsed(message_path(kind, version), committed)
        losses = breaking_changes(committed_schema, now)
        if losses:
            yield (
                f"{name} may only grow from {name}.v{version}, but {all_of(losses)}; undo that, "
                "or make it a new message"
            )
            continue
        # of the same version, only prose may differ
        is_same = strip_annotations(committed_schema) == strip_annotations(now)
        if kind.version == version and not is_same:
            yield (
                f"{name}.v{version} has changed and versions never do: raise `version` of {name} to "
                f"{version + 1} and run {WRITE} again"
            )


def _parsed(path: str, committed: Files) -> dict[str, Any]:
    try:
        data = json.loads(committed[path])
    except ValueError as error:
        raise SchemaError(f"{path}: is not JSON ({error}); restore it from git") from error
    if not isinstance(data, dict):
        raise SchemaError(f"{path}: is not a JSON Schema; restore it from git")
    return data


def _json(document: Mapping[str, Any]) -> bytes:
    return (json.dumps(document, indent=2, sort_keys=True, ensure_ascii=False) + "\n").encode()


def strip_annotations(schema: Mapping[str, Any]) -> JsonSchema:
    """Return `schema` without its prose, with every nested part written out in place."""
    parts = {keyword: value for keyword, value in schema.items() if keyword != "$defs"}
    bare: JsonSchema = _bare(parts, schema.get("$defs", {}))
    return bare


def breaking_changes(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Return a clause for each way in which `new` is not `old` plus optional fields.

    Defaults may change, since writers of the newer version send every field.
    """
    return list(_losses(strip_annotations(old), strip_annotations(new), ""))


def _bare(node: Any, definitions: Mapping[str, Any]) -> Any:
    if _is_list(node):
        return [_bare(item, definitions) for item in node]
    if not _is_object(node):
        return node
    bare: JsonSchema = {}
    for key, value in node.items():
        if key == "$ref":
            definition = str(value).rpartition("/")[2]
            bare.update(_bare(definitions[definition], definitions))
        elif key in _MAPS:
            bare[key] = {name: _bare(field, definitions) for name, field in value.items()}
        elif key == "default":
            bare[key] = value
        elif key not in _PROSE:
            bare[key] = _bare(value, definitions)
    if "required" in bare:
        bare["required"] = sorted(bare["required"])
    return bare


def _losses(old: JsonSchema, new: JsonSchema, path: str) -> Iterator[str]:
    fields: JsonSchema = old.get("properties", {})
    grown: JsonSchema = new.get("properties", {})
    for name, field in fields.items():
        field_path = f"{path}.{name}" if path else name
        if name in grown:
            yield from _losses(field, grown[name], field_path)
        else:
            yield f"the field {field_path} is gone"
    was_required = set(old.get("required", ()))
    is_required = set(new.get("required", ()))
    for name in sorted(is_required - was_required):
        field_path = f"{path}.{name}" if path else name
        yield f"the field {field_path} is required now, give it a default"
    keywords = (old.keys() | new.keys()) - {"properties", "required", "default"}
    for key in sorted(keywords):
        yield from _changes(old.get(key), new.get(key), key, path)


def _changes(old: Any, new: Any, keyword: str, path: str) -> Iterator[str]:
    if _is_object(old) and _is_object(new):
        yield from _losses(old, new, path)
    elif _are_same_length(old, new):  # the places of a tuple, or alternatives
        for old_part, new_part in zip(old, new, strict=True):
            yield from _changes(old_part, new_part, keyword, path)
    elif old != new:
        change = f"{keyword}: {old!r} before, {new!r} now"
        yield f"the field {path} changed ({change})"


def _are_same_length(old: Any, new: Any) -> bool:
    """Return True for two lists with as many schemas."""
    if not _is_list(old) or not _is_list(new):
        return False
    return len(old) == len(new) and all(map(_is_object, [*old, *new]))


def _is_list(value: Any) -> TypeGuard[list[Any]]:
    return isinstance(value, list)


def _is_object(value: Any) -> TypeGuard[JsonSchema]:
    return isinstance(value, dict)
