"""The audit of assistants: its file, its limit, and what `pointit audit --assistants` shows."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from pointit.assistants import audit_file
from pointit.assistants.audit_file import FILE, FOLDER, OLDER, AuditFile, read_audit
from pointit.cli.inspect.audit import command
from pointit.errors import ConfigError
from pointit.runtime.host.state_file import site_folder


def shown(*arguments: str) -> Result:
    return CliRunner().invoke(command, ["--assistants", *arguments], catch_exceptions=False)


@pytest.fixture(name="audit")
def _audit() -> AuditFile:
    return AuditFile(site_folder("lab", FOLDER))


def test_call_is_shown_with_its_caller_and_outcome(audit: AuditFile) -> None:
    call = audit.begin("robo 1.0", "viewer", "stop_robot", {"robot": "rover"})
    audit.end(call, "refused", "no\x1b[2J\nway")
    records = json.loads(shown("--json").output)["calls"]
    assert [each.get("outcome", "") for each in records] == ["", "refused"]
    assert records[0]["arguments"] == '{"robot": "rover"}'
    table = shown().output
    for word in ("robo 1.0", "viewer", "stop_robot", "rover", "refused", "no [2J way"):
        assert word in table
    assert "\x1b" not in table
    assert len(json.loads(shown("--json", "--last", "1").output)["calls"]) == 1


def test_audit_file_is_readable_only_by_its_owner(audit: AuditFile) -> None:
    audit.begin("", "viewer", "things", {})
    assert (site_folder("lab", FOLDER) / FILE).stat().st_mode & 0o077 == 0


def test_audit_file_is_bounded_and_keeps_an_older_part(
    audit: AuditFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(audit_file, "MAX_BYTES", 2000)
    for number in range(100):
        audit.begin("", "viewer", f"tool{number}", {})
    folder = site_folder("lab", FOLDER)
    assert sum((folder / name).stat().st_size for name in (FILE, OLDER)) < 2 * 2500
    assert [each["tool"] for each in read_audit("lab")][-1] == "tool99"


def test_damaged_lines_are_left_out(audit: AuditFile) -> None:
    audit.begin("", "viewer", "things", {})
    path: Path = site_folder("lab", FOLDER) / FILE
    path.write_bytes(b'\xff\xfe\n[]\n{"half": \n' + path.read_bytes())
    assert [each["tool"] for each in read_audit("lab")] == ["things"]


def test_audit_without_calls_says_so() -> None:
    with pytest.raises(ConfigError, match="no assistant has asked site lab"):
        shown()


def test_people_and_objects_are_no_filter_of_calls(audit: AuditFile) -> None:
    audit.begin("", "viewer", "things", {})
    with pytest.raises(ConfigError, match="--assistants excludes --user"):
        shown("--user", "anna")


def test_record_begins_a_line_when_the_previous_has_no_end(audit: AuditFile) -> None:
    """A crash cuts the last line off, and editors leave out the last line end."""
    first = audit.begin("", "viewer", "things", {})
    path = site_folder("lab", FOLDER) / FILE
    path.write_bytes(path.read_bytes().rstrip())
    audit.end(first, "done")
    with path.open("ab") as file:
        file.write(b'{"stamp_ns": 17')
    second = audit.begin("", "viewer", "lamps", {})
    assert [each["call"] for each in read_audit("lab")] == [first, first, second]
