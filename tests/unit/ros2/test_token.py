"""Tokens of nodes and of their endpoints."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.graph.backend import EndpointKind, Qos, RosType
from pointit.bridges.ros2.over_zenoh.token import EndpointToken, NodeToken, gid, mangled, parsed, unmangled
from tests.unit.ros2.facts import golden

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
