"""People in the terminal view: activity, pose and its uncertainty, refusal reasons."""

import math

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from pointit.diagnosis.certainty import UNSURE_DEG, UNSURE_M, figure, position_sigma_m, yaw_sigma_deg
from pointit.launch.run.monitor import Monitor
from pointit.schemas import NS_PER_S, Localization, UserPose
from pointit.services.imu_bridge.page_wrist import LOW_BATTERY
from pointit.services.imu_bridge.wrist.monitor import BATTERY, GAPS, RATE, SIGNAL

WHITE = (255, 255, 255)
ROOMY_WIDTH = 72
"""Columns below which people's rows are shortened."""
AMPLE_WIDTH = 90
"""Columns below which the columns of poses are narrow."""
SCANT_WIDTH = 56
"""Columns below which only the position of a pose is shown."""

METHODS = {"fixed": "told", "static_targets": "lamps", "moving_target": "robot", "external": "tracker"}
"""Short name of each pose method."""

CANDIDATES = 3
"""Number of candidate robots that are named."""


def pose_lines(monitor: Monitor, width: int) -> RenderableType | None:
    """Return people's poses, or None if none is known."""
    if not any(user in monitor.poses for user in monitor.people()):
        return None
    columns = [("person", 6), ("stands at", 19)]
    if width >= SCANT_WIDTH:
        columns.append(("yaw", 13))
    if width >= ROOMY_WIDTH:
        columns += [("by", 5), ("drift", 9), ("anchor age", 10)]
    table = _table(width, AMPLE_WIDTH)
    for column, least in columns:
        table.add_column(column, no_wrap=True, min_width=least)
    for user in monitor.people():
        pose = monitor.poses.get(user)
        name = Text(user, style=color_of(monitor, user))
        cells = [Text("-")] * 5 if pose is None else _pose(pose, monitor.clock.now_ns())
        table.add_row(name, *cells[: len(columns) - 1])
    return table


def wrist_lines(monitor: Monitor) -> list[Text]:
    """Return the state of each device on a wrist, if it has a battery, a signal or gaps."""
    lines: list[Text] = []
    for user in monitor.people():
        health = monitor.health.get(f"imu-bridge.{user}")
        if health is None:
            continue
        charge, rate_hz, gaps, dbm = (figure(health, name) for name in (BATTERY, RATE, GAPS, SIGNAL))
        if charge is None and dbm is None and not gaps:
            continue
        parts = [
            Text(f"{rate_hz or 0.0:.0f} Hz"),
            Text(f"{gaps or 0.0:.0f} gaps/min", "yellow" if gaps else ""),
        ]
        if charge is not None:
            parts.insert(0, Text(f"battery {charge:.0f} %", "yellow" if charge < 100.0 * LOW_BATTERY else ""))
        if dbm is not None:
            parts.append(Text(f"signal {dbm:.0f} dBm"))
        lines.append(Text.assemble((f"{user}'s wrist: ", color_of(monitor, user)), Text(" · ").join(parts)))
    return lines


def instruction_lines(monitor: Monitor) -> list[Text]:
    """Return the next step of each person, as one line if it is the same for all."""
    words_of_user = {user: _words(monitor, user) for user in monitor.people()}
    if (
        len(words_of_user) > 1
        and len({tuple(line.plain for line in lines) for lines in words_of_user.values()}) == 1
    ):
        return [Text.assemble(("everybody: ", "bold"), line) for line in next(iter(words_of_user.values()))]
    return [
        Text.assemble((f"{user}: ", color_of(monitor, user)), line)
        for user, lines in words_of_user.items()
        for line in lines
    ]


def color_of(monitor: Monitor, user: str) -> str:
    """Return the style of a person's own colour; white is the terminal's text colour."""
    color = monitor.colors.get(user, WHITE)
    return "bold" if color == WHITE else f"bold rgb({color[0]},{color[1]},{color[2]})"


def _table(width: int, roomy_width: int) -> Table:
    return Table(box=None, padding=(0, 1 if width < roomy_width else 2, 0, 0), header_style="dim")


def activity_lines(monitor: Monitor, width: int) -> RenderableType:
    """Return the activity of each person, in columns of constant width."""
    narrow = width < ROOMY_WIDTH
    bar = 4 if narrow else 10
    table = _table(width, ROOMY_WIDTH)
    for column, least in (("person", 6), ("state", 10), ("cursor", 6 if narrow else 18), ("object", 6)):
        table.add_column(column, no_wrap=True, min_width=least)
    table.add_column("held", no_wrap=True, min_width=bar)
    for user in monitor.people():
        interaction = monitor.interactions.get(user)
        cursor = monitor.cursors.get(user)
        hover = monitor.hovers.get(user)
        where = "-"
        if cursor is not None and cursor.surface != "none":
            place = "" if narrow else f"{cursor.surface} {cursor.surface_id} at "
            where = f"{place}{cursor.position_m:.2f} m"
        elif cursor is not None and cursor.solid:
            where = cursor.solid if narrow else f"{cursor.solid} {cursor.surface_id}"
        kind, filled = "-", 0
        if hover is not None and hover.object_id:
            kind = monitor.score.kinds.get(hover.object_id) or "?"
            filled = round(bar * hover.progress)
        state = interaction.state if interaction is not None else "-"
        table.add_row(
            Text(user, style=color_of(monitor, user)), state, where, kind, "█" * filled + "░" * (bar - filled)
        )
    return table


def _pose(pose: UserPose, now_ns: int) -> list[Text]:
    sigma_m, sigma_deg = position_sigma_m(pose), yaw_sigma_deg(pose)
    place = Text(f"{pose.position_m[0]:.2f}, {pose.position_m[1]:.2f}")
    yaw = Text(f"{math.degrees(math.remainder(pose.yaw_rad, math.tau)):.1f}°")
    if sigma_m > 0.0:
        place.append(f" ±{sigma_m:.2f}", style="yellow" if sigma_m > UNSURE_M else "")
    if sigma_deg > 0.0:
        yaw.append(f" ±{sigma_deg:.1f}°", style="yellow" if sigma_deg > UNSURE_DEG else "")
    drift = "-"
    if pose.yaw_rate_sigma_radps is not None:
        drift = f"{math.degrees(pose.yaw_rate_radps) * 60:+.1f}°/min"
    anchor = "-" if pose.anchored_ns == 0 else _span(now_ns - pose.anchored_ns)
    return [place.append(" m"), yaw, Text(METHODS[pose.method]), Text(drift), Text(anchor)]


def _words(monitor: Monitor, user: str) -> list[Text]:
    lines: list[Text] = []
    refusal = monitor.refusal(user)
    interaction = monitor.interactions.get(user)
    if refusal:
        lines.append(Text(f"refused: {refusal}", style="bold red"))
    cursor = monitor.cursors.get(user)
    if cursor is not None and cursor.passed is not None and cursor.passed.text:
        lines.append(Text(cursor.passed.text, style="yellow"))
    elif interaction is not None:
        reason = interaction.reason if interaction.state == "idle" and interaction.reason != refusal else ""
        lines.append(Text(f"{reason} {interaction.next_step}".strip()))
    localization = monitor.localizations.get(user)
    if (
        localization is not None
        and localization.phase == "sampling"
        and (localization.samples or localization.target_id)
    ):  # not who waits
        lines.append(Text.assemble(*_progress(localization)))
    return lines


def _progress(localization: Localization) -> list[str | tuple[str, str]]:
    """Return the target, the samples so far and the current uncertainty."""
    parts: list[str] = []
    if localization.target_count > 1:
        parts.append(f"{localization.target_index + 1} of {localization.target_count}")
    parts.append(f"{localization.samples} samples")
    if localization.position_sigma_m is not None:
        parts.append(f"±{localization.position_sigma_m:.2f} m")
    if localization.yaw_sigma_rad is not None:
        parts.append(f"±{math.degrees(localization.yaw_sigma_rad):.1f}°")
    if len(localization.candidates) > 1:
        named = ", ".join(
            f"{candidate.object_id} {candidate.probability:.0%}"
            for candidate in localization.candidates[:CANDIDATES]
        )
        parts.append(f"meant: {named}")
    purpose = "setting the pose right, " if localization.purpose == "anchor" else ""
    target: tuple[str, str] = (
        f"● {localization.target_id} " if localization.target_id else "",
        "bold yellow",
    )
    return [purpose, target, " · ".join(parts)]


def _span(duration_ns: int) -> str:
    """Return a duration as people say it: `12 s`, `3 min`, `5 h`."""
    seconds = max(duration_ns, 0) / NS_PER_S
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 100 * 60 else f"{seconds / 3600:.0f} h"
