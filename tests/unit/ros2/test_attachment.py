"""Attachments of samples, requests and replies."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.ros2.over_zenoh.attachment import Attachment, packed, unpacked
from pointit.bridges.ros2.over_zenoh.token import gid
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
