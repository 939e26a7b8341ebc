"""The view of a run, and its summary."""

import functools
import io
import re
import time
from typing import Any

import pytest
from rich.console import Console
from rich.segment import Segment

from pointit.cli.summary import figures, true_yaw_deg
from pointit.cli.view import (
    MAX_STRIPS,
    NAME_WIDTH,
    ConsoleView,
    TextBlock,
    Worth,
    drop_to_height,
    pixels_along,
)
from pointit.launch.run.monitor import LINES, Monitor
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.link.link import ROUTER_LOST, SILENT_S
from pointit.schemas import (
    Cursor,
    Environment,
    Figure,
    Health,
    Hover,
    Interaction,
    KeyHealth,
    LampColor,
    Localization,
    SelectionEvent,
    StripFrame,
    StripsFrame,
    TrackedObject,
    TrackedObjects,
    UserPose,
    topics,
)
from pointit.schemas.problems import ROUTER_LOST as LOST
from pointit.schemas.problems import Problem
from pointit.schemas.topics import LOCALIZATION, POSE
from pointit.services.user_sim.config import UserSimConfig
from tests.support import there
from tests.support.bench import until
from tests.unit.cli_run.drawn import BLUE, DARK, FRAME, RED, cursor, frame, monitor_of, shown, strip


def cells(monitor: Monitor, name: str = "0", width: int = 100) -> list[tuple[object, object]]:
    """Return the colours of a strip's cells: of the left pixel and of the right one."""
    console = Console(file=io.StringIO(), width=width, color_system="truecolor", force_terminal=True)
    for line in console.render_lines(ConsoleView(monitor, "", lambda: 0.0), console.options):
        if "".join(segment.text for segment in line)[FRAME:].startswith(f"{name:<{NAME_WIDTH}}"):
            return [_colours(segment) for segment in line for _ in segment.text if "▌" in segment.text]
    raise AssertionError("the strip is not shown")


def _colours(segment: Segment) -> tuple[object, object]:
    return there(there(segment.style).color).triplet, there(there(segment.style).bgcolor).triplet


def marks(monitor: Monitor, name: str = "0", width: int = 100) -> str:
    """Return the line below a strip, from its first cell on."""
    lines = shown(monitor, width)
    row = next(i for i, line in enumerate(lines) if line[FRAME:].startswith(f"{name:<{NAME_WIDTH}}"))
    return lines[row + 1][FRAME + NAME_WIDTH :]


@pytest.mark.parametrize("count", [1, MAX_STRIPS + 1])
async def test_names_of_strips_are_cut_with_a_mark_without_room(count: int) -> None:
    names = ("infeed_north_left", "infeed_north_right", *(f"s{n}" for n in range(count - 1)))
    monitor = monitor_of(*(strip(name) for name in names))
    wide = "\n".join(shown(monitor, 100))
    assert "infeed_north_left " in wide
    assert "infeed_north_right " in wide
    narrow = "\n".join(shown(monitor, 50))
    assert "infeed_north_left" not in narrow
    assert "infeed_nort… " in narrow


async def test_mark_shows_that_the_site_is_recorded(bus: MemoryBus) -> None:
    monitor = monitor_of()
    monitor.attach(bus)
    assert "recording" not in shown(monitor)[0]
    recorder = bus.announce(topics.SERVICE_ALIVE, "recorder")
    await until(lambda: "● recording" in shown(monitor)[0])
    recorder.close()
    await until(lambda: "recording" not in shown(monitor)[0])


@pytest.mark.parametrize(("direction", "lit", "pair"), [(1, 0, (RED, BLUE)), (-1, 19, (BLUE, RED))])
def test_cells_have_two_pixels_along_the_line_in_either_wiring(
    direction: int, lit: int, pair: tuple[object, object]
) -> None:
    monitor = monitor_of(strip(direction=direction))
    monitor.frame = frame([RED, BLUE] + [DARK] * 38)
    assert cells(monitor) == [pair if cell == lit else (DARK, DARK) for cell in range(20)]


def test_a_strip_longer_than_the_terminal_is_thinned_out() -> None:
    monitor = monitor_of(strip(pixels=150))
    monitor.frame = frame([RED] * 75 + [BLUE] * 75)
    drawn = cells(monitor, width=52)
    assert len(drawn) == 52 - NAME_WIDTH - 2 * FRAME
    assert drawn[: len(drawn) // 2] == [(RED, RED)] * (len(drawn) // 2)
    assert drawn[len(drawn) // 2 :] == [(BLUE, BLUE)] * (len(drawn) // 2)


def test_strip_with_a_missing_or_torn_frame_is_dark() -> None:
    assert pixels_along(None, strip(pixels=3)) == [DARK] * 3
    assert pixels_along(frame([RED], "other"), strip(pixels=3)) == [DARK] * 3
    torn = StripsFrame(stamp_ns=1, strips=(StripFrame(id="0", rgb=b"\xff\0\0\1"),))
    assert pixels_along(torn, strip(pixels=3)) == [RED]
    monitor = monitor_of(strip())
    monitor.frame = torn
    assert cells(monitor)


@pytest.mark.parametrize(("position_m", "cell"), [(0.0, 0), (1.0, 5), (3.99, 19), (4.0, 19)])
@pytest.mark.parametrize("direction", [1, -1])
def test_the_cursor_stands_below_its_place(position_m: float, cell: int, direction: int) -> None:
    monitor = monitor_of(strip(direction=direction), strip("1"))
    monitor.cursors["anna"] = cursor(position_m)
    assert marks(monitor).index("▲") == cell
    assert "▲" not in marks(monitor, "1")


def test_cursors_of_several_people_are_told_apart() -> None:
    monitor = monitor_of(strip())
    monitor.cursors |= {"user1": cursor(0.0), "user2": cursor(2.0), "user3": cursor(1.0, "0", "belt")}
    assert marks(monitor).split() == ["1", "2", "│"]


def test_before_there_is_a_map_it_says_so() -> None:
    text = "\n".join(shown(monitor_of(), left_s=12.4))
    assert "waiting for the map" in text
    assert "12 s left, Ctrl-C ends it" in text
    assert " s left" not in "\n".join(shown(monitor_of()))


PAGE = "http://127.0.0.1:8090/?token=" + "x" * 24


def test_the_address_of_the_page_stays_visible_in_any_terminal() -> None:
    assert any(f"page: {PAGE} " in line for line in shown(everything(), 80, page=PAGE))
    assert any("page: http://127.0.0.1" in line for line in shown(everything(), 80, height=8, page=PAGE))
    narrow = "".join(line.strip("│ ") for line in shown(everything(), 40, page=PAGE))
    assert PAGE in narrow
    assert "page:" not in "".join(shown(everything()))


def test_it_says_that_it_goes_on_for_an_open_page() -> None:
    sentence = "a page is open: goes on until Ctrl-C or it closes"
    assert sentence in shown(everything(), 80, is_looked_on=True)[-1]
    assert "a page is open, Ctrl-C ends it" in shown(everything(), 40, is_looked_on=True)[-1]
    assert "a page is open" not in "".join(shown(everything(), left_s=3.0))
    soon: dict[str, Any] = {"left_s": 12.0, "is_looked_on": True, "button_of": "user1"}
    sentence = "12 s left, a page is open: goes on after that, "
    assert f"{sentence}Ctrl-C ends it" in shown(everything(), 72, **soon)[-1]
    assert f"{sentence}Space is user1's button, Ctrl-C ends it" in shown(everything(), 100, **soon)[-1]
    assert "12 s left + page, Ctrl-C ends it" in shown(everything(), 40, **soon)[-1]


def everything() -> Monitor:
    monitor = monitor_of(strip(pixels=150), strip("1", 150, -1))
    monitor.lamps["led_0"] = LampColor(stamp_ns=1, color=(255, 255, 0))
    monitor.lamps["led_1"] = LampColor(stamp_ns=1, color=(0, 0, 0))
    monitor.score.kinds["x-1"] = "red"
    monitor.cursors["anna"] = cursor(1.5)
    monitor.hovers["anna"] = Hover(stamp_ns=1, object_id="x-1", progress=0.5)
    monitor.interactions["anna"] = Interaction(stamp_ns=1, state="pointing", next_step="Point.", reason="So.")
    monitor.interactions["ben"] = Interaction(stamp_ns=1, state="idle", next_step="Press.", reason="Silent.")
    monitor.events.append("red 1 selected by anna")
    return monitor


def test_people_are_shown_with_what_they_do_and_should_do() -> None:
    lines = shown(everything())
    anna, ben = (next(line for line in lines if line[FRAME:].startswith(name)) for name in ("anna ", "ben "))
    assert anna[FRAME:].split()[:6] == ["anna", "pointing", "strip", "0", "at", "1.50"]
    assert "red     █████░░░░░" in anna
    assert ben[FRAME:].split()[:3] == ["ben", "idle", "-"]
    assert any("anna: Point." in line for line in lines)
    assert any("ben: Silent. Press." in line for line in lines)
    assert any("● led_0  ○ led_1" in line for line in lines)
    assert any("red 1 selected by anna" in line for line in lines)


@pytest.mark.parametrize("width", [40, 60, 71, 72, 80, 200])
def test_it_fits_every_terminal(width: int) -> None:
    text = "\n".join(shown(everything(), width))
    for what in ("anna", "pointing", "1.50 m", "red", "█", "▲", "selected 0", "Press."):
        assert what in text


def test_it_stands_still_while_cursors_come_and_go() -> None:
    monitor = everything()
    with_cursor = shown(monitor, 80)
    monitor.cursors["anna"] = cursor(0.0, surface="none")
    monitor.hovers["anna"] = Hover(stamp_ns=1)
    without = shown(monitor, 80)
    header = next(line for line in with_cursor if "state" in line)
    assert header in without
    assert len(with_cursor) == len(without)


def health(instance: str, *warnings: str, rate_hz: float = 50.0, user: str = "") -> Health:
    keys = (
        KeyHealth(key=topics.CURSOR.key, direction="out", rate_hz=rate_hz),
        KeyHealth(key=topics.STRIPS_FRAME.key, direction="in", rate_hz=7.0),
    )
    return Health(
        stamp_ns=1, service=instance, instance=instance, user=user, pid=1, keys=keys, warnings=warnings
    )


async def test_it_follows_the_bus(monkeypatch: pytest.MonkeyPatch, bus: MemoryBus) -> None:
    monitor = monitor_of()
    monitor.attach(bus)
    token = bus.announce(topics.USER_ALIVE, "anna")
    service = bus.announce(topics.SERVICE_ALIVE, "pointing.anna")
    bus.publisher(topics.MAP).put(Environment(stamp_ns=1, name="test", strips=(strip(),)))
    thing = TrackedObject(id="x-1", kind="red", position_m=(0.0, 0.0, 0.0))
    bus.publisher(topics.OBJECTS, "conveyor").put(TrackedObjects(stamp_ns=1, objects=(thing,)))
    bus.publisher(topics.LAMP_COLOR, "led_0").put(LampColor(stamp_ns=1, color=(255, 255, 0)))
    stamp_ns = time.time_ns()
    bus.publisher(topics.CURSOR, "anna").put(
        Cursor(stamp_ns=stamp_ns, surface="strip", surface_id="0", position_m=1.0)
    )
    bus.publisher(topics.HOVER, "anna").put(Hover(stamp_ns=1, object_id="x-1", progress=1.0))
    bus.publisher(topics.HEALTH, "pui").put(health("pui"))

    bus.publisher(topics.HEALTH, "pointing.anna").put(health("pointing.anna", "ill", user="anna"))
    await until(lambda: monitor.cursor_count == 1 and len(monitor.health) == 2)
    bus.publisher(topics.STRIPS_FRAME).put(StripsFrame(stamp_ns=stamp_ns, strips=()))
    interactions = bus.publisher(topics.INTERACTION, "anna")
    interactions.put(Interaction(stamp_ns=1, state="idle", reason="Silent."))
    await until(lambda: monitor.frame_count == 1 and "anna" in monitor.interactions)

    interactions.put(Interaction(stamp_ns=2, state="idle", reason="Silent."))  # the same again is no event
    await until(lambda: monitor.interactions["anna"].stamp_ns == 2)
    interactions.put(Interaction(stamp_ns=3, state="pointing", reason="Asked."))
    events = bus.publisher(topics.SELECTION_EVENTS)
    events.put(SelectionEvent(stamp_ns=1, event="selected", object_id="x-1", user="anna"))
    events.put(SelectionEvent(stamp_ns=2, event="refused", object_id="x-1", user="ben", reason="anna's"))
    await until(lambda: len(monitor.events) == 4)
    assert set(monitor.events) == {
        "anna: idle. Silent.",
        "anna: pointing. Asked.",
        "red 1 selected by anna",
        "red 1 refused for ben: anna's",
    }
    assert monitor.first_cursor_unix_s is not None
    assert monitor.latency.count == 1

    text = "\n".join(shown(monitor, 200))
    for what in ("wrist to light p50", "cursor 100 Hz", "selected 1, missed 0, wrong 0", "● led_0", "▲"):
        assert what in text
    assert "frame 7 Hz" not in text  # that is what somebody read
    assert "look at: pointing.anna (pointit doctor)" in text

    service.close()
    token.close()  # anna leaves, and what she did last with her
    await until(lambda: "anna" not in monitor.cursors)

    text = "\n".join(shown(monitor, 200))
    assert "▲" not in text
    assert "look at" not in text

    now_s = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now_s + SILENT_S + 1)
    assert "look at: pui" in "\n".join(shown(monitor, 200))
    monkeypatch.undo()


async def test_rate_of_each_controller_is_shown_and_averaged(bus: MemoryBus) -> None:
    monitor = monitor_of()
    monitor.attach(bus)
    reports = bus.publisher(topics.HEALTH, "led-driver")
    for rate_hz in (8.0, 10.0):
        monitor.health.clear()
        rate = Figure(name="frame rate /dev/leds", value=rate_hz, unit="Hz")
        reports.put(health("led-driver").model_copy(update={"figures": (rate,)}))
        await until(lambda: "led-driver" in monitor.health)
    assert monitor.light_rates() == {"/dev/leds": 9.0}
    assert "/dev/leds up to 10 Hz" in "\n".join(shown(monitor, 200))


def test_only_the_newest_events_are_kept() -> None:
    monitor = monitor_of()
    for number in range(LINES + 3):
        monitor.events.append(f"event {number}")
    text = "\n".join(shown(monitor))
    assert "event 2" not in text
    assert f"event {LINES + 2}" in text


@pytest.mark.parametrize("width", [40, 80, 160])
def test_many_strips_stand_side_by_side_with_their_lengths(width: int) -> None:
    monitor = monitor_of(*(strip(f"s{number}") for number in range(MAX_STRIPS + 1)))
    monitor.frame = frame([RED] * 40, "s3")
    rows = [line for line in shown(monitor, width) if "▌" in line]
    assert len(rows) <= (MAX_STRIPS + 1 if width < 80 else 4 if width < 160 else 2)
    assert all(f"s{number} ▌" in " ".join(rows) for number in range(MAX_STRIPS + 1))
    counts = {len(run) for row in rows for run in re.findall("▌+", row)}
    assert len(counts) == 1  # all are 4 m long


def test_warnings_of_services_are_shown_with_their_names() -> None:
    monitor = monitor_of()
    for each in (health("pui"), health("conveyor-sim", "no belt 'x'", "two")):
        monitor.health[each.instance] = each
    assert monitor.warnings() == ["conveyor-sim: no belt 'x'", "conveyor-sim: two"]


def test_lost_router_is_one_sentence_instead_of_all_services() -> None:
    monitor = monitor_of()
    where = "tcp/10.0.0.1:7447"
    lost = Problem(code=LOST, sentence=ROUTER_LOST.format(where=where, ago_s=5), subject=where)
    for name in ("pui", "selector", "keeper", "pointing.anna"):
        report = health(name, lost.sentence).model_copy(update={"problems": (lost,)})
        monitor.site.take(topics.HEALTH, name, report, time.monotonic())
    text = figures(monitor).plain
    assert "the router at tcp/10.0.0.1:7447 does not answer: nothing arrives from other machines; " in text
    assert "look at" not in text


def block(text: str, worth: Worth, height: int = 1) -> TextBlock:
    return TextBlock([[Segment(text)]] * height, worth)


def texts(blocks: list[TextBlock], room: int) -> str:
    return "".join(segment.text for line in drop_to_height(blocks, room) for segment in line)


@pytest.mark.parametrize(
    ("room", "left"), [(9, "abbcd"), (5, "abbcd"), (4, "abbd"), (3, "ad"), (2, "ad"), (1, "a"), (0, "a")]
)
def test_part_of_lowest_priority_is_left_out_first_and_whole(room: int, left: str) -> None:
    blocks = [block("a", None), block("b", (1, 0), 2), block("c", (0, 5)), block("d", (2, -1))]
    assert texts(blocks, room) == left


def crowd(people: int, strips: int = 22, sentence: str = "Point.") -> Monitor:
    monitor = monitor_of(*(strip(f"{number}") for number in range(strips)))
    for number in range(1, people + 1):
        user = f"user{number}"
        monitor.cursors[user] = cursor(1.5)
        monitor.interactions[user] = Interaction(stamp_ns=1, state="pointing", next_step=sentence)
        monitor.poses[user] = UserPose(stamp_ns=1, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0, method="fixed")
    monitor.events.extend(f"red {number} selected by user1" for number in range(5))
    return monitor


@pytest.mark.parametrize(("width", "height"), [(80, 24), (80, 18), (60, 24), (120, 40)])
def test_view_fits_its_terminal_and_always_shows_the_score(width: int, height: int) -> None:
    lines = shown(crowd(4), width, height=height)
    assert len(lines) <= height
    assert "Ctrl-C ends it" in lines[-1]
    assert "missed 0" in " ".join(line.strip("│ ") for line in lines)
    assert all(any(line.startswith(f"│ user{number}") for line in lines) for number in (1, 2, 3, 4))


def test_the_newest_news_stays_longest() -> None:
    everything = len(shown(crowd(2)))
    lines = shown(crowd(2), height=everything - 2)
    assert len(lines) == everything - 2
    assert not any("red 0 selected" in line or "red 1 selected" in line for line in lines)
    assert any("red 2 selected" in line for line in lines)


def test_common_instruction_is_shown_once() -> None:
    monitor = crowd(3)
    assert sum("Point." in line for line in shown(monitor)) == 1
    assert any("everybody: Point." in line for line in shown(monitor))
    monitor.interactions["user2"] = Interaction(stamp_ns=1, state="idle", next_step="Press the button.")
    assert sum("Point." in line for line in shown(monitor)) == 2
    assert any("user2: Press the button." in line for line in shown(monitor))


S = 1_000_000_000


def pose(stamp_s: float, x_m: float, sigma_m: float, method: str = "static_targets") -> UserPose:
    variance = sigma_m**2
    return UserPose.model_validate(
        {
            "stamp_ns": round(stamp_s * S),
            "position_m": (x_m, 0.0, 0.0),
            "yaw_rad": 0.1,
            "covariance": (variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance),
            "method": method,
        }
    )


def solved(stamp_s: float, **more: object) -> Localization:
    return Localization.model_validate({"stamp_ns": round(stamp_s * S), "phase": "solved", **more})


def _has(monitor: Monitor, message: UserPose | Localization) -> bool:
    return message in (monitor.poses.get("anna"), monitor.localizations.get("anna"))


async def after(*told: UserPose | Localization) -> Monitor:
    """Return a monitor that was told this, in this order."""
    monitor = monitor_of()
    bus = MemoryBus(LocalBroker())
    monitor.attach(bus)
    poses = bus.publisher(POSE, "anna")
    news = bus.publisher(LOCALIZATION, "anna")
    for message in told:
        if isinstance(message, UserPose):
            poses.put(message)
        else:
            news.put(message)
        await until(functools.partial(_has, monitor, message))
    await bus.close()
    return monitor


@pytest.mark.parametrize("pose_first", [True, False])
async def test_found_pose_stays_as_localized_while_it_drifts(pose_first: bool) -> None:
    found = pose(9.9, 1.0, 0.2)
    end = solved(10.0)
    monitor = await after(*((found, end) if pose_first else (end, found)), pose(60.0, 1.0, 0.9))
    assert monitor.found["anna"] == pose(9.9, 1.0, 0.2)


async def test_second_localization_replaces_the_found_pose() -> None:
    monitor = await after(
        pose(9.9, 1.0, 0.2),
        solved(10.0),
        pose(60.0, 1.0, 0.9),
        Localization(stamp_ns=61 * S, phase="sampling"),
        pose(62.0, 1.0, 0.95),  # while they point
        pose(69.9, 3.0, 0.1),
        solved(70.0),
        pose(99.0, 3.0, 0.8),
    )
    assert monitor.found["anna"] == pose(69.9, 3.0, 0.1)

    monitor = await after(
        *(pose(9.9, 1.0, 0.2), solved(10.0), Localization(stamp_ns=61 * S, phase="sampling")),
        *(pose(62.0, 1.0, 0.95), solved(70.0), pose(69.9, 3.0, 0.1), pose(99.0, 3.0, 0.8)),
    )
    assert monitor.found["anna"] == pose(69.9, 3.0, 0.1)  # and not the one that was still there


async def test_anchors_and_given_poses_are_no_found_poses() -> None:
    monitor = await after(
        pose(9.9, 1.0, 0.2), solved(10.0), solved(20.0, purpose="anchor"), pose(20.0, 1.1, 0.3)
    )
    assert monitor.found["anna"] == pose(9.9, 1.0, 0.2)
    monitor = await after(pose(9.9, 1.0, 0.2), solved(10.0), pose(30.0, 2.0, 0.0, "fixed"))
    assert monitor.found == {}


def test_true_yaw_is_known_only_when_set_and_without_drift() -> None:
    def true(**fields: object) -> float | None:
        return true_yaw_deg(UserSimConfig.model_validate(fields).model_dump())

    steady = {"yaw_rate_bias_sd_degps": 0.0}
    assert true(yaw_deg=20.0, wristband=steady) == 20.0
    assert true(yaw_deg=20.0, wristband={"yaw_drift_degpmin": 0.0}) == 20.0
    assert true(yaw_deg=20.0) is None
    assert true(yaw_deg=20.0, wristband={**steady, "yaw_drift_degpmin": 3.0}) is None
    assert true(yaw_deg=None, wristband=steady) is None
