"""The summary of a run, printed or written to a file, and the parts that optional rooms add."""

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
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
from pointit.runtime.host.state_file import replaced_file
from pointit.runtime.link.link import SILENT_S, find_outage
from pointit.runtime.service.plain_console import say
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
    if not os.access(summary if summary.exists() else summary.parent, os.W_OK):
        raise ConfigError(f"--summary {summary}: cannot be written (Permission denied)")


def _people(plan: Plan, monitor: Monitor) -> dict[str, dict[str, Any]]:
    """Return the found poses with their sigma and, of simulated people, the error."""
    launches = [launch for launch in plan.launches if launch.service.NAME == "user-sim"]
    simulated = {launch.user: launch.config.model_dump() for launch in launches}
    people: dict[str, dict[str, Any]] = {}
    for user, pose in sorted(monitor.found.items()):
        x_m, y_m, _ = pose.position_m
        off_m = off_deg = None
        if (config := simulated.get(user)) is not None:
            off_m = round(math.dist((x_m, y_m), config["position_m"][:2]), 3)
            if (yaw_deg := true_yaw_deg(config)) is not None:
                off_deg = round(abs(math.remainder(math.degrees(pose.yaw_rad) - yaw_deg, 360.0)), 2)
        people[user] = {
            "method": pose.method,
            "position_m": [round(x_m, 3), round(y_m, 3)],
            "position_sigma_m": round(floor_sigma.position_sigma_m(pose.covariance), 3),
            "yaw_sigma_deg": round(math.degrees(floor_sigma.yaw_sigma_rad(pose.covariance)), 2),
            "drift_degpmin": round(math.degrees(pose.yaw_rate_radps) * 60.0, 2),
            "position_error_m": off_m,
            "yaw_error_deg": off_deg,
        }
    return people


def _not_found(plan: Plan, monitor: Monitor) -> list[str]:
    sought = {
        launch.user
        for launch in plan.launches
        if launch.service.NAME == "localizer" and launch.config.model_dump()["method"] != "fixed"
    }
    return sorted(sought - monitor.found.keys())


def true_yaw_deg(simulated: Mapping[str, Any]) -> float | None:
    """Return the configured yaw of a simulated person's IMU, or None if it is random or drifts."""
    wristband = simulated["wristband"]
    drift_degpmin = wristband["yaw_drift_degpmin"]
    is_steady = wristband["yaw_rate_bias_sd_degps"] == 0.0 if drift_degpmin is None else drift_degpmin == 0.0
    yaw_deg: float | None = simulated["yaw_deg"]
    return yaw_deg if is_steady else None


def write_summary(plan: Plan, monitor: Monitor, duration_s: float, parts: Sequence[DisplayPart] = ()) -> None:
    """Print the summary of a run of `duration_s`, and write it to the file of the plan, if any."""
    if not (plan.scored or plan.summary is not None or plan.as_json):
        return
    summary: dict[str, Any] = {
        "scenario": plan.name,
        "site": plan.link.site,
        "seed": plan.seed,
        "duration_s": round(duration_s, 3),
        "speed": plan.speed,
        "target_kinds": list(plan.target_kinds),
        **monitor.score.counts(),
        "refused": monitor.score.refused,
        "last_refusal": monitor.score.refusal,
        "acts": {**monitor.acts, "failures": list(monitor.failures)} if monitor.acts else None,
        "dispatched": monitor.score.dispatched(),
        **{name: value for watcher in monitor.watchers for name, value in watcher.summary().items()},
        "latency_ms": monitor.latency.quantiles_ms(),
        "cursors": monitor.cursor_count,
        "frames": monitor.frame_count,
        "light_hz": {port: round(rate_hz, 2) for port, rate_hz in sorted(monitor.light_rates().items())},
        "lamps_missed_by_deg": {
            lamp: round(math.degrees(miss_rad), 2)
            for lamp, miss_rad in sorted(monitor.lamp_misses_rad.items())
        },
        "first_cursor_unix_s": monitor.first_cursor_unix_s,
        "first_frame_unix_s": monitor.first_frame_unix_s,
        "people": _people(plan, monitor),
        "not_found": _not_found(plan, monitor),
        "services": plan.instances,
    }
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


def summary_lines(summary: Mapping[str, Any], parts: Sequence[DisplayPart] = ()) -> list[str]:
    """Return the summary as lines of text, with those of `parts`."""
    latency = summary["latency_ms"]
    shown = (
        "not measured"
        if latency["p50"] is None
        else f"p50 {latency['p50']:.1f} ms, p99 {latency['p99']:.1f} ms"
    )
    speed = "" if summary["speed"] == 1.0 else f" at {summary['speed']:g} times the speed"
    services = f"{len(summary['services'])} services"
    lines = [f"{summary['scenario']} ran {summary['duration_s']:.0f} s{speed} with {services}."]
    if summary["target_kinds"]:
        total = summary["selected"] + summary["missed"] + summary["pending"]
        lines.append(
            f"Selected {summary['selected']} of {total} {'/'.join(summary['target_kinds'])} objects, "
            f"missed {summary['missed']}, still to do {summary['pending']}, "
            f"wrong {summary['wrong']} (corrected {summary['corrected']})."
        )
    if summary.get("refused"):
        times = "once" if summary["refused"] == 1 else f"{summary['refused']} times, at last"
        lines.append(f"Refused {times}: {summary['last_refusal'] or 'no reason given'}.")
    acts = summary.get("acts")
    if acts and (acts.get("failed") or acts.get("started") or not summary["target_kinds"]):
        words = {"failed": "failed", "started": "not ended"}
        others = "".join(f", {acts[name]} {word}" for name, word in words.items() if acts.get(name))
        lines.append(f"Acts: {acts.get('done', 0)} done{others}.")
        lines += [f"{each}." for each in dict.fromkeys(acts["failures"])]
    for bay, kinds in summary.get("dispatched", {}).items():
        came = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        lines.append(f"Bay {bay}: {came}.")
    for part in parts:
        lines += part.summary(summary)
    if met := summary.get("lamps_missed_by_deg"):
        lines.append(f"Nearest to lamps: {', '.join(f'{lamp} {deg:.1f}°' for lamp, deg in met.items())}.")
    for user, found in summary.get("people", {}).items():
        x_m, y_m = found["position_m"]
        off_m = found["position_error_m"]
        off_deg = found.get("yaw_error_deg")
        truly = "" if off_m is None else f", {off_m:.2f} m from the true place"
        truly += "" if off_deg is None else f", yaw {off_deg:.1f}° off"
        lines.append(
            f"{user} was found at {x_m:.2f}, {y_m:.2f} m ±{found['position_sigma_m']:.2f} m, "
            f"yaw ±{found['yaw_sigma_deg']:.1f}°{truly}."
        )
    if missing := summary.get("not_found"):
        were = "was" if len(missing) == 1 else "were"
        lines.append(f"{', '.join(missing)} {were} not found in that time; --duration gives more.")
    lines.append(
        f"Wrist to light: {shown}; {summary['cursors']} cursors on surfaces, {summary['frames']} frames."
    )
    for port, rate_hz in summary.get("light_hz", {}).items():
        lines.append(f"{port} carries {rate_hz:.1f} frames a second.")
    return lines


def figures(monitor: Monitor) -> Text:
    """Return latency, rates, selection counts and services with warnings, in one line."""
    parts: list[str] = []
    latency = monitor.latency.quantiles_ms()
    if latency["p50"] is not None:
        parts.append(f"wrist to light p50 {latency['p50']:.1f} ms, p99 {latency['p99']:.1f} ms")
    rates: dict[str, float] = {}
    for health in list(monitor.health.values()):
        for key in health.keys:
            if key.direction == "out" and key.rate_hz > 0:
                rates[key.key] = rates.get(key.key, 0.0) + key.rate_hz
    parts += [f"{name} {rates[row.key]:.0f} Hz" for name, row in SHOWN_RATES.items() if row.key in rates]
    lights = (figure for health in list(monitor.health.values()) for figure in health.figures)
    parts += [
        f"{figure.name.removeprefix(FRAME_RATE).strip()} up to {figure.value:.0f} Hz"
        for figure in lights
        if figure.name.startswith(FRAME_RATE)
    ]
    if monitor.score.target_kinds:
        counts: dict[str, Any] = monitor.score.counts()
        parts.append(f"selected {counts['selected']}, missed {counts['missed']}, wrong {counts['wrong']}")
    text = Text(" · ".join(parts))
    lost = monitor.lost(SILENT_S)
    ill = lost.union(name for name, health in list(monitor.health.items()) if health.warnings)
    if outage := find_outage({*monitor.health, *lost}, lost, monitor.lost_router):
        text.append(f"  {outage.sentence}; {outage.remedy}", style="red")
    elif ill:
        text.append(f"  look at: {', '.join(sorted(ill))} (pointit doctor)", style="yellow")
    return text
