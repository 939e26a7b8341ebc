"""Messages as readers on Zenoh decode them: bytes and the encoding that names message and version."""

import msgpack
import pytest
import zenoh

from pointit.runtime.zenoh.wire_format import decoded, encoding_of
from pointit.schemas import ClockTick, DecodeError, encode
from pointit.schemas.codec import MEDIA_TYPE

TICK = ClockTick(stamp_ns=1, sim_ns=2, speed=3.0)
GROWN = zenoh.ZBytes(msgpack.packb({**msgpack.unpackb(encode(TICK)), "added_later": 4}))


def test_message_survives_the_way_with_its_encoding() -> None:
    assert decoded(ClockTick, zenoh.ZBytes(encode(TICK)), encoding_of(ClockTick)) == TICK


def test_fields_that_a_newer_version_added_are_ignored() -> None:
    newer = zenoh.Encoding(MEDIA_TYPE).with_schema("ClockTick.v98")
    assert decoded(ClockTick, GROWN, newer) == TICK


@pytest.mark.parametrize("encoding", [None, encoding_of(ClockTick)])
def test_unknown_fields_of_our_own_version_are_refused(encoding: zenoh.Encoding | None) -> None:
    with pytest.raises(DecodeError, match="added_later"):
        decoded(ClockTick, GROWN, encoding)
