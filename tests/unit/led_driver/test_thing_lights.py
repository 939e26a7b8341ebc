"""Lights of things: single lamps and parts of strips that show who points at a thing and who selected it."""

import functools
import itertools
from typing import Any

import pytest

from pointit.schemas import (
    NS_PER_S,
    Environment,
    Hover,
    Lamp,
    Localization,
    SelectedObject,
    Selection,
    SetLamp,
    Thing,
    TrackedObjects,
    UserProfile,
)
from pointit.schemas import topics as at
from pointit.services.led_driver.config import LedDriverConfig, StyleConfig
from pointit.services.led_driver.lamps import DARK, TARGET
from pointit.services.led_driver.light_state import LightState
from pointit.services.pui.tracked_objects import listing
from tests.support import there
from tests.support.bench import ManualClock, memory_bench, until
from tests.unit.led_driver.driving import FAST, started
from tests.unit.led_driver.stage import BLACK, FORTH, GREEN, NOW_NS, Color, colors, item

MS = NS_PER_S // 1000
ANNA = (200, 100, 0)
BEN = (0, 0, 100)
DIM = (90, 90, 90)
BRIGHT = (200, 200, 200)


def thing(name: str, **more: Any) -> Thing:
    return Thing(id=name, center_m=(0, 0, 1), size_m=(0.2, 0.2, 0.2), **more)


ROOM = Environment(
    stamp_ns=1,
    name="room",
    strips=(FORTH,),
    lamps=(Lamp(id="lamp", position_m=(0, 0, 1)), Lamp(id="other", position_m=(1, 0, 1))),
    things=(
        thing("radio", lamp="lamp", mode="switch"),
        thing("screws", strip="forth", part_m=(0.2, 0.8)),
        thing("nuts", strip="forth", part_m=(0.8, 1.2), label="hex nuts"),
    ),
)


def lights() -> LightState:
    shining = LightState(LedDriverConfig(style=StyleConfig(margin_m=0.1, tail_s=0.0)))
    shining.on_map(ROOM)
    for user, color in (("anna", ANNA), ("ben", BEN)):
        shining.content.set_profile(user, UserProfile(stamp_ns=0, cursor_color=color))
    return shining


def hover(progress: float = 0.0, object_id: str = "radio", **more: Any) -> Hover:
    return Hover(stamp_ns=NOW_NS, object_id=object_id, progress=progress, **more)


def selection(*owned: tuple[str, str]) -> Selection:
    return Selection(
        stamp_ns=1, objects=tuple(SelectedObject(id=name, user=user, since_ns=1) for name, user in owned)
    )


def test_lamp_shows_set_colour_then_growing_hover_then_owner() -> None:
    shining = lights()
    shining.lamps.set_color("lamp", GREEN)
    assert shining.lamps.colors(NOW_NS)["lamp"] == GREEN
    assert shining.things.on_hover("anna", hover(), NOW_NS) == "lamps"
    assert shining.lamps.colors(NOW_NS) == {"lamp": (60, 30, 0), "other": DARK}
    assert shining.things.on_hover("ben", hover(0.5), NOW_NS) == "lamps"
    assert shining.lamps.colors(NOW_NS)["lamp"] == (0, 0, 65)  # ben is nearer to selecting it
    assert shining.things.on_hover("ben", hover(1.0, action="refuse"), NOW_NS) == "level"
    assert shining.lamps.colors(NOW_NS)["lamp"] == (60, 30, 0)

    chosen = selection(("radio", "ben"))
    pending = tuple(each.model_copy(update={"is_pending": True}) for each in chosen.objects)
    assert not shining.things.set_selection(chosen.model_copy(update={"objects": pending}))
    assert shining.things.set_selection(chosen)
    assert not shining.things.set_selection(selection(("radio", "ben"), ("a package", "anna")))
    assert shining.lamps.colors(NOW_NS)["lamp"] == BEN
    assert shining.lamps.colors(NOW_NS + 60 * NS_PER_S)["lamp"] == BEN  # a switch stays on
    assert shining.things.set_selection(selection())
    assert shining.lamps.colors(NOW_NS + 60 * NS_PER_S)["lamp"] == GREEN


def test_new_map_shows_what_was_selected_before_it_came() -> None:
    shining = lights()
    shining.on_map(ROOM.model_copy(update={"things": ()}))
    shining.things.set_selection(selection(("radio", "ben")))
    assert shining.lamps.colors(NOW_NS)["lamp"] == DARK
    shining.on_map(ROOM)
    assert shining.lamps.colors(NOW_NS)["lamp"] == BEN


def test_changes_of_level_below_a_twentieth_are_not_shown() -> None:
    shining = lights()
    assert shining.things.on_hover("anna", hover(object_id="screws"), NOW_NS) == "none"
    assert shining.things.on_hover("anna", hover(0.5), NOW_NS) == "lamps"
    for progress in (0.53, 0.56, 0.45):
        assert shining.things.on_hover("anna", hover(progress), NOW_NS) == "none"
    assert shining.lamps.colors(NOW_NS)["lamp"] == (130, 65, 0)
    assert shining.things.on_hover("anna", hover(0.58), NOW_NS) == "level"
    assert shining.lamps.colors(NOW_NS)["lamp"] == (141, 71, 0)
    assert shining.things.on_hover("anna", hover(object_id=""), NOW_NS) == "lamps"
    assert shining.lamps.colors(NOW_NS)["lamp"] == DARK


def test_hover_of_a_silent_person_ends_while_others_localize() -> None:
    shining = lights()
    shining.things.on_hover("anna", hover(), NOW_NS)
    assert shining.lamps.next_change_ns() == NOW_NS + 500 * MS
    news = Localization(stamp_ns=NOW_NS, phase="sampling", target_id="lamp", lamps=("lamp", "other"))
    shining.lamps.queue.on_localization("ben", news, NOW_NS)
    shining.things.set_selection(selection(("radio", "anna")))
    assert shining.lamps.colors(NOW_NS) == {"lamp": TARGET, "other": DARK}
    next_one = news.model_copy(update={"target_id": "other"})
    shining.lamps.queue.on_localization("ben", next_one, NOW_NS + MS)
    assert shining.lamps.colors(NOW_NS + MS) == {"lamp": DARK, "other": TARGET}
    shining.lamps.colors(NOW_NS + 500 * MS)
    assert shining.lamps.next_change_ns() == NOW_NS + 3001 * MS  # the queue's


def test_things_lamp_flashes_at_most_three_times_a_second() -> None:
    shining = lights()
    shown = [DARK]
    for step in range(50):
        shining.things.on_hover("anna", hover(1.0, "" if step % 2 else "radio"), NOW_NS + step * 20 * MS)
        shown.append(shining.lamps.colors(NOW_NS + step * 20 * MS)["lamp"])
    assert sum(one != other for one, other in itertools.pairwise(shown)) == 5


async def test_driver_updates_a_lamp_with_its_things_hover_and_selection() -> None:
    clock = ManualClock()
    told = list[Color]()

    def is_last(color: Color) -> bool:
        return told[-1:] == [color]

    async with memory_bench(clock) as bench:
        bench.bus.subscribe(
            at.LAMP_COLOR, lambda news, lamp: told.append(news.color) if lamp == "lamp" else None
        )
        await started(bench, FAST.model_copy(update={"cursor_timeout_s": 60.0}))  # no expiry helps
        bench.put(at.MAP, ROOM)
        bench.put(at.PROFILE, UserProfile(stamp_ns=1, cursor_color=ANNA), "anna")
        for message, color in (
            (hover(0.0), (60, 30, 0)),
            (hover(0.5), (130, 65, 0)),
            (hover(object_id=""), DARK),
            (hover(0.0), (60, 30, 0)),
        ):
            bench.put(at.HOVER, message, "anna")
            await until(functools.partial(is_last, color))

        bench.put(at.SELECTION, selection(("radio", "anna")))
        await until(lambda: told[-1] == ANNA)
        bench.put(at.PROFILE, UserProfile(stamp_ns=1, cursor_color=GREEN), "anna")
        await until(lambda: told[-1] == GREEN)


@pytest.mark.parametrize(
    ("progress", "owner", "screws"),
    [
        (None, "", [DIM] * 6),
        (0.0, "", [ANNA, *[DIM] * 4, ANNA]),
        (0.6, "", [ANNA, BRIGHT, DIM, DIM, BRIGHT, ANNA]),
        (None, "anna", [ANNA, *[BRIGHT] * 4, ANNA]),
    ],
    ids=["idle", "hovered", "half selected", "selected"],
)
def test_part_of_a_strip_shows_its_own_thing_only(
    progress: float | None, owner: str, screws: list[Color]
) -> None:
    shining = lights()
    shining.content.set_objects("things", listing(ROOM, NOW_NS), NOW_NS)
    shining.content.set_selection(selection(*([("screws", owner)] if owner else [])))
    if progress is not None:
        shining.content.set_hover("anna", hover(progress, "screws"), NOW_NS)
    frame = there(shining.frame(NOW_NS))
    assert colors(frame.strips[0].rgb) == [*[BLACK] * 2, *screws, *[DIM] * 4, *[BLACK] * 8]


def test_moving_object_is_drawn_above_the_light_of_a_thing() -> None:
    shining = lights()
    moving = TrackedObjects(stamp_ns=NOW_NS, objects=(item(0.5, 0.2, kind="red"),))
    shining.content.set_objects("conveyor", moving, NOW_NS)
    shining.content.set_objects("things", listing(ROOM, NOW_NS), NOW_NS)
    shown = colors(there(shining.frame(NOW_NS)).strips[0].rgb)
    assert [color == DIM for color in shown[2:8]] == [True, True, False, False, True, True]


async def test_colour_overridden_by_a_thing_is_reported_with_the_reason() -> None:
    async with memory_bench(clock=ManualClock(NOW_NS)) as bench:
        await started(bench, FAST.model_copy(update={"cursor_timeout_s": 60.0}))
        bench.put(at.MAP, ROOM)
        for user, color in (("anna", ANNA), ("ben", BEN)):
            bench.put(at.PROFILE, UserProfile(stamp_ns=1, cursor_color=color), user)
        bench.put(at.SELECTION, selection(("radio", "anna")))
        await bench.settle()

        async def reply(lamp: str, color: Color | None) -> str:
            return (await bench.bus.call(at.SET_LAMP, SetLamp(color=color), lamp)).message

        assert await reply("lamp", GREEN) == (
            "lamp lamp shows #c86400, as anna has selected radio; #006400 when that ends"
        )
        assert await reply("lamp", ANNA) == "lamp lamp shows #c86400"
        assert await reply("other", GREEN) == "lamp other shows #006400"
        bench.put(at.SELECTION, selection())
        bench.put(at.HOVER, hover(0.0), "anna")
        bench.put(at.HOVER, hover(0.0), "ben")
        await bench.settle()
        assert await reply("lamp", GREEN) == (
            "lamp lamp shows #3c1e00, as anna and ben point at radio; #006400 when that ends"
        )
