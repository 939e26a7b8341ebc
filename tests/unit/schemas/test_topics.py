"""The topic table: keys, names that may stand in them, and the way back from a key to its row."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import KeyNameError
from pointit.schemas.topics import (
    ANY,
    IMU,
    MAP,
    PRESENCES,
    REQUESTS,
    TOPICS,
    Delivery,
    Topic,
    check_name,
    topic_of,
)

names = st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9_.\-]{0,63}", fullmatch=True)
topics = [pytest.param(topic, id=topic.key) for topic in TOPICS]
rows: list[Any] = [*TOPICS, *REQUESTS, *PRESENCES]


@given(names)
def test_every_row_is_found_by_its_keys(name: str) -> None:
    for topic in TOPICS:
        its = name if topic.placeholder else ""
        assert topic_of(topic.at(its)) is topic
        assert topic.name_in(topic.at(its)) == its


@pytest.mark.parametrize(
    "key",
    [
        "", "users", "users/anna", "users/anna/shoe", "users//imu", "users/a/b/imu", "users/*/imu/x", "map/",
        "/map", "xmap", "users/-anna/imu", "users/anna/imux", "xusers/anna/imu", "users/imu",
        "users/{user}/imu",
    ],
)  # fmt: skip
def test_other_keys_belong_to_no_row(key: str) -> None:
    assert topic_of(key) is None


@given(st.text(max_size=30))
def test_no_key_makes_the_lookup_fail(key: str) -> None:
    topic_of(key)
    topic_of(f"users/{key}/imu")


@pytest.mark.parametrize(
    "name",
    [
        "", "*", "**", "$*", "a*", "a/b", "/", "a b", "a#", "a?", "a{b}", "ä", "-a", ".a", "a\n",
        "a\x00", "a" * 65,
    ],
)  # fmt: skip
def test_names_that_cannot_stand_in_a_key_are_refused(name: str) -> None:
    with pytest.raises(KeyNameError, match=r"^user '.*': use 1 to 64 letters"):
        check_name(name, "user")
    if name != ANY:
        with pytest.raises(KeyNameError, match=r"^user "):
            IMU.at(name)


def test_any_stands_for_all_names() -> None:
    assert IMU.at(ANY) == "users/*/imu"
    assert MAP.at(ANY) == MAP.at() == "map"


def test_a_key_without_a_placeholder_takes_no_name() -> None:
    with pytest.raises(KeyNameError, match="map takes no name, got 'anna'"):
        MAP.at("anna")


def test_no_two_rows_share_a_key() -> None:
    keys = [row.at(ANY).replace(ANY, "x") for row in rows]
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize("topic", topics)
def test_only_what_comes_steadily_goes_stale(topic: Topic[Any]) -> None:
    if topic.rate_hz is None:
        assert topic.stale_after_s is None
    else:
        assert topic.delivery is Delivery.LATEST
        assert topic.stale_after_s == 10 / topic.rate_hz
