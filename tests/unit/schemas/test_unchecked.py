"""Constructors that do not validate: the same messages, and nothing wrong gets past who validates."""

import math
import pickle
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from pointit.schemas import Cursor, DecodeError, Hover, Message, PointingRay, decode, encode
from pointit.schemas.base import ConstructorChecks, unchecked
from pointit.schemas.topics import TOPICS
from tests.unit.schemas.strategies import messages

KINDS = sorted({topic.message for topic in TOPICS}, key=lambda kind: kind.__name__)
AHEAD = (1.0, 0.0, 0.0)
EYES = (0.0, 0.0, 1.6)


@pytest.fixture(params=[True, False], ids=["validated", "not validated"])
def either_way(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ConstructorChecks, "are_on", request.param)


@pytest.fixture
def as_in_production(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ConstructorChecks, "are_on", False)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@given(data=st.data())
def test_unchecked_message_behaves_like_a_validated_one(kind: type[Message], data: st.DataObject) -> None:
    checked = data.draw(messages(kind))  # once for both: a draw takes longer than all the rest
    values = dict(reversed(vars(checked).items()))  # the order of the call is not the bytes'
    for are_on in (True, False):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ConstructorChecks, "are_on", are_on)
            made = unchecked(kind)(**values)
        assert (made, type(made), repr(made), hash(made)) == (checked, kind, repr(checked), hash(checked))
        assert encode(made) == encode(checked)
        assert made.model_dump() == checked.model_dump()
        assert made.model_copy(update={"seq": 7}) == checked.model_copy(update={"seq": 7})
        assert pickle.loads(pickle.dumps(made)) == checked  # noqa: S301 - our own


@pytest.mark.usefixtures("either_way")
def test_defaults_are_those_of_the_message() -> None:
    assert encode(unchecked(Hover)(stamp_ns=5)) == encode(Hover(stamp_ns=5))
    assert encode(unchecked(Cursor)(stamp_ns=5)) == encode(Cursor(stamp_ns=5))
    ray = PointingRay(stamp_ns=5, origin_m=EYES, direction=AHEAD)
    assert encode(unchecked(PointingRay)(stamp_ns=5, origin_m=EYES, direction=AHEAD)) == encode(ray)


@pytest.mark.usefixtures("as_in_production")
def test_unchecked_message_is_frozen() -> None:
    ray = unchecked(PointingRay)(stamp_ns=5, origin_m=EYES, direction=AHEAD)
    with pytest.raises(ValidationError, match="frozen"):
        ray.direction = EYES  # pyrefly: ignore[read-only]
    copied = ray.model_copy(update={"seq": 3})
    assert (ray.seq, ray.model_fields_set) == (0, copied.model_fields_set)


WRONG = [(math.nan, 0.0, 0.0), (2.0, 0.0, 0.0), [1.0, 0.0, 0.0], (1.0, 0.0), None]


@pytest.mark.parametrize("direction", WRONG)
def test_tests_find_a_wrong_value_where_it_is_made(direction: Any) -> None:
    with pytest.raises(ValidationError, match="direction"):
        unchecked(PointingRay)(stamp_ns=5, origin_m=EYES, direction=direction)


def test_unchecked_message_in_tests_refuses_values_that_would_be_converted() -> None:
    with pytest.raises(TypeError, match="converts a value"):
        unchecked(Hover)(stamp_ns=5, progress=1)


@pytest.mark.usefixtures("as_in_production")
@pytest.mark.parametrize("direction", [(math.nan, 0.0, 0.0), (2.0, 0.0, 0.0), (1.0, 0.0), None])
def test_receiver_refuses_unchecked_messages_with_wrong_values(direction: Any) -> None:
    ray = unchecked(PointingRay)(stamp_ns=5, origin_m=EYES, direction=direction)
    with pytest.raises(DecodeError, match="direction"):
        decode(PointingRay, encode(ray))


@pytest.mark.usefixtures("as_in_production")
@pytest.mark.parametrize("direction", WRONG)
def test_normal_constructor_always_validates(direction: Any) -> None:
    with pytest.raises(ValidationError, match="direction"):
        PointingRay(stamp_ns=5, origin_m=EYES, direction=direction)
