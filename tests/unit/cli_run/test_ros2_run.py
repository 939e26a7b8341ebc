"""`pointit run --ros2`: what is said of where it is."""

from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from pointit.cli.run import run as run_command
from pointit.cli.run import run_options
from pointit.launch.plan.plan import Plan

SECURED = SimpleNamespace(link=SimpleNamespace(endpoints=("tls/hall:7450",)))


@pytest.fixture
def plans(monkeypatch: pytest.MonkeyPatch) -> list[Plan]:
    """Return the plans of runs, none of which begins."""
    plans: list[Plan] = []

    def execute(plan: Plan, _log_level: str) -> int:
        plans.append(plan)
        return 0

    monkeypatch.setattr(run_command, "execute", execute)
    return plans


@pytest.mark.parametrize(
    ("credentials", "arguments", "connect"),
    [
        (None, [], ()),
        (None, ["--connect", "tcp/hall:7450"], ("tcp/hall:7450",)),
        (SECURED, [], ("tls/hall:7450",)),
    ],
)
def test_where_a_run_listens_is_told_if_it_does(
    credentials: object,
    arguments: list[str],
    connect: tuple[str, ...],
    plans: list[Plan],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for module in (run_command, run_options):
        monkeypatch.setattr(module, "given_credentials", lambda: credentials)
    result = CliRunner().invoke(run_command.run, ["--ros2", "--no-web", *arguments])
    assert result.exception is None, result.output
    assert plans[0].link.connect == connect
    assert plans[0].link.listen == (() if connect else (run_options.BESIDE_ROS,))
    assert any(f"--connect {run_options.BESIDE_ROS}" in note for note in plans[0].notes) == (not connect)


@pytest.mark.parametrize(("arguments", "count"), [(["--users", "0"], 1), (["--site-only"], 1), ([], 0)])
def test_run_without_people_says_how_to_add_one(arguments: list[str], count: int, plans: list[Plan]) -> None:
    result = CliRunner().invoke(run_command.run, ["--no-web", *arguments])
    assert result.exception is None, result.output
    assert sum("pointit person add" in note for note in plans[0].notes) == count
