"""Lines of text of wrists, declared and undeclared."""

import json
import math
import re
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.imu_bridge.network.udp import UdpConfig, UdpDecoder
from pointit.services.imu_bridge.serial.detection import Detection, SerialConfig
from pointit.services.imu_bridge.serial.line_parser import ButtonLine, LineParser, QuaternionLine
from pointit.services.imu_bridge.serial.source import SilenceWatch
from pointit.services.imu_bridge.serial.text_line import LineSplitter, TextFramer
from pointit.services.imu_bridge.sources import Press, Reading
from pointit.services.imu_bridge.streams import (
    FORGET_AFTER,
    MAX_SENSORS,
    PROOF,
    ContentError,
    SensorChoice,
    quoted,
)

XYZW = (0.64, 0.0, -0.48, 0.6)
FORM = re.compile(r'imu-bridge\.(serial|udp)\.line=("(?:[^"\\]|\\.)*")')
DESCRIBED = [  # a line, and the places of w, x, y and z among its numbers
    ("X: 12.0000\tY: 3.1000\tZ: -7.4000\t\tqW: 0.6000 qX: 0.6400 qY: 0.0000 qZ: -0.4800\t\t", (3, 4, 5, 6)),
    ("Game Rotation Vector - r: 0.60 i: 0.64 j: 0.00 k: -0.48", (0, 1, 2, 3)),  # Adafruit BNO08x
    ("0.64,0.00,-0.48,0.60,3", (3, 0, 1, 2)),  # SparkFun BNO080: i, j, k, real, accuracy
    ("8126,0.640,0.000,-0.480,0.600,0.05,0", (4, 1, 2, 3)),  # with the time in ms before
    ("1693912.250000 0.600000 0.640000 0.000000 -0.480000", (1, 2, 3, 4)),  # x-io, Fusion: s and quaternion
    ("q0=0.6, q1=0.64, q2=0.0, q3=-0.48", (0, 1, 2, 3)),  # Madgwick
    ("rotVec: 0.6 0.64 0.0 -0.48 acc:3", (0, 1, 2, 3)),
    ("12:30:15.123 -> quat\t0.60\t0.64\t0.00\t-0.48", (1, 2, 3, 4)),  # Arduino IDE's serial monitor
    ("I (12345) BNO08x: w=0.600 x=0.640 y=0.000 z=-0.480", (1, 2, 3, 4)),  # ESP-IDF
    ("[00:00:01.250,000] <inf> imu: 0.6 0.64 0.0 -0.48", (1, 2, 3, 4)),  # Zephyr
    ("[ 12345][I][main.cpp:42] loop(): 0.6 0.64 0.0 -0.48", (2, 3, 4, 5)),  # ESP32's Arduino core
    ("\x1b[0;32mI (27) q: 0.6,0.64,0.0,-0.48\x1b[0m", (3, 4, 5, 6)),
    ("$VNQTN,+0.640000,+0.000000,-0.480000,+0.600000*6F", (3, 0, 1, 2)),  # VectorNav: the scalar last
    ("0,60;0,64;0,00;-0,48", (0, 1, 2, 3)),  # decimal commas
    ("2026-03-02T09:01:02.5Z,0.6,0.64,0.0,-0.48", (1, 2, 3, 4)),
    ("24:6F:28:0A:0B:01,87%,0.6,0.64,0.0,-0.48,-61dBm", (2, 3, 4, 5)),
    ("w0.6wa0.64ab0.0bc-0.48c", (0, 1, 2, 3)),  # Madgwick for Processing
    ("wrist: 0.6 0.64 0.0 -0.48", (0, 1, 2, 3)),
    ("3,0.6,0.64,0.0,-0.48", (1, 2, 3, 4)),
    ("0.6 0.64 0.0 -0.48 0.8 0.0 0.6 0.0", (0, 1, 2, 3)),  # of two sensors
    ("Calib: 3 3 0 3 | 0.6 0.64 0.0 -0.48", (4, 5, 6, 7)),
    ("{w:0.6,x:0.64,y:0.0,z:-0.48}", (0, 1, 2, 3)),
    ("quat xyzw: 0.64 0.0 -0.48 0.6 0", (3, 0, 1, 2)),
    (
        '{"t": 171456, "motionQuaternionW": "0.6", "X": "0.64", "Y": "0.0", "Z": "-0.48"}',
        (1, 2, 3, 4),
    ),  # SensorLog
    (
        '{"time":"2024_05_01_12:00:00.25","data":{"rotation":{"x":0.64,"y":0.0,"z":-0.48,"w":0.6}}}',
        (4, 1, 2, 3),
    ),
    ('{"rot": [0.64, 0.0, -0.48, 0.6], "bat": 87}', (3, 0, 1, 2)),
    ('[{"name":"orientation","time":17,"values":{"qw":0.6,"qx":0.64,"qy":0.0,"qz":-0.48}}]', (1, 2, 3, 4)),
]
ANGLES = [
    "ypr\t-12.34\t5.60\t0.70",  # MPU6050_DMP6
    "Orientation - roll: 3 pitch: 4 yaw: 5",
    "Q1:0.640 Q2:0.000 Q3:-0.480",  # SparkFun ICM-20948, w left out
    "359.94,-1.00,3.50",
    "Initializing I2C devices...",
]


def filled_form(sentence: str, places: Sequence[int]) -> str:
    """Return the form that a refusal names, with the components of the quaternion at `places`."""
    (found,) = FORM.findall(sentence)
    texts = json.loads(found[1]).split("{_}")
    names = {place % (len(texts) - 1): axis for place, axis in zip(places, "wxyz", strict=True)}
    parts = [f"{{{names.get(index, '_')}}}" for index in range(len(texts) - 1)]
    return "".join(text + part for text, part in zip(texts, [*parts, ""], strict=True))


@pytest.mark.parametrize(("line", "places"), DESCRIBED)
def test_other_lines_are_refused_with_a_parameter_that_reads_them(line: str, places: Sequence[int]) -> None:
    with pytest.raises(ContentError) as refusal:
        LineParser().parse(line.encode())
    config = SerialConfig(line=filled_form(str(refusal.value), places))
    later = line.replace("12:", "23:").replace("123", "987").replace("-03-", "-11-").replace("_05_", "_11_")
    for each in (line, later):
        parsed = LineParser(config.order, config.line).parse(each.encode())
        assert isinstance(parsed, QuaternionLine)
        assert parsed.orientation_xyzw == pytest.approx(XYZW)
    with pytest.raises(ContentError) as refused:
        UdpDecoder(UdpConfig()).items(line.encode(), 0)
    decoder = UdpDecoder(UdpConfig(line=filled_form(str(refused.value), places)))
    (reading,) = decoder.items(line.encode(), 0)
    assert isinstance(reading, Reading)
    assert reading.world_from_sensor == pytest.approx(XYZW)


@pytest.mark.parametrize("line", ANGLES)
def test_lines_without_a_quaternion_are_refused_with_a_remedy(line: str) -> None:
    with pytest.raises(ContentError, match="let the device send four numbers, w, x, y and z"):
        LineParser().parse(line.encode())


def test_sensors_of_one_port_are_refused_until_one_is_named() -> None:
    lines = b"\r\nwrist,0.6,0.64,0,-0.48\r\nelbow,0.8,0,0.6,0" * 20 + b"\r\n"
    form = "{sensor},{w},{x},{y},{z}"
    sensors = SensorChoice("serial.sensor")
    assert len(TextFramer("wxyz", form, sensors).feed(lines, 0)) <= 2  # before the second is proven
    assert sensors.warning == (
        "several sensors send in one stream (elbow, wrist), and none is used: name the wrist's by "
        "--set imu-bridge.serial.sensor=NAME"
    )
    config = SerialConfig(line=form, sensor="Wrist")
    items = Detection(config).feed(lines + b"elbow: button\nwrist: button\n", 7, 0.0)
    readings = [item.world_from_sensor for item in items if isinstance(item, Reading)]
    assert readings == [pytest.approx(XYZW)] * 20
    assert [item for item in items if isinstance(item, Press)] == [Press(7)]


def test_sensors_in_json_are_told_apart_by_their_documented_fields() -> None:
    for field in ("sensor", "id", "name", "device"):
        decoder = UdpDecoder(UdpConfig(sensor="2"))
        for number in (1, 2):
            data = json.dumps({field: number, "q": [0.6, 0.64, 0.0, -0.48]}).encode()
            assert len(decoder.items(data, 0)) == (number == 2)


def test_sensor_whose_name_is_damaged_once_is_used_on() -> None:
    sensors = SensorChoice("serial.sensor")
    assert [sensors.accepts(name) for name in ("wrist", "wrist", "wrist", "wrht", "wrist")] == [
        True, True, True, False, True,
    ]  # fmt: skip
    assert sensors.warning == ""


def test_sensor_that_is_silent_for_long_is_forgotten() -> None:
    sensors = SensorChoice("serial.sensor")
    for name in ("wrist", "elbow") * 3:
        sensors.accepts(name)
    assert not sensors.accepts("elbow")
    assert [sensors.accepts("elbow") for _ in range(FORGET_AFTER)][-1]
    assert sensors.warning == ""


def test_names_that_all_differ_are_reported_and_never_read() -> None:
    sensors = SensorChoice("udp.sensor")
    assert not any([sensors.accepts(f"{100 - n}") for n in range(50)][1:])
    assert sensors.warning.startswith("several sensors send in one stream (51, 52, 53")
    assert len(sensors.others) == MAX_SENSORS


def test_number_of_the_message_is_no_sensor() -> None:
    sensors = SensorChoice("udp.sensor")
    used = [sensors.accepts(f"{number}", "watch") for number in range(810, 1610)]
    assert sum(used) > 700
    assert all(used[PROOF + 1 :])
    assert sensors.warning == ""
    assert all(sensors.accepts(f"{number % 256}", "watch") for number in range(250, 270))


def test_sensors_with_numbers_take_turns_and_are_reported() -> None:
    sensors = SensorChoice("udp.sensor")
    for _ in range(100):
        for number in range(6):
            sensors.accepts(f"{number}")
    assert sensors.used is None or not sensors.accepts(sensors.used)
    assert sensors.warning.startswith("several sensors send in one stream (0, 1, 2")


def test_missing_configured_sensor_is_named_with_those_heard() -> None:
    sensors = SensorChoice("udp.sensor", "Wrist")
    assert not any(sensors.accepts("elbow") for _ in range(3))
    assert (
        sensors.warning
        == "no sensor 'wrist' is heard, but elbow: use one of them, as by --set imu-bridge.udp.sensor=elbow"
    )
    assert sensors.accepts("left", "wrist")
    assert sensors.warning == ""


def test_silent_port_is_distinguished_from_an_unreadable_one() -> None:
    warnings: list[str | None] = []
    for data in (b"", b"\x55\x59\x82"):
        watch = SilenceWatch("the port", 3.0, 0.0)
        detection = Detection(SerialConfig(baud=9600))
        detection.feed(data, 0, 4.0)
        warnings.append(watch.step(data, 4.0, detection))
    assert warnings[0] == (
        "the port is connected but sent nothing readable for 3 s, not one byte: check the cable and that the "
        "device sends"
    )
    assert "3 bytes, the first 55 59 82; tried " in (warnings[1] or "")


def test_port_warning_shows_the_line_and_the_parameter() -> None:
    detection = Detection(SerialConfig())
    watch = SilenceWatch("the port", 3.0, 0.0)
    warning = ""
    for number in range(40):
        data = b"1500,0.6,0.64,0,-0.48\r\n"
        detection.feed(data, number, number / 10)
        warning = watch.step(data, number / 10, detection) or warning
    assert warning == (
        "the lines from the port are not read, the last: '1500,0.6,0.64,0,-0.48' has none of the documented "
        'forms; describe it by imu-bridge.serial.line="{_},{_},{_},{_},{_}", with {w}, {x}, {y} and {z} for '
        "the quaternion's {_}"
    )


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
def test_quoted_data_is_text_or_hexadecimal_when_unreadable(data: bytes, shown: str) -> None:
    assert quoted(data) == shown


def quaternion(line: bytes, parser: LineParser | None = None) -> QuaternionLine:
    parsed = (parser or LineParser()).parse(line)
    assert isinstance(parsed, QuaternionLine)
    return parsed


@pytest.mark.parametrize(
    "line",
    [
        b"0.5,-0.5,0.5,0.5",
        b"0.5, -0.5, 0.5, 0.5\r",
        b"  0.5 -0.5\t0.5 .5 ",
        b"0.5;-0.5;0.5;0.5;",
        b"Quaternion: 0.5, -0.5, 0.5, 0.5",
        b"quat\t0.5\t-0.5\t0.5\t0.5\t",  # i2cdevlib, MPU6050_DMP6
        b"q 5e-1 -5e-1 0.5 +0.5",
        b"qW: 0.5 qX: -0.5 qY: 0.5 qZ: 0.5\t\t",  # Adafruit BNO055, rawdata
        b"Quaternion: w: 0.5 x: -0.5 y: 0.5 z: 0.5",
        b"w,0.5,x,-0.5,y,0.5,z,0.5",
        b"\xef\xbb\xbf0.5,-0.5,0.5,0.5\0",
        b'{"w": 0.5, "x": -0.5, "y": 0.5, "z": 0.5}',
        b'{"quat_w":0.5,"quat_x":-0.5,"quat_y":0.5,"quat_z":0.5,"x":0.1,"y":0,"z":9.8}',
        b'{"t": 7, "q": [0.5, -0.5, 0.5, 0.5]}',
        b'{"Quaternion": [-0.5, 0.5, 0.5, 0.5], "order": "xyzw"}',
        b'{"quat": {"x": -0.5, "y": 0.5, "z": 0.5, "w": 0.5}}',
    ],
)
def test_quaternion_is_read_in_all_its_forms(line: bytes) -> None:
    assert quaternion(line).orientation_xyzw == (-0.5, 0.5, 0.5, 0.5)


def test_order_of_four_numbers_is_configurable() -> None:
    assert quaternion(b"0,0,0,1", LineParser("xyzw")).orientation_xyzw == (0, 0, 0, 1)
    assert quaternion(b"0,0,0,1", LineParser("wxyz")).orientation_xyzw == (0, 0, 1, 0)
    assert quaternion(b"w:0 x:0 y:1 z:0", LineParser("xyzw")).orientation_xyzw == (0, 1, 0, 0)


@pytest.mark.parametrize(
    ("form", "line", "time_ns", "names"),
    [
        ("{sensor},{t_us},{w},{x},{y},{z}", "wrist,1500000,1,0,0,0", 1_500_000_000, ("wrist",)),
        ("{t_ms};{w};{x};{y};{z}", "20,5; 1,0 ;0;0;0;", 20_500_000, ()),  # decimal commas
        ("{t_s} {w} {x} {y} {z}", "0.25\t1.00  0.00 | 0 0", 250_000_000, ()),
        ("{x},{y},{z},{w},{_},{_}", "0,0,0,1,nan,ovf", None, ()),
        ("IMU{_} {w} {x} {y} {z}", "IMU3 1 0 0 0", None, ()),
        (
            "[{_}] <inf> {sensor}: {w} {x} {y} {z}",
            "[ 00:00:01.250,000] <inf> left-1: 1 0 0 0",
            None,
            ("left-1",),
        ),
        ("$QUAT,{x},{y},{z},{w}*{_}", "$QUAT,0,0,0,+1.0*3E", None, ()),
        ('{"id": {sensor},"rot": [{x},{y},{z},{w}]}', '{"id": 7, "rot": [0.0, 0.0, 0.0, 1.0]}', None, ("7",)),
    ],
)
def test_described_line_is_read_as_it_is_described(
    form: str, line: str, time_ns: int | None, names: tuple[str, ...]
) -> None:
    parser = LineParser("wxyz", form)
    assert quaternion(line.encode(), parser) == QuaternionLine((0.0, 0.0, 0.0, 1.0), time_ns, names)
    assert parser.parse(b"wrist: button hold") == ButtonLine("hold", ("wrist",))
    with pytest.raises(ContentError, match=r"has another form than imu-bridge\.serial\.line; describe it by"):
        parser.parse(b"1,0,0,0,7,7,7")


@pytest.mark.parametrize(
    ("form", "reason"),
    [
        ("{w},{x},{y}", "must have each of"),
        ("{w},{x},{y},{z},{z}", "must have each of"),
        ("{w},{x},{y},{z},{q}", "has the unknown part {q}"),
        ("{w}{x},{y},{z}", "has {w}{x} without a separator"),
    ],
)
def test_form_without_a_clear_quaternion_is_refused(form: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        SerialConfig(line=form)
    with pytest.raises(ValueError, match=reason):
        UdpConfig(line=form)


def test_line_that_nearly_fits_a_long_form_is_refused_fast() -> None:
    parser = LineParser("wxyz", ":".join(["{_}"] * 40) + ",{w},{x},{y},{z}")
    with pytest.raises(ContentError):
        parser.parse(b":" * 200 + b"1:" * 28)


@pytest.mark.parametrize("line", [b"button", b"B", b"Button press", b"b:press"])
def test_button_lines_are_gestures(line: bytes) -> None:
    assert LineParser().parse(line) == ButtonLine("press")
    assert LineParser().parse(b"button double") == ButtonLine("double")


@pytest.mark.parametrize(
    "line", [b"", b"  ", b"# hello", b"Calibration: 1, 0, 0, 0", b"Orientation: 10, 20, 30"]
)
def test_lines_of_other_readings_are_ignored(line: bytes) -> None:
    assert LineParser().parse(line) is None


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"nan,0,0,1", "let the device send four numbers"),
        (b"1e999,0,0,1", "norm inf"),
        (b"1_0,0,0,1", "describe it by"),
        (b"1,0,0", "let the device send four numbers, w, x, y and z"),
        (b"0,0,0,0", "norm 0"),
        (b"1,1,0,0", "norm 1.41"),
        (b"0.89,0,0,0", "norm 0.89"),
        (
            b"1,0,0,0,1",
            'none of the documented forms; describe it by imu-bridge.serial.line="{_},{_},{_},{_},{_}"',
        ),
        (b'{"quat": [1, 0, 0, 0], "q": [0, 1, 0, 0]}', "has several quaternions; describe it by"),
        (b'{"q": [1, 0, 0, 0], "w": 1, "x": 0, "y": 0, "z": 0}', "has several quaternions; describe it by"),
        (b'{"q": [1, 0, 0, 0], "order": "yxzw"}', "has the order 'yxzw'"),
        (b'[{"q": [1, 0, 0, 0]}]', "describe it by"),
        (b'{"qw": 1, "qx": 0, "y": 0, "z": 0}', "has no quaternion; describe it by"),
        (b"\xff\x00\x80", "not text"),
    ],
)
def test_unreadable_line_is_refused_with_a_reason(line: bytes, reason: str) -> None:
    with pytest.raises(ContentError, match=re.escape(reason)):
        LineParser().parse(line)


@given(st.text("0123456789.,;-+eE: \tnaifbQ", max_size=60))
def test_random_almost_lines_give_unit_quaternions_or_reasons(text: str) -> None:
    try:
        parsed = LineParser().parse(text.encode())
    except ContentError:
        return
    if isinstance(parsed, QuaternionLine):
        assert math.isclose(math.hypot(*parsed.orientation_xyzw), 1.0, abs_tol=1e-9)


def test_first_partial_line_is_discarded() -> None:
    splitter = LineSplitter()
    assert splitter.feed(b"0,0,0\n1,0,") == []
    assert splitter.feed(b"0,0\r\nb") == [b"1,0,0,0"]
    assert splitter.feed(b"utton\n\n") == [b"button"]


@given(st.lists(st.sampled_from([b"1,0,0,0", b"button", b"x" * 300, b""]), max_size=20), st.integers(1, 50))
def test_lines_are_read_however_the_stream_is_cut(lines: list[bytes], size: int) -> None:
    stream = b"\n" + b"".join(line + b"\r\n" for line in lines)
    whole = LineSplitter()
    pieces = LineSplitter()
    one_by_one: list[bytes] = []
    for start in range(0, len(stream), size):
        one_by_one += pieces.feed(stream[start : start + size])
    assert one_by_one == whole.feed(stream) == [line for line in lines if 0 < len(line) < 300]
    assert pieces.overlong == whole.overlong == lines.count(b"x" * 300)


def test_device_without_an_orientation_is_a_warning_with_its_remedy() -> None:
    watch = SilenceWatch("the port", 3.0, 0.0)
    detection = Detection(SerialConfig(format="ximu3", baud=115_200))
    for data in (b"T,1000000,25.5\r\n", b"N,1000000,ok\r\n"):
        detection.feed(data, 0, 1.0)
    warning = watch.step(b"T,1000000,25.5\r\n", 4.0, detection)
    assert warning is not None
    assert "messages without an orientation (1 of T, 1 of N): set the AHRS message type" in warning
