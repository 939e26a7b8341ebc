"""Rights that need a word of their own; the tables tell the others."""

import pytest

from pointit.access.rights import ALL, ROLES, Role, rights_of
from pointit.schemas.topics import DEPLOYMENT, READ_HISTORY, SELECTION_EVENTS


def test_person_whose_name_begins_like_a_runs_tells_no_deployment() -> None:
    assert DEPLOYMENT.at("anna") in rights_of("user", "anna").writes
    assert not [key for key in rights_of("user", "run.scenario_4").writes if key.startswith("deployment/")]


@pytest.mark.parametrize("role", ROLES)
def test_who_reads_selection_events_may_ask_for_those_of_before(role: Role) -> None:
    rights = rights_of(role, "anna")
    reads, asks = ({ALL, row.at()} for row in (SELECTION_EVENTS, READ_HISTORY))
    assert reads & set(rights.reads)
    assert asks & set(rights.asks)
