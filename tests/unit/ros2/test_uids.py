"""Numbers of things: kept digits, stable, reversible, bounded."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.routing.uids import MAX_NUMBER, Kinds, Uids


def test_digits_are_kept_where_they_are_free() -> None:
    uids = Uids()
    assert uids.number("package12") == 12
    assert uids.number("19a1-12") != 12
    assert uids.number("package12") == 12
    assert uids.number("robot") != uids.number("drone")


def test_digits_that_do_not_fit_are_not_kept() -> None:
    uids = Uids()
    assert uids.number("a-4294967296") <= MAX_NUMBER
    assert Uids(255).number("strip-300") <= 255
    assert Uids(255).number("strip-255") == 255


@given(st.lists(st.text(max_size=12) | st.integers(0, 30).map(lambda n: f"p{n}"), max_size=60))
def test_numbers_are_stable_apart_and_lead_back(names: list[str]) -> None:
    uids = Uids()
    numbers = {name: uids.number(name) for name in names}
    assert len(set(numbers.values())) == len(numbers)
    for name, number in numbers.items():
        assert uids.number(name) == number
        assert uids.name(number) == name
        assert 0 <= number <= MAX_NUMBER


@given(
    st.lists(
        st.tuples(st.sampled_from(("number", "bind")), st.integers(0, 9), st.integers(0, 9)), max_size=80
    )
)
def test_whatever_is_bound_both_directions_agree(steps: list[tuple[str, int, int]]) -> None:
    uids = Uids(most=9, kept=6)
    names: set[str] = set()
    for what, number, who in steps:
        name = f"p{who}"
        names.add(name)
        if what == "bind":
            uids.bind(number, name)
            assert uids.number(name) == number
        else:
            assert uids.name(uids.number(name)) == name
        held = [found for number in range(10) if (found := uids.name(number)) is not None]
        assert len(held) == len(set(held)) <= 10
        assert set(held) <= names


def test_a_number_that_was_asked_for_goes_to_who_comes_next() -> None:
    uids = Uids()
    uids.number("old-1")
    uids.reserve(7)
    assert uids.is_settled("old-1")
    assert not uids.is_settled("new-2")
    uids.bind(7, "new-2")
    uids.end_reservation(7)
    assert uids.is_settled("other-3")
    assert uids.number("new-2") == 7
    uids.bind(1, "new-2")  # takes it from the other, and leaves its own
    assert (uids.name(1), uids.name(7)) == ("new-2", None)
    assert uids.number("old-1") != 1
    with pytest.raises(ValueError, match="beyond"):
        uids.bind(MAX_NUMBER + 1, "x")


def test_names_used_longest_ago_are_forgotten() -> None:
    uids = Uids(kept=3)
    for name in ("a1", "b2", "c3", "a1", "d4"):
        uids.number(name)
    assert [uids.name(number) for number in (1, 2, 3, 4)] == ["a1", None, "c3", "d4"]


def test_all_numbers_are_given_before_any_comes_again() -> None:
    uids = Uids(most=9)
    assert {uids.number(f"p{chr(97 + n)}") for n in range(10)} == set(range(10))
    assert uids.number("one more") in range(10)


def test_kinds_have_numbers_and_back() -> None:
    kinds = Kinds(("blue", "red", "blue"))
    assert [kinds.number(kind) for kind in ("blue", "red", "pink")] == [0, 1, Kinds.OTHER]
    assert [kinds.kind(number) for number in (0, 1, 2, 3, 255, -1)] == [
        "blue",
        "red",
        "blue",
        None,
        None,
        None,
    ]
