"""Requests of pages: permission and validation."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.web.pages.page_requests import (
    DEEDS,
    OPERATORS,
    REQUESTS,
    Call,
    PageAction,
    Press,
    Tremor,
    parse_request,
)
from pointit.bridges.web.wire import Ask, Deed, Role
from pointit.runtime.errors import PointItError, RefusedError
from pointit.schemas import SchemaError, SetSpeed, StopRobot
from pointit.schemas.topics import SET_MOUNTING, SET_OFFSET, SET_POSE, SET_SPEED, STOP_ROBOT, UNDO_SELECTION


def ask(key: str = "", *, deed: Deed | None = None, name: str = "", **query: Any) -> Ask:
    return Ask(id=1, key=key, deed=deed, name=name, query=query)


def test_a_request_goes_to_its_server_as_the_table_says() -> None:
    call = parse_request(ask(SET_SPEED.key, speed_mps=1, belts=["a", "b"]), "operator")
    assert call == Call(request=SET_SPEED, query=SetSpeed(speed_mps=1.0, belts=("a", "b")), name="")


def test_a_request_about_a_person_names_them() -> None:
    call = parse_request(ask(UNDO_SELECTION.key, name="anna"), "operator")
    assert isinstance(call, Call)
    assert call.name == "anna"


@pytest.mark.parametrize("row", [SET_POSE, SET_MOUNTING, SET_OFFSET])
def test_what_calibration_sets_pages_cannot(row: Any) -> None:
    with pytest.raises(RefusedError, match="pages cannot ask for"):
        parse_request(ask(row.key, name="anna"), "operator")


def test_everybody_who_sees_a_robot_may_stop_it() -> None:
    for role in ("operator", "viewer"):
        call = parse_request(ask(STOP_ROBOT.key, name="quad", reason="too near"), role)
        assert call == Call(request=STOP_ROBOT, query=StopRobot(reason="too near"), name="quad")


@pytest.mark.parametrize("row", [pytest.param(row, id=row.key) for row in OPERATORS if row is not STOP_ROBOT])
def test_a_viewer_may_ask_for_nothing_else(row: Any) -> None:
    assert REQUESTS["viewer"] == (STOP_ROBOT,)
    with pytest.raises(RefusedError, match="only looks on"):
        parse_request(ask(row.key, name="anna" if row.placeholder else ""), "viewer")


@pytest.mark.parametrize("deed", DEEDS["operator"])
def test_a_viewer_may_do_nothing(deed: Deed) -> None:
    assert DEEDS["viewer"] == ()
    with pytest.raises(RefusedError, match="only looks on"):
        parse_request(ask(deed=deed, name="anna"), "viewer")


def test_a_phone_pairs_no_phones() -> None:
    with pytest.raises(RefusedError, match="phone"):
        parse_request(ask(deed="pair", name="anna"), "wrist")
    assert isinstance(parse_request(ask(deed="press", name="anna"), "wrist"), PageAction)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (ask(SET_SPEED.key, speed_mps=99), "speed_mps"),
        (ask(SET_SPEED.key, speed_mps="1"), "speed_mps"),
        (ask(SET_SPEED.key, speed_mps=1, faster=True), "faster"),
        (ask(SET_SPEED.key), "speed_mps"),
        (ask(SET_SPEED.key, name="anna", speed_mps=1), "takes no name"),
        (ask("no/such"), "pages cannot ask for 'no/such'"),
        (ask(), "pages cannot ask for ''"),
        (ask(deed="press", name="anna", gesture="kick"), "gesture"),
        (ask(deed="tremor", name="anna", rms_deg=50), "rms_deg"),
        (ask(deed="tremor", name="anna"), "rms_deg"),
        (ask(deed="take", name="anna", by="force"), "by"),
        (ask(SET_SPEED.key, deed="press", name="anna"), "one thing at a time"),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(wrong: Ask, sentence: str) -> None:
    with pytest.raises(RefusedError, match=sentence):
        parse_request(wrong, "operator")


@pytest.mark.parametrize("name", ["", "*", "../x", "a/b", "-x", "a" * 65])
def test_a_name_must_be_one(name: str) -> None:
    with pytest.raises(SchemaError):
        parse_request(ask(UNDO_SELECTION.key, name=name[:64] if len(name) < 65 else ""), "operator")
    with pytest.raises((SchemaError, RefusedError)):
        parse_request(ask(deed="press", name=name[:64] if len(name) < 65 else "*"), "operator")


def test_deeds_have_parameters() -> None:
    press = parse_request(ask(deed="press", name="anna", gesture="hold"), "operator")
    assert press == PageAction(deed="press", user="anna", extras=Press(gesture="hold"))
    tremor = parse_request(ask(deed="tremor", name="anna", rms_deg=1), "operator")
    assert tremor == PageAction(deed="tremor", user="anna", extras=Tremor(rms_deg=1.0))


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=10,
)


@given(
    key=st.sampled_from([row.key for row in OPERATORS]) | st.text(max_size=64),
    deed=st.none() | st.sampled_from(DEEDS["operator"]),
    name=st.just("anna") | st.text(max_size=64),
    query=st.dictionaries(
        st.sampled_from(["speed_mps", "belts", "kind", "rms_deg", "gesture", "dwell_s"]) | st.text(),
        JSON,
        max_size=3,
    ),
    role=st.sampled_from(["operator", "viewer", "wrist"]),
)
def test_whatever_is_asked_is_understood_or_refused(
    key: str, deed: Deed | None, name: str, query: dict[str, Any], role: Role
) -> None:
    try:
        meant = parse_request(Ask(id=1, key=key, deed=deed, name=name, query=query), role)
    except (PointItError, SchemaError):
        return
    if isinstance(meant, Call):
        assert meant.request in REQUESTS[role]
        assert isinstance(meant.query, meant.request.query)
    else:
        assert meant.deed in DEEDS[role]
