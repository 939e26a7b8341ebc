"""NatNet: connection, clock, names and streams that are not used; packets of others, changed and damaged."""

import contextlib
import json
import math
import random
import socket
import struct
from collections.abc import Sequence
from pathlib import Path

import pytest

from pointit.bridges.mocap import natnet_client
from pointit.bridges.mocap.bodies import Bodies, TimedFrame
from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.natnet_client import NatNetClient, NatNetSession, ServerClock
from pointit.bridges.mocap.natnet_packets import (
    MalformedPacketError,
    ServerInfo,
    connect_packet,
    read_frame,
    read_models,
    read_server_info,
    split_packet,
)
from pointit.schemas import NS_PER_S
from tests.support.bench import START_NS
from tests.unit.mocap import natnet_encoder as natnet
from tests.unit.mocap.natnet_encoder import CLOCK_HZ, Body

MS = NS_PER_S // 1000
AHEAD_NS = 7 * 10**14


def ticks(time_ns: int) -> int:
    return (time_ns + AHEAD_NS) * CLOCK_HZ // NS_PER_S


class Conversation:
    """A session and what it used, with a server whose answers take a millisecond."""

    def __init__(self, version: tuple[int, int] = (3, 1), *, connected: bool = True) -> None:
        self.version = version
        self.used: list[TimedFrame] = []
        self.session = NatNetSession("motive-pc", self.used.append)
        self.session.restart(START_NS)
        self.now_ns = START_NS
        self.number = 0
        self.asked: list[int] = []
        if connected:
            self.session.receive(natnet.info(version), self.now_ns)
            self.answer({1: "cup", 2: "plate"})

    def answer(self, names: dict[int, str]) -> None:
        for request in self.session.requests(self.now_ns):
            self.asked.append(request[0])
            if request[0] == 4:
                self.session.receive(natnet.models(names, self.version), self.now_ns)
            elif request[0] == 12:
                self.session.receive(natnet.echo(request, ticks(self.now_ns + MS // 2)), self.now_ns + MS)

    def stream(
        self, frames: int, *bodies: Body, age_ns: int = 5 * MS, stands: bool = False, flags: int = 0
    ) -> None:
        for _ in range(frames):
            self.now_ns += 10 * MS
            self.number += not stands
            exposure_ns = START_NS if stands else self.now_ns - age_ns
            data = natnet.frame(
                bodies or (Body(1),),
                self.version,
                number=self.number,
                exposure=ticks(exposure_ns),
                flags=flags,
            )
            self.session.receive(data, self.now_ns)

    @property
    def problem(self) -> str:
        return self.session.problem(self.now_ns)


@pytest.mark.parametrize("version", [(3, 0), (3, 1), (4, 0), (4, 1)])
def test_bodies_have_their_names_and_times_of_exposure(version: tuple[int, int]) -> None:
    talk = Conversation(version)
    talk.stream(3, Body(2), Body(1))
    assert [name for name, _ in talk.used[-1].bodies] == ["plate", "cup"]
    assert talk.used[-1].stamp_ns == pytest.approx(talk.now_ns - 5 * MS, abs=MS)
    assert talk.used[-1].sigma_s < 0.0005
    assert talk.problem == ""


def test_frames_without_a_clock_are_stamped_at_arrival() -> None:
    talk = Conversation((2, 9))
    talk.stream(1)
    assert (talk.used[-1].stamp_ns, talk.used[-1].sigma_s) == (talk.now_ns, 0.02)


def test_frames_are_stamped_at_sending_when_exposure_is_missing() -> None:
    talk = Conversation()
    talk.now_ns += 10 * MS
    data = natnet.frame([Body(1)], exposure=0, sent=ticks(talk.now_ns - 3 * MS))
    talk.session.receive(data, talk.now_ns)
    assert talk.used[-1].stamp_ns == pytest.approx(talk.now_ns - 3 * MS, abs=MS)
    assert talk.used[-1].sigma_s >= 0.005


def test_silence_and_missing_frames_have_different_messages() -> None:
    talk = Conversation(connected=False)
    assert talk.problem == ""
    talk.now_ns += 4 * NS_PER_S
    assert "motive-pc does not answer" in talk.problem
    talk = Conversation()
    talk.now_ns += 4 * NS_PER_S
    assert "no frames come (unicast, port 1511)" in talk.problem


def test_frames_that_stand_still_are_not_used_and_reported() -> None:
    talk = Conversation()
    talk.stream(1)
    talk.stream(200, stands=True)
    assert len(talk.used) <= 2
    assert "stand still" in talk.problem
    talk.stream(2)
    assert talk.problem == ""


def test_a_recording_that_motive_plays_is_not_used() -> None:
    talk = Conversation()
    talk.stream(200, age_ns=90 * NS_PER_S)
    assert not talk.used
    assert "90.0 s old" in talk.problem


def test_frames_of_another_machine_are_reported_and_not_used() -> None:
    talk = Conversation()
    talk.stream(1)
    talk.session.receive_unknown(natnet.frame([Body(1)], number=9), "10.0.0.9", talk.now_ns)
    assert len(talk.used) == 1
    assert "10.0.0.9 streams here, too" in talk.problem
    talk.stream(1001)
    assert talk.problem == ""


def test_a_damaged_packet_costs_itself_only() -> None:
    talk = Conversation()
    talk.stream(1)
    talk.session.receive(natnet.frame([Body(1)])[:40], talk.now_ns)
    talk.session.receive(b"\x07", talk.now_ns)
    talk.stream(1)
    assert (len(talk.used), talk.session.damaged) == (2, 2)
    assert "sent no NatNet as it is known" in talk.problem


def test_names_are_requested_when_models_change_or_bodies_are_unknown() -> None:
    talk = Conversation()
    talk.stream(1, flags=2)
    talk.answer({1: "mug"})
    talk.stream(1)
    assert talk.used[-1].bodies[0][0] == "mug"
    talk.stream(1, Body(77))
    assert talk.used[-1].bodies[0][0] == "body 77"
    talk.answer({77: "hat"})
    talk.stream(1, Body(77))
    assert talk.used[-1].bodies[0][0] == "hat"
    talk.asked.clear()
    talk.answer({})
    assert 4 not in talk.asked, "names that are known are not asked for"


def test_bodies_that_share_an_id_are_not_used_and_reported() -> None:
    talk = Conversation()
    talk.stream(1, flags=2)
    models = natnet.models({1: "cap", 2: "cup", 7: "cuff"}).replace(
        struct.pack("<ii", 7, -1), struct.pack("<ii", 1, -1)
    )
    talk.session.receive(models, talk.now_ns)
    bodies = Bodies(MocapConfig.model_validate({"up": "z", "bodies": {"cuff": {}}}))
    for _ in range(250):
        talk.stream(1, Body(1, (1.0, 1.0, 1.0)), Body(1, (3.0, 1.0, 1.0)), Body(2, (2.0, 2.0, 1.0)))
        assert [pose.name for pose in bodies.update(talk.used[-1], None)] == ["cup"]
    sentence = "the bodies cap, cuff have one streaming id, 1, and are not used: give each its own in Motive"
    assert sentence in bodies.problem(talk.now_ns)


def test_more_bodies_than_a_room_has_are_damage() -> None:
    talk = Conversation()
    talk.stream(1, *(Body(number) for number in range(257)))
    assert (talk.used, talk.session.damaged) == ([], 1)


def test_a_server_that_is_silent_is_connected_to_anew() -> None:
    talk = Conversation()
    talk.stream(1)
    talk.now_ns += 6 * NS_PER_S
    assert [request[0] for request in talk.session.requests(talk.now_ns)] == [0]
    talk.session.receive(natnet.info((4, 1)), talk.now_ns)
    talk.version = (4, 1)
    talk.answer({1: "cup"})
    talk.stream(1)
    assert talk.used[-1].bodies[0][0] == "cup"


@pytest.mark.parametrize("rate", [-40e-6, 0.0, 40e-6])
def test_clock_is_accurate_to_0_5_ms_despite_drift_and_delays(
    rate: float,
) -> None:
    dice = random.Random(3)
    clock = ServerClock(CLOCK_HZ)
    errors: list[float] = []
    for second in range(120):
        sent_ns = START_NS + second * NS_PER_S // 2
        away_ns, back_ns = (int(dice.expovariate(1 / (0.3 * MS))) + MS // 20 for _ in range(2))
        there_ns = sent_ns + away_ns
        clock.add(sent_ns, there_ns + back_ns, ticks(there_ns + round(rate * (there_ns - START_NS))))
        now_ns = sent_ns + NS_PER_S // 3
        time = clock.time_ns(ticks(now_ns + round(rate * (now_ns - START_NS))), now_ns)
        assert time is not None
        errors.append(abs(time[0] - now_ns))
    assert sorted(errors)[-6] < MS // 2
    assert clock.steps == 0


@pytest.mark.parametrize("step_ns", [-30 * NS_PER_S, 8 * MS, 30 * NS_PER_S])
def test_clock_that_was_set_is_followed_from_the_next_echo(step_ns: int) -> None:
    clock = ServerClock(CLOCK_HZ)
    for index in range(40):
        sent_ns = START_NS + index * NS_PER_S // 2
        moved_ns = step_ns if index >= 20 else 0
        clock.add(sent_ns, sent_ns + MS, ticks(sent_ns + MS // 2 + moved_ns))
        time = clock.time_ns(ticks(sent_ns + moved_ns), sent_ns)
        assert time is not None
        assert time[0] == pytest.approx(sent_ns, abs=MS // 2)
    assert clock.steps == 1


FILE = json.loads((Path(__file__).parent / "packets.json").read_text(encoding="utf-8"))
PACKETS = {
    name: bytes.fromhex(text)
    for group in ("recorded", "encoded")
    for name, text in FILE[group]["packets"].items()
}
RECORDED = {
    "2.5": (92881, 1, (-0.2631579, 0.0391267, 1.1235183), 6.563962e-06, None),
    "2.7": (411213, 1, (0.0060196, 0.0958076, -1.4075972), 2.163400e-05, None),
    "2.9": (11823217, 2, (0.2453393, 0.0169602, 0.2201603), 1.156181e-04, 3),
}


def version_of(name: str) -> tuple[int, int]:
    major, _, minor = name.rsplit(maxsplit=1)[-1].partition(".")
    return int(major), int(minor)


@pytest.mark.parametrize("version", RECORDED)
def test_frames_that_were_recorded_from_motive_are_read(version: str) -> None:
    number, body_id, position_m, error_m, measured = RECORDED[version]
    name = f"frame {version}"
    frame = read_frame(split_packet(PACKETS[name])[1], version_of(name))
    (body,) = frame.bodies
    assert (frame.number, frame.flags, body.id, body.is_tracked) == (number, 0, body_id, True)
    assert body.position_m == pytest.approx(position_m, abs=1e-6)
    assert body.error_m == pytest.approx(error_m, rel=1e-5)
    assert math.hypot(*body.orientation_xyzw) == pytest.approx(1.0)
    assert body.measured == measured


@pytest.mark.parametrize("version", ["3.0", "3.1", "4.0", "4.1"])
def test_frames_of_another_program_are_read_past_other_sections(version: str) -> None:
    frame = read_frame(split_packet(PACKETS[f"frame {version}"])[1], version_of(version))
    cup, occluded, ghost = frame.bodies
    assert (frame.number, frame.flags, frame.exposure_ticks) == (1234, 2, 125_000_000)
    assert (cup.id, cup.position_m, cup.is_tracked, cup.measured) == (7, (1.0, 1.25, -2.5), True, 3)
    assert cup.orientation_xyzw == pytest.approx((0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)))
    assert (occluded.id, occluded.is_tracked) == (8, False)
    assert (ghost.id, ghost.is_tracked, ghost.measured) == (3, True, 0)


@pytest.mark.parametrize("version", ["3.0", "3.1", "4.0", "4.1"])
def test_names_that_another_program_wrote_are_read_past_other_models(version: str) -> None:
    payload = split_packet(PACKETS[f"models {version}"])[1]
    assert read_models(payload, version_of(version)) == {7: ("cup",), 8: ("Größe 8",), 3: ("ghost",)}


@pytest.mark.parametrize("name", [name for name in PACKETS if name.startswith("info")])
def test_servers_that_others_recorded_and_wrote_are_read(name: str) -> None:
    info = read_server_info(split_packet(PACKETS[name])[1])
    is_new = version_of(name) >= (3, 0)
    assert info.version[0] == version_of(name)[0]
    assert info.application == ("Motive" if is_new else "NatNetLib")
    assert (info.clock_hz, info.data_port, info.group) == (10_000_000 if is_new else 0, 1511, "239.255.42.99")


def test_bodies_of_later_versions_may_be_longer() -> None:
    body = struct.pack("<i3f4ffH", 5, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.001, 1) + b"later"
    sections = struct.pack("<8i", 9, 0, 0, 0, 0, 2, 2 * len(body), 0)[:28] + 2 * body
    rest = struct.pack("<10i", *[0] * 10) + bytes(8) + struct.pack("<IId3QII", 0, 0, 0.0, 4, 5, 6, 0, 0)
    frame = read_frame(sections + rest + struct.pack("<Hi", 0, 0), (4, 4))
    assert [each.position_m for each in frame.bodies] == [(1.0, 2.0, 3.0)] * 2
    assert (frame.exposure_ticks, frame.sent_ticks) == (4, 6)


@pytest.mark.parametrize("number", [math.nan, math.inf, 1e20])
def test_a_body_without_a_position_or_orientation_is_not_tracked(number: float) -> None:
    payload = split_packet(PACKETS["frame 3.1"])[1]
    cup = struct.pack("<i3f", 7, 1.0, 1.25, -2.5)
    assert payload.count(cup) == 1
    at = payload.index(cup)
    for begin, values in ((at + 8, (number,)), (at + 16, (0.0, 0.0, 0.0, 0.0))):
        changed = bytearray(payload)
        struct.pack_into(f"<{len(values)}f", changed, begin, *values)
        assert not read_frame(bytes(changed), (3, 1)).bodies[0].is_tracked


def test_names_may_be_empty_repeated_or_in_windows_code_pages() -> None:
    payload = split_packet(PACKETS["models 3.1"])[1]
    body = struct.pack("<i", 1)  # the kind of a model, before its name
    changed = payload.replace(body + b"cup\0", body + b"\0").replace(body + b"ghost\0", body + b"cup\0")
    changed = changed.replace("Größe 8".encode(), "Größe 8".encode("cp1252"))
    assert read_models(changed, (3, 1)) == {7: ("",), 8: ("Größe 8",), 3: ("cup",)}


def test_a_request_to_connect_asks_for_version_4_1() -> None:
    message, payload = split_packet(connect_packet())
    assert (message, len(payload), payload[-4:]) == (0, 269, bytes((4, 1, 0, 0)))


def test_damaged_packets_are_read_or_refused() -> None:
    dice = random.Random(1)
    names = sorted(PACKETS)
    for _ in range(2000):
        name = dice.choice(names)
        damaged = bytearray(PACKETS[name])
        for _ in range(dice.choice((0, 1, 1, 2, 8))):
            damaged[dice.randrange(len(damaged))] = dice.choice((0, 1, 127, 128, 255, dice.randrange(256)))
        cut = dice.choice((len(damaged), len(damaged), dice.randrange(len(damaged))))
        read_all(bytes(damaged[:cut]), version_of(name))


def read_all(data: bytes, version: tuple[int, int]) -> None:
    """Read in every way. Anything but a `MalformedPacketError` is an error."""
    for read in (
        lambda: read_frame(split_packet(data)[1], version),
        lambda: read_models(split_packet(data)[1], version),
        lambda: read_server_info(split_packet(data)[1]),
    ):
        with contextlib.suppress(MalformedPacketError):
            read()


def test_an_independent_decoder_reads_the_same() -> None:
    data_frame = pytest.importorskip("natnet.data_frame", reason="natnet 0.3.0 is not installed")
    buffers = pytest.importorskip("natnet.packet_buffer")
    versions = pytest.importorskip("natnet.version")
    frames = {name: data for name, data in PACKETS.items() if name.startswith("frame")}
    for name, data in frames.items():
        payload = split_packet(data)[1]
        version = version_of(name)
        theirs = data_frame.DataFrame.read_from_buffer(
            buffers.PacketBuffer(payload), versions.Version(*version)
        )
        ours = read_frame(payload, version)
        assert ours.number == theirs.prefix.frame_number, name
        assert [body.id for body in ours.bodies] == [body.id_num for body in theirs.rigid_bodies]
        for body, other in zip(ours.bodies, theirs.rigid_bodies, strict=True):
            assert body.is_tracked == other.tracking_valid or version < (2, 6)
            assert body.position_m == other.pos
            assert body.orientation_xyzw == pytest.approx(other.rot, abs=1e-6)
            assert body.error_m == other.marker_error
        if version >= (3, 0):
            assert ours.exposure_ticks == theirs.suffix.stamp_camera_mid_exposure


async def test_named_interface_joins_without_route_to_server(monkeypatch: pytest.MonkeyPatch) -> None:
    joined: list[str] = []

    def no_route(host: str) -> str:
        raise OSError(host)

    def join(_sock: socket.socket, _group: str, interfaces: Sequence[str]) -> None:
        joined.extend(interfaces)

    monkeypatch.setattr(natnet_client, "_own_address", no_route)
    monkeypatch.setattr(natnet_client, "_join", join)
    conversation = Conversation()
    client = NatNetClient(
        conversation.session, lambda: START_NS, lambda _warning: None, interface="127.0.0.1"
    )
    info = ServerInfo("Motive", (3, 1), CLOCK_HZ, data_port=0, is_multicast=True, group="239.255.42.99")

    stream = await client._open_stream(info, "motive-pc")
    stream.close()
    assert joined == ["127.0.0.1"]
