"""Each pixel where it should be: directions, ends, states, several cursors, brightness."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry.colormap import colormap
from pointit.schemas import Environment, Strip
from pointit.schemas.base import FARTHEST_ALONG
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.light_state import LightState
from pointit.services.led_driver.render import Layout
from tests.unit.led_driver.stage import (
    BACK,
    BLACK,
    BLUE,
    DIM,
    FORTH,
    GAP,
    GREEN,
    PENDING,
    RED,
    WHITE,
    Stage,
    item,
)


@given(st.floats(-0.5, 2.5), st.floats(0.001, 1.0), st.sampled_from(["forth", "back"]), st.integers(1, 300))
def test_cursor_lights_exactly_the_pixels_with_centres_under_it(
    position_m: float, width_m: float, strip_id: str, pixels: int
) -> None:
    strip = (FORTH if strip_id == "forth" else BACK).model_copy(update={"pixels": pixels})
    stage = Stage(strip).profile("anna", width_m=width_m).point("anna", position_m, strip_id)
    pitch_m = 2.0 / pixels
    centres = (np.arange(pixels) + 0.5) * pitch_m
    if strip_id == "back":
        centres = centres[::-1]
    distance = np.abs(centres - position_m)
    got = np.zeros(pixels, dtype=bool)
    got[stage.lit(strip_id)] = True
    rounding = 1e-9

    if (distance < width_m / 2 - rounding).any() or width_m >= pitch_m:
        assert got[distance < width_m / 2 - rounding].all()
        assert not got[distance > width_m / 2 + rounding].any()
    else:  # narrower than a pixel and between two centres: the nearest, if it is on the strip
        assert got.sum() <= 1
        beyond_m = max(-position_m, position_m - 2.0)
        if abs(beyond_m) > 1e-5:
            assert (got.sum() == 1) == (beyond_m < 0)
        assert not got[distance > pitch_m / 2 + 1e-5].any()


def test_object_is_dim_until_selected_then_bright_with_owners_ends() -> None:
    assert Stage().put(item(0.6)).shown()[2:10] == [BLACK, *[DIM] * 6, BLACK]
    unknown = Stage().put(item(0.6)).select("anna").shown()
    assert unknown[2:10] == [BLACK, WHITE, *[RED] * 4, WHITE, BLACK]
    known = Stage().profile("anna", GREEN).put(item(0.6)).select("anna").shown()
    assert known[2:10] == [BLACK, GREEN, *[RED] * 4, GREEN, BLACK]


def test_hovered_object_has_the_persons_ends_and_fills_with_progress() -> None:
    def shown(progress: float, *, owner: str = "", **more: Any) -> list[tuple[int, int, int]]:
        stage = Stage().profile("anna", GREEN).profile("ben", BLUE).put(item(0.6)).select(owner)
        return stage.hover("anna", progress, **more).shown()[3:9]

    assert shown(0.0) == [GREEN, *[DIM] * 4, GREEN]
    assert shown(0.7) == [GREEN, RED, DIM, DIM, RED, GREEN]
    assert shown(1.0, action="select") == [GREEN, *[RED] * 4, GREEN]
    assert shown(1.0, action="refuse") == [GREEN, *[DIM] * 4, GREEN]  # nothing would change
    # selected and hovered: both are told, the one pixel of each end has one of them
    assert shown(0.7, owner="ben") == [BLUE, DIM, RED, RED, DIM, GREEN]
    assert shown(1.0, owner="ben", action="deselect") == [BLUE, *[DIM] * 4, GREEN]
    assert shown(1.0, owner="ben", action="select") == [BLUE, *[RED] * 4, GREEN]


def margins(stage: Stage) -> list[tuple[int, int, int]]:
    shown = stage.shown()
    return [*shown[5:7], *shown[12:14]]


def wide() -> Stage:
    people = Stage(margin_m=0.2).profile("anna", GREEN).profile("ben", BLUE).profile("cleo", (9, 9, 9))
    return people.put(item(0.95, 0.9))


def test_margins_distinguish_hovered_and_selected_objects() -> None:
    told = {
        "hovered": margins(wide().hover("anna")),
        "selected": margins(wide().select("anna")),
        "hovered by another": margins(wide().select("ben").hover("anna")),
        "hovered by its owner": margins(wide().select("anna").hover("anna")),
        "by two others": margins(wide().select("cleo").hover("anna").hover("ben")),
        "idle": margins(wide()),
    }
    assert told["hovered"] == told["selected"] == [GREEN] * 4  # told by the body: dim, full
    assert wide().hover("anna").shown()[9] == DIM
    assert wide().select("anna").shown()[9] == RED
    assert told["hovered by another"] == [BLUE, GREEN, GREEN, BLUE]  # the owner outside
    assert told["hovered by its owner"] == [GREEN, WHITE, WHITE, GREEN]
    assert set(told["by two others"]) == {(9, 9, 9), GREEN, BLUE}
    assert told["idle"] == [DIM] * 4


def test_reservation_is_a_thin_outer_mark_in_the_users_colour() -> None:
    assert margins(wide().select(reserver="ben")) == [BLUE, DIM, DIM, BLUE]
    assert margins(wide().select(reserver="ben").hover("anna")) == [BLUE, GREEN, GREEN, BLUE]
    assert margins(wide().hover("anna", taken_by="ben")) == [BLUE, GREEN, GREEN, BLUE]
    assert margins(wide().select(reserver="anna").hover("anna")) == [GREEN] * 4


def test_pending_object_has_its_own_brightness_and_no_pattern() -> None:
    stage = wide().profile("ben", BLUE, pattern="hollow").select("ben", pending=True)

    assert margins(stage) == [BLUE] * 4  # unlike a reservation
    assert stage.shown()[7:12] == [PENDING] * 5  # between that of a free object and of a selected one


def test_pending_object_shows_its_claimant_outside_when_hovered() -> None:
    by_another = wide().select("ben", pending=True).hover("anna")
    by_its_claimant = wide().select("ben", pending=True).hover("ben")

    assert margins(by_another) == [BLUE, GREEN, GREEN, BLUE]
    assert margins(by_its_claimant) == [BLUE, WHITE, WHITE, BLUE]


def test_pending_object_fills_when_its_claimant_deselects_it() -> None:
    def body(action: str) -> list[tuple[int, int, int]]:
        stage = Stage().profile("ben", BLUE).put(item(0.6)).select("ben", pending=True)
        return stage.hover("ben", 1.0, action=action).shown()[4:8]

    assert body("deselect") == [DIM] * 4
    assert body("select") == [PENDING] * 4  # nothing would change


PATTERNS = ["solid", "dashed", "dotted", "striped", "hollow", "tailed"]


def test_patterns_of_nine_pixels() -> None:
    def signs(pattern: str, speed_mps: float = 0.0) -> str:
        stage = Stage(margin_m=0.2).profile("anna", GREEN, pattern=pattern)
        shown = stage.put(item(0.95, 0.9, surface_speed_mps=speed_mps)).select("anna").shown()
        return "".join({GREEN: "M", RED: "B", GAP: "."}[color] for color in shown[5:14])

    assert [signs(pattern) for pattern in PATTERNS] == [
        "MMBBBBBMM", "MM.BBB.MM", "MMB.B.BMM", "MMBMBMBMM", "MMB...BMM", "MMMMBBBMM"
    ]  # fmt: skip
    assert signs("tailed", -0.1) == "MMBBBMMMM"  # behind it


def test_objects_that_are_not_selected_have_no_pattern() -> None:
    stage = wide().profile("anna", GREEN, pattern="hollow").hover("anna")
    assert stage.shown()[7:12] == [DIM] * 5


def test_moving_object_has_a_fading_tail_behind_it() -> None:
    forth = Stage(tail_s=0.2).put(item(1.0, 0.4, surface_speed_mps=2.0)).shown()
    assert forth[8:12] == [DIM] * 4
    tail = [color[0] for color in forth[4:8]]
    assert 0 < tail[0] < tail[1] < tail[2] < tail[3] <= 25
    assert forth[12] == forth[3] == BLACK
    back = Stage(tail_s=0.2).put(item(1.0, 0.4, surface_speed_mps=-2.0)).shown()
    assert back == forth[::-1]
    assert Stage(tail_s=0.2).put(item(1.0, 0.4)).lit() == [8, 9, 10, 11]


@given(st.floats(0.3, 1.7), st.floats(0.2, 0.6), st.floats(0.1, 3.0), st.sampled_from([1.0, -1.0]))
def test_tail_is_behind_the_object_and_covers_none_of_it(
    at_m: float, length_m: float, speed_mps: float, sign: float
) -> None:
    shown = Stage(tail_s=0.2).put(item(at_m, length_m, surface_speed_mps=sign * speed_mps)).shown()
    for number, color in enumerate(shown):
        ahead_m = sign * (0.05 + 0.1 * number - at_m)
        if abs(ahead_m) < length_m / 2 - 1e-9:
            assert color == DIM
        elif ahead_m > length_m / 2 + 1e-9 or ahead_m < -length_m / 2 - 0.2 * speed_mps - 1e-9:
            assert color == BLACK
        elif abs(ahead_m) > length_m / 2 + 1e-9:
            assert color[0] <= DIM[0] / 2


def test_tail_of_a_moving_object_excludes_its_last_pixel() -> None:
    for number in range(3, 16):  # its front is at a pixel's centre, as well as floats have it
        shown = Stage(tail_s=0.2).put(item(0.1 * number - 0.05, 0.2, surface_speed_mps=1.0)).shown()
        assert {shown[number - 1], shown[number]} <= {DIM, BLACK}


def test_tails_lie_beneath_other_objects() -> None:
    stage = Stage(tail_s=0.2).put(item(0.5, 0.4, id="q"), item(1.0, 0.4, surface_speed_mps=2.0))
    assert stage.shown()[3:7] == [DIM] * 4


def test_object_partly_beyond_the_strip_keeps_its_shape() -> None:
    at_start = Stage().put(item(0.1)).select("x").shown()
    assert at_start[:5] == [*[RED] * 3, WHITE, BLACK]
    at_end = Stage().put(item(1.9)).select("x").shown()
    assert at_end[15:] == [BLACK, WHITE, *[RED] * 3]
    assert Stage().put(item(-0.5)).shown() == Stage().put(item(2.5)).shown() == [BLACK] * 20


def test_short_object_is_one_pixel_of_its_colour() -> None:
    shown = Stage(tail_s=1.0).put(item(0.51, 0.0, surface_speed_mps=0.1)).select("x").shown()
    assert shown[4:7] == [BLACK, RED, BLACK]


def test_unknown_kind_has_a_default_colour_and_unknown_lines_stay_dark() -> None:
    assert Stage().put(item(0.6, kind="?")).select("x").shown()[5] == (8, 8, 8)
    assert Stage().put(item(0.5, surface_id="x")).point("anna", 0.5, "x").lit() == []
    assert Stage().put(item(0.5, surface="none")).point("anna", 0.5, surface="none").lit() == []


def test_cursors_lie_on_top_of_objects() -> None:
    stage = Stage(FORTH).profile("anna", GREEN).put(item(0.6)).select("x").point("anna", 0.55)
    assert stage.shown()[3:9] == [WHITE, GREEN, GREEN, GREEN, RED, WHITE]


def test_overlapping_cursors_alternate_and_lone_parts_stay_whole() -> None:
    stage = Stage().profile("anna", WHITE, 0.6).profile("ben", GREEN, 0.6).profile("cleo")
    stage.point("anna", 0.5).point("ben", 0.8).point("cleo", 1.0, "back")
    got = stage.shown()
    assert got[2:5] == [WHITE] * 3
    assert got[5:8] == [GREEN, WHITE, GREEN]
    assert got[8:11] == [GREEN] * 3
    assert stage.lit() == list(range(2, 11))
    assert len(stage.lit("back")) in (3, 4)


def test_cursor_shows_its_distance_by_a_colormap() -> None:
    def color(**miss: Any) -> tuple[int, int, int]:
        stage = Stage().profile("anna", GREEN, cursor_colormap="viridis")
        return stage.point("anna", 0.55, **miss).shown()[5]

    viridis = colormap("viridis")
    assert color(miss_rad=0.0, miss_m=9.0) == viridis.rgb(1.0)
    assert color(miss_rad=np.radians(2.5), miss_m=9.0) == viridis.rgb(0.75)
    assert color(miss_rad=1.0) == viridis.rgb(0.0)


def test_brightness_of_one_strip_leaves_the_others_alone() -> None:
    stage = Stage().profile("anna").put(item(0.6)).point("anna", 1.0, "back")
    front = stage.shown()
    back = stage.shown("back")
    stage.lights.set_brightness(0.5, ["back"])
    assert stage.shown() == front
    assert stage.shown("back") == [tuple(round(value / 2) for value in color) for color in back]
    with pytest.raises(ValueError, match="there is no strip 'left'; there are "):
        stage.lights.set_brightness(0.5, ["left"])
    stage.lights.set_brightness(1.0)
    assert stage.shown("back") == back


def test_frame_keeps_nothing_of_the_one_before() -> None:
    stage = Stage().put(item(0.6)).point("anna", 1.0, "back")
    assert stage.lit()
    assert stage.lit("back")
    stage.put().point("anna", 1.0, surface="none")
    assert stage.lit() == stage.lit("back") == []


def test_line_without_length_is_refused_and_the_previous_map_stays() -> None:
    stage = Stage()
    broken = FORTH.model_copy(update={"line_m": ((0, 0, 0), (0, 0, 0))})
    with pytest.raises(ValueError, match="two different vertices"):
        stage.lights.on_map(Environment(stamp_ns=0, name="bad", strips=(broken,)))
    assert set(stage.frame()) == {"forth", "back"}


def test_more_pixels_than_a_frame_holds_are_refused() -> None:
    line = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    strips = [Strip(id=f"strip_{n}", line_m=line, pixels=4096) for n in range(65)]
    assert Layout(strips[:64]).count == 64 * 4096
    with pytest.raises(ValueError, match="266240 pixels together, a frame holds 262144"):
        Layout(strips)


@pytest.mark.parametrize("end_m", [1e-8, 2.0])
@pytest.mark.parametrize("position_m", [-FARTHEST_ALONG, FARTHEST_ALONG])
def test_cursors_beyond_the_world_light_nothing_however_many(end_m: float, position_m: float) -> None:
    strip = Strip(id="a", line_m=((0.0, 0.0, 0.0), (end_m, 0.0, 0.0)), pixels=20)
    stage = Stage(strip).put(item(position_m, 1.0, surface_id="a"))
    for user in "abc":
        stage.profile(user, (9, 9, 9), 1.0).point(user, position_m, "a")
    assert stage.lit("a") == []


def test_frame_is_missing_without_a_map_and_empty_without_strips() -> None:
    lights = LightState(LedDriverConfig())
    assert lights.frame(0) is None
    lights.on_map(Environment(stamp_ns=0, name="dark"))
    frame = lights.frame(5)
    assert frame is not None
    assert (frame.strips, frame.stamp_ns) == ((), 5)
