"""The benchmark of one hop through a genuine rclpy node counts what it sends and what comes back."""

from pathlib import Path

import pytest

from pointit_lab.benchmarks import rclpy_relay


def test_a_hop_is_measured(rclpy_python: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rclpy_relay, "PYTHON", rclpy_python)
    cost = rclpy_relay.measure_cost(50.0, 1.0)
    assert cost["messages"] == 50
    assert 0 <= cost["lost"] < 50
    assert cost["us_per_message"] > 0.0
