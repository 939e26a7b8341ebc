"""The catalogue: everything that travels, as files for others, and the rule that messages only grow.

Files are mappings of relative path to content here; `pointit topic schema` reads and writes the folder.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from pointit.schemas.catalogue import asyncapi
from pointit.schemas.catalogue.asyncapi import Kind
from pointit.schemas.catalogue.compatibility import breaking_changes, strip_annotations
from pointit.schemas.catalogue.example import example
from pointit.schemas.codec import encode
from pointit.schemas.errors import SchemaError
from pointit.schemas.topics import REQUESTS, TOPICS

WRITE = "`pointit topic schema --write`"
"""The command that brings the catalogue up to date."""

SHIPPED = Path(__file__).with_name("shipped")
"""Copy of the committed catalogue in an installed package; a checkout has it in `schemas/catalogue`."""

Files = Mapping[str, bytes]

_VERSIONED = re.compile(r"(messages|samples)/(\w+)\.v([1-9]\d{0,5})\.(json|msgpack)")


def all_kinds() -> tuple[Kind, ...]:
    """Return every message, query and reply of the topic table, by name.

    Raises:
        SchemaError: two of them have the same name.
    """
    found: dict[str, Kind] = {}
    rows = [topic.message for topic in TOPICS]
    rows += [kind for request in REQUESTS for kind in (request.query, request.reply)]
    for kind in rows:
        if found.setdefault(kind.__name__, kind) is not kind:
            raise SchemaError(f"two messages are called {kind.__name__}: rename one")
    return tuple(found[name] for name in sorted(found))


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
    files = {"README.md": asyncapi.readme().encode(), "asyncapi.json": _json(asyncapi.document())}
    for kind in all_kinds() if kinds is None else kinds:
        files[message_path(kind)] = _json(message_schema(kind))
        files[sample_path(kind)] = encode(example(kind))
    return files


def compatibility_errors(committed: Files, kinds: Iterable[Kind] | None = None) -> list[str]:
    """Return a sentence for each change of today's messages that is not a mere addition."""
    today = {kind.__name__: kind for kind in (all_kinds() if kinds is None else kinds)}
    sentences: list[str] = []
    versions: dict[str, set[int]] = {}
    for path in committed:
        if (found := _VERSIONED.fullmatch(path)) and found[1] == "messages":
            versions.setdefault(found[2], set()).add(int(found[3]))
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
    return {
        path: content
        for path, content in generate(kinds).items()
        if committed.get(path) != content and not (path.startswith("samples/") and path in committed)
    }


def check_committed(committed: Files, kinds: Iterable[Kind] | None = None) -> list[str]:
    """Return a sentence for each problem of a committed catalogue, with the remedy."""
    kinds = tuple(all_kinds() if kinds is None else kinds)
    if broken := compatibility_errors(committed, kinds):
        return broken
    sentences: list[str] = []
    if stale := sorted(updated_files(committed, kinds)):
        more = f" and {len(stale) - 3} more" if len(stale) > 3 else ""
        sentences.append(f"missing or out of date: {', '.join(stale[:3])}{more}; run {WRITE}")
    for path in sorted(committed):
        if not path.startswith(("messages/", "samples/")):
            continue
        found = _VERSIONED.fullmatch(path)
        if found is None or (found[1] == "messages") != (found[4] == "json"):
            sentences.append(f"{path} is no file of the catalogue: delete it")
        elif f"samples/{found[2]}.v{found[3]}.msgpack" not in committed:
            sentences.append(f"{path} has lost its sample: restore samples/{found[2]}.v{found[3]}.msgpack")
        elif f"messages/{found[2]}.v{found[3]}.json" not in committed:
            sentences.append(f"{path} has lost its schema: restore messages/{found[2]}.v{found[3]}.json")
    return sentences


def _broken(kind: Kind, versions: set[int], committed: Files) -> Iterator[str]:
    name, newest = kind.__name__, max(versions)
    if kind.version < newest:
        yield f"{name} has version {kind.version}, but {name}.v{newest} is committed: versions never go back"
        return
    if kind.version > newest + 1:
        yield f"{name} has version {kind.version}, but {name}.v{newest} is the newest: raise `version` by one"
        return
    now = message_schema(kind)
    for version in sorted(versions):
        before = _parsed(message_path(kind, version), committed)
        if lost := breaking_changes(before, now):
            yield (
                f"{name} may only grow from {name}.v{version}, but {' and '.join(lost)}; undo that, "
                "or make it a new message"
            )
        elif kind.version == version and strip_annotations(before) != strip_annotations(now):
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
    return data  # pyright: ignore[reportUnknownVariableType] - whatever JSON holds


def _json(document: Mapping[str, Any]) -> bytes:
    return (json.dumps(document, indent=2, sort_keys=True, ensure_ascii=False) + "\n").encode()
