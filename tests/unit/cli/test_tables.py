"""`pointit topic list`, `list` and `service list` say exactly what the tables say."""

import json
from typing import Any

import pytest
from click.testing import CliRunner

from pointit.cli.main import command
from pointit.schemas import ImuSample
from pointit.schemas.topics import PRESENCES, REQUESTS, TOPICS
from pointit.services.registry import PROCESSES


def invoke(*arguments: str) -> str:
    result = CliRunner().invoke(command, list(arguments))
    assert result.exit_code == 0, result.output
    return result.output


def records(*arguments: str) -> dict[str, list[dict[str, Any]]]:
    parsed: dict[str, list[dict[str, Any]]] = json.loads(invoke(*arguments, "--json"))
    return parsed


def test_topics_shows_every_row_on_one_line() -> None:
    lines = invoke("topic", "list").splitlines()
    for topic in TOPICS:
        (line,) = (line for line in lines if line.split()[:1] == [topic.key])
        assert topic.message.schema_name() in line
        assert f" {topic.delivery.value} " in line
        assert ", ".join(topic.writers) in line
        assert topic.about in line
        assert topic.rate_hz is None or f" {topic.rate_hz:g} " in line


def test_topics_as_json() -> None:
    tables = records("topic", "list")
    assert list(tables) == ["topics", "requests", "presence"]
    assert [row["key"] for row in tables["topics"]] == [topic.key for topic in TOPICS]
    assert tables["topics"][0] == {
        "key": TOPICS[0].key,
        "message": f"ImuSample.v{ImuSample.version}",
        "delivery": "latest",
        "rate_hz": 50,
        "writers": list(TOPICS[0].writers),
        "about": TOPICS[0].about,
    }
    assert [row["key"] for row in tables["requests"]] == [request.key for request in REQUESTS]
    assert [row["server"] for row in tables["requests"]] == [request.server for request in REQUESTS]
    assert [row["key"] for row in tables["presence"]] == [presence.key for presence in PRESENCES]


def test_list_shows_what_each_service_reads_writes_and_serves() -> None:
    rows = {row["name"]: row for row in records("list", "services")["services"]}
    assert list(rows) == [row.name for row in PROCESSES]
    for row in PROCESSES:
        shown = rows[row.name]
        assert shown["scope"] == row.scope
        assert shown["about"] == row.about
        assert shown["extra"] == row.extra
        assert shown["reads"] == [topic.key for topic in row.reads]
        assert shown["writes"] == [topic.key for topic in row.writes]
        assert shown["serves"] == [request.key for request in row.serves]
    assert {"web", "foxglove"} <= rows.keys()  # bridges are processes too
    text = invoke("list")
    assert all(row.about in text for row in PROCESSES)


@pytest.mark.parametrize("noun", ["service", "map", "plugin"])
def test_a_noun_lists_what_list_shows_of_it(noun: str) -> None:
    assert records(noun, "list") == records("list", f"{noun}s")


def test_an_unknown_section_is_a_mistake() -> None:
    result = CliRunner().invoke(command, ["list", "service"])
    assert result.exit_code == 2
    assert result.output == "Error: no section 'service'; did you mean services?\n"


@pytest.mark.parametrize("width", ["40", "200"])
def test_a_narrow_terminal_loses_no_text(monkeypatch: pytest.MonkeyPatch, width: str) -> None:
    monkeypatch.setenv("COLUMNS", width)
    text = invoke("topic", "list")
    assert "…" not in text
