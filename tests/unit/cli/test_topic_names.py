"""Topics and names that typed keys resolve to."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.cli.common.lazy import UnknownNameError
from pointit.cli.common.topic_names import Wanted, resolve, resolve_all
from pointit.schemas.topics import CURSOR, HEALTH, IMU, MAP, OBJECTS, SELECTION, SELECTION_EVENTS, TOPICS


@pytest.mark.parametrize(
    ("typed", "wanted"),
    [
        ("users/anna/imu", [(IMU, "anna")]),
        ("/users/anna/imu/", [(IMU, "anna")]),
        ("users/*/cursor", [(CURSOR, "*")]),
        ("users/{user}/cursor", [(CURSOR, "*")]),
        ("map", [(MAP, "")]),
        ("*", [(MAP, ""), (SELECTION, "")]),
        ("objects/*", [(OBJECTS, "*")]),
        ("selection/**", [(SELECTION, ""), (SELECTION_EVENTS, "")]),
        ("health/pointing.anna", [(HEALTH, "pointing.anna")]),
    ],
)
def test_keys_stand_for_rows_and_names(typed: str, wanted: list[Wanted]) -> None:
    assert [pair for pair in resolve(typed) if pair[0].key != "clock"] == wanted


def test_all_of_one_person() -> None:
    found = resolve("users/anna/*")
    assert {name for _, name in found} == {"anna"}
    assert [topic for topic, _ in found] == [topic for topic in TOPICS if topic.placeholder == "user"]


def test_everything_is_every_row() -> None:
    assert [topic for topic, _ in resolve("**")] == list(TOPICS)


def test_doubles_count_once() -> None:
    assert resolve_all(["map", "users/*/imu", "map"]) == [(MAP, ""), (IMU, "*")]


@given(st.sampled_from(TOPICS), st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,20}", fullmatch=True))
def test_every_key_of_the_table_is_found_by_itself(topic: object, name: str) -> None:
    row = next(other for other in TOPICS if other is topic)
    wanted = name if row.placeholder else ""
    assert resolve(row.at(wanted)) == [(row, wanted)]


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("users/anna/imuu", "did you mean users/anna/imu"),
        ("user/anna/cursor", "users/anna/cursor"),
        ("mapp", "did you mean map"),
        ("zzzzzzzz", "`pointit topic list` shows them all"),
        ("conveyor/reset", "is something to ask for"),
        ("alive/users/anna", "is presence"),
        ("users/a b/imu", "use 1 to 64 letters"),
        ("", "no topic has the key ''"),
    ],
)
def test_unknown_keys_get_one_sentence(typed: str, said: str) -> None:
    with pytest.raises(UnknownNameError) as caught:
        resolve(typed)
    assert said in caught.value.message
    assert "\n" not in caught.value.message
    assert caught.value.exit_code == 2
