"""ROS on Zenoh: attachments, keys, qualities of service, tokens, as genuine rmw_zenoh nodes write them."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.graph.backend import LATCHED, ROSOUT, SENSOR, SERVICE, EndpointKind, Qos, RosType
from pointit.bridges.ros2.over_zenoh.attachment import packed, unpacked
from pointit.bridges.ros2.over_zenoh.qos_text import qos_of, qos_text
from pointit.bridges.ros2.over_zenoh.rmw_zenoh import BRIDGE, RmwZenoh
from pointit.bridges.ros2.over_zenoh.token import (
    EndpointToken,
    NodeToken,
    data_key,
    dds_type,
    gid,
    parsed,
    resolved,
)
from tests.unit.ros2.values import golden


def test_attachment_matches_that_of_running_nodes() -> None:
    wire = golden("wire")
    senders = {token.split("/")[9].replace("%", "/"): gid(token) for token, _ in wire["tokens"][1:]}
    assert len(wire["samples"]) == 4
    assert len(wire["calls"]) == 3

    for sample in wire["samples"]:
        data = bytes.fromhex(sample["attachment"])
        attachment = unpacked(data)
        assert packed(attachment) == data
        assert attachment.sequence == 1
        assert f"{attachment.stamp_ns}".startswith("1795144401")  # when it was captured
        name = "/" + "/".join(sample["key"].split("/")[1:-2])
        assert attachment.gid == senders[name]
    for number, call in enumerate(wire["calls"], start=1):
        request, reply = (
            unpacked(bytes.fromhex(call[f"{part}_attachment"])) for part in ("request", "reply")
        )
        assert request.sequence == reply.sequence == number
        assert request.gid == reply.gid == senders["/add_pack_native"]
        assert reply.stamp_ns > request.stamp_ns


def test_keys_of_a_topic_and_a_service() -> None:
    seen = [each["key"] for each in golden("wire")["samples"] + golden("wire")["calls"]]
    assert len(seen) == 7
    for key in seen:
        *name, dds_name, type_hash = key.split("/")[1:]
        assert data_key(7, f"/{'/'.join(name)}", dds_type(dds_name, type_hash)) == key
    pose = RosType(name="geometry_msgs/msg/PoseStamped", hash="RIHS01_10")
    assert data_key(0, "/user1/ray", pose) == "0/user1/ray/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_10"
    assert dds_type("std_srvs::srv::dds_::Empty_", "x") == RosType(name="std_srvs/srv/Empty", hash="x")


NO_NAMES = [
    *("", "/", "a", "a/b", "/a/", "//a", "/a//b", "/1a", "/a-b", "/a b", "~/a", "/{user}/a", "/**", "/a$*"),
    *("/\u00e9", "/a\n", "/@a", "/a%b"),
]


@pytest.mark.parametrize("name", NO_NAMES)
def test_name_that_is_not_resolved_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="not a full ROS name"):
        resolved(name)
    for good in ("/a", "/_a/b_1", "/user1/metawear_ros/rotation", "/a/_action/get_result"):
        assert resolved(good) == good


@pytest.mark.parametrize(
    ("text", "type_hash"),
    [
        *((text, "RIHS01_0") for text in ("", "std_msgs/msg/Bool", "std_msgs::msg::Bool", "::::dds_::_")),
        *((text, "RIHS01_0") for text in ("a::msg::dds_::Bool", "a::b::c::dds_::D_")),
        *(("std_msgs::msg::dds_::Bool_", text) for text in ("", "RIHS01 0", "\x1b[2J", "RIHS01_é")),
    ],
)
def test_invalid_dds_type_is_refused(text: str, type_hash: str) -> None:
    with pytest.raises(ValueError, match="not a type"):
        dds_type(text, type_hash)


@pytest.mark.parametrize(
    ("qos", "text", "others"),
    [
        (
            SERVICE,
            "::,10:,:,:,,",
            ["1:2:1,10:5,0:,:1,3,0", "1:2:1,10:5,0:9223372036,854775807:1,3,0", "::,10"],
        ),
        (SENSOR, "2::,5:,:,:,,", []),
        (LATCHED, ":1:,1:,:,:,,", []),
        (Qos(depth=100), "::,100:,:,:,,", []),
        (Qos(depth=100, latched=True), ":1:,100:,:,:,,", []),
        (Qos(depth=42), "::,:,:,:,,", ["::2,:,:,:,,"]),
        (ROSOUT, ":1:,1000:,:10,0:,,", []),
    ],
)
def test_qos_text_matches_a_real_rmw_zenoh_node(qos: Qos, text: str, others: list[str]) -> None:
    assert qos_text(qos) == text
    for each in (text, *others):  # with defaults written out, and fields that the bridge has no use for
        assert qos_of(each) == qos


@pytest.mark.parametrize(
    "text",
    [
        "",
        "3::,1:,:,:,,",
        ":3:,1:,:,:,,",
        "::3,1:,:,:,,",
        "::,1_0:,:,:,,",
        "::,\u00b2:,:,:,,",
        "::,1,1:,:,:,,",
        "::,1:,:-1,0:,,",
        "::,1:,:ten,0:,,",
        f"::,{'9' * 5000}:,:,:,,",
        "reliable:volatile:,1:,:,:,,",
    ],
)
def test_malformed_qos_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="not a quality of service"):
        qos_of(text)


@given(st.text(alphabet=":,0123456789-_ \u00b2", max_size=40))
def test_any_text_is_a_qos_or_refused(text: str) -> None:
    try:
        qos_of(text)
    except ValueError:
        return


TOKENS: list[tuple[str, str]] = golden("wire")["tokens"]
NODE = NodeToken(domain=7, session="fd857cb30ca6267672bad8919c98b29f", node_id="0", node="/user1/belt")
RAY = EndpointToken(
    domain=7,
    session="fd857cb30ca6267672bad8919c98b29f",
    node_id="0",
    node="/user1/belt",
    endpoint_id="10",
    kind="subscriber",
    name="/user1/pointing_ray",
    type=RosType(
        name="geometry_msgs/msg/PoseStamped",
        hash="RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    ),
    qos=Qos(depth=10),
)
NAMES = st.lists(st.from_regex(r"[A-Za-z_][A-Za-z0-9_]*", fullmatch=True), min_size=1, max_size=4).map(
    lambda chunks: "/" + "/".join(chunks)
)
KINDS: list[EndpointKind] = ["publisher", "subscriber", "server", "client"]


@pytest.mark.parametrize(
    ("written", "instead", "changes"),
    [
        ("/0/10/", "/robot/2/", {"node_id": "robot", "endpoint_id": "2"}),  # as dora-rs writes them
        ("/MS/%/", "/MS/%secret%arm/", {"enclave": "/secret/arm"}),
        (RAY.type.hash, "TypeHashNotSupported", {"type": replace(RAY.type, hash="TypeHashNotSupported")}),
    ],
    ids=["ids of dora-rs", "enclave", "Humble"],
)
def test_tokens_of_others_are_read_as_written(written: str, instead: str, changes: dict[str, Any]) -> None:
    text = RAY.text.replace(written, instead)
    assert parsed(text) == replace(RAY, **changes)
    assert parsed(text).text == text


@pytest.mark.parametrize("more", ["/backends:cpu:;", "/backends:cuda%3A0:a%2Fb;", "/one/more"])
def test_chunks_of_later_distributions_are_ignored(more: str) -> None:
    assert parsed(RAY.text + more) == RAY
    assert gid(RAY.text + more) != gid(RAY.text)


@given(
    st.builds(
        EndpointToken,
        domain=st.integers(0, 232),
        session=st.from_regex(r"[0-9a-f]{1,32}", fullmatch=True),
        node_id=st.integers(0, 10**6).map(str),
        node=NAMES,
        endpoint_id=st.integers(0, 10**6).map(str),
        kind=st.sampled_from(KINDS),
        name=NAMES,
        type=st.just(RAY.type),
        qos=st.builds(
            Qos,
            depth=st.integers(0, 10**17),
            reliable=st.booleans(),
            latched=st.booleans(),
            lifespan_ns=st.none() | st.integers(0, 2**63 - 2),
        ),
    )
)
def test_tokens_survive_a_round_trip(token: EndpointToken) -> None:
    assert parsed(token.text) == token
    assert token.text.count("/") == 12
    assert len(gid(token.text)) == 16


CHUNKS = RAY.text.split("/")


@pytest.mark.parametrize(
    ("index", "chunk"),
    [
        *((0, "@adv"), (1, "-1"), (1, "x"), (1, "9" * 5000), (2, "FD"), (2, "f" * 33), (5, "MX"), (5, "NS")),
        *((7, "user1"), (7, "%a b"), (8, "\x1b[2J"), (9, "ray"), (9, "%a%%b"), (10, "PoseStamped")),
        *((11, "\x1b[2J"), (12, "best_effort")),
        *((index, "") for index in range(13)),
    ],
)
def test_invalid_and_missing_chunks_are_refused(index: int, chunk: str) -> None:
    for text in ("/".join([*CHUNKS[:index], chunk, *CHUNKS[index + 1 :]]), "/".join(CHUNKS[:index])):
        with pytest.raises(ValueError, match=r"not|neither|that is none"):
            parsed(text)


@given(
    st.one_of(
        st.text(max_size=200),
        st.lists(
            st.one_of(st.sampled_from([*CHUNKS, "NN", "%", "@ros2_lv", ""]), st.text(max_size=5)), max_size=15
        ).map("/".join),
    )
)
def test_any_text_is_a_token_or_refused(text: str) -> None:
    try:
        token = parsed(text)
    except ValueError:
        return
    again = parsed(token.text)  # what is read can be written, and means the same
    assert again == token


POSE = RosType(name="geometry_msgs/msg/PoseStamped", hash="RIHS01_" + "a" * 64)
SESSION = "fd857cb30ca6267672bad8919c98b29f"


def test_written_tokens_match_those_of_a_genuine_node() -> None:
    """The fixture is one node with 26 endpoints, numbered as it declared them."""
    genuine = {int(text.split("/")[4]): (text, identity) for text, identity in TOKENS}
    assert len(genuine) == 27
    assert {parsed(text) for text, _ in TOKENS} >= {NODE, RAY}

    ours = RmwZenoh(session=SESSION, node="/user1/belt", domain=7)
    assert ours.node_token() == genuine[0][0]
    for number in range(1, len(genuine)):
        text, identity = genuine[number]
        seen = ours.read(text)
        assert seen.endpoint is not None
        endpoint = seen.endpoint
        assert (endpoint.is_ours, endpoint.domain, endpoint.node) == (True, 7, "/user1/belt")
        assert endpoint.qos is not None
        token = ours.endpoint_token(endpoint.kind, endpoint.name, endpoint.type, endpoint.qos)
        assert token == text
        assert gid(token).hex() == identity


def test_bridges_recognize_each_other_by_their_enclave() -> None:
    ours, other = (
        RmwZenoh(session=session, node="/pointit", domain=7, enclave=BRIDGE) for session in (SESSION, "ab")
    )
    token = other.endpoint_token("publisher", "/x", POSE, SENSOR)
    seen = ours.read(token)
    own = other.read(token)

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


@given(
    st.binary(max_size=80)
    | st.none()
    | st.tuples(
        st.binary(min_size=16, max_size=16), st.just(b"\x10") | st.binary(min_size=1, max_size=1)
    ).map(lambda parts: parts[0] + parts[1] + parts[0])
)
def test_an_attachment_is_one_or_a_sentence(data: bytes | None) -> None:
    if data is not None and len(data) == 33 and data[16] == 16:
        assert packed(unpacked(data)) == data
    else:
        with pytest.raises(ValueError, match="attachment"):
            unpacked(data)
