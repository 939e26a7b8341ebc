"""Findings about shards of a service, and about its default instance beside them."""

from pointit.diagnosis.diagnose import diagnose
from pointit.schemas import Deployment, ExpectedService
from pointit.schemas.topics import RAY
from tests.unit.diagnosis.test_diagnose import WELL, health, key, observation, only

ANNAS = health("pointing.anna", key(RAY, "out"))
BENS = health("pointing.ben", key(RAY, "out"))
"""People who point all the time."""


def test_a_default_instance_need_not_hear_people_whom_shards_serve() -> None:
    quiet, shard = health("pui", key(RAY, "in", 9.0)), health("pui.anna", key(RAY, "in"))
    assert not diagnose(observation(ANNAS, quiet, shard))
    assert only(observation(ANNAS, quiet)).code == "stale"


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
