"""Addresses of ROS's router."""

import pytest
from pydantic import ValidationError

from pointit.bridges.ros2.config import BackendConfig, Ros2Config
from pointit.bridges.ros2.graph.addresses import check_apart, place_of
from pointit.bridges.ros2.service import Ros2
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, check_launches

ROS = "tcp/127.0.0.1:7447"


def launch(**backend: object) -> Launch:
    config = Ros2Config(backend=BackendConfig.model_validate(backend))
    return Launch(service=Ros2, config=config)


@pytest.mark.parametrize(
    "own", [ROS, "tls/localhost:7447", "tcp/[::]:7447", "tcp/0.0.0.0:7447", "tls/127.0.0.1:7447#root=/a.pem"]
)
def test_one_port_is_not_both(own: str) -> None:
    with pytest.raises(ConfigError) as caught:
        check_launches([launch()], ["tcp/other:7447", own])
    assert str(caught.value) == (
        f"ros2: backend.endpoint {ROS} is where this command has PointIt itself ({own}), and one port is "
        "either ROS's router or PointIt's: say with --connect where PointIt is (a run with --ros2 is at "
        "tcp/127.0.0.1:7448), or with backend.endpoint where ROS's router is"
    )


@pytest.mark.parametrize(
    "own", ["tcp/127.0.0.1:7448", "tcp/hall:7447", "quic/127.0.0.1:7447", "serial//dev/x"]
)
def test_other_ports_machines_and_protocols_are_apart(own: str) -> None:
    check_launches([launch()], [own])
    check_apart("serial//dev/x", [own])


def test_where_a_router_of_ros_is_matters_only_where_there_is_one() -> None:
    check_launches([launch(kind="dds")], [ROS])


def test_hosts_are_the_same_however_they_are_written() -> None:
    assert place_of("tcp/Robot.local:7447") == place_of("tls/robot.local:7447?x=1")
    assert place_of("udp/robot.local:7447") != place_of("tcp/robot.local:7447")


@pytest.mark.parametrize("endpoint", ["foo", "7447", "tcp/127.0.0.1:70000"])
def test_an_address_that_is_none_is_refused_before_anything_is_opened(endpoint: str) -> None:
    with pytest.raises(
        ConfigError, match=rf"^ros2: backend\.endpoint: '{endpoint}' is no address; write one"
    ):
        check_launches([launch(endpoint=endpoint)])


@pytest.mark.parametrize("node", ["pointit", "", "/", "/a b", "/pointit\n"])
def test_a_node_that_has_no_full_name(node: str) -> None:
    with pytest.raises(ValidationError, match="begin with / and write letters"):
        BackendConfig(node=node)
