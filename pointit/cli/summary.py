"""The summary of a run, printed or written to a file, and the parts that optional rooms add."""

import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import click
from rich.console import Console, RenderableType
from rich.text import Text

from pointit.geometry import floor_sigma
from pointit.launch.plan.plan import Plan
from pointit.launch.run.monitor import Monitor
from pointit.launch.run.running_scenario import RunningScenario
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.advised_commands import advised_commands
from pointit.runtime.host.state_file import replaced_file
from pointit.runtime.link.link import SILENT_S, find_outage
from pointit.runtime.service.plain_console import say
from pointit.schemas import Health
from pointit.schemas.topics import CURSOR, IMU, RAY, STRIPS_FRAME, Topic
from pointit.services.led_driver.outputs import FRAME_RATE

SHOWN_RATES: dict[str, Topic[Any]] = {"imu": IMU, "ray": RAY, "cursor": CURSOR, "frame": STRIPS_FRAME}
"""Topics whose rates are shown: the pipeline from wrist to light."""


@dataclass(frozen=True, kw_only=True)
class DisplayPart:
    """Display functions for the observations of a run."""

    rows: Callable[[Monitor, int], RenderableType | None] = lambda _monitor, _width: None
    """Returns its table at a terminal's width, or None if it has nothing to show."""
    lines: Callable[[Monitor], Sequence[Text]] = lambda _monitor: ()
    """Returns lines below the table, left out first in a low terminal."""
    summary: Callable[[Mapping[str, Any]], Sequence[str]] = lambda _summary: ()
    """Returns sentences on the summary of a run."""


LiveView: TypeAlias = Callable[
    [RunningScenario, Console, Callable[[], float | None], Callable[[], bool], Sequence[DisplayPart]],
    AbstractContextManager[None],
]
"""Draws a scenario in a terminal while the context is open. The two functions return the monotonic time when
the run ends by itself, if ever, and True if a page is open, for which it continues."""


def check_writable(summary: Path) -> None:
    """Check before a run that its summary can be written after it.

    Raises:
        ConfigError: If it cannot, with the reason.
    """
    if summary.is_dir():
        raise ConfigError(f"--summary {summary}: is a directory, give a file in it")
    if not summary.parent.is_dir():
        raise ConfigError(f"--summary {summary}: there is no directory {summary.parent}")
    written = summary if summary.exists() else summary.parent
    if not os.access(written, os.W_OK):
        raise ConfigError(f"--summary {summary}: cannot be written (permission denied)")


def _people(plan: Plan, monitor: Monitor) -> dict[str, dict[str, Any]]:
    """Return the found poses with their sigma and, of simulated people, the error."""
    simulated: dict[str, dict[str, Any]] = {}
    for launch in plan.launches:
        if launch.service.NAME == "user-sim":
            simulated[launch.user] = launch.config.model_dump()

    # Of simulated people the true pose is known, the yaw only if their IMU does not drift
    people: dict[str, dict[str, Any]] = {}
    for user, pose in sorted(monitor.found.items()):
        x_m, y_m, _ = pose.position_m
        position_error_m: float | None = None
        yaw_error_deg: float | None = None
        config = simulated.get(user)
        if config is not None:
            true_position_m = config["position_m"][:2]
            position_error_m = round(math.dist((x_m, y_m), true_position_m), 3)
            yaw_deg = true_yaw_deg(config)
            if yaw_deg is not None:
                difference_deg = math.remainder(math.degrees(pose.yaw_rad) - yaw_deg, 360.0)
                yaw_error_deg = round(abs(difference_deg), 2)
        position_sigma_m = floor_sigma.position_sigma_m(pose.covariance)
        yaw_sigma_rad = floor_sigma.yaw_sigma_rad(pose.covariance)
        people[user] = {
            "method": pose.method,
            "position_m": [round(x_m, 3), round(y_m, 3)],
            "position_sigma_m": round(position_sigma_m, 3),
            "yaw_sigma_deg": round(math.degrees(yaw_sigma_rad), 2),
            "drift_degpmin": round(math.degrees(pose.yaw_rate_radps) * 60.0, 2),
            "position_error_m": position_error_m,
            "yaw_error_deg": yaw_error_deg,
        }
    return people


def _not_found(plan: Plan, monitor: Monitor) -> list[str]:
    sought: set[str] = set()
    for launch in plan.launches:
        if launch.service.NAME != "localizer":
            continue
        if launch.config.model_dump()["method"] != "fixed":
            sought.add(launch.user)
    return sorted(sought - monitor.found.keys())


def true_yaw_deg(simulated: Mapping[str, Any]) -> float | None:
    """Return the configured yaw of a simulated person's IMU, or None if it is random or drifts."""
    wristband = simulated["wristband"]
    drift_degpmin = wristband["yaw_drift_degpmin"]
    if drift_degpmin is None:  # it is drawn from a distribution
        drift_degpmin = wristband["yaw_rate_bias_sd_degps"]
    yaw_deg: float | None = simulated["yaw_deg"]
    return yaw_deg if drift_degpmin == 0.0 else None


def write_summary(plan: Plan, monitor: Monitor, duration_s: float, parts: Sequence[DisplayPart] = ()) -> None:
    """Print the summary of a run of `duration_s`, and write it to the file of the plan, if any."""
    is_wanted = plan.scored or plan.as_json
    if not is_wanted and plan.summary is None:
        return
    summary = _summary(plan, monitor, duration_s)
    if plan.as_json:
        click.echo(json.dumps(summary, indent=2))
    else:
        for line in summary_lines(summary, parts):
            say(line)
        if plan.closing_note:
            click.echo(plan.closing_note)
    if plan.summary is not None:
        with replaced_file(plan.summary) as part:
            part.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")


def _summary(plan: Plan, monitor: Monitor, duration_s: float) -> dict[str, Any]:
    summary: dict[str, Any] = {
        "scenario": plan.name,
        "site": plan.link.site,
        "seed": plan.seed,
        "duration_s": round(duration_s, 3),
        "speed": plan.speed,
        "target_kinds": list(plan.target_kinds),
    }

    # What was selected, and what selections have caused
    score = monitor.score
    summary |= score.counts()
    summary["refused"] = score.refused
    summary["last_refusal"] = score.refusal
    summary["acts"] = None
    if monitor.acts:
        summary["acts"] = {**monitor.acts, "failures": list(monitor.failures)}
    summary["dispatched"] = score.dispatched()
    for watcher in monitor.watchers:
        summary |= watcher.summary()

    # What came on the way from the wrist to the light
    summary["latency_ms"] = monitor.latency.quantiles_ms()
    summary["cursors"] = monitor.cursor_count
    summary["frames"] = monitor.frame_count
    light_hz = sorted(monitor.light_rates().items())
    summary["light_hz"] = {port: round(rate_hz, 2) for port, rate_hz in light_hz}
    misses_rad = sorted(monitor.lamp_misses_rad.items())
    summary["lamps_missed_by_deg"] = {lamp: round(math.degrees(miss_rad), 2) for lamp, miss_rad in misses_rad}
    summary["first_cursor_unix_s"] = monitor.first_cursor_unix_s
    summary["first_frame_unix_s"] = monitor.first_frame_unix_s

    summary["people"] = _people(plan, monitor)
    summary["not_found"] = _not_found(plan, monitor)
    summary["services"] = plan.instances
    return summary


def summary_lines(summary: Mapping[str, Any], parts: Sequence[DisplayPart] = ()) -> list[str]:
    """Return the summary as lines of text, with those of `parts`."""
    speed = ""
    if summary["speed"] != 1.0:
        speed = f" at {summary['speed']:g} times the speed"
    duration = f"{summary['duration_s']:.0f} s{speed}"
    services = len(summary["services"])
    lines = [f"{summary['scenario']} ran {duration} with {services} services."]

    # Selections, and what they have caused
    if summary["target_kinds"]:
        selected = summary["selected"]
        missed = summary["missed"]
        pending = summary["pending"]
        kinds = "/".join(summary["target_kinds"])
        lines.append(
            f"Selected {selected} of {selected + missed + pending} {kinds} objects, "
            f"missed {missed}, still to do {pending}, "
            f"wrong {summary['wrong']} (corrected {summary['corrected']})."
        )
    refused = summary.get("refused")
    if refused:
        times = "once" if refused == 1 else f"{refused} times, at last"
        reason = summary["last_refusal"] or "no reason given"
        lines.append(f"Refused {times}: {reason}.")
    lines += _act_lines(summary)
    for bay, counts in summary.get("dispatched", {}).items():
        dispatched = [f"{count} {kind}" for kind, count in counts.items()]
        lines.append(f"Bay {bay}: {', '.join(dispatched)}.")
    for part in parts:
        lines += part.summary(summary)

    # People
    misses_deg = summary.get("lamps_missed_by_deg")
    if misses_deg:
        misses = [f"{lamp} {miss_deg:.1f}°" for lamp, miss_deg in misses_deg.items()]
        lines.append(f"Nearest to lamps: {', '.join(misses)}.")
    for user, pose in summary.get("people", {}).items():
        lines.append(_pose_line(user, pose))
    missing = summary.get("not_found")
    if missing:
        were = "was" if len(missing) == 1 else "were"
        lines.append(f"{', '.join(missing)} {were} not found in that time; --duration gives more.")

    # The way to the light
    latency = _latency_text(summary["latency_ms"]) or "not measured"
    lines.append(
        f"Wrist to light: {latency}; {summary['cursors']} cursors on surfaces, {summary['frames']} frames."
    )
    for port, rate_hz in summary.get("light_hz", {}).items():
        lines.append(f"{port} carries {rate_hz:.1f} frames a second.")
    return lines


def _latency_text(latency_ms: Mapping[str, float | None]) -> str:
    """Return the median and the 99th percentile of a latency, `""` if it was not measured."""
    p50_ms = latency_ms["p50"]
    if p50_ms is None:
        return ""
    return f"p50 {p50_ms:.1f} ms, p99 {latency_ms['p99']:.1f} ms"


def _rates(reports: Iterable[Health]) -> list[str]:
    """Return the rates of the pipeline, each summed over all who write."""
    rates_hz: dict[str, float] = {}
    for health in reports:
        for key in health.keys:
            if key.direction == "out" and key.rate_hz > 0:
                rates_hz[key.key] = rates_hz.get(key.key, 0.0) + key.rate_hz
    parts: list[str] = []
    for name, topic in SHOWN_RATES.items():
        if topic.key in rates_hz:
            parts.append(f"{name} {rates_hz[topic.key]:.0f} Hz")
    return parts


def _light_rates(reports: Iterable[Health]) -> list[str]:
    parts: list[str] = []
    for health in reports:
        for metric in health.figures:
            if metric.name.startswith(FRAME_RATE):
                port = metric.name.removeprefix(FRAME_RATE).strip()
                parts.append(f"{port} up to {metric.value:.0f} Hz")
    return parts


def _act_lines(summary: Mapping[str, Any]) -> list[str]:
    """Return sentences on the acts of things, if any failed or nothing else was to be selected."""
    acts = summary.get("acts")
    if not acts:
        return []
    has_problem = acts.get("failed") or acts.get("started")
    if not has_problem and summary["target_kinds"]:
        return []
    counts = f"{acts.get('done', 0)} done"
    for name, word in (("failed", "failed"), ("started", "not ended")):
        if acts.get(name):
            counts += f", {acts[name]} {word}"
    lines = [f"Acts: {counts}."]
    for failure in dict.fromkeys(acts["failures"]):
        lines.append(f"{failure}.")
    return lines


def _pose_line(user: str, pose: Mapping[str, Any]) -> str:
    x_m, y_m = pose["position_m"]
    sigma_m = pose["position_sigma_m"]
    sigma_deg = pose["yaw_sigma_deg"]
    position = f"{x_m:.2f}, {y_m:.2f} m ±{sigma_m:.2f} m"
    error = ""
    error_m = pose["position_error_m"]
    if error_m is not None:
        error += f", {error_m:.2f} m from the true place"
    error_deg = pose.get("yaw_error_deg")
    if error_deg is not None:
        error += f", yaw {error_deg:.1f}° off"
    return f"{user} was found at {position}, yaw ±{sigma_deg:.1f}°{error}."


def figures(monitor: Monitor) -> Text:
    """Return latency, rates, selection counts and services with warnings, in one line."""
    parts: list[str] = []
    latency = _latency_text(monitor.latency.quantiles_ms())
    if latency:
        parts.append(f"wrist to light {latency}")

    # A copy, since reports come in another thread than that which draws
    reports = dict(monitor.health)
    parts += _rates(reports.values())
    parts += _light_rates(reports.values())
    if monitor.score.target_kinds:
        counts: dict[str, Any] = monitor.score.counts()
        parts.append(f"selected {counts['selected']}, missed {counts['missed']}, wrong {counts['wrong']}")
    text = Text(" · ".join(parts))

    # A site that is out of reach explains all warnings
    lost = monitor.lost(SILENT_S)
    impaired = set(lost)
    for name, health in reports.items():
        if health.warnings:
            impaired.add(name)
    outage = find_outage({*monitor.health, *lost}, lost, monitor.lost_router, advised_commands())
    if outage is not None:
        text.append(f"  {outage.sentence}; {outage.remedy}", style="red")
    elif impaired:
        doctor = advised_commands().command("pointit doctor").strip("`")
        text.append(f"  look at: {', '.join(sorted(impaired))} ({doctor})", style="yellow")
    return text
