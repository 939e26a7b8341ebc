"""Commands to lamps: the newest colour only, at rates that bulbs take, and dark ones first."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas.base import Rgb
from pointit.services.led_driver.output.mqtt.lamp_commands import DARK, LampCommands

RED: Rgb = (255, 0, 0)
GREEN: Rgb = (0, 255, 0)
LAMPS = ("a", "b", "c")


def commands(lamp_rate_hz: float = 5.0, max_rate_hz: float = 1000.0) -> LampCommands:
    made = LampCommands(lamp_rate_hz, max_rate_hz)
    made.set_lamps(LAMPS)
    return made


def drain(sender: LampCommands, now_s: float, until_s: float) -> list[tuple[float, str, Rgb]]:
    """Take all commands that are due until `until_s`, as a sender that waits as told."""
    taken: list[tuple[float, str, Rgb]] = []
    while True:
        while (command := sender.take(now_s)) is not None:
            taken.append((now_s, *command))
        wait_s = sender.wait_s(now_s)
        if wait_s is None or now_s + wait_s > until_s:
            return taken
        now_s += max(wait_s, 1e-6)  # a timer is never early


def test_a_lamp_gets_its_newest_colour_once() -> None:
    sender = commands()
    assert sender.wait_s(0.0) is None
    for color in (GREEN, DARK, RED):
        sender.show("a", color)
    assert drain(sender, 0.0, 10.0) == [(0.0, "a", RED)]
    sender.show("a", RED)
    assert sender.wait_s(10.0) is None


def test_a_lamp_gets_no_more_commands_than_it_takes() -> None:
    sender = commands(lamp_rate_hz=5.0)
    times: list[float] = []
    for step in range(200):  # 2 s
        sender.show("a", (step, 0, 0))
        times += [now_s for now_s, _, _ in drain(sender, step / 100, step / 100)]
    assert 9 <= len(times) <= 10
    assert all(after - before >= 0.2 - 1e-9 for before, after in itertools.pairwise(times))
    assert [color for _, _, color in drain(sender, 2.0, 3.0)] == [(199, 0, 0)]


def test_all_lamps_share_a_rate_and_none_waits_for_another() -> None:
    sender = commands(lamp_rate_hz=5.0, max_rate_hz=10.0)
    got: dict[str, int] = dict.fromkeys(LAMPS, 0)
    for step in range(300):
        for lamp_id in LAMPS:
            sender.show(lamp_id, (step % 256, 1, 0))
        for _, lamp_id, _ in drain(sender, step / 100, step / 100):
            got[lamp_id] += 1
    assert 28 <= sum(got.values()) <= 31
    assert max(got.values()) - min(got.values()) <= 1


def test_lamps_that_go_off_come_first() -> None:
    sender = commands()
    sender.show("b", RED)
    assert drain(sender, 0.0, 0.0)
    sender.show("a", GREEN)
    sender.show("b", DARK)
    assert [lamp for _, lamp, _ in drain(sender, 1.0, 1.1)] == ["b", "a"]
    assert list(sender.lit) == ["a"]


def test_an_offline_lamp_gets_nothing_until_it_is_back_and_then_its_colour() -> None:
    sender = commands()
    sender.show("a", RED)
    assert drain(sender, 0.0, 0.0)
    sender.set_offline(["a"])
    sender.show("a", GREEN)
    sender.show("b", RED)
    assert [lamp for _, lamp, _ in drain(sender, 1.0, 2.0)] == ["b"]
    sender.show("a", RED)  # as before; the bulb may have lost it
    sender.set_offline([])
    assert drain(sender, 3.0, 3.0) == [(3.0, "a", RED)]


def test_a_lit_lamp_that_leaves_the_map_goes_off() -> None:
    sender = commands()
    sender.show("a", RED)
    sender.show("b", DARK)
    assert len(drain(sender, 0.0, 1.0)) == 2
    sender.set_lamps(["c"])
    assert drain(sender, 1.0, 2.0) == [(1.0, "a", DARK)]
    sender.show("a", RED)
    assert sender.wait_s(2.0) is None


def test_after_a_new_connection_all_colours_are_sent_again() -> None:
    sender = commands()
    sender.show("a", RED)
    sender.show("b", DARK)
    assert len(drain(sender, 0.0, 1.0)) == 2
    sender.resend()
    assert {lamp for _, lamp, _ in drain(sender, 1.0, 2.0)} == {"a", "b"}


SHOW = st.tuples(st.sampled_from((*LAMPS, "gone")), st.tuples(*[st.sampled_from((0, 9, 255))] * 3))


@given(st.lists(st.tuples(st.floats(0.0, 0.5), SHOW), max_size=60))
def test_whatever_is_shown_each_lamp_ends_with_its_newest_colour_within_the_rates(
    shows: list[tuple[float, tuple[str, Rgb]]],
) -> None:
    sender = commands(lamp_rate_hz=5.0, max_rate_hz=20.0)
    now_s = 0.0
    wanted: dict[str, Rgb] = {}
    sent: list[tuple[float, str, Rgb]] = []
    for wait_s, (lamp_id, color) in shows:
        now_s += wait_s
        sender.show(lamp_id, color)
        if lamp_id in LAMPS:
            wanted[lamp_id] = color
        sent += drain(sender, now_s, now_s)
    sent += drain(sender, now_s, now_s + 100.0)
    assert {lamp_id: color for _, lamp_id, color in sent} == wanted
    times = [at_s for at_s, _, _ in sent]
    assert all(after - before >= 0.05 - 1e-9 for before, after in itertools.pairwise(times))
    for lamp_id in LAMPS:
        own = [at_s for at_s, lamp, _ in sent if lamp == lamp_id]
        assert all(after - before >= 0.2 - 1e-9 for before, after in itertools.pairwise(own))
    assert set(sender.lit) == {lamp_id for lamp_id, color in wanted.items() if color != DARK}
