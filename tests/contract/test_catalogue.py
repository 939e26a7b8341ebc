"""The committed catalogue: what the code generates; old samples are still read; `pointit topic schema`."""

import json
from pathlib import Path
from typing import Any, TypeGuard

import msgpack
import pytest
from click.testing import CliRunner, Result

from pointit.cli.inspect.schema import command, read_folder
from pointit.runtime.errors import ConfigError
from pointit.schemas import ImuSample, Message, Query, SchemaError, decode, encode
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


def test_channels_have_a_delivery_and_requests_query_and_reply() -> None:
    document = json.loads((FOLDER / "asyncapi.json").read_bytes())
    channels = document["channels"]
    imu = channels["users.user.imu"]
    button = channels["users.user.button"]
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


ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _in_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def run(*arguments: str) -> Result:
    return CliRunner().invoke(command, arguments, standalone_mode=False)


def code(result: Result) -> Any:
    if result.exception is not None:
        raise result.exception
    return result.return_value


def test_a_message_is_shown_with_its_fields() -> None:
    result = run("ImuSample")
    assert code(result) == 0
    for text in ("orientation_xyzw", "4 x number (norm 1)", "required", "charge left, 0 to 1"):
        assert text in result.output
    assert "keys.rate_hz" in run("Health").output


def test_json_is_the_schema_and_the_asyncapi_document() -> None:
    assert json.loads(run("ImuSample", "--json").output) == catalogue.message_schema(ImuSample)
    assert json.loads(run("ImuSample.v3", "--json").output) == catalogue.message_schema(ImuSample)
    assert json.loads(run("--json").output)["asyncapi"] == "3.0.0"


@pytest.mark.parametrize(
    ("name", "hint"), [("ImuSampel", "did you mean ImuSample"), ("ImuSample.v9", "today's is ImuSample.v3")]
)
def test_an_unknown_message_is_answered_with_a_hint(name: str, hint: str) -> None:
    with pytest.raises(SchemaError, match=hint):
        code(run(name))


def test_write_then_check(tmp_path: Path) -> None:
    arguments = ("--dir", str(tmp_path))
    assert code(run("--check", *arguments)) == 1
    assert "run `pointit topic schema --write`" in run("--check", *arguments).stderr
    result = run("--write", *arguments)
    assert code(result) == 0
    assert f"wrote {tmp_path / 'messages' / 'ImuSample.v3.json'}" in result.output
    assert code(run("--check", *arguments)) == 0
    assert code(run("--write", *arguments)) == 0
    assert json.loads(run("--write", "--json", *arguments).output) == {"written": []}
    assert json.loads(run("--check", "--json", *arguments).output) == {"ok": True, "problems": []}


def test_a_change_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    arguments = ("--dir", str(tmp_path))
    run("--write", *arguments)
    path = tmp_path / "messages" / "ImuSample.v3.json"
    schema = json.loads(path.read_bytes())
    del schema["properties"]["battery"]
    path.write_text(json.dumps(schema), encoding="utf-8")
    (tmp_path / "README.md").unlink()
    with pytest.raises(
        SchemaError, match=r"raise `version` of ImuSample to 4 and run `pointit topic schema --write`"
    ):
        code(run("--write", *arguments))
    assert not (tmp_path / "README.md").exists()
    assert code(run("--check", *arguments)) == 1
    assert json.loads(run("--check", "--json", *arguments).stdout)["ok"] is False


def test_elsewhere_it_says_where_to_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        ConfigError, match=r"schemas/catalogue/shipped: there is no such folder; run this in the root"
    ):
        code(run("--write"))
    assert code(run("--check")) == 0  # what the package ships
    assert code(run("ImuSample")) == 0
