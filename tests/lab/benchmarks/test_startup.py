"""Benchmark of starts: what is counted, and in which environment."""

import pytest

from pointit_lab.benchmarks import startup


def test_startup_time_is_the_median_after_a_discarded_first_run(monkeypatch: pytest.MonkeyPatch) -> None:
    lights_s = iter([9.0, 0.5, 0.7, 0.6])

    def run(_scenario: str) -> dict[str, float]:
        return {"command_to_first_light_s": next(lights_s)}

    monkeypatch.setattr(startup, "_run", run)
    assert startup.start("a") == {"scenario": "a", "command_to_first_light_s": 0.6}


def test_starts_are_measured_with_bytecode() -> None:
    assert "PYTHONDONTWRITEBYTECODE" not in startup.ENVIRONMENT
    assert startup.ENVIRONMENT.keys() >= {"PATH"}
