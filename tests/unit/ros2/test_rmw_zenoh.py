"""Encoding of ROS on Zenoh against captures of genuine rmw_zenoh nodes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.graph.backend import SENSOR, EndpointKind, RosType
from pointit.bridges.ros2.over_zenoh.rmw_zenoh import RmwZenoh
from pointit.bridges.ros2.over_zenoh.token import BRIDGE, gid
from tests.unit.ros2.facts import golden

POSE = RosType(name="geometry_msgs/msg/PoseStamped", hash="RIHS01_" + "a" * 64)
SESSION = "fd857cb30ca6267672bad8919c98b29f"
KINDS: tuple[EndpointKind, ...] = ("publisher", "subscriber", "server", "client")


def rmw() -> RmwZenoh:
    return RmwZenoh(session=SESSION, node="/user1/belt", domain=7)


def test_we_write_the_tokens_of_a_genuine_node_one_after_the_other() -> None:
    """The fixture is one node with 26 endpoints, numbered as it declared them."""
    genuine = {int(text.split("/")[4]): (text, gid) for text, gid in golden("wire")["tokens"]}
    ours = rmw()
    assert ours.node_token() == genuine[0][0]
    for number in range(1, len(genuine)):
        text, gid = genuine[number]
        seen = ours.read(text)
        assert seen.endpoint is not None
        endpoint = seen.endpoint
        assert (endpoint.is_ours, endpoint.domain, endpoint.node) == (True, 7, "/user1/belt")
        assert endpoint.qos is not None
        token = ours.endpoint_token(endpoint.kind, endpoint.name, endpoint.type, endpoint.qos)
        assert token == text
        assert ours.gid(token).hex() == gid


def test_bridges_of_pointit_know_each_other_by_their_enclave_whatever_they_are_called() -> None:
    ours, other = (
        RmwZenoh(session=session, node="/pointit", domain=7, enclave=BRIDGE) for session in (SESSION, "ab")
    )
    token = other.endpoint_token("publisher", "/x", POSE, SENSOR)
    seen, own = ours.read(token), other.read(token)
    assert seen.endpoint is not None
    assert (seen.endpoint.is_ours, seen.endpoint.is_bridge, seen.bridge_gid) == (False, True, gid(token))
    assert own.endpoint is not None
    assert (own.endpoint.is_ours, own.endpoint.is_bridge, own.bridge_gid) == (True, False, None)
    plain = RmwZenoh(session="cd", node="/pointit", domain=7)
    stranger = plain.endpoint_token("publisher", "/x", POSE, SENSOR)
    for reader, text in ((plain, token), (ours, stranger)):
        endpoint = reader.read(text).endpoint
        assert endpoint is not None
        assert not endpoint.is_bridge
        assert reader.read(text).bridge_gid is None


def test_all_tokens_are_under_the_pattern_and_no_two_are_the_same() -> None:
    ours = rmw()
    tokens = [ours.node_token()] + [ours.endpoint_token(kind, "/x", POSE, SENSOR) for kind in KINDS * 2]
    assert len(set(tokens)) == 9
    assert all(token.startswith(ours.tokens.removesuffix("**")) for token in tokens)
    assert all(len(token.split("/")) == 13 for token in tokens[1:]), "Lyrical: no buffers, please"


def test_strays_are_everything_with_the_name_but_what_is_right() -> None:
    ours = rmw()
    key = ours.key("/user1/ray", POSE)
    assert key == f"7/user1/ray/geometry_msgs::msg::dds_::PoseStamped_/{POSE.hash}"
    assert ours.misrouted_keys("/user1/ray") == "*/user1/ray/*/*"
    assert ours.misrouting_reason(key, "/user1/ray", POSE) == ""
    for stray, why in (
        (key.replace("7/", "0/", 1), "domain 0, we are in 7; set domain_id to theirs"),
        (key.replace("PoseStamped", "Pose"), "they are geometry_msgs::msg::dds_::Pose_, not"),
        (key.replace("aaaa", "cccc"), "hash RIHS01_ccccccccccccc, ours RIHS01_aaaaaaaaaaaaa; rebuild"),
    ):
        assert why in ours.misrouting_reason(stray, "/user1/ray", POSE)


def _with_length(data: bytes) -> bytes:
    return data[:16] + b"\x10" + data[16:]


@given(st.binary(max_size=80) | st.none() | st.binary(min_size=32, max_size=32).map(_with_length))
def test_an_attachment_is_one_or_a_sentence(data: bytes | None) -> None:
    if data is not None and len(data) == 33 and data[16] == 16:
        origin = rmw().unpack(data)
        assert origin is not None
        assert rmw().pack(origin) == data
    else:
        with pytest.raises(ValueError, match="attachment"):
            rmw().unpack(data)


def test_attachments_of_old_versions_are_recognized() -> None:
    for field in (b"source_gid", b"sequence_number"):
        with pytest.raises(ValueError, match=r"before 0\.1\.2 \(Humble\) or 0\.2\.4 \(Jazzy\)"):
            rmw().unpack(b"\x03\x0a" + field + bytes(20))


NO_NODES = ("pointit", "/", "/a//b", "/9", "/a b", "")


@pytest.mark.parametrize("node", NO_NODES)
def test_a_node_has_a_full_name(node: str) -> None:
    with pytest.raises(ValueError, match="is not a full ROS name"):
        RmwZenoh(session=SESSION, node=node, domain=0)


@pytest.mark.parametrize("chunks", ["5\x1b[2J/{}/{}", "7/\x1b[2J/{1}", "7/{0}/\n\x1b[2J"])
def test_no_key_that_goes_astray_writes_to_terminals(chunks: str) -> None:
    ours = RmwZenoh(session="aa", node="/pointit", domain=7)
    domain, _, rest = chunks.partition("/")
    key = f"{domain}/x/{rest.format(POSE.dds_name, POSE.hash)}"
    assert ours.misrouting_reason(key, "/x", POSE)
    assert ours.misrouting_reason(key, "/x", POSE).isprintable()
