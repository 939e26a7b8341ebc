"""Shards of shared services, and who must hear whom beside them."""

import pytest

from pointit.diagnosis.diagnose import diagnose
from pointit.schemas import Deployment, ExpectedService
from pointit.schemas.topics import CURSOR, RAY
from tests.unit.diagnosis.test_diagnose import WELL, health, key, observation, only

ANNAS = health("pointing.anna", key(RAY, "out"))
BENS = health("pointing.ben", key(RAY, "out"))
"""People who point all the time."""


def test_a_default_instance_need_not_hear_people_whom_shards_serve() -> None:
    quiet, shard = health("pui", key(RAY, "in", 9.0)), health("pui.anna", key(RAY, "in"))
    assert not diagnose(observation(ANNAS, quiet, shard))
    assert only(observation(ANNAS, quiet)).code == "stale"


@pytest.mark.parametrize("shard", ["pui.anna", "pui.hall"])
def test_a_default_instance_must_hear_people_whom_no_shard_serves(shard: str) -> None:
    deaf, other = health("pui", key(RAY, "in", 9.0)), health(shard, key(RAY, "in"))
    shards = frozenset({"pui.anna", "selector.ben"})
    assert not diagnose(observation(ANNAS, deaf, other, shards=shards))
    finding = only(observation(ANNAS, BENS, deaf, other, shards=shards))
    assert (finding.code, finding.service) == ("stale", "pui")
    assert "pointing.ben" in finding.sentence
    assert "anna" not in finding.sentence


def test_a_default_selector_must_hear_the_cursors_of_people_whom_no_shard_serves() -> None:
    site = (
        health("pui", key(CURSOR, "out")),
        health("pui.anna", key(CURSOR, "out")),
        health("selector", key(CURSOR, "in", 9.0)),
        health("selector.hall", key(CURSOR, "in")),
    )
    finding = only(observation(*site, shards=frozenset({"pui.anna", "selector.anna"})))
    assert (finding.code, finding.service) == ("stale", "selector")
    assert not diagnose(observation(*site, shards=frozenset({"pui.anna", "selector.anna", "selector.ben"})))


def test_a_shard_called_after_a_person_must_hear_them() -> None:
    deaf, other = health("pui.anna", key(RAY, "in", 9.0)), health("pui.hall", key(RAY, "in", 9.0))
    assert only(observation(ANNAS, BENS, deaf)).service == "pui.anna"
    assert not diagnose(observation(BENS, deaf, other))  # presence does not tell whom the other serves


def test_a_missing_shard_is_named_with_its_command() -> None:
    gone = ExpectedService(service="pui", name="anna", command=("python", "-m", "x"))
    told = {"anna": Deployment(stamp_ns=0, name="anna", services=(gone,))}
    finding = only(observation(WELL[2], deployments=told))
    assert (finding.code, finding.service) == ("absent", "pui.anna")
    assert "pointit service run pui --name anna --people [...]" in finding.remedy
