"""Bytes of E1.31, Art-Net and DDP: golden ones, what others read in them; the search for controllers."""

import struct
import sys
import uuid
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.runtime.errors import ConfigError
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import Strip, StripFrame, StripsFrame
from pointit.services.led_driver.output import artnet, e131
from pointit.services.led_driver.output.artnet import (
    ArtnetConfig,
    ArtnetStream,
    broadcast_addresses,
    make_artnet,
    merge_reply,
)
from pointit.services.led_driver.output.ddp import described, encode_frame
from pointit.services.led_driver.output.e131 import E131Config, E131Stream
from pointit.services.led_driver.output.udp_output import Datagram, Destination
from pointit.services.led_driver.outputs import Segment
from tests.support.running_source import Health
from tests.support.sacn_packets import read_packet

CID = uuid.UUID("00112233-4455-6677-8899-aabbccddeeff")
E131_GOLDEN = (
    "0010 0000 4153432d45312e3137000000 7071 00000004 00112233445566778899aabbccddeeff"
    "705b 00000002"
    + "506f696e744974".ljust(128, "0")  # PointIt
    + "64 0000 07 00 1234 700e 02 a1 0000 0001 0004 00 0a0b0c"
)
ARTNET_GOLDEN = "4172742d4e657400 0050 000e 08 00 2301 0004 0a0b0c00"
REPLY = (
    b"Art-Net\0\x00\x21" + bytes((192, 168, 1, 7)) + b"\x36\x19" + bytes(2) + bytes((1, 2)) + bytes(6)
    + b"node".ljust(18, b"\0") + b"A node in the attic".ljust(64, b"\0") + b"#0001 [1] ok".ljust(64, b"\0")
    + bytes((0, 3)) + bytes((0x80, 0xC0, 0x40, 0x80)) + bytes(12) + bytes((5, 6, 7, 8)) + bytes(45)
)  # fmt: skip
slots = st.binary(min_size=1, max_size=512)


def test_e131_packet_matches_the_golden_bytes() -> None:
    packet = e131.data_packet(e131.E131Sender(CID, "PointIt"), 0x1234, 7, bytes.fromhex("0a0b0c"))
    assert packet.hex() == E131_GOLDEN.replace(" ", "")


senders = st.builds(e131.E131Sender, st.just(CID), st.text(), st.integers(0, 200))


@given(
    sender=senders,
    data=slots,
    universe=st.integers(1, 63999),
    number=st.integers(0, 100_000),
    ended=st.booleans(),
)
def test_e131_packet_is_read_by_an_independent_decoder(
    *, sender: e131.E131Sender, data: bytes, universe: int, number: int, ended: bool
) -> None:
    packet = e131.data_packet(sender, universe, number, data, ended=ended)
    assert len(packet) == 126 + len(data)
    if len(data) == 512:
        assert len(packet) == 638
    read = read_packet(packet)
    assert (read.universe, read.sequence, read.priority) == (universe, number % 256, sender.priority)
    assert read.slots[: len(data)] == data
    assert read.ended is ended
    assert read.cid == CID.bytes
    assert len(packet[44:108].rstrip(b"\0").decode()) <= 63


@pytest.mark.parametrize(("universe", "group"), [(1, "239.255.0.1"), (63999, "239.255.249.255")])
def test_multicast_goes_to_the_group_of_each_universe(universe: int, group: str) -> None:
    assert e131.multicast_address(universe) == group
    stream = E131Stream(Destination(host="multicast", port=5568, interface="10.0.0.1"), 1)
    assert stream.frame([(universe, b"x")], 1)[0].host == group
    assert stream.destination == Destination(host="", port=5568, interface="10.0.0.1")


def test_stream_ends_with_a_dark_frame_and_three_termination_packets() -> None:
    stream = E131Stream(Destination(host="10.0.0.2", port=5568), 1)
    ends = [read_packet(each.data) for each in stream.end([(1, bytes(3)), (2, bytes(6))], 255)]
    for universe in (1, 2):
        mine = [each for each in ends if each.universe == universe]
        assert [each.ended for each in mine] == [False, True, True, True]
        assert [each.sequence for each in mine] == [255, 0, 1, 2]
        assert not any(any(each.slots) for each in mine)


def test_receivers_do_not_merge_a_stream_with_its_own_past() -> None:
    def cid(host: str) -> bytes:
        stream = E131Stream(Destination(host=host, port=5568), 1)
        return read_packet(stream.frame([(1, b"x")], 1)[0].data).cid

    assert cid("10.0.0.2") == cid("10.0.0.2") != cid("10.0.0.3")


@pytest.mark.parametrize("values", [{"host": "multicast"}, {"interface": "eth0"}])
def test_multicast_without_the_address_of_an_interface_is_refused(values: dict[str, str]) -> None:
    with pytest.raises(ValueError, match="interface"):
        E131Config.model_validate(values)


def test_artnet_packet_matches_the_golden_bytes() -> None:
    assert artnet.dmx_packet(0x123, 7, bytes.fromhex("0a0b0c")).hex() == ARTNET_GOLDEN.replace(" ", "")


@given(slots, st.integers(0, 0x7FFF), st.integers(0, 100_000))
def test_artnet_packet_has_even_slots_and_counts_from_one(data: bytes, universe: int, number: int) -> None:
    packet = artnet.dmx_packet(universe, number, data)
    assert int.from_bytes(packet[16:18], "big") == len(packet) - 18 == len(data) + len(data) % 2
    assert packet[18 : 18 + len(data)] == data
    assert int.from_bytes(packet[14:16], "little") == universe
    assert 1 <= packet[12] <= 255
    assert artnet.dmx_packet(universe, number + 1, data)[12] == packet[12] % 255 + 1


def test_several_universes_are_shown_at_once_by_a_sync_packet() -> None:
    two = [(0, b"ab"), (1, b"cd")]
    sync = Datagram(bytes.fromhex("4172742d4e657400 0052 000e 0000"))
    assert ArtnetStream("x", 1).frame(two, 1)[-1] == sync
    assert sync not in ArtnetStream("x", 1).frame(two[:1], 1)


def test_node_that_answers_is_read() -> None:
    node = artnet.ArtnetNode("192.168.1.7", "A node in the attic", "#0001 [1] ok", (0x125, 0x126))
    assert artnet.read_reply(REPLY) == node


def test_node_with_several_replies_is_one_node_with_all_universes() -> None:
    nodes: dict[str, artnet.ArtnetNode] = {}
    for name, universes in (("wall", (4, 5)), ("", (0, 1, 2, 3)), ("wall", (4, 5))):
        merge_reply(nodes, artnet.ArtnetNode("10.0.0.7", name, "", universes))
    merge_reply(nodes, artnet.ArtnetNode("10.0.0.8", "wall", "", (0,)))
    assert [(each.address, each.universes) for each in nodes.values()] == [
        ("10.0.0.7", (0, 1, 2, 3, 4, 5)), ("10.0.0.8", (0,))
    ]  # fmt: skip


@given(st.one_of(st.binary(max_size=300), st.integers(0, len(REPLY)).map(lambda size: REPLY[:size])))
def test_any_bytes_are_an_answer_or_none(data: bytes) -> None:
    for packet in (data, REPLY[:10] + data):
        node = artnet.read_reply(packet)
        assert node is None or node.name.isprintable()


@given(st.integers(1, 700), st.sampled_from(["RGB", "GRBW"]), st.integers(1, 100))
def test_pixels_fill_universes_without_being_split(pixels: int, order: str, first: int) -> None:
    strip = Strip(id="a", line_m=((0, 0, 0), (1, 0, 0)), pixels=pixels)
    rgb = bytes(1 + k % 250 for k in range(3 * pixels))
    most = 170 if order == "RGB" else 128
    segment = Segment(strip="a", order=order)

    config = ArtnetConfig(host="x", universe=first, segments=(segment,))
    output = make_artnet(config, Surroundings.detached())
    output.pixel_map, problems = output.map_strips([strip])
    assert not problems

    frame = output.pixel_map.output_bytes(StripsFrame(stamp_ns=1, strips=(StripFrame(id="a", rgb=rgb),)))
    packets = [each.data for each in output.encode(frame, 1) if each.data != artnet.sync_packet()]
    universes = [int.from_bytes(packet[14:16], "little") for packet in packets]
    assert universes[0] == first
    assert all(after == before + 1 for before, after in pairwise(universes))
    assert all(len(packet) - 18 == most * len(order) for packet in packets[:-1])

    sent = b"".join(packet[18:] for packet in packets)[: pixels * len(order)]
    shown = [sent[k : k + len(order)] for k in range(0, len(sent), len(order))]
    assert [bytes(pixel[order.index(color)] for color in "RGB") for pixel in shown] == [
        rgb[k : k + 3] for k in range(0, len(rgb), 3)
    ]


def test_no_loopback_is_asked() -> None:
    assert not [address for address in broadcast_addresses() if address.startswith("127.")]


def test_search_without_its_extra_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ifaddr", None)
    with pytest.raises(ConfigError, match="scripts/setup discovery"):
        broadcast_addresses()


def test_frame_of_a_thousand_pixels_matches_the_golden_bytes() -> None:
    pixels = bytes(k % 256 for k in range(3000))
    packets = encode_frame(pixels, 3, 1)
    assert [packet[:10].hex() for packet in packets] == [
        "40010b010000000005a0",
        "40020b01000005a005a0",
        "41030b0100000b400078",
    ]
    assert b"".join(packet[10:] for packet in packets) == pixels


def test_ddp_packets_have_the_type_of_white_and_whole_pixels() -> None:
    first, last = encode_frame(bytes(4 * 400), 4, 1)
    assert (first[2], len(first) - 10) == (0x1B, 4 * 360)
    assert struct.unpack(">I", last[4:8]) == (4 * 360,)


def shown_by_wled(packets: Sequence[bytes], last_push: int) -> tuple[bool, int]:
    """Return True if WLED takes all packets after a frame that ended with `last_push`, and their own end.

    The rule is that of the description of WLED 0.15, with its default to skip packets out of sequence.
    """
    for packet in packets:
        sequence = packet[1]
        if sequence and last_push:
            if last_push > 5:
                if last_push - 5 < sequence < last_push:
                    return False, last_push
            elif sequence > 10 + last_push or sequence < last_push:
                return False, last_push
    return True, packets[-1][1] or last_push


@given(st.integers(1, 20_000), st.sampled_from([3, 4]))
def test_wled_drops_no_packet_as_late_and_shows_frames_once(pixels: int, colors: int) -> None:
    data = bytes(pixels * colors)
    last = 0
    for number in range(1, 18):
        packets = encode_frame(data, colors, number)
        taken, last = shown_by_wled(packets, last)
        assert taken
        assert [packet[0] & 1 for packet in packets] == [0] * (len(packets) - 1) + [1]
        assert all(packet[1] <= 15 for packet in packets)
        assert sum(len(packet) - 10 for packet in packets) == len(data)


def test_output_without_pixels_sends_nothing() -> None:
    assert encode_frame(b"", 3, 1) == []


def test_controller_is_described_by_its_name_pixels_and_version() -> None:
    info = {"leds": {"count": 120}, "ver": "0.15.1", "name": "Kitchen"}
    found = described("wled-kitchen.local", "wled-kitchen", info)
    assert (found.address, found.label) == ("wled-kitchen.local", "Kitchen, 120 pixels, WLED 0.15.1")
    assert found.details == {"pixels": 120, "version": "0.15.1"}


def test_controllers_name_and_version_are_short_text_without_control_characters() -> None:
    info = {"name": "a\x1b[2J" + "x" * 100_000, "ver": "1" * 100_000}
    found = described("10.0.0.9", "wled-1", info)
    assert len(found.label) < 200
    assert found.label.startswith("a?[2Jx")
    assert len(str(found.details["version"])) <= 64
    nested: object = "x"
    for _ in range(20_000):
        nested = list[object]([nested])
    assert described("10.0.0.9", "wled-1", {"name": nested, "ver": nested}).label == "wled-1"


@given(st.recursive(st.none() | st.integers() | st.text(), lambda some: st.dictionaries(st.text(), some)))
def test_controller_that_describes_itself_oddly_is_listed_all_the_same(info: object) -> None:
    assert described("10.0.0.9", "wled-1", info).address == "10.0.0.9"
    assert described("10.0.0.9", "wled-1", {"leds": info}).label.startswith("wled-1")
    for count in (10**4000, -5, True):
        assert "pixels" not in described("10.0.0.9", "wled-1", {"leds": {"count": count}}).details


async def test_node_is_named_by_its_host_alone_whatever_its_port() -> None:
    told = Health()
    config = ArtnetConfig(host="node", port=7000, segments=(Segment(strip="b"),))
    make_artnet(config, replace(Surroundings.detached(), health=told)).set_strips(())
    assert told.warnings == {"segments node": "node: the map has no strip b: correct `segments`"}
