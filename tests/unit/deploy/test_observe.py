"""The dashboard, the alert rules and the scrape configuration ask for metrics that there are."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from pointit.bridges.web.server.metrics_server import TEXT, exposition
from pointit.bridges.web.site_metrics import SiteMetrics
from pointit.cli.inspect.metrics import command
from tests.unit.deploy.stack import DEPLOY

FOLDER = DEPLOY / "observe"
RULES = FOLDER / "rules.yml"


def families() -> set[str]:
    """Return the names in a scrape, without suffixes."""
    content, _ = exposition(SiteMetrics("lab", "1"), TEXT)
    names = re.findall(r"^# TYPE (\w+)", content.decode(), re.MULTILINE)
    return {re.sub(r"_(total|info)$", "", name) for name in names}


def expressions() -> list[str]:
    board: dict[str, Any] = json.loads((FOLDER / "dashboard.json").read_text(encoding="utf-8"))
    rules: dict[str, Any] = yaml.safe_load(RULES.read_text(encoding="utf-8"))
    return [
        *(target["expr"] for panel in board["panels"] for target in panel["targets"]),
        *(rule["expr"] for group in rules["groups"] for rule in group["rules"]),
    ]


def test_queried_metrics_exist_and_all_but_two_are_shown() -> None:
    there = families()
    asked = {
        re.sub(r"_(total|bucket|count|sum)$", "", name)
        for expression in expressions()
        for name in re.findall(r"\bpointit_\w+", expression)
    }
    assert asked <= there
    assert there - asked == {"pointit_site", "pointit_service_warnings"}


def test_prometheus_reads_what_the_command_serves_by_default() -> None:
    config = yaml.safe_load((FOLDER / "prometheus.yml").read_text(encoding="utf-8"))
    (job,) = config["scrape_configs"]
    (listen,) = (each.default for each in command.params if each.name == "listen")
    assert job["static_configs"] == [{"targets": [listen]}]
    assert job["job_name"] == "pointit"  # which rules and dashboard select
    assert config["rule_files"] == [RULES.name]


def promtool(*arguments: str) -> None:
    """Run Prometheus' own checks, which must find no fault."""
    program = shutil.which("promtool")
    if program is None:
        pytest.skip("promtool of Prometheus is not installed")
    done = subprocess.run([program, *arguments], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr


def test_promtool_accepts_the_configuration_and_the_rules() -> None:
    promtool("check", "config", str(FOLDER / "prometheus.yml"))


ALERTS = {
    "PointItUnreachable": {'up{job="pointit"}': "0x60"},
    "PointItServiceMissing": {'pointit_service_present{service="pui"}': "0x60"},
    "PointItServiceLeft": {'pointit_service_present{service="pui"}': "1x20 stale", "pointit_people": "1x60"},
    "PointItServiceSilent": {'pointit_service_reported_timestamp_seconds{service="pui"}': "0x60"},
    "PointItServiceDegraded": {'pointit_service_healthy{service="pui"}': "0x60"},
    "PointItServiceFails": {'pointit_errors_total{service="pui"}': "0+1x60"},
    "PointItLightIsLate": {
        'pointit_latency_seconds_bucket{service="led-driver",le="0.05"}': "0+4x60",
        'pointit_latency_seconds_count{service="led-driver"}': "0+5x60",
    },
    "PointItMessagesLost": {'pointit_discarded_messages_total{service="pui",reason="lost"}': "0+1x60"},
    "PointItRouterRefuses": {'pointit_router_refusals_total{service="router"}': "0+1x60"},
    "PointItPoseUncertain": {'pointit_pose_yaw_sigma_radians{user="anna"}': "0.2x60"},
    "PointItBatteryLow": {'pointit_battery_ratio{user="anna"}': "0.1x60"},
}
"""Series, each 5 s, with which an alert fires after five minutes."""

WELL = {
    "pointit_people": "1x60",
    'pointit_service_present{service="pointing",name="anna"}': "1x20 stale",
    'up{job="pointit"}': "1x60",
    'pointit_service_present{service="pui"}': "1x60",
    'pointit_service_reported_timestamp_seconds{service="pui"}': "0+5x60",
    'pointit_service_healthy{service="pui"}': "1x60",
    'pointit_errors_total{service="pui"}': "3x60",
    'pointit_latency_seconds_bucket{service="led-driver",le="0.05"}': "0+5x60",
    'pointit_latency_seconds_count{service="led-driver"}': "0+5x60",
    'pointit_discarded_messages_total{service="pui",reason="lost"}': "3x60",
    'pointit_discarded_messages_total{service="pui",reason="dropped"}': "0+1x60",
    'pointit_router_refusals_total{service="router"}': "3x60",
    'pointit_pose_yaw_sigma_radians{user="anna"}': "0.02x60",
    'pointit_battery_ratio{user="anna"}': "0.8x60",
}


def test_promtool_fires_each_alert_on_its_fault_only(tmp_path: Path) -> None:
    assert set(ALERTS) == set(re.findall(r"alert: (\w+)", RULES.read_text(encoding="utf-8")))

    def case(series: dict[str, str], fires: str) -> dict[str, Any]:
        return {
            "interval": "5s",
            "input_series": [{"series": name, "values": values} for name, values in series.items()],
            "promql_expr_test": [
                {
                    "expr": 'count by (alertname) (ALERTS{alertstate="firing"})',
                    "eval_time": "5m",
                    "exp_samples": [{"labels": f'{{alertname="{fires}"}}', "value": 1}] if fires else [],
                }
            ],
        }

    cases = [case(WELL, ""), *(case(series, name) for name, series in ALERTS.items())]
    tests = {"rule_files": [str(RULES)], "evaluation_interval": "5s", "tests": cases}
    path = tmp_path / "tests.yml"
    path.write_text(json.dumps(tests), encoding="utf-8")
    promtool("test", "rules", str(path))
