"""Perception of rendered frames: the own cursor anywhere, and states of things."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry.polyline import Polyline
from pointit.schemas import (
    Belt,
    Cursor,
    Environment,
    Hover,
    SelectedObject,
    Selection,
    Strip,
    StripFrame,
    StripsFrame,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.light_state import LightState
from pointit.services.user_sim.eyes import Eyes, Kind, ObservedAppearance, SeenCursor, Span
from tests.support import there

PITCH_M = 5.0 / 150
GREEN = (0, 158, 115)
WHITE = (255, 255, 255)
STRIPS = Environment(
    stamp_ns=0,
    name="strips",
    strips=(
        Strip(id="0", line_m=((4.85, -1.425, 0.9), (4.85, 3.575, 0.9)), pixels=150, direction=-1),
        Strip(id="1", line_m=((4.83, 3.595, 0.9), (-0.17, 3.595, 0.9)), pixels=150),
    ),
)
BELTS = Environment(
    stamp_ns=0,
    name="belts",
    strips=(
        Strip(id="left", line_m=((0.0, 0.25, 1.0), (4.0, 0.25, 1.0)), pixels=120),
        Strip(id="right", line_m=((4.0, -0.25, 1.0), (0.0, -0.25, 1.0)), pixels=120, direction=-1),
        Strip(id="far", line_m=((0.0, 2.0, 1.0), (4.0, 2.0, 1.0)), pixels=120),
    ),
    belts=(Belt(id="b", line_m=((0.0, 0.0, 1.0), (5.0, 0.0, 1.0))),),
)


class Bench:
    """A room that is lit, and somebody who looks at it."""

    def __init__(self, room: Environment, profile: UserProfile, brightness: float = 1.0) -> None:
        self.room = room
        self.lights = LightState(LedDriverConfig(brightness=brightness))
        self.lights.on_map(room)
        self.eyes = Eyes()
        self.eyes.learn(room)
        self.eyes.set_profile(profile)
        self.people: dict[str, UserProfile] = {}
        self.know("anna", profile)
        self.things: list[TrackedObject] = []

    def know(self, user: str, profile: UserProfile) -> None:
        self.people[user] = profile
        self.lights.content.set_profile(user, profile)

    def point(self, user: str, kind: Kind, line: str, along_m: float, **more: float) -> None:
        lines = {("strip", strip.id): strip.line_m for strip in self.room.strips}
        lines |= {("belt", belt.id): belt.line_m for belt in self.room.belts}
        point = Polyline(lines[kind, line]).point_at(along_m)
        cursor = Cursor(stamp_ns=0, surface=kind, surface_id=line, point_m=point, position_m=along_m)
        self.lights.on_cursor(user, cursor.model_copy(update=more), 0)

    def put(self, name: str, kind: str, surface: Kind, line: str, along_m: float) -> None:
        lying = {"surface": surface, "surface_id": line, "surface_position_m": along_m}
        fields = {"id": name, "kind": kind, "position_m": (0.0, 0.0, 0.0), "length_m": 0.3, **lying}
        self.things.append(TrackedObject.model_validate(fields))
        self.lights.content.set_objects("t", TrackedObjects(stamp_ns=0, objects=tuple(self.things)), 0)

    def choose(self, **owners: str) -> None:
        objects = tuple(SelectedObject(id=name, user=user, since_ns=0) for name, user in owners.items())
        self.lights.content.set_selection(Selection(stamp_ns=0, objects=objects))

    def open(self) -> None:
        self.eyes.open(there(self.lights.frame(0)))

    def find(self, kind: Kind = "strip") -> SeenCursor:
        return there(self.look(kind))

    def look_long(self) -> SeenCursor:
        """Look until the eyes have adapted to dimmed strips."""
        for _ in range(80):
            if seen := self.look():
                return seen
        raise AssertionError("no cursor is found")

    def look(self, kind: Kind = "strip") -> SeenCursor | None:
        self.open()
        spans: list[Span] = [
            ((kind, thing.surface_id), at_m - thing.length_m / 2, at_m + thing.length_m / 2)
            for thing in self.things
            for at_m in (thing.surface_position_m,)
        ]
        return self.eyes.cursor(kind, None, spans)

    def looks(self, name: str) -> ObservedAppearance:
        self.open()
        thing = next(thing for thing in self.things if thing.id == name)
        assert thing.surface in ("strip", "belt")
        key: tuple[Kind, str] = (thing.surface, thing.surface_id)
        return there(self.eyes.looks(thing.kind, key, thing.surface_position_m, thing.length_m))


def profile(color: tuple[int, int, int] = WHITE, **more: object) -> UserProfile:
    return UserProfile.model_validate({"stamp_ns": 0, "cursor_color": color, **more})


@given(
    st.floats(0.0, 5.0),
    st.sampled_from(["0", "1"]),
    st.sampled_from([WHITE, GREEN, (230, 159, 0), (86, 180, 233)]),
    st.floats(0.1, 1.0),
    st.floats(0.05, 0.3),
)
def test_own_cursor_is_found_to_a_pixel_at_any_position(
    along_m: float, strip: str, color: tuple[int, int, int], brightness: float, width_m: float
) -> None:
    bench = Bench(STRIPS, profile(color, cursor_width_m=width_m), brightness)
    bench.point("anna", "strip", strip, along_m)
    seen = bench.look_long()
    assert (seen.kind, seen.line_id) == ("strip", strip)
    # at an end a part of it is not seen
    assert seen.position_m == pytest.approx(along_m, abs=PITCH_M + max(0.0, width_m / 4.0))
    if width_m < along_m < 5.0 - width_m:
        assert seen.position_m == pytest.approx(along_m, abs=PITCH_M)


def test_nobodys_cursor_is_no_cursor() -> None:
    bench = Bench(STRIPS, profile())
    assert bench.look() is None
    bench.know("ben", profile(GREEN))
    bench.point("ben", "strip", "0", 2.0)
    for kind, at_m in (("red", 1.0), ("blue", 3.0), ("whatever", 4.0)):
        bench.put(kind, kind, "strip", "0", at_m)
    assert all(bench.look() is None for _ in range(100))


@pytest.mark.parametrize("off_m", [-0.12, -0.08, 0.0, 0.05, 0.11])
@pytest.mark.parametrize("is_selected", [False, True])
def test_white_cursor_is_found_on_a_thing_with_white_ends(*, off_m: float, is_selected: bool) -> None:
    bench = Bench(STRIPS, profile())
    bench.put("a", "red", "strip", "0", 2.0)
    bench.put("b", "red", "strip", "1", 1.0)
    bench.choose(**({"a": "anna", "b": "anna"} if is_selected else {"b": "anna"}))
    bench.lights.content.set_hover("anna", Hover(stamp_ns=0, object_id="a", progress=0.3), 0)
    bench.point("anna", "strip", "0", 2.0 + off_m)
    seen = bench.find()
    assert seen.line_id == "0"
    assert seen.position_m == pytest.approx(2.0 + off_m, abs=1.6 * PITCH_M)


@pytest.mark.parametrize("width", [{}, *({"cursor_width_m": width_m} for width_m in (0.06, 0.08, 0.1))])
def test_ends_of_distant_own_things_are_no_cursor(width: dict[str, Any]) -> None:
    bench = Bench(STRIPS, profile(**width))
    bench.put("a", "red", "strip", "0", 2.0)
    bench.choose(a="anna")
    assert bench.looks("a").full
    bench.open()
    span: Span = (("strip", "0"), 1.85, 2.15)
    # far from where the hand points they are not even thought of
    assert bench.eyes.cursor("strip", STRIPS.strips[0].line_m[1], [span]) is None


@pytest.mark.parametrize("along_m", [0.3, 1.7, 3.6])
def test_beside_a_belt_it_is_on_the_belt(along_m: float) -> None:
    bench = Bench(BELTS, profile())
    bench.point("anna", "belt", "b", along_m)
    seen = bench.find("belt")
    assert (seen.kind, seen.line_id) == ("belt", "b")
    assert seen.position_m == pytest.approx(along_m, abs=PITCH_M)
    assert seen.point_m == pytest.approx((seen.position_m, 0.0, 1.0))
    assert bench.find("strip").line_id in ("left", "right")


@pytest.mark.parametrize(("room", "surface", "line"), [(STRIPS, "strip", "0"), (BELTS, "belt", "b")])
@pytest.mark.parametrize("brightness", [1.0, 0.3])
@pytest.mark.parametrize("pattern", ["solid", "dashed", "dotted", "striped", "hollow", "tailed"])
def test_appearance_of_a_thing_gives_its_status(
    room: Environment, surface: Kind, line: str, brightness: float, pattern: str
) -> None:
    bench = Bench(room, profile(GREEN, pattern=pattern), brightness)
    bench.know("ben", profile((204, 121, 167), pattern=pattern))
    for name, at_m in (("free", 0.6), ("mine", 1.4), ("theirs", 2.2), ("held", 3.0)):
        bench.put(name, "red", surface, line, at_m)
    for name in ("free", "mine", "theirs", "held"):
        assert not bench.looks(name).marked

    bench.choose(mine="anna", theirs="ben")
    bench.lights.content.set_hover(
        "ben", Hover(stamp_ns=0, object_id="held", progress=0.2, action="select"), 0
    )
    bench.point("ben", surface, line, 3.0)
    assert not bench.looks("free").marked

    mine, theirs, held = (bench.looks(name) for name in ("mine", "theirs", "held"))
    assert (mine.marked, mine.full, mine.own, mine.foreign) == (True, True, True, False)
    assert (theirs.full, theirs.foreign, theirs.own) == (True, True, False)
    assert (held.marked, held.foreign, held.full) == (True, True, False)


def test_frames_that_do_not_fit_the_room_are_dark() -> None:
    eyes = Eyes()
    eyes.open(StripsFrame(stamp_ns=0, strips=(StripFrame(id="0", rgb=b"\xff" * 9),)))
    assert eyes.cursor("strip") is None
    eyes.learn(STRIPS)
    assert eyes.cursor("strip") is None
    assert eyes.looks("red", ("strip", "0"), 2.0, 0.3) is None
    assert eyes.looks("red", ("belt", "none"), 2.0, 0.3) is None
