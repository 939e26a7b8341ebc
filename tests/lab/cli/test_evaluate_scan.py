"""`pointit evaluate scan`: rows of scans of simulated rooms, and of people who point."""

import json

import pytest
from click.testing import CliRunner

from pointit_lab.cli.scan import scan


@pytest.mark.long
def test_scans_of_a_room_state_their_errors() -> None:
    result = CliRunner().invoke(
        scan, ["--rooms", "1", "--seed", "33", "--jobs", "1", "--json", "-"], catch_exceptions=False
    )
    assert result.exit_code == 0
    rows = json.loads(result.stdout)
    assert set(rows) == {"3", "4", "5", "6", "7", "8"}
    (last,) = rows["8"]
    assert last["identified"] > 0
    assert max(last["errors_m"]) < 0.05


def test_people_who_point_get_what_they_are_told() -> None:
    result = CliRunner().invoke(
        scan, ["--by-pointing", "--rooms", "4", "--json", "-"], catch_exceptions=False
    )
    rows = json.loads(result.stdout)["3"]
    assert len(rows) == 20
    assert sum(row["error_m"] < 3 * row["sigma_m"] for row in rows) >= 17
