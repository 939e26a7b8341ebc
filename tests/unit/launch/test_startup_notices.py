"""Notices at the start of people's services."""

import time

import pytest

from pointit.launch.plan.launches import (
    Choices,
    assumed_places,
    stored_mounting_notices,
    stored_offset_notices,
    user_launches,
)
from pointit.launch.plan.plan import FloorPose, read_scenario
from pointit.runtime.host.state_file import StateFile
from pointit.schemas import PointingOffset
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.stored_mounting import PURPOSE, StoredMounting, StoredMountings
from pointit.services.supervisor.transitions import OFFSET_PURPOSE

SERIAL = "serial:/dev/ttyUSB7"
FITTED_NS = 1_795_172_700_000_000_000


@pytest.fixture(autouse=True)
def in_utc(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()


def said(choices: Choices, user: str = "anna", index: int = 0) -> list[str]:
    chosen = choices.of_one(index)
    launches = user_launches(read_scenario("scenario_3"), chosen, user, index)
    return list(assumed_places(launches, chosen, index))


@pytest.mark.parametrize("index", [0, 1])
def test_notice_states_the_assumed_place_of_people_with_devices(index: int) -> None:
    place = read_scenario("scenario_3").places[index]
    x_m, y_m, _ = place.position_m
    (sentence,) = said(Choices(imu=[SERIAL]), index=index)
    assert sentence == (
        f"anna is assumed to stand at {x_m:.2f}, {y_m:.2f} m, yaw {place.yaw_deg:g}°, as the scenario says; "
        "give --pose X,Y,YAW or --localize to change that"
    )


@pytest.mark.parametrize(
    "choices",
    [
        Choices(),
        Choices(imu=["sim"]),
        Choices(imu=[SERIAL], poses=[FloorPose(x_m=1.0, y_m=2.0)]),
        Choices(imu=[SERIAL], localize=True),
        Choices(imu=[SERIAL], settings=["localizer.yaw_deg=30"]),
    ],
)
@pytest.mark.parametrize("index", [0, 1])
def test_notice_is_omitted_for_given_or_simulated_places(choices: Choices, index: int) -> None:
    assert said(choices, index=index) == []


def test_notices_name_stored_offset_and_mounting_in_use() -> None:
    launches = user_launches(read_scenario("scenario_3"), Choices(imu=[SERIAL]), "anna")
    assert [*stored_mounting_notices(launches), *stored_offset_notices(launches)] == []
    StateFile(PointingOffset, "anna", OFFSET_PURPOSE).write(PointingOffset(rung="pitch", fitted_ns=FITTED_NS))
    (bridge,) = (launch.config for launch in launches if isinstance(launch.config, ImuBridgeConfig))
    same = (0.0, 0.0, 0.0, 1.0)
    own = StoredMounting(sensor_from_arm_xyzw=same, configured=bridge.mounting, set_ns=FITTED_NS)
    mountings = StateFile(StoredMountings, "anna", PURPOSE)
    mountings.write(StoredMountings(by_source={"serial": own}))
    since = "of 2026-11-20 11:05 is in use; `pointit person calibrate"

    assert [*stored_offset_notices(launches)] == [f"anna: an offset {since} user anna --erase` forgets it"]
    assert [*stored_mounting_notices(launches)] == [
        f"anna: a mounting {since} mounting anna --erase` forgets it"
    ]

    mountings.write(StoredMountings(by_source={"replay": own}))  # of another device
    assert list(stored_mounting_notices(launches)) == []
    mountings.path.write_text("{", encoding="utf-8")  # the service complains of it
    assert list(stored_mounting_notices(launches)) == []
