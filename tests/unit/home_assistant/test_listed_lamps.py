"""Homes of any size: their lamps are listed as far as a message has room, and what is stored is read."""

from pathlib import Path

import pytest

from pointit.bridges.home_assistant.entities import HomeEntity
from pointit.bridges.home_assistant.setup.home_files import HomeFiles
from pointit.bridges.home_assistant.setup.listed_lamps import (
    MAX_OFFERED,
    REST_BYTES,
    fitting_lamps,
    listable_entities,
)
from pointit.bridges.home_assistant.setup.progress import MAX_LAMPS, ChosenLamp, LampPress, StoredSetup
from pointit.schemas import HomeSetup, decode, encode
from pointit.schemas.base import MAX_ID
from pointit.schemas.home import HomeLamp

TEXT = "\U0001f4a1" * MAX_ID
"""Text of the maximum number of characters, and of the maximum number of bytes for each."""


def entity(name: str) -> HomeEntity:
    return HomeEntity(area="", entity=name, name="", state="on")


def test_entities_whose_ids_no_message_can_have_are_left_out() -> None:
    long = [entity(f"light.{'x' * 329}"), entity(f"light.{'x' * 250}"), entity("light.desk")]
    listed = listable_entities(long)
    assert [len(each.entity) for each in listed] == [MAX_ID, 10]
    many = [entity(f"switch.s{number}") for number in range(MAX_OFFERED + 7)]
    assert listable_entities(many) == many[:MAX_OFFERED]


@pytest.mark.parametrize(
    ("count", "text", "is_whole"), [(1400, "Lamp in the hall", True), (MAX_OFFERED, TEXT, False)]
)
def test_list_of_lamps_fits_into_its_message(count: int, text: str, *, is_whole: bool) -> None:
    lamps = [
        HomeLamp(id=f"light.{number:0250}", label=text, area=text, is_chosen=number >= count - 64)
        for number in range(count)
    ]
    listed = fitting_lamps(lamps)
    assert (listed == lamps) == is_whole
    assert [lamp for lamp in listed if lamp.is_chosen] == lamps[-64:]
    sentence = "\U0001f4a1" * 500
    reply = HomeSetup(step="choose", lamps=tuple(listed), advice=(sentence,) * 16, problem=sentence)
    payload = encode(reply)
    assert len(payload) <= HomeSetup.max_bytes
    assert decode(HomeSetup, payload) == reply


def test_chosen_lamps_with_the_longest_reasons_fit_beside_the_list() -> None:
    lamp = HomeLamp(id=TEXT, label=TEXT, area=TEXT, state=TEXT, reason="\U0001f4a1" * 500)
    assert 40 * len(encode(lamp)) < HomeSetup.max_bytes - REST_BYTES
    lamps = [lamp.model_copy(update={"id": f"{number:0256}"}) for number in range(MAX_LAMPS)]
    assert fitting_lamps(lamps) == lamps


def test_largest_setup_is_read_again(tmp_path: Path) -> None:
    lamps = tuple(
        ChosenLamp(id=f"{number:05}{TEXT[5:]}", label=TEXT, area=TEXT) for number in range(MAX_LAMPS)
    )
    setup = StoredSetup(
        step="place",
        lamps=lamps,
        offered=tuple(f"{number:05}{TEXT[5:]}" for number in range(MAX_OFFERED)),
        presses=tuple(
            LampPress(lamp=lamp.id, end="", place=place, azimuth_rad=0.1, elevation_rad=0.1, eyes_m=1.6)
            for lamp in lamps
            for place in ("A", "B")
        ),
        left_out={lamp.id: TEXT for lamp in lamps},
    )
    file = HomeFiles(tmp_path).state
    file.write(setup)
    assert file.read() == setup
