# (of JSON nothing is known)
"""Every type that we emit, any value of it, read by two decoders of others: both read what we meant."""

import base64
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pointit.bridges.ros2.routing.route_types import InboundRoute, ServiceRoute
from pointit.bridges.ros2.routing.routes import routes
from tests.interop.ros2.ament import definition
from tests.interop.ros2.peers import EMPTY, HERE, TYPES
from tests.support.environments import fetched
from tests.support.told import Told
from tests.unit.ros2.values import any_value

EMITTED = sorted(
    {row.type for row in routes(ros4hri=True).all if not isinstance(row, InboundRoute | ServiceRoute)}
    | {TYPES.response_of(row.type) for row in routes().served}
)
EXAMPLES = settings(max_examples=12, suppress_health_check=[HealthCheck.data_too_large])


def asked(decoder: Told, name: str, cdr: bytes) -> Any:
    """Return the value that `decoder` decodes from `cdr`."""
    return decoder.ask(type=name, definition=definition(TYPES, name), cdr=base64.b64encode(cdr).decode())


@pytest.fixture(scope="module")
def mcap(peers_python: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Told]:
    said = tmp_path_factory.mktemp("mcap") / "stderr"
    decoder = Told("mcap", (f"{peers_python}", f"{HERE / 'mcap_decoder.py'}"), said)
    yield decoder
    decoder.end()


@pytest.fixture(scope="module")
def foxglove(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Told]:
    folder = tmp_path_factory.mktemp("decoder")
    node = fetched(HERE / "decoder", folder)
    decoder = Told("foxglove", (node, f"{folder / 'decode.mjs'}"), folder / "stderr")
    yield decoder
    decoder.end()


def meant(value: Any) -> Any:
    """Return a ROS value as the decoders of others write it in JSON."""
    if isinstance(value, np.ndarray):
        return [meant(each) for each in value.tolist()]
    if isinstance(value, list):
        return [meant(each) for each in value]
    names = getattr(type(value), "__dataclass_fields__", None)
    if names is None:
        return value
    return {
        name: meant(getattr(value, name))
        for name in names
        if name == name.lower() and not name.startswith("__") and name not in EMPTY
    }


def read(value: Any, expected: Any) -> Any:
    """Return a decoded value with the field names of ROS times and with numbers of the expected type."""
    match value, expected:
        case list(), list():
            return [read(each, other) for each, other in itertools.zip_longest(value, expected)]
        case {"big": big}, _:
            return int(big)
        case dict(), dict():
            named = {"nanosec" if name == "nsec" else name: each for name, each in value.items()}
            return {name: read(each, expected.get(name)) for name, each in named.items()}
        case int(), float():
            return float(value)
        case int(), int() if 128 <= value < 256 and expected < 0:
            return value - 256  # a `byte`, which rosbags takes for one with a sign; there is no int8
        case _:
            return value


@pytest.mark.parametrize("name", EMITTED)
@given(data=st.data())
@EXAMPLES
def test_decoders_of_others_read_what_we_meant(
    name: str, mcap: Told, foxglove: Told, data: st.DataObject
) -> None:
    value = data.draw(any_value(name))
    cdr = TYPES.encode(name, value)
    expected = meant(TYPES.decode(name, cdr))  # 32-bit floats are rounded there
    for decoder in (mcap, foxglove):
        assert read(asked(decoder, name, cdr), expected) == expected
