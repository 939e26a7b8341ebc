"""The text of qualities of service."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.graph.backend import LATCHED, ROSOUT, SENSOR, SERVICE, Qos
from pointit.bridges.ros2.over_zenoh.qos import qos_of, qos_text


@pytest.mark.parametrize(
    ("qos", "text"),
    [
        (SERVICE, "::,10:,:,:,,"),
        (SENSOR, "2::,5:,:,:,,"),
        (LATCHED, ":1:,1:,:,:,,"),
        (Qos(depth=100), "::,100:,:,:,,"),
        (Qos(depth=100, latched=True), ":1:,100:,:,:,,"),
        (Qos(depth=42), "::,:,:,:,,"),
        (ROSOUT, ":1:,1000:,:10,0:,,"),
    ],
)
def test_qos_text_matches_a_real_rmw_zenoh_node(qos: Qos, text: str) -> None:
    assert qos_text(qos) == text
    assert qos_of(text) == qos


@given(
    st.builds(
        Qos,
        depth=st.integers(0, 10**17),
        reliable=st.booleans(),
        latched=st.booleans(),
        lifespan_ns=st.none() | st.integers(0, 2**63 - 2),
    )
)
def test_qos_survives_a_round_trip(qos: Qos) -> None:
    assert qos_of(qos_text(qos)) == qos


def test_defaults_that_are_written_out_and_what_the_bridge_has_no_use_for() -> None:
    assert qos_of("1:2:1,10:5,0:,:1,3,0") == Qos(depth=10)
    assert qos_of("1:2:1,10:5,0:9223372036,854775807:1,3,0") == Qos(depth=10)
    assert qos_of("::,10") == Qos(depth=10)
    assert qos_of("::2,:,:,:,,") == Qos(depth=42)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "::",
        "3::,1:,:,:,,",
        ":3:,1:,:,:,,",
        "::3,1:,:,:,,",
        "::,-1:,:,:,,",
        "::,1_0:,:,:,,",
        "::,\u00b2:,:,:,,",
        "::1:,:,:,,",
        "::,1,1:,:,:,,",
        "::,1:,:-1,0:,,",
        "::,1:,:1:,,",
        "::,1:,:ten,0:,,",
        f"::,{'9' * 5000}:,:,:,,",
        "reliable:volatile:,1:,:,:,,",
    ],
)
def test_malformed_qos_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="not a quality of service"):
        qos_of(text)


@given(st.text(alphabet=":,0123456789-_ \u00b2", max_size=40))
def test_no_text_does_worse_than_to_be_refused(text: str) -> None:
    try:
        qos_of(text)
    except ValueError:
        return
