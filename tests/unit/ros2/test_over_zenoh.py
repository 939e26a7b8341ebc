"""ROS on Zenoh: attachments, keys, qualities of service, tokens, as genuine rmw_zenoh nodes write them."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.graph.backend import LATCHED, ROSOUT, SENSOR, SERVICE, EndpointKind, Qos, RosType
from pointit.bridges.ros2.over_zenoh.attachment import Attachment, packed, unpacked
from pointit.bridges.ros2.over_zenoh.keys import data_key, dds_type, resolved
from pointit.bridges.ros2.over_zenoh.qos import qos_of, qos_text
from pointit.bridges.ros2.over_zenoh.token import EndpointToken, NodeToken, gid, mangled, parsed, unmangled
from tests.unit.ros2.facts import golden

INT64 = st.integers(-(2**63), 2**63 - 1)


def test_as_running_nodes_attach_it() -> None:
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


@given(st.builds(Attachment, sequence=INT64, stamp_ns=INT64, gid=st.binary(min_size=16, max_size=16)))
def test_attachments_survive_a_round_trip(attachment: Attachment) -> None:
    assert len(packed(attachment)) == 33
    assert unpacked(packed(attachment)) == attachment


@pytest.mark.parametrize(
    "attachment",
    [
        Attachment(sequence=2**63, stamp_ns=0, gid=bytes(16)),
        Attachment(sequence=0, stamp_ns=-(2**63) - 1, gid=bytes(16)),
        Attachment(sequence=0, stamp_ns=0, gid=bytes(15)),
        Attachment(sequence=0, stamp_ns=0, gid=bytes(17)),  # struct alone would cut it
        Attachment(sequence=0, stamp_ns=0, gid=b""),
    ],
)
def test_what_would_abort_a_ros_node_is_never_packed(attachment: Attachment) -> None:
    with pytest.raises(ValueError, match=r"gid of|does not fit"):
        packed(attachment)


@given(st.binary(max_size=70))
def test_malformed_attachments_are_refused(data: bytes) -> None:
    if len(data) == 33 and data[16] == 16:
        assert packed(unpacked(data)) == data
        return
    with pytest.raises(ValueError, match="attachment"):
        unpacked(data)


@given(st.integers(0, 255).filter(lambda length: length != 16))
def test_another_length_of_the_gid_is_refused(length: int) -> None:
    with pytest.raises(ValueError, match="gid"):
        unpacked(bytes(16) + bytes([length]) + bytes(16))


def test_a_topic_and_a_service() -> None:
    seen = [each["key"] for each in golden("wire")["samples"] + golden("wire")["calls"]]
    assert len(seen) == 7
    for key in seen:
        *name, dds_name, type_hash = key.split("/")[1:]
        assert data_key(7, f"/{'/'.join(name)}", dds_type(dds_name, type_hash)) == key
    pose = RosType(name="geometry_msgs/msg/PoseStamped", hash="RIHS01_10")
    assert data_key(0, "/user1/ray", pose) == "0/user1/ray/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_10"


@pytest.mark.parametrize("name", ["/a", "/_a/b_1", "/user1/metawear_ros/rotation", "/a/_action/get_result"])
def test_resolved_names_are_accepted(name: str) -> None:
    assert resolved(name) == name


NO_NAMES = [
    *("", "/", "a", "a/b", "/a/", "//a", "/a//b", "/1a", "/a-b", "/a b", "~/a", "/{user}/a", "/**"),
    "/a$*",
]
STRANGE = ["/\u00e9", "/a\n", "/@a", "/a%b"]


@pytest.mark.parametrize("name", [*NO_NAMES, *STRANGE])
def test_what_would_become_another_key_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="not a full ROS name"):
        resolved(name)
    with pytest.raises(ValueError, match="not a full ROS name"):
        data_key(0, name, RosType(name="std_msgs/msg/Bool", hash="RIHS01_0"))


def test_types_are_read_as_dds_writes_them() -> None:
    kind = dds_type("std_srvs::srv::dds_::Empty_", "RIHS01_0")
    assert kind == RosType(name="std_srvs/srv/Empty", hash="RIHS01_0")
    assert dds_type(kind.dds_name, kind.hash) == kind


NO_TYPES = [
    "",
    "std_msgs/msg/Bool",
    "std_msgs::msg::Bool",
    "::::dds_::_",
    "a::msg::dds_::Bool",
    "a::b::c::dds_::D_",
]


@pytest.mark.parametrize("text", NO_TYPES)
def test_anything_else_is_no_type(text: str) -> None:
    with pytest.raises(ValueError, match="not a type"):
        dds_type(text, "RIHS01_0")


@pytest.mark.parametrize("type_hash", ["", "RIHS01 0", "\x1b[2J", "RIHS01_é"])
def test_a_hash_is_a_word(type_hash: str) -> None:
    with pytest.raises(ValueError, match="not a type"):
        dds_type("std_msgs::msg::dds_::Bool_", type_hash)


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
def test_no_text_is_worse_than_a_refused_qos(text: str) -> None:
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


def test_tokens_and_gids_of_a_running_node() -> None:
    assert len(TOKENS) == 27
    for text, expected in TOKENS:
        assert gid(text).hex() == expected
        assert parsed(text).text == text
    found = {parsed(text) for text, _ in TOKENS}
    assert NODE in found
    assert RAY in found
    ours = {token.gid.hex() for token in found if isinstance(token, EndpointToken)}
    assert len(ours & {expected for _, expected in TOKENS}) == 26, "all but the node's"


def test_ids_need_not_be_numbers() -> None:
    text = RAY.text.replace("/0/10/", "/robot/2/")  # as dora-rs writes them
    assert parsed(text).node_id == "robot"
    assert parsed(text).text == text


def test_a_node_at_the_root() -> None:
    root = replace(NODE, node="/belt")
    assert root.text.endswith("/0/0/NN/%/%/belt")
    assert parsed(root.text) == root
    assert mangled("") == mangled("/") == "%"
    assert unmangled("%user1%x") == "/user1/x"


@pytest.mark.parametrize("more", ["/backends:cpu:;", "/backends:cuda%3A0:a%2Fb;", "/one/more"])
def test_chunks_that_later_distributions_add_are_read_over(more: str) -> None:
    assert parsed(RAY.text + more) == RAY
    assert gid(RAY.text + more) != RAY.gid


def test_token_carries_another_enclave() -> None:
    text = RAY.text.replace("/MS/%/", "/MS/%secret%arm/")
    assert parsed(text) == replace(RAY, enclave="/secret/arm")
    assert parsed(text).text == text


def test_token_of_humble_has_no_hash() -> None:
    token = parsed(RAY.text.replace(RAY.type.hash, "TypeHashNotSupported"))
    assert isinstance(token, EndpointToken)
    assert token.type.hash == "TypeHashNotSupported"


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
            depth=st.integers(0, 1000),
            reliable=st.booleans(),
            latched=st.booleans(),
            lifespan_ns=st.none() | st.integers(0, 2**63 - 2),
        ),
    )
)
def test_tokens_survive_a_round_trip(token: EndpointToken) -> None:
    assert parsed(token.text) == token
    assert token.text.count("/") == 12
    assert len(token.gid) == 16


@pytest.mark.parametrize("bad", ["belt", "/", "/a/b c", "/**", ""])
def test_no_token_of_ours_has_a_name_that_is_none(bad: str) -> None:
    with pytest.raises(ValueError, match="not a full ROS name"):
        _ = replace(NODE, node=bad).text
    with pytest.raises(ValueError, match="not a full ROS name"):
        _ = replace(RAY, name=bad).text


CHUNKS = RAY.text.split("/")


@pytest.mark.parametrize(
    ("index", "chunk"),
    [
        (0, "@adv"),
        (1, "-1"),
        (1, "x"),
        (1, "9" * 5000),
        (2, "FD"),
        (2, "f" * 33),
        (5, "MX"),
        (5, "NS"),
        (7, "user1"),
        (7, "%a b"),
        (8, "\x1b[2J"),
        (9, "ray"),
        (9, "%a%%b"),
        (10, "PoseStamped"),
        (11, "\x1b[2J"),
        (12, "best_effort"),
        *((index, "") for index in range(13)),
    ],
)
def test_a_chunk_that_is_none_is_refused(index: int, chunk: str) -> None:
    with pytest.raises(ValueError, match=r"not|neither|that is none"):
        parsed("/".join([*CHUNKS[:index], chunk, *CHUNKS[index + 1 :]]))


@pytest.mark.parametrize("count", range(13))
def test_a_token_that_ends_early_is_refused(count: int) -> None:
    with pytest.raises(ValueError, match=r"not|neither"):
        parsed("/".join(CHUNKS[:count]))


@given(
    st.one_of(
        st.text(max_size=200),
        st.lists(
            st.one_of(st.sampled_from([*CHUNKS, "NN", "%", "@ros2_lv", ""]), st.text(max_size=5)), max_size=15
        ).map("/".join),
    )
)
def test_no_text_does_worse_than_to_be_refused(text: str) -> None:
    try:
        token = parsed(text)
    except ValueError:
        return
    again = parsed(token.text)  # what is read can be written, and means the same
    assert again == token
