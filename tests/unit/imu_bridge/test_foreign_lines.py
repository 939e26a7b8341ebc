"""Lines and JSON as other people's boards write them, and how those that are refused are named."""

import pytest

from pointit.services.imu_bridge.serial.detection import Detection, SerialConfig
from pointit.services.imu_bridge.serial.line_parser import LineError, LineParser, QuaternionLine
from pointit.services.imu_bridge.serial.source import SilenceWatch
from pointit.services.imu_bridge.serial.text_line import TextFramer
from pointit.services.imu_bridge.sources import Reading
from pointit.services.imu_bridge.streams import ContentError, quaternions, quoted

XYZW = (0.64, 0.0, -0.48, 0.6)


@pytest.mark.parametrize(
    ("line", "names"),
    [
        ("quat\t0.60\t0.64\t0.00\t-0.48", ()),  # i2cdevlib, MPU6050_DMP6
        ("Quaternion: w: 0.6 x: 0.64 y: 0.0 z: -0.48", ()),
        ("qW: 0.6000 qX: 0.6400 qY: 0.0000 qZ: -0.4800\t\t", ()),  # Adafruit BNO055, rawdata
        ("X: 12.0 Y: 3.1 Z: -7.4\t\tqW: 0.6000 qX: 0.6400 qY: 0.0000 qZ: -0.4800\t\t", ()),
        ("Game Rotation Vector - r: 0.60 i: 0.64 j: 0.00 k: -0.48", ()),  # Adafruit BNO08x
        ("q0=0.6, q1=0.64, q2=0.0, q3=-0.48", ()),
        ("Q1:0.640 Q2:0.000 Q3:-0.480 Accuracy:0", ()),  # SparkFun ICM-20948: q0 is left out
        ("Q: 0.6 0.64 0 -0.48", ()),
        ("q = [0.6, 0.64, 0.0, -0.48]", ()),
        ("w,0.6,x,0.64,y,0,z,-0.48", ()),
        ("wrist quat: 0.6|0.64|0|-0.48", ("wrist",)),
        ("id: 3 w: 0.6 x: 0.64 y: 0 z: -0.48", ("3",)),
        ("\ufeff0.6,0.64,0,-0.48\0", ()),
        ("\x1b[0;32mquat 0.6 0.64 0 -0.48\x1b[0m", ()),
        ("QUAT,0.6,0.64,0,-0.48", ()),
        ("I (12345) BNO: w=0.6 x=0.64 y=0 z=-0.48", ("BNO",)),  # ESP-IDF
        ("[ 12345][I][main.cpp:42] loop(): quat 0.6 0.64 0 -0.48", ("loop",)),  # ESP32, Arduino
        ("[00:00:01.250,000] <inf> wrist: 0.6 0.64 0 -0.48", ("wrist",)),  # Zephyr
        ("192.168.1.20 0.6 0.64 0 -0.48", ("192.168.1.20",)),
        ("0,6;0,64;0;-0,48", ()),  # decimal commas
        ("quat 0,6 0,64 0,0 -0,48", ()),
        ("w=0,60 x=0,64 y=0,00 z=-0,48", ()),
        ("wrist: 0,6\t0,64\t0\t-0,48", ("wrist",)),
        ("12:30:15.123 -> quat\t0.60\t0.64\t0.00\t-0.48", ()),  # Arduino's serial monitor
        ("2026-03-02T09:01:02.5Z,0.6,0.64,0,-0.48", ()),
        ("2026-03-02 09:01:02,500; 0.6; 0.64; 0; -0.48", ()),
    ],
)
def test_quaternions_of_known_sketches_are_read(line: str, names: tuple[str, ...]) -> None:
    parsed = LineParser().parse(line.encode())
    assert isinstance(parsed, QuaternionLine)
    assert parsed.orientation_xyzw == pytest.approx(XYZW)
    assert parsed.names == names


def test_number_of_a_sensor_before_commas_is_no_decimal() -> None:
    parser = LineParser()
    *_, parsed = [parser.parse(f"{sensor},1,0,0,0".encode()) for sensor in ("1", "2") * 3]
    assert isinstance(parsed, QuaternionLine)
    assert (parsed.orientation_xyzw, parsed.names) == ((0.0, 0.0, 0.0, 1.0), ("2",))


@pytest.mark.parametrize("line", ["Accel x: 0.6 y: 0.0 z: 0.8 w: 0.0", "gravity: x=0 y=0 z=1 w=0"])
def test_other_vectors_with_four_components_are_no_quaternion(line: str) -> None:
    assert LineParser().parse(line.encode()) is None


@pytest.mark.parametrize("name", ["acceleration", "linearAcceleration", "mag", "gravity", "position", "gyro"])
def test_other_vectors_of_json_are_no_quaternion(name: str) -> None:
    vector = {"x": 0.6, "y": 0.0, "z": 0.8, "w": 0.0}
    own = {"x": XYZW[0], "y": XYZW[1], "z": XYZW[2], "w": XYZW[3]}
    found = quaternions({name: vector, "quat": own}, "wxyz")
    assert [each.orientation_xyzw for each in found] == [pytest.approx(XYZW)]
    with pytest.raises(ContentError, match="has no quaternion"):
        quaternions({name: vector}, "wxyz")


def test_quaternion_of_core_motion_is_read_by_its_names() -> None:
    fields = {f"motionQuaternion{axis}": f"{value}" for axis, value in zip("XYZW", XYZW, strict=True)}
    rates = {"motionRotationRateX": "0.5", "motionGravityX": "1.0", "gyroRotationX": "0.2"}
    (found,) = quaternions({**rates, **fields, "loggingTime": "2026-03-02 09:01:02"}, "wxyz")
    assert found.orientation_xyzw == pytest.approx(XYZW)


def test_time_is_read_from_a_field_whose_name_states_the_unit_and_else_not() -> None:
    for field, time_ns in (("t_us: 1500", 1_500_000), ("millis=20", 20_000_000), ("t: 1500", None)):
        parsed = LineParser().parse(f"{field} w: 0.6 x: 0.64 y: 0 z: -0.48".encode())
        assert isinstance(parsed, QuaternionLine)
        assert parsed.device_time_ns == time_ns


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("ypr\t-12.34\t5.60\t0.70", "has angles: let it send quaternions .*OUTPUT_READABLE_QUATERNION"),
        ("Yaw: 12.0 Pitch: 3.0 Roll: -4.5", "has angles: let it send quaternions"),
        ("X: 359.94 Y: -1.00 Z: 3.50", "has x, y and z without w: let it send quaternions"),
        ("12.5,3.25,-4", "has 3 numbers, .*if they are angles, let it send quaternions"),
        ("q1:0.6 q2:0.64 q3:0 q4:-0.48", "q1 or q4 may be w"),
        ("qW:1 qX:0 qY:0 qZ:0 qW:1 qX:0 qY:0 qZ:0", "has qW twice: .* in its own line"),
        ("1,0,0,0,0,1,0,0", "has 8 numbers, .* in its own line"),
        ("wrist:1,0,0,0;elbow:0.8,0,0.6,0", "has several quaternions: .* in its own line"),
        ("wrist,1,0,0,0,elbow,0.8,0,0.6,0", "has several quaternions: .* in its own line"),
        ("wrist: nan,0,0,1", "'nan'"),
        ("ovf 0 0 0 1", "'ovf'"),
        ("0 " * 200, "400 bytes, limit 256"),
    ],
)
def test_what_is_no_quaternion_is_refused_with_an_action(line: str, reason: str) -> None:
    with pytest.raises(LineError, match=reason):
        LineParser().parse(line.encode())


def test_angles_beside_quaternions_are_no_problem() -> None:
    framer = TextFramer()
    framer.feed(b"\nquat\t1\t0\t0\t0\nypr\t1.0\t2.0\t3.0\n", 0)
    assert framer.bad == 0
    assert framer.good == 1


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"yaw": 1.0, "pitch": 2.0, "roll": 3.0}, "has angles only: let it send quaternions"),
        ({"quat": [1, "a", 0, 0]}, "where numbers were expected"),
        ({"q": [1, 1, 0, 0]}, "a quaternion of norm 1.414214, not 1"),
        ({"temperature": 20}, "has no quaternion"),
        ([1, 2, 3], "has no quaternion"),
    ],
)
def test_json_without_a_quaternion_is_refused_by_name(content: object, reason: str) -> None:
    with pytest.raises(ContentError, match=reason):
        quaternions(content, "wxyz")


def test_json_of_a_sketch_is_read_on_a_cable() -> None:
    framer = TextFramer()
    line = b'{"quat_w":0.600, "quat_x":0.640, "quat_y":0.000, "quat_z":-0.480}\r\n'
    (reading,) = framer.feed(b"\n" + line, 5)
    assert isinstance(reading, Reading)
    assert reading.world_from_sensor == pytest.approx(XYZW)


@pytest.mark.parametrize(
    ("data", "shown"),
    [
        (b"ypr\t1.0\x07", r"'ypr\t1.0\x07'"),
        ("Zoë IMU №2".encode(), "'Zoë IMU №2'"),
        ("äöü".encode()[:5], "'äö'"),
        ("Gerät 20 °C".encode("latin-1"), r"'Ger\xe4t 20 \xb0C'"),
        (b"\x55\x53\x01\x02\x90", "55 53 01 02 90"),
        (b"a" * 50, "'" + "a" * 40 + "'"),
        (b"", "''"),
    ],
)
def test_readable_data_is_shown_as_text_and_other_data_in_hexadecimal(data: bytes, shown: str) -> None:
    assert quoted(data) == shown


def test_warning_of_silence_shows_text_and_why_it_is_not_read() -> None:
    detection, watch, warning = Detection(SerialConfig()), SilenceWatch("the port", 3.0, 0.0), ""
    for number in range(40):
        data = "Gyroskop µ\typr\t1.5\t2.5\t-3.5\r\n".encode()
        detection.feed(data, number, number / 10)
        warning = watch.step(data, detection.good, number / 10, detection.tried) or warning
    assert r"the first 'Gyroskop µ\typr\t1.5" in warning
    assert "has angles: let it send quaternions" in warning


@pytest.mark.parametrize("key", ["ch", "dev", "port", "mux", "body", "sensor_index", "sensorNo", "imu_num"])
def test_numbers_of_sensors_in_json_tell_two_sensors_apart(key: str) -> None:
    assert [quaternions({key: n, "quat": [1, 0, 0, 0]}, "wxyz")[0].names for n in (0, 1)] == [("0",), ("1",)]


def test_a_count_behind_a_name_and_a_colon_is_no_part_of_the_name() -> None:
    parsed = [LineParser().parse(f"wrist:{n}:1,0,0,0".encode()) for n in (1000, 1010)]
    assert all("wrist" in each.names for each in parsed if isinstance(each, QuaternionLine))
    assert all(isinstance(each, QuaternionLine) for each in parsed)
    address = LineParser().parse(b"C4:1D:22:03:04:05 1,0,0,0")
    assert isinstance(address, QuaternionLine)
    assert address.names == ("C4:1D:22:03:04:05",)


@pytest.mark.parametrize("line", ["Calib: 1 0 0 0", "cal,1,0,0,0", "status 0 0 1 0"])
def test_states_of_calibration_are_no_orientation(line: str) -> None:
    assert not isinstance(LineParser().parse(line.encode()), QuaternionLine)
