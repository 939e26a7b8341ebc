"""View in a terminal with too few lines for all blocks."""

import pytest
from rich.segment import Segment

from pointit.cli.display.view import Block, Worth, drop_to_height
from pointit.launch.run.monitor import Monitor
from pointit.schemas import Interaction, UserPose
from tests.unit.cli_run.drawn import cursor, monitor_of, shown, strip


def block(text: str, worth: Worth, height: int = 1) -> Block:
    return Block([[Segment(text)]] * height, worth)


def texts(blocks: list[Block], room: int) -> str:
    return "".join(segment.text for line in drop_to_height(blocks, room) for segment in line)


@pytest.mark.parametrize(
    ("room", "left"), [(9, "abbcd"), (5, "abbcd"), (4, "abbd"), (3, "ad"), (2, "ad"), (1, "a"), (0, "a")]
)
def test_what_is_worth_least_goes_first_and_as_a_whole(room: int, left: str) -> None:
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
def test_a_view_is_no_higher_than_its_terminal_and_always_says_the_score(width: int, height: int) -> None:
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


def test_what_all_should_do_is_said_once() -> None:
    monitor = crowd(3)
    assert sum("Point." in line for line in shown(monitor)) == 1
    assert any("everybody: Point." in line for line in shown(monitor))
    monitor.interactions["user2"] = Interaction(stamp_ns=1, state="idle", next_step="Press the button.")
    assert sum("Point." in line for line in shown(monitor)) == 2
    assert any("user2: Press the button." in line for line in shown(monitor))
