"""Poses of people in the view: position, uncertainty, age, and reason of a refusal."""

import math
from typing import Any

import pytest
from rich.console import Console
from rich.segment import Segment

from pointit.cli.inspect.pose_errors import TRUTH_DISPLAY
from pointit.cli.robots import ROBOTS_DISPLAY
from pointit.cli.view import ConsoleView
from pointit.diagnosis.symptoms import UNSURE_DEG, UNSURE_M
from pointit.launch.robots import RobotWatcher
from pointit.launch.run.monitor import Monitor
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.schemas import (
    NS_PER_S,
    Anchor,
    Candidate,
    Cursor,
    Feedback,
    Figure,
    Health,
    Interaction,
    Localization,
    Passed,
    RobotState,
    UserPose,
    topics,
)
from pointit.services.imu_bridge.device_wrist import BATTERY, GAPS, RATE, SIGNAL
from tests.support import there
from tests.support.bench import until
from tests.unit.cli_run.drawn import FRAME, cursor, monitor_of, shown, strip

REASON = "led_1 and led_2 are seen in nearly the same direction; point at a lamp elsewhere and start again"


def pose(sigma_m: float = 0.12, sigma_deg: float = 2.1, **fields: Any) -> UserPose:
    variance = sigma_m**2
    yaw = math.radians(sigma_deg) ** 2
    values: dict[str, Any] = {
        "stamp_ns": 1,
        "position_m": (2.03, -0.48, 0.0),
        "yaw_rad": math.radians(-123.4),
        # wide to one side, narrow across, turned by 45 degrees: 1 sigma is that along the wide side
        "covariance": (variance / 2, variance / 2, 0.0, variance / 2, variance / 2, 0.0, 0.0, 0.0, yaw),
        "method": "static_targets",
        "yaw_rate_radps": math.radians(12.3) / 60,
        "yaw_rate_sigma_radps": 0.001,
        "anchored_ns": 1,
    }
    return UserPose.model_validate({**values, **fields})


def news(phase: str, **fields: Any) -> Localization:
    return Localization.model_validate({"stamp_ns": 1, "phase": phase, **fields})


def localized() -> Monitor:
    monitor = monitor_of(strip())
    monitor.cursors["anna"] = cursor(1.5)
    monitor.interactions["anna"] = Interaction(stamp_ns=1, state="pointing", next_step="Point.")
    ago_ns = monitor.clock.now_ns() - 12 * NS_PER_S
    monitor.poses["anna"] = pose(anchored_ns=ago_ns)
    return monitor


def row(monitor: Monitor, name: str, width: int = 80) -> str:
    """Return the second line that begins with `name`: the one about their place."""
    return [line for line in shown(monitor, width) if line[FRAME:].startswith(f"{name} ")][1]


def styled(monitor: Monitor, text: str, width: int = 100) -> list[Segment]:
    console = Console(width=width, color_system="truecolor", force_terminal=True)
    lines = console.render_lines(ConsoleView(monitor, "", lambda: 0.0), console.options)
    return [segment for line in lines for segment in line if text in segment.text]


def test_battery_gaps_and_signal_of_a_wrist_are_shown() -> None:
    monitor = localized()
    told = (Figure(name=RATE, value=99.6, unit="Hz"), Figure(name=GAPS, value=0.0, unit="/min"))
    about: dict[str, Any] = {"service": "imu-bridge", "instance": "imu-bridge.anna", "user": "anna"}
    health = Health(**about, stamp_ns=1, pid=1, host="", uptime_s=1.0, figures=told)
    monitor.health["imu-bridge.anna"] = health
    assert not any("wrist:" in line for line in shown(monitor))
    more = (Figure(name=BATTERY, value=7.0, unit="%"), Figure(name=SIGNAL, value=-71.0, unit="dBm"))
    monitor.health["imu-bridge.anna"] = health.model_copy(update={"figures": told + more})
    line = next(line for line in shown(monitor) if "wrist:" in line)
    assert "anna's wrist: battery 7 % · 100 Hz · 0 gaps/min · signal -71 dBm" in line
    assert "yellow" in str(styled(monitor, "battery 7 %")[0].style)


def test_unknown_values_are_shown_as_unknown() -> None:
    monitor = localized()
    monitor.poses["anna"] = UserPose(stamp_ns=1, position_m=(2.0, 0.5, 0.0), yaw_rad=0.0)
    told = row(monitor, "anna")
    assert "±" not in told
    assert "2.00, 0.50 m" in told
    assert told.split()[-4:-1] == ["given", "-", "-"]
    monitor.interactions["ben"] = Interaction(stamp_ns=1, state="idle", next_step="Press.")
    assert row(monitor, "ben").split()[2:-1] == ["-"] * 5


@pytest.mark.parametrize(
    ("sigma_m", "sigma_deg", "yellow"),
    [
        (UNSURE_M, UNSURE_DEG, []),
        (3.7, 2.1, ["±3.70"]),
        (0.1, 39.0, ["±39.0°"]),
        (3.7, 39.0, ["±3.70", "±39.0°"]),
    ],
)
def test_an_uncertain_pose_is_yellow(sigma_m: float, sigma_deg: float, yellow: list[str]) -> None:
    monitor = localized()
    monitor.poses["anna"] = pose(sigma_m, sigma_deg)
    warned = [each.text.strip() for each in styled(monitor, "±") if "yellow" in str(each.style)]
    assert warned == yellow


def everything_at_once() -> Monitor:
    monitor = localized()
    monitor.interactions["ben"] = Interaction(stamp_ns=1, state="localizing", next_step="Point at led_2.")
    monitor.localizations["ben"] = news(
        "sampling",
        target_id="led_2",
        target_index=1,
        target_count=3,
        samples=85,
        position_sigma_m=0.31,
        yaw_sigma_rad=math.radians(4.2),
        candidates=(
            Candidate(object_id="robot_1", probability=0.72),
            Candidate(object_id="robot_2", probability=0.28),
        ),
    )
    monitor.interactions["eve"] = Interaction(stamp_ns=1, state="idle", next_step="Press.", reason=REASON)
    monitor.refusals["eve"] = REASON
    return monitor


def test_a_localization_in_progress_is_shown() -> None:
    text = "\n".join(shown(everything_at_once(), 100))
    assert "ben: ● led_2 2 of 3 · 85 samples · ±0.31 m · ±4.2° · meant: robot_1 72%, robot_2 28%" in text
    monitor = localized()
    monitor.localizations["anna"] = news("sampling", target_id="led_0", samples=3, purpose="anchor")
    text = "\n".join(shown(monitor, 100))
    assert "anna: setting the pose right, ● led_0 3 samples" in text
    monitor.localizations["anna"] = news("solved", target_id="led_0", samples=3, purpose="anchor")
    assert "3 samples" not in "\n".join(shown(monitor, 100))


def test_cue_of_pointing_past_replaces_the_next_step() -> None:
    monitor = monitor_of()
    monitor.interactions["anna"] = Interaction(stamp_ns=1, state="pointing", next_step="Point at things.")
    passed = Passed(point_m=(0.0, 0.0, 0.0), right_rad=0.0, up_rad=0.3, text="you point 15° below belt a")
    monitor.cursors["anna"] = Cursor(stamp_ns=1, passed=passed)
    text = "\n".join(shown(monitor, 120))
    assert "anna: you point 15° below belt a" in text
    assert "Point at things." not in text


def test_a_refusal_is_red_and_said_once() -> None:
    monitor = everything_at_once()
    text = " ".join("\n".join(shown(monitor, 200)).split())
    assert text.count(REASON) == 1
    assert f"eve: refused: {REASON}" in text
    (segment,) = styled(monitor, "refused: ", 200)
    assert there(there(segment.style).color).name == "red"


@pytest.mark.parametrize("width", [40, 55, 56, 71, 72, 80, 120])
def test_people_fit_every_terminal_and_nothing_that_matters_is_cut(width: int) -> None:
    monitor = everything_at_once()
    lines = shown(monitor, width)  # checks the width of each
    words = " ".join(" ".join(line[FRAME:-FRAME] for line in lines).split())
    for what in (f"eve: refused: {REASON}", "2.03, -0.48 ±0.12 m", "robot_2 28%"):
        assert what in words
    assert ("-123.4° ±2.1°" in words) == (width >= 56)
    assert ("lamps +12.3°/min 12 s" in words) == (width >= 72)


def test_the_widest_numbers_fit_80_columns() -> None:
    monitor = localized()
    ago_ns = monitor.clock.now_ns() - 99 * NS_PER_S
    monitor.poses["anna"] = pose(
        1.234, 12.3, position_m=(-12.345, -12.345, 0.0), yaw_rad=math.radians(-179.9),
        yaw_rate_radps=math.radians(-123.4) / 60, anchored_ns=ago_ns, method="external",
    )  # fmt: skip
    told = row(monitor, "anna")
    for what in ("-12.35, -12.35 ±1.23 m", "-179.9° ±12.3°", "tracker", "-123.4°/min", "99 s"):
        assert what in told
    assert "…" not in told


def followed(bus: MemoryBus) -> Monitor:
    monitor = monitor_of()
    monitor.attach(bus)
    return monitor


async def test_refusals_stay_until_the_next_attempt(bus: MemoryBus) -> None:
    monitor = followed(bus)
    token = bus.announce(topics.USER_ALIVE, "anna")
    localizations = bus.publisher(topics.LOCALIZATION, "anna")
    cues = bus.publisher(topics.FEEDBACK, "anna")
    interactions = bus.publisher(topics.INTERACTION, "anna")
    bus.publisher(topics.POSE, "anna").put(pose())

    localizations.put(news("refused", reason=REASON))
    await until(lambda: monitor.refusal("anna") == REASON and "anna" in monitor.poses)
    localizations.put(news("idle"))
    await until(lambda: monitor.localizations["anna"].phase == "idle")
    assert monitor.refusal("anna") == REASON

    localizations.put(news("sampling", target_id="led_1"))
    await until(lambda: not monitor.refusal("anna"))
    # what the supervisor refuses comes as a cue with the interaction
    interactions.put(Interaction(stamp_ns=1, state="idle", reason="There is no map."))
    cues.put(Feedback(stamp_ns=1, cue="refused", text="There is no map."))
    await until(lambda: monitor.refusal("anna") == "There is no map.")

    cues.put(Feedback(stamp_ns=2, cue="started", text="Point."))  # after an anchor's refusal it goes on
    interactions.put(Interaction(stamp_ns=2, state="idle", reason="There is no map.", next_step="Press."))
    await until(lambda: monitor.interactions["anna"].next_step == "Press.")
    assert monitor.refusal("anna") == "There is no map."

    interactions.put(Interaction(stamp_ns=3, state="localizing"))
    await until(lambda: not monitor.refusal("anna"))
    # what the selector refuses is news, not a person's state
    cues.put(Feedback(stamp_ns=3, cue="refused", text="it is ben's"))
    await until(lambda: "anna" in monitor.cues)
    assert not monitor.refusal("anna")

    localizations.put(news("refused", reason=REASON))
    await until(lambda: monitor.refusal("anna") == REASON)
    token.close()
    await until(lambda: "anna" not in monitor.poses)
    assert not monitor.refusal("anna")
    assert "anna" in monitor.found  # for the summary


async def test_anchors_are_news(bus: MemoryBus) -> None:
    monitor = followed(bus)
    anchors = bus.publisher(topics.ANCHOR, "anna")
    anchor = Anchor(
        stamp_ns=1, target_id="led_1", origin_m=(0.0, 0.0, 1.6), raw_direction=(1.0, 0.0, 0.0),
        direction=(1.0, 0.0, 0.0), azimuth_error_rad=math.radians(7.21),
    )  # fmt: skip
    anchors.put(anchor)
    anchors.put(anchor.model_copy(update={"accepted": False, "reason": "the arm wandered"}))
    await until(lambda: len(monitor.events) == 2)
    assert list(monitor.events) == [
        "anna: anchor at led_1, the yaw was off by +7.2°",
        "anna: anchor at led_1 rejected: the arm wandered",
    ]


async def test_a_monitor_of_one_person_has_no_events_of_others(bus: MemoryBus) -> None:
    monitor = followed(bus)
    of_ben = Monitor(monitor.score, monitor.clock, person="ben")
    of_ben.attach(bus)
    anchors = bus.publisher(topics.ANCHOR, "anna")
    anchors.put(Anchor(stamp_ns=1, target_id="led_1", accepted=False, origin_m=(0.0, 0.0, 1.6),
                       raw_direction=(1.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0)))  # fmt: skip
    for user in ("anna", "ben"):
        bus.publisher(topics.POSE, user).put(pose())
        bus.publisher(topics.CURSOR, user).put(cursor(1.0))
    await until(lambda: "ben" in of_ben.poses and monitor.people() == ["anna", "ben"])
    assert len(monitor.events) == 1
    assert not of_ben.events
    assert of_ben.people() == ["ben"]
    assert of_ben.found.keys() == {"ben"}


def test_a_person_without_a_pose_needs_no_table() -> None:
    monitor = monitor_of(strip())
    monitor.cursors["anna"] = Cursor(stamp_ns=1)
    assert "stands at" not in "\n".join(shown(monitor))


def test_pose_errors_are_shown_when_motion_capture_knows_the_truth() -> None:
    monitor = localized()
    (user,) = monitor.people()
    assert not any("error of the pose" in line for line in shown(monitor, parts=[TRUTH_DISPLAY]))
    position = Figure(name=f"position error of {user}", value=0.123, unit="m")
    for figures, text in (
        ((position,), "0.12 m"),
        ((position, Figure(name=f"yaw error of {user}", value=-3.44, unit="°")), "0.12 m, -3.4°"),
    ):
        monitor.health["mocap"] = Health(
            stamp_ns=1, service="mocap", instance="mocap", pid=1, figures=figures
        )
        lines = shown(monitor, parts=[TRUTH_DISPLAY])
        assert any(f"{user}: error of the pose {text}" in line for line in lines), lines


def robot(**fields: Any) -> RobotState:
    at = {"position_m": (1.0, 2.0, 0.84), "velocity_mps": (0.0, 0.0, 0.0), "yaw_rad": 0.0, "radius_m": 0.2}
    return RobotState.model_validate({"stamp_ns": 1, "kind": "quadrotor", "phase": "idle", **at, **fields})


def watched() -> tuple[Monitor, RobotWatcher]:
    monitor = monitor_of()
    robots = RobotWatcher()
    monitor.watchers = [robots]
    return monitor, robots


def take(robots: RobotWatcher, state: RobotState, name: str) -> None:
    robots.site.take(topics.ROBOT_STATE, name, state, 0.0)


def robots_view(monitor: Monitor, width: int = 100) -> list[str]:
    return shown(monitor, width, parts=[ROBOTS_DISPLAY])


def robot_rows(monitor: Monitor, width: int = 100) -> list[list[str]]:
    lines = [line.strip("│ ").split("  ") for line in robots_view(monitor, width)]
    cells = [[cell.strip() for cell in line if cell.strip()] for line in lines]
    return [line for line in cells if line and line[0] in ("cart", "quad")]


def test_robots_are_listed_with_who_steers_them_and_where_to() -> None:
    monitor, robots = watched()
    take(robots, robot(phase="taking_off", user="anna", target_m=(3.04, -1.0, 0.2), battery=0.5), "quad")
    take(robots, robot(kind="ground", phase="stopped", reason="ben is too near; step back"), "cart")
    assert robot_rows(monitor) == [
        ["cart", "-", "stopped", "-", "1.0, 2.0, 0.8 m", "-"],
        ["quad", "anna", "taking off", "3.0, -1.0 m", "1.0, 2.0, 0.8 m", "50%"],
    ]
    assert any("cart: ben is too near; step back" in line for line in robots_view(monitor))


@pytest.mark.parametrize("width", [44, 60])
def test_a_narrow_terminal_shows_the_first_columns(width: int) -> None:
    monitor, robots = watched()
    take(robots, robot(phase="moving", user="anna", target_m=(3.0, -1.0, 0.2)), "quad")
    (line,) = (line for line in robots_view(monitor, width) if "quad" in line)
    assert "anna" in line
    assert "moving" in line


def test_no_robot_takes_no_line() -> None:
    assert not any("steered by" in line for line in robots_view(watched()[0]))


def test_one_persons_view_has_their_robot_and_free_ones() -> None:
    monitor, robots = watched()
    monitor.person = "anna"
    take(robots, robot(user="ben"), "cart")
    take(robots, robot(), "quad")
    assert [line[0] for line in robot_rows(monitor)] == ["quad"]


def test_a_cursor_on_a_solid_names_it() -> None:
    monitor = monitor_of()
    monitor.cursors["anna"] = Cursor(stamp_ns=1, solid="plane", surface_id="floor", point_m=(0, 0, 0))
    assert any("plane floor" in line for line in shown(monitor))


async def test_changes_are_told_once_whatever_their_figures(bus: MemoryBus) -> None:
    robots = RobotWatcher()
    told = list[str]()
    robots.attach(bus, lambda line, _user: told.append(line))
    states: tuple[dict[str, str], ...] = (
        {},
        {"user": "anna"},
        {"reason": "ben is 0.91 m away", "reason_code": "person"},
        {"reason": "ben is 0.87 m away", "reason_code": "person"},
        {},
    )
    for fields in states:
        take(robots, robot(**fields), "quad")
    assert told == ["quad: anna steers it", "quad: nobody steers it", "quad: ben is 0.91 m away"]


async def test_a_robot_is_shown_as_long_as_its_service_runs() -> None:
    exchange = LocalBroker()
    bus = MemoryBus(exchange)
    other = MemoryBus(exchange)
    monitor, robots = watched()
    monitor.attach(bus)
    presence = other.announce(topics.SERVICE_ALIVE, "robot.quad")
    for name in ("quad", "cart"):
        other.publisher(topics.ROBOT_STATE, name).put(robot(user="anna"))

    await until(lambda: set(robots.states) == {"quad", "cart"})
    presence.close()
    await until(lambda: set(robots.states) == {"cart"})
    assert sorted(monitor.events) == ["cart: anna steers it", "quad: anna steers it"]

    monitor.detach()
    await bus.close()
    await other.close()
