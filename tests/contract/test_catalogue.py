"""The committed catalogue: equals what the code generates, and old samples are still read."""

import json
from pathlib import Path
from typing import Any, TypeGuard

import msgpack
import pytest

from pointit.cli.inspect.schema import read_folder
from pointit.schemas import Message, Query, decode, encode
from pointit.schemas.catalogue import catalogue
from pointit.schemas.topics import REQUESTS, TOPICS

FOLDER = Path(__file__).parents[2] / "schemas" / "catalogue" / "shipped"
SAMPLES = [pytest.param(path, id=path.stem) for path in sorted((FOLDER / "samples").glob("*.msgpack"))]
KINDS: dict[str, type[Message | Query]] = {kind.__name__: kind for kind in catalogue.all_kinds()}


def test_the_committed_catalogue_is_what_the_code_says() -> None:
    problems = catalogue.check_committed(read_folder(FOLDER))
    assert not problems, (
        "; ".join(problems) + " -- then commit: `pointit topic schema --write` does the writing"
    )


@pytest.mark.parametrize("kind", [pytest.param(kind, id=name) for name, kind in KINDS.items()])
def test_samples_are_there_and_leave_no_field_out(kind: type[Message | Query]) -> None:
    values = msgpack.unpackb((FOLDER / catalogue.sample_path(kind)).read_bytes())
    assert list(values) == list(kind.model_fields)
    assert not [name for name, value in values.items() if value is None or value in ("", [], b"")]
    assert len(SAMPLES) >= len(KINDS) > 20


@pytest.mark.parametrize("path", SAMPLES)
def test_samples_of_every_version_are_still_read(path: Path) -> None:
    name, _, version = path.stem.partition(".v")
    payload = path.read_bytes()
    message = decode(KINDS[name], payload, path.stem)
    again = encode(message)
    if int(version) == KINDS[name].version:
        assert again == payload
    else:
        assert decode(KINDS[name], again) == message
        assert _grown(msgpack.unpackb(payload), msgpack.unpackb(again))


def test_the_asyncapi_document_holds_together() -> None:
    document = json.loads((FOLDER / "asyncapi.json").read_bytes())
    assert document["asyncapi"].startswith("3.0.")
    addresses = {channel["address"] for channel in document["channels"].values()}
    assert addresses == {row.key for row in (*TOPICS, *REQUESTS)}
    references = list(_references(document))
    assert len(references) > 3 * len(addresses)
    for reference in references:
        file, _, pointer = reference.partition("#")
        node = json.loads((FOLDER / file).read_bytes()) if file else document
        for part in pointer.strip("/").split("/") if pointer else ():
            node = node[part]
        assert node


def test_channels_say_how_they_are_delivered_and_requests_have_a_query_and_a_reply() -> None:
    document = json.loads((FOLDER / "asyncapi.json").read_bytes())
    channels = document["channels"]
    imu, button = channels["users.user.imu"], channels["users.user.button"]
    assert (imu["x-delivery"], imu["x-rate-hz"], button["x-delivery"]) == ("latest", 50, "event")
    assert "imu-bridge" in imu["x-writers"]
    assert list(imu["parameters"]) == ["user"]
    assert channels["conveyor.add_package"]["x-server"] == "conveyor-sim"
    answers = {name: each for name, each in document["operations"].items() if "reply" in each}
    assert len(answers) == len(REQUESTS)
    add = answers["conveyor.add_package.answer"]
    assert add["messages"] == [{"$ref": "#/channels/conveyor.add_package/messages/AddPackage"}]
    assert add["reply"]["messages"] == [{"$ref": "#/channels/conveyor.add_package/messages/AddPackageReply"}]


def test_the_readme_lists_every_row() -> None:
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert not [row.key for row in (*TOPICS, *REQUESTS) if f"| `{row.key}` |" not in text]


def _references(node: Any) -> list[str]:
    if _is_object(node):
        own = [node["$ref"]] if "$ref" in node else []
        return own + [reference for each in node.values() for reference in _references(each)]
    return [reference for each in node for reference in _references(each)] if _is_list(node) else []


def _grown(old: Any, new: Any) -> bool:
    """Return True if `new` holds everything that `old` holds."""
    if _is_object(old):
        return all(name in new and _grown(value, new[name]) for name, value in old.items())
    if _is_list(old):
        return len(old) == len(new) and all(map(_grown, old, new))
    return bool(old == new)


def _is_object(value: Any) -> TypeGuard[dict[str, Any]]:
    return isinstance(value, dict)


def _is_list(value: Any) -> TypeGuard[list[Any]]:
    return isinstance(value, list)
