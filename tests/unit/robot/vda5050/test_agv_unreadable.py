"""An AGV that keeps VDA 5050 only partly: it is steered by what can be read, and health names the rest."""

import json

import pytest

from pointit.services.robot.robot_driver import Follow, FollowPath
from tests.unit.robot.vda5050.agv_bench import AgvBench, connected_bench, orders

FAR = (9.0, 0.0, 0.0)


@pytest.fixture(name="bench")
def _bench() -> AgvBench:
    return connected_bench()


def test_agv_is_steered_despite_unreadable_fields_which_health_reports(bench: AgvBench) -> None:
    for charge in (-1, -2):
        bench.change(batteryState={"batteryCharge": charge}, errors=None, lastNodeSequenceId=None)
        bench.run(0.1)
    assert bench.reports[-1].battery is None
    assert bench.health.warnings["message state"] == (
        "uagv/v2/acme/7/state: batteryCharge is -1; correct it at the AGV, or update its software to keep "
        "VDA 5050"
    )
    bench.change(batteryState={"batteryCharge": 100})
    path = bench.tell(FollowPath, ((1.0, 0.0, 0.0),))
    bench.run(3.0)
    assert bench.outcomes(path)[-1] == ("done", "")
    assert bench.reports[-1].battery == 1.0
    assert "message state" not in bench.health.warnings


@pytest.mark.parametrize("header", [{"headerId": 0}, {"headerId": None}, {"timestamp": None}])
def test_agv_without_a_counter_is_steered(header: dict[str, object]) -> None:
    bench = AgvBench()
    bench.change(**header)
    bench.connect()
    path = 0
    for run in range(60):
        bench.run(0.05)
        bench.hear("state", bench.virtual.state())
        path = path or (bench.tell(FollowPath, ((1.0, 0.0, 0.0),)) if run else 0)
    assert bench.outcomes(path)[-1] == ("done", "")


def test_agv_with_an_unreadable_emergency_stop_gets_no_order(bench: AgvBench) -> None:
    bench.change(safetyState=None)
    bench.run(0.1)
    assert "safetyState is missing" in bench.health.warnings["message state"]
    order = bench.tell(Follow, FAR)
    bench.run(1.0)
    assert bench.outcomes(order)[-1][0] == "refused"
    assert "safetyState.eStop is not stated" in bench.outcomes(order)[-1][1]
    assert orders(bench) == []


def test_agv_is_reported_as_standing_only_if_it_says_so(bench: AgvBench) -> None:
    bench.change(driving=None)
    bench.run(0.1)
    bench.is_lossy = lambda _topic: True
    before = len(bench.reports)
    bench.run(3.0)
    assert len(bench.reports) == before


def test_agv_without_a_position_says_so(bench: AgvBench) -> None:
    bench.connect()
    bench.virtual.extra = {"agvPosition": {"x": "?", "y": 1.0}}
    bench.hear("state", bench.virtual.state())
    assert bench.lost[-1].startswith("the AGV reports no agvPosition")
    assert "x is '?'" in bench.health.warnings["message state"]


def test_agv_without_a_map_is_reported_if_one_is_configured() -> None:
    bench = AgvBench(map_id="hall")
    bench.change(agvPosition={"x": 1.0, "y": 2.0, "theta": 0.0, "mapId": None})
    bench.connect()
    bench.hear("state", bench.virtual.state())
    assert bench.lost[-1] == (
        "the AGV states no mapId, and `map_id` is 'hall': set it at the AGV, or leave `map_id` empty"
    )


def test_heading_in_degrees_is_reported_and_the_position_is_used(bench: AgvBench) -> None:
    where = {"x": 2.0, "y": 3.0, "theta": 90.0, "mapId": "hall", "positionInitialized": True}
    bench.hear("visualization", json.dumps({"headerId": 900, "agvPosition": where}).encode())
    assert bench.reports[-1].position_m == (2.0, 3.0, 0.0)
    assert "theta is 90.0" in bench.health.warnings["message visualization"]


@pytest.mark.parametrize("prefix", ["/plant/uagv/2.0", "/plant/uagv/2.0/"])
def test_topics_with_other_first_levels_can_be_named(prefix: str) -> None:
    bench = AgvBench(topic_prefix=prefix)
    publication = bench.agv.on_connected()
    assert publication[0] == "/plant/uagv/2.0/acme/7/instantActions"
    bench.hear("state", bench.virtual.state())
    assert bench.reports[-1].position_m == (0.0, 0.0, 0.0)
