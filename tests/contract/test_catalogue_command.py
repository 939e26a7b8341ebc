"""`pointit topic schema`, as typed."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from pointit.cli.inspect.schema import command
from pointit.runtime.errors import ConfigError
from pointit.schemas import ImuSample, SchemaError
from pointit.schemas.catalogue import catalogue

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
