"""Bytes that no node of ROS sends, from a bare session: dropped, counted, named, and never the end of us."""

import asyncio
import itertools
import re
import struct

import pytest
import zenoh
from zenoh.handlers import Callback

from pointit.bridges.ros2.graph.node_backend import NodeContext
from tests.integration.ros2.nodes import ADD, GID, POSE, Graphs, Node, attachment, cdr_of, key_of, number_of
from tests.support.bench import PATIENCE_S, until

OLD = b"\x03\x0fsequence_number\x08%b\x10source_timestamp\x08%b\x0asource_gid\x10%b" % (
    bytes(8),
    bytes(8),
    GID,
)

MALFORMED = {
    "none": (None, "no attachment"),
    "empty": (b"", "an attachment of 0 bytes"),
    "short": (attachment()[:-1], "an attachment of 32 bytes"),
    "long": (attachment() + b"\0", "an attachment of 34 bytes"),
    "another length": (attachment(length=15), "a gid of 15 bytes"),
    "of an rmw_zenoh before Jazzy 0.2.4": (OLD, r"an attachment of \d+ bytes.*update ros-\*-rmw-zenoh-cpp"),
}


async def test_malformed_attachments_are_counted(a: Node, stranger: zenoh.Session) -> None:
    seen = a.hears("/x", POSE)
    for number, (data, why) in enumerate(MALFORMED.values(), start=1):
        stranger.put(key_of("/x"), cdr_of(number), attachment=data)
        stranger.put(key_of("/x"), cdr_of(number), attachment=attachment(number))
        await until(lambda number=number: seen == [*range(1, number + 1)])
        said = a.shown.now["attachments of /x"]
        assert said.startswith(f"dropped {number} messages on /x: ")
        assert re.search(why, said), said


async def test_too_long_messages_are_dropped_and_deletes_ignored(
    at: Graphs, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(NodeContext, "max_bytes", 1000)
    a = await at.node("/a", "router")
    stranger = await at.stranger()
    seen = a.hears("/x", POSE)
    key = f"7/x/{POSE.dds_name}/{POSE.hash}"
    whole = zenoh.CongestionControl.BLOCK  # two megabytes need time; what follows must not be dropped
    stranger.put(key, cdr_of(1, 997), attachment=attachment(1), congestion_control=whole)
    stranger.put(key, cdr_of(2, 2_000_000), attachment=attachment(2), congestion_control=whole)
    stranger.put(key, cdr_of(3), attachment=bytes(5000), congestion_control=whole)
    stranger.delete(key, congestion_control=whole)

    stranger.put(key, cdr_of(4, 996), attachment=attachment(3), congestion_control=whole)
    await until(lambda: seen == [4])
    assert a.shown.now == {"losses of /x": "dropped messages on /x: 3 were longer than 1000 bytes"}, (
        "the third by its attachment"
    )


TOKENS = [
    *("@ros2_lv/x", "@ros2_lv/7/1/0/0/NN/%/%", "@ros2_lv/7/1/0/0/XX/%/%/node"),
    "@ros2_lv/7/1/0/1/MP/%/%/node/x y/a::msg::dds_::B_/RIHS01_1/::,10:,:,:,,",
    "@ros2_lv/7/1/0/1/MP/%/%/node/" + "x" * 6000,
    "@ros2_lv/7/" + "/".join("1" * 200),
]
"""Some that are none; unit tests have more."""


async def test_tokens_that_are_none_are_no_nodes(a: Node, stranger: zenoh.Session) -> None:
    good = f"@ros2_lv/7/1/0/2/MP/%/%/node/%x/{POSE.dds_name}/{POSE.hash}/::,10:,:,:,,"
    texts = (*TOKENS, good, f"{good}/backends:cpu:1;more/of/it")
    tokens = [stranger.liveliness().declare_token(each) for each in texts]
    await until(lambda: {each.name for each in a.graph.endpoints} == {"/x"})
    assert a.graph.nodes == {"/a", "/node"}
    for token in tokens:
        token.undeclare()
    await until(lambda: not a.graph.endpoints)
    assert not a.shown.now


async def ask(stranger: zenoh.Session, payload: bytes, attached: bytes | None) -> str:
    def get() -> str:
        (reply,) = stranger.get(key_of("/s", ADD), payload=payload, attachment=attached, timeout=60.0)
        if reply.ok is None:
            assert reply.err is not None
            return reply.err.payload.to_string()
        assert reply.ok.attachment is not None
        return reply.ok.attachment.to_bytes().hex()

    return await asyncio.to_thread(get)


async def test_any_request_gets_an_answer(at: Graphs, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NodeContext, "max_bytes", 1000)
    a = await at.node("/a", "router")
    stranger = await at.stranger()
    asked: list[bytes] = []
    gate = asyncio.Event()

    async def serve(request: bytes) -> bytes:
        asked.append(request)
        if request == cdr_of(1):
            await gate.wait()
        return cdr_of(0)

    a.backend.serve("/s", ADD, serve)
    for what, (data, _) in MALFORMED.items():
        assert "attachment" in await ask(stranger, cdr_of(0), data), what
    assert "too long" in await ask(stranger, bytes(1001), attachment())
    assert "too long" in await ask(stranger, b"", bytes(5000))
    assert asked == []
    assert "dropped a request to /s" in a.shown.now["attachments of /s"]

    first = asyncio.create_task(ask(stranger, cdr_of(1), attachment(5)))
    await until(lambda: len(asked) == 1)
    assert await ask(stranger, cdr_of(1), attachment(5)) == "duplicate sequence number"

    gate.set()
    answer = bytes.fromhex(await first)
    sequence, stamp_ns, length, gid = struct.unpack("<qqB16s", answer)
    assert (sequence, length, gid) == (5, 16, GID)
    assert stamp_ns > 0

    async with asyncio.timeout(PATIENCE_S):  # the number is free again soon after the answer
        while (again := await ask(stranger, cdr_of(2), attachment(5))) == "duplicate sequence number":
            pass
    assert len(again) == 66


def garbled(query: zenoh.Query) -> list[tuple[bytes, bytes | None]]:
    """Return answers to a request, the last one the good one."""
    assert query.attachment is not None
    own = query.attachment.to_bytes()
    return [
        (cdr_of(1), None),
        (cdr_of(2), b""),
        (cdr_of(3), OLD),
        (cdr_of(4), own[:-1] + bytes([own[-1] ^ 1])),
        (cdr_of(5), bytes([own[0] + 1]) + own[1:]),
        (bytes(2_000_000), own),
        (cdr_of(7), own),
    ]


async def test_valid_answer_is_used_among_several(a: Node, stranger: zenoh.Session) -> None:
    key = f"7/s/{ADD.dds_name}/{ADD.hash}"
    takes = itertools.cycle([slice(None), slice(0, 6), slice(0, 0)])

    def answer(query: zenoh.Query) -> None:
        with query:
            for payload, attached in garbled(query)[next(takes)]:
                query.reply(key, payload, attachment=attached)

    queryable = stranger.declare_queryable(key, Callback(answer, indirect=True), complete=True)
    assert number_of(await a.backend.call("/s", ADD, cdr_of(1), timeout_s=60)) == 7
    with pytest.raises(TimeoutError) as caught:
        await a.backend.call("/s", ADD, cdr_of(1), timeout_s=10)
    for why in ("no attachment", "of 0 bytes", "another request", "longer than 1000000"):
        assert why in str(caught.value)
    assert number_of(await a.backend.call("/s", ADD, cdr_of(1), timeout_s=60)) == 7, "empty, and again"
    queryable.undeclare()


async def test_graph_problem_is_reported_while_it_lasts(a: Node, stranger: zenoh.Session) -> None:
    a.hears("/x", POSE)
    rebuilt = f"@ros2_lv/7/abc/0/1/MP/%/%/robot/%x/{POSE.dds_name}/RIHS01_{'9' * 64}/::,10:,:,:,,"
    declared = stranger.liveliness().declare_token(rebuilt)
    await until(lambda: "definition of /x" in a.shown.now, 5)
    sentence = "ROS node /robot uses a different definition of geometry_msgs/msg/PoseStamped: on /x expected "
    assert a.shown.now["definition of /x"].startswith(sentence)
    declared.undeclare()
    await until(lambda: not a.shown.now)


async def test_missing_nodes_are_a_note_and_no_problem(at: Graphs, a: Node) -> None:
    await until(lambda: "no other ROS node is seen in domain 7" in " ".join(a.backend.notes))
    b = await at.node("/b")
    b.hears("/z", POSE)
    await until(lambda: not a.backend.notes)
    assert not a.shown.ever
