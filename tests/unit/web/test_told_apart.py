"""What a page is told of the things that are told apart from each place of the floor."""

import asyncio
import threading
from itertools import chain

import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from pointit.bridges.web.model import told_apart
from pointit.bridges.web.model.told_apart import ToldApart
from pointit.maps.checks.things import TESTED
from pointit.maps.checks.things import told_apart as share_of
from pointit.maps.file import load_map
from pointit.maps.picture.picture import map_figure
from pointit.runtime.errors import RefusedError
from pointit.schemas import Environment

SHELF = load_map("shelf", 0)


def test_the_page_has_the_squares_and_the_numbers_of_the_command() -> None:
    figure = map_figure(SHELF, {}, "shelf", told_apart=share_of(SHELF.things))
    (mesh,) = (each for each in figure.axes[0].collections if isinstance(each, QuadMesh))
    floor = told_apart.floor(SHELF)
    corners = np.stack(np.meshgrid(floor["x_m"], floor["y_m"]), axis=-1)
    np.testing.assert_allclose(mesh.get_coordinates(), corners)
    shares = np.asarray(floor["told_apart"]) / len(floor["things"])
    np.testing.assert_allclose(np.asarray(mesh.get_array()), shares)
    for told, pairs in zip(np.ravel(floor["told_apart"]), chain(*floor["confused"]), strict=True):
        assert (told == len(floor["things"])) == (pairs == []), "who is not told apart has a name"


async def test_the_floor_is_computed_beside_the_loop_and_once_for_each_map(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    computed: list[tuple[str, bool]] = []

    def floor(room: Environment) -> dict[str, str]:
        computed.append((room.name, threading.current_thread() is threading.main_thread()))
        return {"of": room.name}

    monkeypatch.setattr(told_apart, "floor", floor)
    asked = ToldApart()
    asked.take(SHELF)
    assert await asyncio.gather(asked.answer(), asked.answer()) == [{"of": "shelf"}] * 2
    asked.take(SHELF.model_copy(update={"stamp_ns": 7, "seq": 9}))  # published again
    assert await asked.answer() == {"of": "shelf"}
    asked.take(SHELF.model_copy(update={"name": "other"}))
    assert await asked.answer() == {"of": "other"}
    assert computed == [("shelf", False), ("other", False)]


@pytest.mark.parametrize(("count", "sentence"), [(0, "add a section `things`"), (TESTED + 1, "limit 200")])
async def test_without_things_or_with_too_many_it_is_refused(count: int, sentence: str) -> None:
    asked = ToldApart()
    with pytest.raises(RefusedError, match="no things"):
        await asked.answer()
    asked.take(SHELF.model_copy(update={"things": (SHELF.things[0],) * count}))
    with pytest.raises(RefusedError, match=sentence):
        await asked.answer()
