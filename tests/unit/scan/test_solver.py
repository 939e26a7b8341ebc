"""Views, the solver of a scan, and the map of its solution."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from pointit.bridges.web.scan.session import marked_pixels
from pointit.cli.maps.exchange import import_
from pointit.cli.maps.scan import command
from pointit.maps.file import load_map, parse_map_file
from pointit.runtime.errors import ConfigError
from pointit.scan.advice import next_view
from pointit.scan.result import Scan, ScanError, map_text
from pointit.scan.solver import solve
from pointit.scan.views import (
    CameraView,
    KnownLength,
    Mark,
    StripSighting,
    StripSpec,
    Survey,
    parse_survey,
    read_survey,
)
from tests.unit.scan.photographs import LAMP, LAMPS, LINES, PITCH_M, PLACES, photograph, photographs, specs


def to_json(survey: Survey) -> bytes:
    """Return `survey` as the content of a file."""
    return TypeAdapter(Survey).dump_json(survey)


def distances(scan: Scan) -> dict[str, float]:
    """Return the largest error of an end of each strip after the best motion to the truth, m."""
    names = [name for name in LINES if name in scan.strips]
    found = np.array([end for name in names for end in (scan.strips[name].start, scan.strips[name].end)])
    true = np.array([end for name in names for end in (LINES[name][0], LINES[name][-1])])
    left, _, right = np.linalg.svd((true - true.mean(axis=0)).T @ (found - found.mean(axis=0)))
    turn = left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right
    off = np.linalg.norm((found - found.mean(axis=0)) @ turn.T - (true - true.mean(axis=0)), axis=1)
    return {name: float(off[2 * row : 2 * row + 2].max()) for row, name in enumerate(names)}


def test_strips_are_located_within_15_mm_despite_wrong_numbers() -> None:
    scan = solve(specs(), LAMPS, photographs(4, wrong=0.1))
    assert max(distances(scan).values()) < 0.015
    assert all(strip.identified for strip in scan.strips.values())
    assert scan.complete(0.02)
    assert scan.focal_px == pytest.approx(950.0, rel=0.02)


@pytest.fixture(scope="module")
def scan() -> Scan:
    """Return the scan of four views of the room."""
    return solve(specs(), LAMPS, photographs(4))


def test_bent_strip_has_its_corner_and_straight_ones_have_none(scan: Scan) -> None:
    assert {name: len(strip.line_m) for name, strip in scan.strips.items()} == {
        "left": 2, "back": 2, "post": 2, "table": 2, "bent": 3,
    }  # fmt: skip
    start, corner, end = (np.array(point) for point in scan.strips["bent"].line_m)
    assert np.linalg.norm(corner - start) == pytest.approx(1.4, abs=0.02)
    assert np.linalg.norm(end - corner) == pytest.approx(1.2, abs=0.02)


def test_the_room_is_level_by_gravity_or_by_its_strips(scan: Scan) -> None:
    for each, source in ((scan, "gravity"), (solve(specs(), LAMPS, photographs(4, gravity=False)), "strips")):
        along = np.subtract(each.strips["post"].end, each.strips["post"].start)
        assert along[2] / np.linalg.norm(along) == pytest.approx(1.0, abs=1e-3)
        assert each.level_from == source


def test_known_length_sets_the_scale_and_contradicting_pitches_are_reported() -> None:
    known = KnownLength(Mark("post", 0), Mark("post", 59), 59 * PITCH_M * 1.1)
    scan = solve(specs(), LAMPS, photographs(4), known_length=known)
    assert scan.scale_from == "length"
    assert np.linalg.norm(np.subtract(scan.strips["back"].end, scan.strips["back"].start)) == pytest.approx(
        2.2, rel=0.005
    )
    assert "the known length makes all pitches" in " ".join(scan.problems)


def test_a_lamp_is_found_beside_the_strips(scan: Scan) -> None:
    apart = np.linalg.norm(np.subtract(scan.lamps["lamp"].position_m, scan.strips["back"].start))
    assert apart == pytest.approx(math.dist(LAMP, LINES["back"][0]), abs=0.02)


def test_a_strip_of_unknown_pitch_is_found_by_the_others() -> None:
    strips = [replace(spec, pitch_m=None) if spec.name == "table" else spec for spec in specs()]
    scan = solve(strips, LAMPS, photographs(4))
    assert scan.strips["table"].pitch_m == pytest.approx(PITCH_M, rel=0.02)


def test_the_nearer_of_a_strip_and_its_reflection_is_taken() -> None:
    rng = np.random.default_rng(3)
    mirrored = {"table": [[x, y, -z] for x, y, z in LINES["table"]]}
    views = [
        replace(view, sightings=view.sightings + photograph(at, rng, lines=mirrored).sightings)
        for view, at in zip(photographs(4), PLACES, strict=True)
    ]
    assert distances(solve(specs(), LAMPS, views))["table"] < 0.01


def test_origin_and_heading_move_the_scan_and_keep_it_level(scan: Scan) -> None:
    start, end = scan.strips["back"].line_m
    heading = math.atan2(end[1] - start[1], end[0] - start[0])
    placed = scan.placed(start, heading)
    assert placed.strips["back"].start == pytest.approx((0, 0, 0), abs=1e-9)
    assert placed.strips["back"].end == pytest.approx(
        (math.dist(start[:2], end[:2]), 0, end[2] - start[2]), abs=1e-9
    )
    camera = placed.cameras[0]
    before = scan.cameras[0]
    assert camera is not None
    assert before is not None
    assert math.dist(camera.position_m, (0, 0, 0)) == pytest.approx(math.dist(before.position_m, start))


def test_scanned_map_has_the_strips_and_their_accuracy(scan: Scan) -> None:
    text = map_text(scan)
    assert list(parse_map_file(text.encode(), Path("room.yaml")).strips) == list(LINES)
    assert "# within" in text


def test_an_end_that_no_view_shows_is_not_identified() -> None:
    views = [
        replace(view, sightings=tuple(s for s in view.sightings if s.name != "back" or s.pixel < 80))
        for view in photographs(4)
    ]
    back = solve(specs(), LAMPS, views).strips["back"]
    assert not back.identified
    assert back.sigma_m > 0.02
    assert "no two views show pixels" in back.reason


def test_two_views_of_all_ends_request_no_other_count() -> None:
    rng = np.random.default_rng(1)
    views = [photograph(at, rng, marks=10) for at in PLACES[:2]]
    scan = solve(specs(), LAMPS, views)
    assert {(strip.identified, strip.reason) for strip in scan.strips.values()} == {(True, "")}
    assert not scan.complete(0.01), "two views say where the ends are, but not to 1 cm"


@pytest.mark.parametrize(
    ("known", "sentence"),
    [
        (KnownLength(Mark("back", 0), Mark("back", 9999), 1.0), "pixel 9999 of 'back', which is not there"),
        (KnownLength(Mark("back", 0), Mark("back", -1), 1.0), "pixel -1 of 'back'"),
        (KnownLength(Mark("back", 0), Mark("nobody"), 1.0), "'nobody'"),
        (KnownLength(Mark("back", 0), Mark("back", 0), 1.0), "between two different pixels"),
        (KnownLength(Mark("back", 0), Mark("back", 9), math.inf), "0.01 to 1000 m"),
        (KnownLength(Mark("back", 0), Mark("back", 9), math.nan), "0.01 to 1000 m"),
        (KnownLength(Mark("back", 0), Mark("back", 9), 1e-9), "0.01 to 1000 m"),
        (KnownLength(Mark("back", 0), Mark("back", 9), 1.0, 1e9), "sigma_m of the known length"),
        (KnownLength(Mark("back", 0), Mark("back", 9), 100.0), "is 0.15 m by the pitches"),
    ],
)
def test_impossible_known_length_is_an_error_that_names_it(known: KnownLength, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        solve(specs(), LAMPS, photographs(3), known_length=known)


def test_strip_swapped_with_one_of_another_pitch_is_not_identified() -> None:
    strips = [replace(spec, pitch_m=1 / 30) if spec.name == "left" else spec for spec in specs()]
    rng = np.random.default_rng(4)
    count = {spec.name: spec.count for spec in strips}
    swap = {"left": "post", "post": "left"}

    views = [
        CameraView(
            1280,
            720,
            tuple(
                StripSighting(seen.name, min(seen.pixel, count.get(seen.name, 1) - 1), seen.u, seen.v)
                for seen in photograph(at, rng, names=swap).sightings
            ),
        )
        for at in PLACES
    ]
    scan = solve(strips, LAMPS, views)
    found = scan.strips.get("left")
    assert found is None or not found.identified
    assert any("'left'" in each for each in (*scan.problems, "'left'" if found and found.reason else ""))


def test_swap_with_a_shorter_strip_is_suggested_as_the_reason() -> None:
    counts = {spec.name: spec.count for spec in specs()}
    shown = {"left": "post", "post": "left"}  # 90 and 60 pixels; those beyond the shorter strip do not shine
    marks = {name: marked_pixels(count) for name, count in counts.items()}
    views = [
        replace(
            view,
            sightings=tuple(
                replace(seen, name=name)
                for seen in view.sightings
                for name in [shown.get(seen.name, seen.name)]
                if seen.pixel in marks.get(name, (0,))
            ),
        )
        for view in photographs(4, marks=200)
    ]
    left = solve(specs(), LAMPS, views).strips["left"]

    assert not left.identified
    assert left.reason == (
        "no two views show pixels 60 to 89: photograph that part, or correct its count, "
        "or is it 'post' (60 pixels) or 'table' (61 pixels), swapped at the controller?"
    )


def test_advice_names_a_strip_that_was_seen_once() -> None:
    views = [
        replace(view, sightings=tuple(s for s in view.sightings if s.name != "table" or number == 0))
        for number, view in enumerate(photographs(4))
    ]
    scan = solve(specs(), LAMPS, views)
    advice = next_view(scan)
    assert not scan.complete(0.05)
    assert advice is not None
    assert "table" in advice.text


def test_no_advice_is_left_when_the_scan_is_complete(scan: Scan) -> None:
    assert next_view(scan, 0.05) is None


def test_a_picture_of_something_else_is_refused_in_a_sentence() -> None:
    rng = np.random.default_rng(5)
    noise = [
        CameraView(
            1280,
            720,
            tuple(StripSighting("left", int(n), *rng.uniform(0, 700, 2)) for n in rng.integers(0, 90, 30)),
        )
        for _ in range(3)
    ]
    with pytest.raises(ScanError):
        solve(specs(), [], noise)


def test_one_view_or_none_is_refused() -> None:
    for views in ([], photographs(1)):
        with pytest.raises(ScanError, match="two positions"):
            solve(specs(), LAMPS, views)


def test_strips_without_any_pitch_are_refused() -> None:
    with pytest.raises(ScanError, match="pitch"):
        solve([StripSpec("left", 90)], [], photographs(0) + [CameraView(1280, 720, ())] * 2)


def test_pixel_beyond_the_strips_count_is_an_error_naming_it() -> None:
    with pytest.raises(ConfigError, match=r"has no pixel .*; its pixels are 0 to "):
        solve([StripSpec(s.name, 20, s.pitch_m) for s in specs()], LAMPS, photographs(2))


def test_a_survey_is_the_same_after_json() -> None:
    survey = Survey(tuple(specs()), tuple(LAMPS), tuple(photographs(2)))
    assert parse_survey(to_json(survey)) == survey


def test_survey_with_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    survey = Survey(tuple(specs()), tuple(LAMPS), tuple(photographs(2)))
    path = tmp_path / "views.json"
    path.write_bytes(b"\xef\xbb\xbf" + to_json(survey))
    assert read_survey(path) == survey


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ("x", "JSON"),
        ('{"views": [{"width": 1280}]}', "height"),
        ('{"strips": [{"name": "a", "count": 1}]}', "1 pixels"),
        ('{"strips": [{"name": "a", "count": 9}, {"name": "a", "count": 9}]}', "same name"),
        ('{"strips": [{"name": "a", "count": 9, "pitch_m": 60}]}', "pitch"),
        ('{"strips": [{"name": "../a", "count": 9}]}', "use 1 to 64 letters"),
        ('{"lamps": [{"name": "a\\nb"}]}', "use 1 to 64 letters"),
        ('{"views": [{"width": 0, "height": 0, "sightings": []}]}', "image"),
        ('{"known_lenght": {}}', "known_lenght"),
        ('{"strips": [{"name": "a", "count": 9, "pitch": 0.01}]}', "pitch"),
        ('{"lamps": [{"name": "a", "colour": 1}]}', "colour"),
        ('{"views":[{"width":9,"height":9,"sightings":[{"name":"b","pixel":0,"u":1,"v":1,"w":1}]}]}', "w: "),
        ('{"views": [{"width": 64, "height": 64, "sightings": [], "gravity": [0, 9.8, 0]}]}', "gravity"),
        ('{"views":[{"width":99,"height":99,"sightings":[{"name":"b","pixel":0,"u":1,"v":1}]}]}', "'b'"),
    ],
)
def test_a_wrong_survey_is_an_error_that_names_it(data: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        parse_survey(data)


@given(st.binary(max_size=80))
def test_any_bytes_are_a_survey_or_an_error_sentence(data: bytes) -> None:
    try:
        survey = parse_survey(data)
    except ConfigError as error:
        assert "\n" not in str(error)  # noqa: PT017 - both outcomes are right
    else:
        assert isinstance(survey, Survey)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.json"):
        read_survey(tmp_path / "none.json")


@pytest.fixture
def views(tmp_path: Path) -> Path:
    """Return a file of views."""
    path = tmp_path / "views.json"
    path.write_bytes(to_json(Survey(tuple(specs()), tuple(LAMPS), tuple(photographs(4)))))
    return path


@pytest.mark.slow
def test_command_writes_a_readable_map_and_never_overwrites_one(views: Path) -> None:
    room = views.with_name("room.yaml")
    arguments = ["--from", str(views), "-o", str(room), "--known", "post:0,post:59,0.98"]
    result = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert {strip.id for strip in load_map(str(room), 0).strips} == {spec.name for spec in specs()}
    before = room.read_bytes()
    with pytest.raises(ConfigError, match="exists already"):
        CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert room.read_bytes() == before


@pytest.mark.slow
def test_exit_code_reports_lights_left_out_of_the_map(views: Path) -> None:
    survey = read_survey(views)
    hidden = [
        replace(
            view, sightings=tuple(each for each in view.sightings if each.name != "post" or each.pixel < 40)
        )
        for view in survey.views
    ]
    views.write_bytes(to_json(replace(survey, views=tuple(hidden))))
    for option, code, count in ((["--all"], 0, 1), ([], 1, 0)):
        room = views.with_name(f"room{code}.yaml")
        arguments = ["--from", str(views), "-o", str(room), *option]
        result = CliRunner().invoke(command, arguments, catch_exceptions=False, standalone_mode=False)
        assert result.return_value == code
        assert "no two views show pixels" in result.stderr
        assert sum(strip.id == "post" for strip in load_map(str(room), 0).strips) == count


@pytest.mark.parametrize("option", [("--known", "a,b"), ("--known", "a:x,b:1,2")])
def test_wrong_options_are_named(views: Path, option: tuple[str, str]) -> None:
    result = CliRunner().invoke(command, ["--from", str(views), *option])
    assert result.exit_code == 2
    assert option[1] in result.output


@pytest.mark.parametrize("kind", ["csv", "segments", "ledmap"])
def test_a_file_of_something_else_is_named(tmp_path: Path, kind: str) -> None:
    other = tmp_path / "other.bin"
    other.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match=r"other\.bin"):
        CliRunner().invoke(import_, [str(other), "--as", kind], catch_exceptions=False)
