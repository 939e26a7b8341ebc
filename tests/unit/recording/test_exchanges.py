"""Accounts of answered requests as entries."""

import pytest

from pointit.recording.entries import Exchange, entry_of
from pointit.schemas import Query, ServedRequest, SetBrightness, SetPose, UndoSelection
from pointit.schemas.topics import SET_BRIGHTNESS, SET_POSE, UNDO_SELECTION

POSE = SetPose(position_m=(1.0, 2.0, 0.0), yaw_rad=0.5)


def account(key: str, query: Query) -> ServedRequest:
    return ServedRequest(
        stamp_ns=7,
        service="led-driver",
        instance="led-driver",
        request=key,
        query=query.model_dump_json(),
        refusal="no",
    )


@pytest.mark.parametrize(
    ("instance", "key", "query"),
    [
        ("localizer.anna", SET_POSE.at("anna"), POSE),
        ("selector", UNDO_SELECTION.at("anna"), UndoSelection()),
        ("led-driver", SET_BRIGHTNESS.key, SetBrightness(brightness=0.5)),
    ],
)
def test_account_of_the_service_that_answers_is_an_exchange(instance: str, key: str, query: Query) -> None:
    found = entry_of(account(key, query), instance, 9)
    assert found is not None
    assert (found.key, found.time_ns) == (key, 9)
    assert isinstance(found.body, Exchange)
    assert (found.body.query, found.body.refusal) == (query, "no")


@pytest.mark.parametrize(
    ("instance", "key", "query"),
    [
        ("pointing.anna", SET_POSE.at("anna"), POSE),
        ("localizer.ben", SET_POSE.at("anna"), POSE),
        ("plugin", SET_BRIGHTNESS.key, SetBrightness(brightness=0.5)),
        ("led-driver", "nothing/of/ours", SetBrightness(brightness=0.5)),
        ("led-driver", SET_BRIGHTNESS.key, UndoSelection()),
    ],
)
def test_account_of_what_a_service_cannot_have_answered_is_left_out(
    instance: str, key: str, query: Query
) -> None:
    assert entry_of(account(key, query), instance, 9) is None
