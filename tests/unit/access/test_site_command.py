"""`pointit site` as it is typed."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from pointit.cli.main import command
from pointit.runtime.errors import ConfigError
from pointit.schemas import KeyNameError


def site(*arguments: str) -> Result:
    return CliRunner().invoke(command, ["site", *arguments])


def refused(*arguments: str) -> str:
    result = site(*arguments)
    assert isinstance(result.exception, ConfigError | KeyNameError), result.output
    return str(result.exception)


@pytest.fixture
def folder(tmp_path: Path) -> str:
    path = str(tmp_path / "lab")
    result = site("init", "lab", "--folder", path, "--users", "anna, ben", "--guests", "2", "--days", "90")
    assert result.exit_code == 0, result.output
    assert "keep" in result.output
    return path


def names_of(folder: str) -> set[str]:
    return {
        row["name"] for row in json.loads(site("show", "--folder", folder, "--json").output)["identities"]
    }


def test_a_site_has_everybody_who_was_named(folder: str) -> None:
    standing = {"router", "services", "web", "ros2", "operator", "supervisor", "dashboard1"}
    assert names_of(folder) == {*standing, "anna", "ben", "guest1", "guest2"}
    people = json.loads(site("user", "list", "--folder", folder, "--json").output)["identities"]
    assert [row["name"] for row in people] == ["anna", "ben", "guest1", "guest2"]


def test_people_are_added_and_removed(folder: str) -> None:
    result = site("user", "add", "carla", "--folder", folder)
    assert "identities/carla" in result.output
    assert (Path(folder) / "identities/carla/key.pem").exists()
    site("user", "remove", "carla", "--folder", folder)
    assert "carla" not in names_of(folder)
    assert "services is a reserved name of the site" in refused("user", "add", "services", "--folder", folder)
    assert "is not a person" in refused("user", "remove", "web", "--folder", folder)
    assert "'run.bob': names that begin with 'run.'" in refused("user", "add", "run.bob", "--folder", folder)
    assert refused("user", "add", "carla", "carla", "--folder", folder).startswith("carla is named twice")
    assert "carla" not in names_of(folder)


@pytest.mark.parametrize(
    ("users", "sentence"),
    [
        ("a,b,a", "a is named twice; name each person once"),
        ("guest2", "guest2 is named twice"),
        ("web", "web is a reserved name of the site"),
        ("dashboard7", "dashboard7 is a reserved name of the site"),
        ("a,run.bob", "user 'run.bob': names that begin with 'run.' are those of runs; choose another"),
    ],
)
def test_names_that_cannot_be_given_are_told_apart(users: str, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "lab"
    said = refused("init", "lab", "--folder", str(path), "--users", users)
    assert said.startswith(sentence)
    assert not path.exists()


def test_a_number_of_people_are_numbered(tmp_path: Path) -> None:
    site(
        "init", "lab", "--folder", str(tmp_path / "lab"), "--users", "3", "--guests", "0", "--dashboards", "0"
    )
    assert {"user1", "user2", "user3"} < names_of(str(tmp_path / "lab"))
    assert "guest1" not in names_of(str(tmp_path / "lab"))


def test_what_ends_soon_is_warned_of(tmp_path: Path) -> None:
    path = str(tmp_path / "lab")
    site("init", "lab", "--folder", path, "--days", "20", "--guests", "0")
    result = site("show", "--folder", path)
    assert result.exit_code == 1
    assert "ends soon" in result.output
    assert "renew with `pointit site renew`" in result.output
    assert "router has a new certificate" in site("renew", "--folder", path).output


def test_passwords_which_do_not_end_are_kept_when_certificates_are_renewed(tmp_path: Path) -> None:
    path = str(tmp_path / "lab")
    site("init", "lab", "--folder", path, "--days", "20", "--guests", "0", "--users", "anna", "--password")
    users = tmp_path / "lab" / "router" / "users.txt"
    before = users.read_text()
    said = site("renew", "--folder", path).output
    assert said.startswith("router has a new certificate")
    assert said.count("\n") == 1
    assert users.read_text() == before
    assert "anna has a new password: copy" in site("renew", "anna", "--folder", path).output
    assert users.read_text() != before


def test_all_is_well_is_exit_code_0_and_revoked_is_shown(folder: str) -> None:
    assert site("show", "--folder", folder).exit_code == 0
    assert "valid for 30 days or more" in site("renew", "--folder", folder).output
    said = site("revoke", "anna", "--folder", folder).output
    assert said == f"anna has no rights any more; `pointit site renew anna --folder {folder}` restores them\n"
    rows = json.loads(site("show", "--folder", folder, "--json").output)["identities"]
    assert [row["state"] for row in rows if row["name"] == "anna"] == ["revoked"]


@pytest.mark.parametrize("options", [[], ["--password"]], ids=["keys", "passwords"])
def test_no_secret_is_printed(tmp_path: Path, options: list[str]) -> None:
    path = tmp_path / "lab"

    def secrets() -> list[str]:
        keys = [file.read_text().splitlines()[1] for file in path.glob("identities/*/key.pem")]
        users = path / "router" / "users.txt"
        lines = users.read_text().splitlines() if options else []
        return [*keys, *(line.rpartition(":")[2] for line in lines)]

    said = site("init", "lab", "--folder", str(path), "--users", "anna,ben", *options).output
    for arguments in (["show"], ["show", "--json"], ["user", "list"], ["renew", "anna"], ["revoke", "ben"]):
        before = secrets()
        said += site(*arguments, "--folder", str(path)).output
        assert before
        assert not any(secret in said for secret in (*before, *secrets()))
