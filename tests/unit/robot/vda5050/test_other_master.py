"""An AGV by VDA 5050 that another master control steers: it is left alone, and said."""

import pytest

from pointit.services.robot.robot_driver import Follow, FollowPath, Stop
from tests.unit.robot.vda5050.agv_bench import AgvBench, connected_bench

FAR = (9.0, 0.0, 0.0)
THEIRS = [{"nodeId": "theirs", "sequenceId": 2, "nodePosition": {"x": 9.0, "y": 0.0}}]
"""Node of an order of another master control."""


def order_of_another(bench: AgvBench) -> None:
    bench.virtual.base = list(THEIRS)
    bench.change(orderId="theirs")


def test_order_of_another_master_at_the_start_is_left_alone() -> None:
    bench = AgvBench()
    order_of_another(bench)
    bench.agv.on_connected()
    bench.hear("visualization", bench.virtual.visualization())
    stop = bench.tell(Stop)  # as the service does at the first report
    bench.run(5.0)
    bench.tell(Stop)
    bench.run(1.0)
    for publication in bench.agv.closing_messages():
        bench.deliver(publication)

    assert bench.outcomes(stop) == [("done", "")]
    assert bench.reports[-1].has_other_master
    assert bench.virtual.base == THEIRS
    assert "cancelOrder" not in str(bench.sent)

    bench.virtual.base = []
    bench.virtual.has_changed = True
    bench.run(0.2)
    assert not bench.reports[-1].has_other_master

    path = bench.tell(FollowPath, ((bench.virtual.place[0] + 1.0, 0.0, 0.0),))
    bench.virtual.extra = {}
    bench.run(3.0)
    assert bench.outcomes(path)[-1] == ("done", "")


@pytest.mark.parametrize("order", [Follow, FollowPath])
def test_order_during_another_masters_fails_and_cancels_nothing(
    order: type[Follow | FollowPath],
) -> None:
    bench = connected_bench()
    target: object = FAR if order is Follow else (FAR,)
    bench.is_lossy = lambda topic: topic.endswith("/order")
    early = bench.tell(order, target)
    bench.run(0.2)
    order_of_another(bench)
    bench.run(3.0)
    late = bench.tell(order, target)
    bench.run(3.0)
    assert bench.outcomes(early)[-1] == ("failed", "another master control has given the AGV an order")
    assert bench.outcomes(late)[-1][0] == "refused"
    assert bench.virtual.base == THEIRS
    assert "cancelOrder" not in str(bench.sent)


def test_other_masters_order_during_a_lost_link_is_not_cancelled() -> None:
    bench = connected_bench()
    bench.tell(FollowPath, (FAR,))
    bench.run(1.0)
    bench.agv.on_disconnected("the broker is gone")
    order_of_another(bench)
    bench.connect()
    bench.run(3.0)
    assert bench.virtual.base == THEIRS
    assert "cancelOrder" not in str(bench.sent)


def test_agv_is_asked_again_when_its_first_state_is_lost() -> None:
    """Nothing is sent before its state is known, and by the standard it sends one every 30 s only."""
    bench = AgvBench()
    bench.is_lossy = lambda topic: topic.endswith("/instantActions")
    bench.connect()
    bench.run(0.1)
    path = bench.tell(FollowPath, ((1.0, 0.0, 0.0),))
    bench.is_lossy = lambda _topic: False
    bench.run(3.0)
    assert bench.outcomes(path)[-1:] == [("done", "")]
