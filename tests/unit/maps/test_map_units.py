"""Maps in another unit than metres, and maps that are too large."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry.vector import Vec3
from pointit.maps.checks.check import check_map
from pointit.maps.checks.things import SAME_PLACE_M, check_lamps
from pointit.maps.file import parse_map_file, read_map_file
from pointit.maps.model import LampEntry, MapFile
from pointit.runtime.errors import ConfigError

ROOMS: dict[str, dict[str, Any]] = {
    "lamps": {"lamps": {"a": [0.4, 0.3, 1.9], "b": [4.1, 0.2, 1.2], "c": [2.0, 3.6, 2.4]}},
    "lamps on a desk": {"lamps": {"a": [0.1, 0.0, 0.75], "b": [1.7, 0.0, 0.8]}},
    "a large hall": {"lamps": {"a": [0, 0, 4.5], "b": [180, 0, 4.5], "c": [90, 60, 4.0]}},
    "strips on the floor": {
        "strips": {"s": ([[0, 0, 0], [3, 0, 0]], 180), "t": ([[0, 2, 0], [3, 2, 0]], 90)}
    },
    "things": {
        "things": {"door": ([3.9, 0.5, 1.0], [0.1, 0.9, 2.0]), "tv": ([0.2, 2.5, 1.1], [0.1, 1.2, 0.7])}
    },
}


def in_unit(room: dict[str, Any], factor: float) -> MapFile:
    """Return the map of `room` whose numbers are multiplied with `factor`."""

    def scaled(value: Any) -> Any:
        return (np.array(value) * factor).tolist()

    return MapFile.model_validate(
        {
            "lamps": {name: {"position": scaled(at)} for name, at in room.get("lamps", {}).items()},
            "strips": {
                name: {"line": scaled(line), "pixels": count}
                for name, (line, count) in room.get("strips", {}).items()
            },
            "things": {
                name: {"center": scaled(center), "size": scaled(size)}
                for name, (center, size) in room.get("things", {}).items()
            },
        }
    )


@pytest.mark.parametrize("name", ROOMS)
def test_a_map_in_millimetres_is_suspected_and_in_metres_it_is_not(name: str) -> None:
    assert not [each for each in check_map(in_unit(ROOMS[name], 1.0), {}) if each.where == "map"]
    (finding,) = [each for each in check_map(in_unit(ROOMS[name], 1000.0), {}) if each.where == "map"]
    assert finding.text.endswith("; give positions in metres")


@pytest.mark.parametrize(
    ("corner", "texts"),
    [
        ((5.0, 4.0, 2.6), []),
        ((4.0, 2.6, -2.0), ["reaches 2.0 m below the floor; set up to the axis of the file that points up"]),
        ((150.0, 50.0, 100.0), ["is 100 m high; set unit, if it is not in metres"]),
    ],
)
def test_a_cloud_with_unlikely_axes_or_height_is_a_warning(corner: Vec3, texts: list[str]) -> None:
    points = np.array([[0.0, 0.0, 0.0], corner, [1.0, 1.0, 0.5]])
    file = MapFile.model_validate({"clouds": {"scan": {"file": "scan.ply"}}})
    found = [each.text for each in check_map(file, {"scan": points}) if each.where == "clouds.scan"]
    assert [text.partition(", such")[0] for text in found] == texts


def lamps_text(count: int) -> str:
    return "lamps:\n" + "".join(
        f"  l{n}: {{position: [{n % 316 / 20}, {n // 316 / 20}, 1]}}\n" for n in range(count)
    )


def test_a_map_of_100_000_lamps_is_refused_at_once_with_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "many.yaml"
    path.write_text(lamps_text(100_000))
    began_s = time.process_time()
    message = r"has 200001 keys, limit 80000, and a map holds about 20000 lamps"
    with pytest.raises(ConfigError, match=message):
        read_map_file(path)
    with pytest.raises(ConfigError, match=message):
        parse_map_file(path.read_bytes(), path)
    assert time.process_time() - began_s < 1.0


def test_as_many_lamps_as_a_map_can_have_are_compared_in_a_second() -> None:
    lamps = {f"l{n}": LampEntry(position=(n % 150 / 10, n // 150 / 10, 1.0)) for n in range(20_000)}
    lamps |= {f"twin{n}": LampEntry(position=(1.0, 1.0, 1.0)) for n in range(1000)}
    began_s = time.process_time()
    assert len(list(check_lamps(lamps, None))) == 1000
    assert time.process_time() - began_s < 3.0


COORDINATES = st.integers(0, 3).map(lambda n: n * 0.004)


@given(st.lists(st.tuples(COORDINATES, COORDINATES, COORDINATES), min_size=2, max_size=12))
def test_lamps_at_one_place_are_those_of_a_comparison_of_all_pairs(places: list[Vec3]) -> None:
    lamps = {str(n): LampEntry(position=place) for n, place in enumerate(places)}
    found = [each for each in check_lamps(lamps, (5.0, 5.0)) if "is where" in each.text]
    away_m = np.linalg.norm(np.array(places)[:, None] - np.array(places)[None], axis=2)
    near = away_m + np.eye(len(places)) < SAME_PLACE_M
    assert bool(found) == bool(near.any())
    for each in found:
        index, other = int(each.where.rpartition(".")[2]), int(each.text.split()[2])
        assert other < index
        assert near[index, other]
    exact = [index for index, place in enumerate(places) if place in places[:index]]
    assert {f"lamps.{index}" for index in exact} <= {each.where for each in found}
