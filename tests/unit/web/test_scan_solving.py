"""The solver behind the page: what it is given, what the page shows, and the map's text."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pointit.bridges.web.scan.session import ScanSolution, marked_pixels
from pointit.bridges.web.scan.simulated_room import SimulatedRoom
from pointit.bridges.web.scan.solver_process import SolverProcess, solution_of, solve_survey
from pointit.bridges.web.scan.wire import ScanThing
from pointit.geometry.vector import Vec3
from pointit.maps.file import load_map
from pointit.runtime.errors import ConfigError, PointItError, RefusedError
from pointit.scan.views import CameraView, LampSpec, StripSighting, StripSpec, Survey
from tests.support import there

FOCAL_PX = 900.0
WIDTH = 1280
HEIGHT = 720
ROOM = SimulatedRoom().seen
TRUE = {strip.name: strip.places_m for strip in ROOM.strips}
COUNTS = {strip.name: len(strip.places_m) for strip in ROOM.strips}


def axes_of(at_m: Vec3) -> NDArray[np.float64]:
    """Return the axes of a level camera at `at_m`, pointed at the middle of the strips."""
    middle = np.mean([place for strip in ROOM.strips for place in strip.places_m], axis=0)
    ahead = (middle - at_m) / np.linalg.norm(middle - at_m)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(ahead, right), ahead])


def image_of(at_m: Vec3, place_m: Vec3) -> tuple[float, float]:
    x, y, z = axes_of(at_m) @ np.subtract(place_m, at_m)
    return float(FOCAL_PX * x / z + WIDTH / 2), float(FOCAL_PX * y / z + HEIGHT / 2)


def view_from(at_m: Vec3, seed: int) -> CameraView:
    """Return the view of that camera."""
    rng = np.random.default_rng(seed)
    axes = axes_of(at_m)
    seen = list[StripSighting]()
    for strip in ROOM.strips:
        for pixel in marked_pixels(len(strip.places_m)):
            u, v = image_of(at_m, strip.places_m[pixel]) + rng.normal(0.0, 0.3, 2)
            seen.append(StripSighting(strip.name, pixel, float(u), float(v)))
    down_x, down_y, down_z = (float(value) for value in -axes[:, 2])
    return CameraView(WIDTH, HEIGHT, tuple(seen), (down_x, down_y, down_z))


def survey(views: int) -> Survey:
    strips = tuple(StripSpec(name, count, 1 / 60) for name, count in COUNTS.items() if count > 1)
    lamps = tuple(LampSpec(name) for name, count in COUNTS.items() if count == 1)
    return Survey(strips, lamps, tuple(view_from(at, seed) for seed, at in enumerate(ROOM.places_m[:views])))


@pytest.fixture(scope="module")
def solution() -> ScanSolution:
    return solution_of(solve_survey(survey(4)), (WIDTH, HEIGHT))


def test_solution_has_every_strip_and_lamp_with_its_uncertainty(solution: ScanSolution) -> None:
    assert solution.is_complete
    assert {strip.name: strip.pixels for strip in solution.strips} == COUNTS
    assert len(solution.cameras_m) == 4
    for strip in solution.strips:
        assert there(strip.sigma_m) < 0.01


@pytest.mark.parametrize("origin", ["shelf_high", "desk"])
def test_map_origin_is_below_the_first_light_along_the_strip(
    solution: ScanSolution, origin: str, tmp_path: Path
) -> None:
    path = tmp_path / "room.yaml"
    path.write_text(solution.map_text(origin, ()))
    room = load_map(str(path), 0)
    strips = {strip.id: strip for strip in room.strips}
    assert {name: strip.pixels for name, strip in strips.items()} | {
        lamp.id: 1 for lamp in room.lamps
    } == COUNTS

    lamps = {lamp.id: lamp.position_m for lamp in room.lamps}
    apart_m = math.dist(*(places[0] for places in TRUE.values() if len(places) == 1))
    assert math.dist(*lamps.values()) == pytest.approx(apart_m, abs=0.01)

    first, last = strips[origin].line_m
    assert (first[0], first[1], last[1]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    assert last[0] > 0.9
    assert min(z for strip in strips.values() for _, _, z in strip.line_m) == pytest.approx(0.0, abs=1e-3)

    length_m = math.dist(*strips["shelf_low"].line_m)
    assert length_m == pytest.approx(1.5, abs=0.01)


def test_upright_strip_gives_an_origin_without_a_heading(solution: ScanSolution, tmp_path: Path) -> None:
    path = tmp_path / "room.yaml"
    path.write_text(solution.map_text("door", ()))
    assert "x points" not in path.read_text()
    (door,) = (strip for strip in load_map(str(path), 0).strips if strip.id == "door")
    assert door.line_m[0][:2] == pytest.approx((0.0, 0.0), abs=1e-3)
    with pytest.raises(ConfigError, match="'lamp' is not known yet"):
        solution.map_text("lamp", ())


def tapped(name: str, shape: str, places: list[Vec3], views: tuple[int, int] = (0, 1)) -> ScanThing:
    """Return a thing whose corners are tapped where `places` are in the pictures of two views."""
    taps = [tuple((view, *image_of(ROOM.places_m[view], place)) for view in views) for place in places]
    return ScanThing.model_validate({"name": name, "shape": shape, "corners": taps})


def test_things_are_located_by_corners_tapped_in_two_views(solution: ScanSolution, tmp_path: Path) -> None:
    low = TRUE["shelf_low"]
    high = TRUE["shelf_high"]
    screen = tapped("front", "screen", [low[0], low[-1], high[0]])
    box = tapped("crate", "box", [(0.0, 1.0, 0.8), (0.6, 1.0, 0.8), (0.6, 1.4, 0.8), (0.6, 1.4, 0.2)])
    shown = there(solution.thing)(screen)
    assert (len(shown.line_m), shown.pixels, there(shown.sigma_m) < 0.08) == (3, 0, True)

    path = tmp_path / "room.yaml"
    path.write_text(solution.map_text("shelf_low", (screen, box)))
    room = load_map(str(path), 0)
    (crate,) = room.boxes
    assert crate.size_m == pytest.approx((0.6, 0.4, 0.6), abs=0.02)
    # the origin is below the first LED of shelf_low, at the height of the lowest light
    assert crate.center_m == pytest.approx((0.3 - low[0][0], 1.2 - low[0][1], 0.5 - 0.308), abs=0.02)

    (front,) = room.planes
    assert front.size_m == pytest.approx((1.483, 0.8), abs=0.02)


@pytest.mark.parametrize(
    ("thing", "sentence"),
    [
        (tapped("a", "box", [(0.0, 1.0, 0.8)] * 4), "span no box"),
        (ScanThing(name="a", corners=(((0, 1.0, 1.0), (9, 2.0, 2.0)),)), "view 10 is not known"),
        (ScanThing(name="a", corners=(((0, 1.0, 1.0), (1, 1200.0, 700.0)),)), "not show the same corner"),
    ],
)
def test_taps_are_refused_when_they_give_no_thing(
    solution: ScanSolution, thing: ScanThing, sentence: str
) -> None:
    with pytest.raises(RefusedError, match=sentence):
        there(solution.thing)(thing)


def test_advice_says_how_the_room_was_levelled_without_gravity() -> None:
    seen = survey(3)
    views = tuple(replace(view, gravity=None) for view in seen.views)
    solution = solution_of(solve_survey(replace(seen, views=views)), (WIDTH, HEIGHT))
    assert "No view tells where down is" in solution.advice


async def test_solver_process_returns_a_solution_or_the_reason() -> None:
    solver = SolverProcess()
    try:
        solution = await solver.solve(survey(3))
        assert len(solution.strips) == len(COUNTS)
        with pytest.raises(PointItError):
            await solver.solve(Survey(survey(1).strips, (), (CameraView(WIDTH, HEIGHT, ()),) * 2))
    finally:
        solver.close()
