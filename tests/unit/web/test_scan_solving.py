"""The solver behind the page: what it is given, what the page shows, and the map's text."""

import math
from pathlib import Path

import numpy as np
import pytest

from pointit.bridges.web.scan.code import marked_pixels
from pointit.bridges.web.scan.session import Solution
from pointit.bridges.web.scan.simulated_room import SimulatedRoom
from pointit.bridges.web.scan.solver_process import SolverProcess
from pointit.bridges.web.scan.solving import solution_of, solve_survey
from pointit.geometry.vector import Vec3
from pointit.maps.file import load_map
from pointit.runtime.errors import ConfigError, PointItError
from pointit.scan.views import Sighting, StripSpec, Survey, View

FOCAL_PX = 900.0
WIDTH, HEIGHT = 1280, 720
ROOM = SimulatedRoom().seen
COUNTS = {strip.name: len(strip.places_m) for strip in ROOM.strips}


def view_from(at_m: Vec3, seed: int) -> View:
    """Return the view of a level camera at `at_m`, pointed at the middle of the strips."""
    rng = np.random.default_rng(seed)
    middle = np.mean([place for strip in ROOM.strips for place in strip.places_m], axis=0)
    ahead = (middle - at_m) / np.linalg.norm(middle - at_m)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(ahead, right), ahead])
    seen = list[Sighting]()
    for strip in ROOM.strips:
        for pixel in marked_pixels(len(strip.places_m)):
            x, y, z = axes @ (np.array(strip.places_m[pixel]) - at_m)
            u, v = FOCAL_PX * np.array([x, y]) / z + (WIDTH / 2, HEIGHT / 2) + rng.normal(0.0, 0.3, 2)
            seen.append(Sighting(strip.name, pixel, float(u), float(v)))
    down_x, down_y, down_z = (float(value) for value in -axes[:, 2])
    return View(WIDTH, HEIGHT, tuple(seen), (down_x, down_y, down_z))


def survey(views: int) -> Survey:
    strips = tuple(StripSpec(name, count, 1 / 60) for name, count in COUNTS.items())
    return Survey(strips, (), tuple(view_from(at, seed) for seed, at in enumerate(ROOM.places_m[:views])))


@pytest.fixture(scope="module")
def solution() -> Solution:
    return solution_of(solve_survey(survey(4)))


def test_the_page_shows_every_strip_with_the_uncertainty_of_its_ends(solution: Solution) -> None:
    assert solution.is_complete
    assert {strip.name: strip.pixels for strip in solution.strips} == COUNTS
    assert len(solution.cameras_m) == 4
    for strip in solution.strips:
        assert strip.sigma_m is not None
        assert strip.sigma_m < 0.01


@pytest.mark.parametrize("origin", ["shelf_high", "desk"])
def test_the_map_begins_below_the_first_light_and_x_runs_to_the_last(
    solution: Solution, origin: str, tmp_path: Path
) -> None:
    path = tmp_path / "room.yaml"
    path.write_text(solution.map_text(origin))
    strips = {strip.id: strip for strip in load_map(str(path), 0).strips}
    assert {name: strip.pixels for name, strip in strips.items()} == COUNTS
    first, last = strips[origin].line_m
    assert (first[0], first[1], last[1]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    assert last[0] > 0.9
    assert min(z for strip in strips.values() for _, _, z in strip.line_m) == pytest.approx(0.0, abs=1e-3)
    length_m = math.dist(*strips["shelf_low"].line_m)
    assert length_m == pytest.approx(1.5, abs=0.01)


def test_an_upright_strip_is_an_origin_without_a_heading(solution: Solution, tmp_path: Path) -> None:
    path = tmp_path / "room.yaml"
    path.write_text(solution.map_text("door"))
    assert "x points" not in path.read_text()
    (door,) = (strip for strip in load_map(str(path), 0).strips if strip.id == "door")
    assert door.line_m[0][:2] == pytest.approx((0.0, 0.0), abs=1e-3)
    with pytest.raises(ConfigError, match="'lamp' is not known yet"):
        solution.map_text("lamp")


async def test_a_process_of_its_own_solves_and_says_what_hinders() -> None:
    solver = SolverProcess()
    try:
        solution = await solver.solve(survey(3))
        assert len(solution.strips) == len(COUNTS)
        with pytest.raises(PointItError):
            await solver.solve(Survey(survey(1).strips, (), (View(WIDTH, HEIGHT, ()),) * 2))
    finally:
        solver.close()
