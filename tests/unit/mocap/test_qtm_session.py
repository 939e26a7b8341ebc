"""A session with a QTM server: names, times, axes, and bodies and frames that are not used."""

import asyncio
import math
import struct

import pytest

from pointit.bridges.mocap.bodies import Bodies, TimedFrame
from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.qtm_client import QtmClient, QtmSession
from pointit.geometry import rotation
from pointit.schemas import NS_PER_S
from tests.support.bench import START_NS
from tests.unit.mocap.qtm_server import LEVEL, LOST, NAN, QtmBody, settings

MS = NS_PER_S // 1000
CUP: QtmBody = ((1000.0, 2000.0, 1500.0), LEVEL, 0.4)


class QtmConversation:
    """A connected session, and the frames that it used."""

    def __init__(self, *names: str, up: str = "+Z") -> None:
        self.used: list[TimedFrame] = []
        self.session = QtmSession("qtm-pc", self.used.append)
        self.now_ns = START_NS
        self.time_us = 0
        self.session.restart(self.now_ns, is_connected=True)
        self.session.set_parameters(settings(names or ("cup",), up).encode() + b"\0")

    def stream(self, frames: int, *bodies: QtmBody, delay_ns: int = 5 * MS, stands: bool = False) -> None:
        for _ in range(frames):
            self.now_ns += 10 * MS
            self.time_us += 0 if stands else 10_000
            self.session.receive(self.time_us, bodies or (CUP,), self.now_ns + delay_ns)

    @property
    def problem(self) -> str:
        return self.session.problem(self.now_ns + 2 * NS_PER_S)


def test_bodies_are_in_metres_with_their_names_and_residuals() -> None:
    talk = QtmConversation("cup", "plate")
    talk.stream(1, CUP, ((-1.5, 0.0, 20.0), LEVEL, 2.0))
    (cup_name, cup), (plate_name, plate) = talk.used[-1].bodies
    assert (cup_name, plate_name) == ("cup", "plate")
    assert cup.position_m == (1.0, 2.0, 1.5)
    assert cup.error_m == pytest.approx(0.0004)
    assert plate.position_m == pytest.approx((-0.0015, 0.0, 0.02))
    assert talk.session.problem(talk.now_ns) == ""


def columns_of(turn: rotation.Quaternion) -> list[float]:
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    return [value for axis in axes for value in rotation.rotate(turn, axis)]


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, 0.8)])
@pytest.mark.parametrize("angle_rad", [0.0, 0.3, math.pi / 2, math.pi, -2.5])
def test_matrices_by_columns_become_their_rotations(
    axis: tuple[float, float, float], angle_rad: float
) -> None:
    turn = rotation.from_axis_angle(axis, angle_rad)
    talk = QtmConversation()
    talk.stream(1, (CUP[0], columns_of(turn), 0.1))
    result = talk.used[-1].bodies[0][1].orientation_xyzw
    assert abs(sum(a * b for a, b in zip(result, turn, strict=True))) == pytest.approx(1.0)


def test_the_columns_are_those_of_a_table_that_qtm_exported() -> None:
    """A row that QTM wrote (public data set of a towing tank): roll, pitch, yaw in degrees, and Rot[0..8]."""
    roll, pitch, yaw = (math.radians(value) for value in (-0.65630, 0.09391, 0.05772))
    matrix = (1.00000, 0.00099, -0.00165, -0.00101, 0.99993, -0.01145, 0.00164, 0.01145, 0.99993)
    talk = QtmConversation()
    talk.stream(1, (CUP[0], matrix, 4.98536))
    assert talk.used[-1].bodies[0][1].orientation_xyzw == pytest.approx(
        (roll / 2, pitch / 2, yaw / 2, 1.0), abs=1e-4
    )


@pytest.mark.parametrize(
    "lost",
    [
        LOST,
        ((NAN, 0.0, 0.0), LEVEL, 0.1),
        (CUP[0], (NAN,) * 9, 0.1),
        (CUP[0], (0.0,) * 9, 0.1),
        (CUP[0], (-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0), 0.1),
        ((3e38, 0.0, 0.0), LEVEL, 0.1),
        ((math.inf, 0.0, 0.0), LEVEL, 0.1),
    ],
)
def test_lost_bodies_are_not_used_and_the_others_are(lost: QtmBody) -> None:
    talk = QtmConversation("plate", "cup")
    talk.stream(1, lost, CUP)
    config = MocapConfig.model_validate({"system": "qtm", "bodies": {"plate": {}}})
    bodies = Bodies(config)
    assert [pose.name for pose in bodies.update(talk.used[-1], None)] == ["cup"]
    for _ in range(300):
        talk.stream(1, lost, CUP)
        bodies.update(talk.used[-1], None)
    assert "plate is not seen" in bodies.problem(talk.now_ns)


@pytest.mark.parametrize("residual", [NAN, -1.0, 0.0])
def test_a_residual_that_is_none_leaves_the_least_uncertainty(residual: float) -> None:
    talk = QtmConversation()
    talk.stream(1, (CUP[0], LEVEL, residual))
    (pose,) = Bodies(MocapConfig()).update(talk.used[-1], None)
    assert pose.sigma_m == 0.001


def test_up_axis_is_that_of_qtm_unless_configured() -> None:
    talk = QtmConversation(up="+Y")
    talk.stream(1)
    ((y_up,),) = (Bodies(MocapConfig(system="qtm")).update(talk.used[-1], None),)
    assert y_up.position_m == (1.0, -1.5, 2.0)
    ((z_up,),) = (Bodies(MocapConfig(system="qtm", up="z")).update(talk.used[-1], None),)
    assert z_up.position_m == (1.0, 2.0, 1.5)
    talk = QtmConversation(up="-Z")
    talk.stream(200)
    assert not talk.used
    assert "its axis -Z points up: choose +Z or +Y" in talk.problem


def test_delays_of_single_frames_do_not_move_their_times() -> None:
    talk = QtmConversation()
    talk.stream(1)
    first_ns = talk.used[-1].stamp_ns
    talk.stream(1, delay_ns=45 * MS)
    talk.stream(1, delay_ns=9 * MS)
    assert [each.stamp_ns - first_ns for each in talk.used] == [0, 10 * MS, 20 * MS]


def test_a_clock_that_drifts_is_followed() -> None:
    talk = QtmConversation()
    for _ in range(12_000):
        talk.now_ns += 10 * MS + 1000  # 100 ppm faster than QTM's
        talk.time_us += 10_000
        talk.session.receive(talk.time_us, (CUP,), talk.now_ns)
    assert talk.now_ns - talk.used[-1].stamp_ns < 1.1 * MS


def test_a_measurement_that_begins_anew_is_used_at_once() -> None:
    talk = QtmConversation()
    talk.stream(100)
    talk.time_us = 0
    talk.stream(1)
    assert talk.used[-1].stamp_ns == talk.now_ns + 5 * MS


@pytest.mark.parametrize(
    ("delay_ns", "stands", "sentence"),
    [(3 * NS_PER_S, False, "come 3.0 s late"), (5 * MS, True, "stand still")],
)
def test_late_and_repeated_frames_are_reported_and_not_used(
    delay_ns: int, sentence: str, *, stands: bool
) -> None:
    talk = QtmConversation()
    talk.stream(1)
    talk.stream(200, delay_ns=delay_ns, stands=stands)
    assert len(talk.used) == 1
    assert sentence in talk.session.problem(talk.now_ns + 3 * NS_PER_S)


def test_played_file_is_not_used_until_cameras_measure() -> None:
    talk = QtmConversation()
    talk.session.set_event(8)
    talk.stream(100)
    assert not talk.used
    assert "QTM plays a file" in talk.problem
    talk.session.set_event(11)  # settings: it plays on
    talk.stream(1)
    assert not talk.used
    talk.session.set_event(3)
    talk.session.set_parameters(settings(["cup"]).encode())
    talk.stream(1)
    assert len(talk.used) == 1


def test_frames_are_not_used_when_settings_have_changed() -> None:
    talk = QtmConversation("cup")
    talk.stream(1)
    talk.session.set_event(11)
    talk.stream(1)
    assert len(talk.used) == 1
    talk.session.set_parameters(settings(["plate"]).encode())
    talk.stream(1)
    assert [name for name, _ in talk.used[-1].bodies] == ["plate"]
    talk.session.restart(talk.now_ns, is_connected=True)  # another QTM may have other bodies
    talk.stream(1)
    assert len(talk.used) == 2


def test_frames_without_names_are_not_used_and_names_requested() -> None:
    talk = QtmConversation("cup", "plate")
    assert not talk.session.are_settings_stale
    talk.stream(200)
    assert not talk.used
    assert talk.session.are_settings_stale
    assert "its frames have 1 bodies, its settings 2" in talk.problem


def test_missing_frames_and_missing_connection_have_different_messages() -> None:
    talk = QtmConversation()
    assert "answers, but no frames come: start a measurement" in talk.session.problem(
        talk.now_ns + 4 * NS_PER_S
    )
    talk.session.restart(talk.now_ns, is_connected=False)
    assert talk.session.problem(talk.now_ns + 4 * NS_PER_S) == ""


SETTINGS_1_25 = """<QTM_Parameters_Ver_1.25>
    <The_3D><AxisUpwards>+Z</AxisUpwards></The_3D>
    <The_6D>
        <Body><Name>refined</Name><Enabled>true</Enabled><Color R="0" G="255" B="0"/>
            <Mesh><Name>Arqus.obj</Name><Scale>0.01</Scale></Mesh>
            <Points><Point X="-67.9" Y="29.8" Z="-1.6" Virtual="0" Name="Layout 3 - 1"/></Points>
        </Body>
        <Body><Name>Table</Name><Enabled>true</Enabled></Body>
    </The_6D>
</QTM_Parameters_Ver_1.25>"""
"""Elements and names as in Tests/Data/6Dof.h of the maker's qualisys_cpp_sdk (MIT), shortened."""


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (settings(["Körper", ""]).encode(), ["Körper", "body 2"]),
        (settings(["Körper", ""]).encode("cp1252"), ["Körper", "body 2"]),
        (b'<?xml version="1.0" encoding="UTF-8"?>' + settings([" a ", "b&amp;c"]).encode(), ["a", "b&c"]),
        (SETTINGS_1_25.encode(), ["refined", "Table"]),
    ],
)
def test_settings_of_other_versions_and_encodings_are_read(text: bytes, names: list[str]) -> None:
    talk = QtmConversation()
    talk.session.set_parameters(text)
    talk.stream(1, CUP, CUP)
    assert [name for name, _ in talk.used[-1].bodies] == names


@pytest.mark.parametrize(
    "text", [b"", b"\0", b"Parameters not available", b"<a><b></a>", b"<!DOCTYPE a><a/>"]
)
def test_settings_that_are_no_xml_are_refused(text: bytes) -> None:
    with pytest.raises(ValueError, match="its settings"):
        QtmConversation().session.set_parameters(text)


PACKET = bytes.fromhex(
    "5c000000 03000000"  # size 92, data
    "d204000000000000 07000000 01000000"  # 1234 us, frame 7, one component
    "44000000 0b000000"  # size 68, type 11: 6D with residual
    "01000000 0000 0000"  # one body; drop rate, out of synchronisation rate
    "00007a44 0000fa44 0080bb44"  # 1000, 2000, 1500 mm
    "00000000 0000803f 00000000"  # a quarter turn about z: the columns of its matrix
    "000080bf 00000000 00000000"
    "00000000 00000000 0000803f"
    "0000003f"  # 0.5 mm
)
"""A data packet written by hand after QTM's description of its RT protocol: data packet, 6DOF residual."""


class Connection(asyncio.Transport):
    def pause_reading(self) -> None:
        pass

    def resume_reading(self) -> None:
        pass


async def test_a_packet_as_the_protocol_describes_it_is_read() -> None:
    pytest.importorskip("qtm_rt", reason="qtm-rt is not installed")
    talk = QtmConversation()
    client = QtmClient(talk.session, lambda: talk.now_ns, lambda _: None)
    client.connection_made(Connection())
    client.data_received(PACKET[:50])
    client.data_received(PACKET[50:])
    (name, body), *others = talk.used[-1].bodies
    assert (name, body.position_m, body.error_m, others) == ("cup", (1.0, 2.0, 1.5), 0.0005, [])
    half = math.sqrt(0.5)
    assert body.orientation_xyzw == pytest.approx((0.0, 0.0, half, half))


def test_test_encoder_agrees_with_the_decoder_of_the_maker() -> None:
    qtm_rt = pytest.importorskip("qtm_rt", reason="qtm-rt is not installed")
    from tests.unit.mocap.qtm_server import frame  # noqa: PLC0415 - only with that package

    packet = qtm_rt.QRTPacket(frame(1234, [CUP, LOST], 7)[8:])
    assert (packet.timestamp, packet.framenumber) == (1234, 7)
    info, ((position, turn, residual), (lost, _, _)) = packet.get_6d_residual()
    assert (info.body_count, tuple(position), tuple(turn.matrix)) == (2, CUP[0], LEVEL)
    assert struct.pack("<f", residual.residual) == struct.pack("<f", 0.4)
    assert all(map(math.isnan, lost))
