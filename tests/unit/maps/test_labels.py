"""Labels of things that are spoken: those that sound alike, and those that take too long."""

import pytest

from pointit.maps.checks.things import check_labels, spoken_words, syllable_count
from pointit.schemas import Thing


def findings(*labels: str) -> list[str]:
    size = (0.2, 0.2, 0.2)
    things = [
        Thing(id=f"t{index}", label=label, center_m=(1.0, 0.0, 1.0), size_m=size)
        for index, label in enumerate(labels)
    ]
    return [f"{each.where}: {each.text}" for each in check_labels(things)]


@pytest.mark.parametrize(
    ("first", "second"), [("bolts", "volts"), ("Nuts", "mats"), ("Tür", "dur"), ("left door", "lift tour")]
)
def test_labels_of_similar_letters_are_reported_as_sounding_alike(first: str, second: str) -> None:
    assert findings(first, second) == [f"things.t1: {second!r} sounds like {first!r} of t0; change one label"]


@pytest.mark.parametrize(
    ("first", "second"),
    [("bin 1", "bin 11"), ("fifteen", "fifty"), ("bin 5", "bin 50"), ("box 13", "box 30")],
)
def test_numbers_that_are_taken_for_each_other_sound_alike(first: str, second: str) -> None:
    assert findings(first, second)[0] == (
        f"things.t1: {second!r} sounds like {first!r} of t0; change one label"
    )


def test_labels_whose_first_three_syllables_are_the_same_begin_alike() -> None:
    found = findings("Kaffeemaschine oben links", "Kaffeemaschine oben rechts", "Kaffee")
    assert found[0] == (
        "things.t1: 'Kaffeemaschine oben rechts' begins for 0.6 s as 'Kaffeemaschine oben links' of t0; "
        "say first what differs"
    )
    assert len(found) == 2


@pytest.mark.parametrize(
    ("first", "second"),
    [("radio", "kettle"), ("box 1", "box 2"), ("door", "lamp"), ("灯", "门"), ("bin 10", "bin 1")],
)
def test_labels_that_sound_different_are_not_reported(first: str, second: str) -> None:
    assert findings(first, second) == []


def test_a_label_of_more_than_three_syllables_takes_too_long() -> None:
    assert findings("radio", "heater", "washing machine") == [
        ("things: labels take longer than 0.6 s to speak: 'washing machine' (0.8 s); give shorter ones")
    ]
    many = findings(*(f"washing machine {letter}" for letter in "abcdefghijkl"))
    assert many[-1].endswith(" and 2 more; give shorter ones")


def test_long_ids_without_a_label_are_no_labels() -> None:
    assert findings("", "", "") == []


def test_digits_and_accents_count_as_spoken() -> None:
    assert spoken_words("Café_27") == ["cafe", "twenty", "seven"]
    assert spoken_words("bin 11, 105, 07") == ["bin", "eleven", "one", "zero", "five", "zero", "seven"]
    assert [syllable_count(word) for word in ("table", "stove", "the", "rhythm", "灯")] == [2, 1, 1, 1, 1]
