"""`ExpiringDict`: the newest value of each key, for a while."""

from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas.expiring_dict import ExpiringDict

MAX_AGE_NS = 10
MAX_KEYS = 3
PUTS = st.lists(st.tuples(st.sampled_from("abcde"), st.integers(0, 8)), max_size=30)
"""Keys, and the time that passes before each is put, ns."""


def test_value_ends_when_its_key_has_been_silent_for_its_age() -> None:
    hovers = ExpiringDict[str, str](MAX_AGE_NS)
    hovers.put("anna", "box", 0)
    hovers.put("ben", "lamp", 4)
    assert hovers.next_expiry_ns() == 10

    assert hovers.expire(9) == []
    assert hovers.expire(10) == ["anna"]
    assert dict(hovers) == {"ben": "lamp"}

    hovers.put("ben", "door", 12)
    assert hovers.expire(14) == []
    assert hovers.expire(22) == ["ben"]
    assert hovers.next_expiry_ns() is None


def test_value_from_the_future_ends_since_the_clock_was_set_back() -> None:
    hovers = ExpiringDict[str, str](MAX_AGE_NS)
    hovers.put("anna", "box", 100)
    assert hovers.expire(99) == ["anna"]


def test_age_may_depend_on_the_value() -> None:
    leases = ExpiringDict[str, int](lambda age_ns: age_ns)
    leases.put("short", 5, 0)
    leases.put("long", 50, 0)
    assert leases.next_expiry_ns() == 5
    assert leases.expire(5) == ["short"]
    assert leases.next_expiry_ns() == 50


def test_discarded_value_is_told_once() -> None:
    hovers = ExpiringDict[str, str](MAX_AGE_NS)
    hovers.put("anna", "box", 0)
    assert hovers.discard("anna")
    assert not hovers.discard("anna")


@given(PUTS)
def test_key_that_was_silent_for_longest_makes_room(puts: list[tuple[str, int]]) -> None:
    newest = ExpiringDict[str, int](MAX_AGE_NS, max_keys=MAX_KEYS)
    arrivals: dict[str, int] = {}
    now_ns = 0
    for number, (key, passed_ns) in enumerate(puts):
        now_ns += passed_ns
        newest.expire(now_ns)
        newest.put(key, number, now_ns)

        arrivals = {other: at_ns for other, at_ns in arrivals.items() if now_ns - at_ns < MAX_AGE_NS}
        arrivals.pop(key, None)
        arrivals[key] = now_ns
        arrivals = dict(list(arrivals.items())[-MAX_KEYS:])
        assert list(newest) == list(arrivals)
        assert newest[key] == number
        assert newest.next_expiry_ns() == min(arrivals.values()) + MAX_AGE_NS
