"""Things of a map as they are listed: boxes, parts of strips, lamps."""

import pytest

from pointit.schemas import Environment, Strip, Thing, TrackedObject
from pointit.services.pui.tracked_objects import listing

STRIP = Strip(id="shelf", line_m=((2.4, 1.0, 1.25), (2.4, -1.0, 1.25)), pixels=120)


def listed(**fields: object) -> TrackedObject:
    thing = Thing.model_validate(
        {"id": "nuts", "center_m": (2.6, 0.0, 1.4), "size_m": (0.4, 0.3, 0.2)} | fields
    )
    room = Environment(stamp_ns=0, name="room", strips=(STRIP,), things=(thing,))
    (tracked,) = listing(room, 7).objects
    return tracked


def test_thing_without_light_is_listed_as_an_unlit_box() -> None:
    tracked = listed()
    assert (tracked.id, tracked.kind, tracked.surface, tracked.lit) == ("nuts", "nuts", "none", False)
    assert (tracked.position_m, tracked.size_m) == ((2.6, 0.0, 1.4), (0.4, 0.3, 0.2))
    assert tracked.length_m == 0.4


def test_a_tracked_object_is_listed_by_its_tracker_only() -> None:
    cart = Thing(id="cart", center_m=(0, 0, 0), size_m=(1, 1, 1), is_tracked=True)
    assert listing(Environment(stamp_ns=0, name="room", things=(cart,)), 7).objects == ()


def test_label_mode_press_and_dwell_travel_with_it() -> None:
    tracked = listed(label="M4 nuts", mode="switch", press=True, dwell_s=2.0, yaw_rad=0.5)
    assert (tracked.kind, tracked.mode, tracked.press, tracked.dwell_s) == ("M4 nuts", "switch", True, 2.0)
    assert tracked.yaw_rad == 0.5


def test_a_lamp_lights_it_where_it_is() -> None:
    tracked = listed(lamp="radio")
    assert (tracked.surface, tracked.lit) == ("none", True)


@pytest.mark.parametrize(
    ("part_m", "middle_m", "length_m"),
    [((0.8, 1.2), 1.0, 0.4), ((1.5, 9.0), 1.75, 0.5), ((-1.0, 1.0), 0.5, 1.0)],
    ids=["within", "beyond its end", "before its start"],
)
def test_part_of_a_strip_is_an_object_on_it(
    part_m: tuple[float, float], middle_m: float, length_m: float
) -> None:
    tracked = listed(strip="shelf", part_m=part_m)
    assert (tracked.surface, tracked.surface_id, tracked.lit) == ("strip", "shelf", True)
    assert tracked.surface_position_m == pytest.approx(middle_m)
    assert tracked.length_m == pytest.approx(length_m)
    assert tracked.position_m == (2.6, 0.0, 1.4)
