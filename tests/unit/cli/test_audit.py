"""`pointit audit`: the table, its filters, what it says when there is none."""

import datetime as dt
import json
import os
from pathlib import Path
from typing import Literal

import pytest
from click.testing import CliRunner, Result

from pointit.cli.inspect.audit import command, since_ns
from pointit.runtime.errors import ConfigError
from pointit.services.selector.journal import Journal
from pointit.services.selector.selection_publisher import Record

S = 1_000_000_000
NOW = 1_700_000_000 * S


def audit(*arguments: str) -> Result:
    return CliRunner().invoke(command, list(arguments), catch_exceptions=False)


@pytest.fixture(name="journal")
def _journal(own_state: Path) -> Path:
    journal = Journal(own_state / "lab" / "selector")
    journal.begin(NOW)
    doings: tuple[tuple[Literal["selected", "refused", "deselected"], str], ...] = (
        ("selected", "anna"),
        ("refused", "ben"),
        ("deselected", "anna"),
    )
    for seq, (event, user) in enumerate(doings, 1):
        record = Record(
            stamp_ns=NOW + seq * S, event=event, object_id="p-1", kind="red", user=user, owner="anna",
            since_ns=NOW + S, cause="dwell", method="gauge", confidence=0.875,
            reason="hers" if event == "refused" else "", seq=seq,
        )  # fmt: skip
        journal.add(record)
    journal.commit(NOW)
    journal.close()
    return journal.path


@pytest.mark.usefixtures("journal")
def test_the_table_says_who_selected_what_and_when() -> None:
    lines = audit().output.splitlines()
    row = next(line for line in lines if " selected " in line)
    assert all(word in row for word in ("anna", "red", "p-1", "dwell", "gauge", "0.875", "2023-11-14"))
    assert sum("p-1" in line for line in lines) == 3


@pytest.mark.usefixtures("journal")
def test_json_has_everything() -> None:
    events = json.loads(audit("--json").output)["events"]
    assert [event["event"] for event in events] == ["selected", "refused", "deselected"]
    assert events[1] == {
        "stamp_ns": NOW + 2 * S,
        "event": "refused",
        "object_id": "p-1",
        "kind": "red",
        "user": "ben",
        "owner": "anna",
        "since_ns": NOW + S,
        "cause": "dwell",
        "method": "gauge",
        "confidence": 0.875,
        "reason": "hers",
        "seq": 2,
    }


@pytest.mark.usefixtures("journal")
@pytest.mark.parametrize(
    ("arguments", "seqs"),
    [
        (("--user", "ben"), [2]),
        (("--user", "anna"), [1, 2, 3]),
        (("--object", "p-1"), [1, 2, 3]),
        (("--object", "p-2"), []),
        (("--last", "1"), [3]),
        (("--since", "1s"), []),
        (("--since", "2023-01-01"), [1, 2, 3]),
    ],
)
def test_filters(arguments: tuple[str, ...], seqs: list[int]) -> None:
    events = json.loads(audit("--json", *arguments).output)["events"]
    assert [event["seq"] for event in events] == seqs


def test_no_journal_says_what_to_do() -> None:
    with pytest.raises(ConfigError, match=r"no selector of site hall has kept a journal.*--site"):
        audit("--site", "hall")
    assert not Path(os.environ["POINTIT_STATE"]).exists()


def test_a_damaged_journal_says_what_to_do(journal: Path) -> None:
    journal.write_bytes(b"\xff" * 4096)
    with pytest.raises(ConfigError, match=r"cannot be read.*restart the selector"):
        audit()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", 0),
        ("90s", NOW - 90 * S),
        ("1.5 min", NOW - 90 * S),
        ("2h", NOW - 7200 * S),
        ("7d", NOW - 7 * 86400 * S),
        ("2023-03-01T14:30+00:00", int(dt.datetime(2023, 3, 1, 14, 30, tzinfo=dt.UTC).timestamp()) * S),
        ("99999999d", 0),
    ],
)
def test_since_is_understood(text: str, expected: int) -> None:
    assert since_ns(text, NOW) == expected


@pytest.mark.parametrize("text", ["soon", "5 weeks", "2023-13-01", "-3h", "9" * 400 + "d"])
def test_since_rejects_a_text_that_is_no_time(text: str) -> None:
    with pytest.raises(ConfigError, match="not a time"):
        since_ns(text, NOW)


@pytest.mark.usefixtures("journal")
def test_after_the_end_of_time_there_is_nothing() -> None:
    assert "no matching entry is in" in audit("--since", "9999-01-01").output
    assert audit("--last", "9" * 25).exit_code == 2  # a mistake of the caller's, told by click
