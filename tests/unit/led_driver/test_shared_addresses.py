"""Outputs that share an address: allowed where something divides it, such as a universe."""

from pathlib import Path
from typing import Any

import pytest

from pointit.errors import ConfigError
from pointit.runtime.clock import WallClock
from pointit.runtime.service.surroundings import NullHealth, Surroundings
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.outputs import make_outputs

AROUND = Surroundings(clock=WallClock(), health=NullHealth(), folder=Path("unused"))


def names(*outputs: dict[str, Any]) -> list[str]:
    """Return the name of each output of a configuration."""
    given: list[str] = []

    def surroundings(_kind: str, _name: str, _user: str, which: str) -> Surroundings:
        given.append(which)
        return AROUND

    make_outputs(LedDriverConfig.model_validate({"outputs": outputs}).outputs, surroundings, NullHealth())
    return given


@pytest.mark.parametrize("kind", ["e131", "artnet", "spotlight"])
def test_outputs_at_one_node_have_a_universe_each(kind: str) -> None:
    node = {"kind": kind, "host": "10.0.0.5"}
    assert names(node | {"universe": 2}, node | {"universe": 3}) == [
        "10.0.0.5 universe 2",
        "10.0.0.5 universe 3",
    ]
    with pytest.raises(ConfigError, match=r"outputs.1.host: 10.0.0.5 universe 2 is used .* `universe`"):
        names(node | {"universe": 2}, node | {"universe": 2})


def test_outputs_at_one_host_have_a_port_each() -> None:
    host = {"kind": "ddp", "host": "10.0.0.5"}
    assert names(host, host | {"port": 4049}) == ["10.0.0.5 port 4048", "10.0.0.5 port 4049"]
    with pytest.raises(ConfigError, match=r"outputs.1.host: 10.0.0.5 port 4048 is used .* `port`"):
        names(host, host)


def test_address_that_nothing_divides_has_one_output() -> None:
    port = {"kind": "adalight", "port": "/dev/x"}
    with pytest.raises(ConfigError, match=r"outputs.1.port: /dev/x is used by two outputs: remove one$"):
        names(port, port)
