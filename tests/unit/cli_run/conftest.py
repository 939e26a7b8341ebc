"""Runs that are planned and not executed."""

import pytest

from pointit.launch.plan.plan import Plan


@pytest.fixture
def plans(monkeypatch: pytest.MonkeyPatch) -> list[Plan]:
    """Return the plans that `pointit run` makes in the test, in order."""
    plans: list[Plan] = []

    def execute(plan: Plan, _log_level: str) -> int:
        plans.append(plan)
        return 0

    monkeypatch.setattr("pointit.cli.run.run.execute", execute)
    return plans
