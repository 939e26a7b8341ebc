"""Numbers of things that are told apart from each place of the floor, as pages get them."""

import asyncio
import threading
from itertools import chain

import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from pointit.bridges.web.model import separability
from pointit.bridges.web.model.separability import Floor, FloorSeparability
from pointit.maps.checks.things import TESTED
from pointit.maps.checks.things import separability as share_of
from pointit.maps.file import load_map
from pointit.maps.picture import map_figure
from pointit.runtime.errors import RefusedError
from pointit.schemas import Environment

SHELF = load_map("shelf", 0)


def test_floor_has_the_squares_and_numbers_of_the_command() -> None:
    figure = map_figure(SHELF, {}, "shelf", separability=share_of(SHELF.things))
    (mesh,) = (each for each in figure.axes[0].collections if isinstance(each, QuadMesh))
    floor = separability.floor(SHELF)
    count = len(SHELF.things)
    x_m, y_m = np.asarray(mesh.get_coordinates(), dtype=np.float64).transpose(2, 0, 1)
    np.testing.assert_allclose(x_m[0], floor["x_m"])
    np.testing.assert_allclose(y_m[:, 0], floor["y_m"])
    shares = np.asarray(floor["told_apart"]) / count
    np.testing.assert_allclose(np.asarray(mesh.get_array(), dtype=np.float64), shares)
    for told, pairs in zip(chain(*floor["told_apart"]), chain(*floor["confused"]), strict=True):
        assert (told == count) == (pairs == []), "a thing that is not told apart has a name"


async def test_floor_is_computed_in_a_thread_once_a_map(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    computed: list[tuple[str, bool]] = []

    def floor(room: Environment) -> Floor:
        computed.append((room.name, threading.current_thread() is threading.main_thread()))
        return Floor(x_m=[], y_m=[], things=[room.name], told_apart=[], confused=[], uncovered=[])

    monkeypatch.setattr(separability, "floor", floor)
    asked = FloorSeparability()
    asked.set_room(SHELF)
    both = await asyncio.gather(asked.answer(), asked.answer())
    assert [each["things"] for each in both] == [["shelf"]] * 2
    asked.set_room(SHELF.model_copy(update={"stamp_ns": 7, "seq": 9}))  # published again
    assert (await asked.answer())["things"] == ["shelf"]
    asked.set_room(SHELF.model_copy(update={"name": "other"}))
    assert (await asked.answer())["things"] == ["other"]
    assert computed == [("shelf", False), ("other", False)]


@pytest.mark.parametrize(("count", "sentence"), [(0, "add a section `things`"), (TESTED + 1, "limit 200")])
async def test_floor_is_refused_when_things_are_missing_or_too_many(count: int, sentence: str) -> None:
    asked = FloorSeparability()
    with pytest.raises(RefusedError, match="no things"):
        await asked.answer()
    asked.set_room(SHELF.model_copy(update={"things": (SHELF.things[0],) * count}))
    with pytest.raises(RefusedError, match=sentence):
        await asked.answer()
