"""Sensors, times and measurements beside the quaternion in lines of text, and the order that it states."""

import pytest

from pointit.services.imu_bridge.serial.line_parser import LineError, LineParser, QuaternionLine
from pointit.services.imu_bridge.serial.text_line import TextFramer
from pointit.services.imu_bridge.sources import Reading
from pointit.services.imu_bridge.streams import SensorChoice

XYZW = (0.28, -0.64, 0.48, 0.5333)
OTHER = (0.0, 0.6, 0.0, 0.8)


def read(line: str, parser: LineParser | None = None) -> QuaternionLine:
    parsed = (parser or LineParser()).parse(line.encode())
    assert isinstance(parsed, QuaternionLine), line
    return parsed


NUMBERS = "0.5333,0.28,-0.64,0.48"
FIELDS = "w:0.5333 x:0.28 y:-0.64 z:0.48"


@pytest.mark.parametrize(
    ("line", "names"),
    [
        (f"{NUMBERS} RSSI:-61", ()),
        (f"{NUMBERS},rssi=-61dBm,bat=3.71V", ()),
        (f"{NUMBERS} temp=24.5", ()),
        (f"{NUMBERS};87%", ()),
        (f"{NUMBERS} 50Hz", ()),
        (f"{NUMBERS},nan", ()),
        (f"{NUMBERS} Cal: 3 3 0 3", ()),
        (f"{NUMBERS} acc:0.1,0.2,9.8", ()),
        (f"q,{NUMBERS},acc,0.1,0.2,9.8", ()),
        (f"gyro 0.1 0.2 0.3 quat {NUMBERS}", ()),
        (f"Heading: 211 Quat: {NUMBERS}", ()),
        (f"seq=17 wrist {NUMBERS}", ("wrist",)),
        (f"node1 rssi=-61 {NUMBERS}", ("node1",)),
        (f"temp: 24.5 {NUMBERS}", ()),
        (f"seq=17,[{NUMBERS}]", ()),
        (f"left: bat=87 rssi=-61 {NUMBERS}", ("left",)),
        (f"{NUMBERS} id=7", ("7",)),
        (f"{NUMBERS} sensor: left batt: 3.7V", ("left",)),
        (f"{NUMBERS},wrist", ("wrist",)),
        (f"{FIELDS} ch:2", ("2",)),
        (f"ch:2 {FIELDS}", ("2",)),
        (f"{FIELDS} side=left", ("left",)),
        (f"{FIELDS} wrist", ("wrist",)),
        (f"mac=C4:1D:22:03:04:05 {FIELDS}", ("C4:1D:22:03:04:05",)),
        (f"addr=0x28 {FIELDS}", ("0x28",)),
        (f"#3 {FIELDS}", ("3",)),
        (f"#3: {NUMBERS}", ("3",)),
        ("imu2.w=0.5333 imu2.x=0.28 imu2.y=-0.64 imu2.z=0.48", ("imu2",)),
        ("qw4:0.5333,qx4:0.28,qy4:-0.64,qz4:0.48", ("4",)),
        (f"S:3,A:1,M:0,G:3 {FIELDS}", ()),
        (f"{FIELDS} temp:nan", ()),
        (f"[2024-05-01 12:00:00] wrist: {NUMBERS}", ("wrist",)),
        (f"[2024-05-01T12:00:00.123Z] {NUMBERS}", ()),
        (f"[12:00:00.250] wrist {NUMBERS}", ("wrist",)),
        (f"01.05.2024 12:00:00 {NUMBERS}", ()),
        (f"12:00:00 -> wrist: {NUMBERS}", ("wrist",)),
        (f"May  1 12:00:00 wrist: {NUMBERS}", ("wrist",)),
        (f"[  12.345678] wrist: {NUMBERS}", ("wrist",)),
        (f"1714560000.123 wrist: {NUMBERS}", ("wrist",)),
        (f"/*{NUMBERS}*/", ()),
        (f"{NUMBERS}*5A", ()),
        (f"$QUAT,{NUMBERS}*3E", ()),
    ],
)
def test_quaternion_is_read_beside_other_fields(line: str, names: tuple[str, ...]) -> None:
    parsed = read(line)
    assert parsed.orientation_xyzw == pytest.approx(XYZW, abs=2e-3)
    assert parsed.names == names


@pytest.mark.parametrize(
    "pattern",
    [
        *("ch:{n} {q}", "id={n} {q}", "{q} ch:{n}", "{q} id={name}", "{q} sensor: {name} rssi: -{t}"),
        *(
            "{c} id={n}",
            "{c},{name}",
            "{name}: {c} RSSI:-{t}",
            "t:{t} id:{n} {c}",
            "{name} acc {t} 0.1 9.8 q {c}",
        ),
        *("[2024-05-01 12:00:{t}] {name}: {c}", "{name}.w={w} {name}.x={x} {name}.y={y} {name}.z={z}"),
    ],
)
@pytest.mark.parametrize("is_noisy", [True, False])
def test_two_sensors_with_labels_are_told_apart(pattern: str, *, is_noisy: bool) -> None:
    framer = TextFramer(sensors=(sensors := SensorChoice("serial.sensor", is_noisy=is_noisy)))
    data = "\n"
    for step in range(80):
        x, y, z, w = (XYZW, OTHER)[step % 2]
        names = {"n": step % 2, "name": ("wrist", "elbow")[step % 2], "t": 10 + step // 2}
        numbers = {"w": w, "x": x, "y": y, "z": z}
        q, c = " ".join(f"{key}:{each}" for key, each in numbers.items()), f"{w},{x},{y},{z}"
        data += pattern.format(q=q, c=c, **names, **numbers) + "\n"
    readings = [item for item in framer.feed(data.encode(), 0) if isinstance(item, Reading)]
    assert framer.bad == 0, framer.reason
    assert len(readings) >= 80 // 2 - 20
    assert len({each.world_from_sensor for each in readings}) == 1
    assert "set serial.sensor to the one on the wrist" in sensors.warning


@pytest.mark.parametrize(
    "label",
    ["quat xyzw:", "q_xyzw:", "xyzw,", "qxyzw=", "Quat (x, y, z, w) =", "wrist XYZW", "quat[x y z w]:"],
)
def test_order_in_a_label_is_used(label: str) -> None:
    parsed = read(f"{label} 0.28,-0.64,0.48,0.5333")
    assert parsed.orientation_xyzw == pytest.approx(XYZW, abs=2e-3)
    turned = read(
        f"{label.lower().replace('xyz', 'wxy', 1)} {NUMBERS}" if "xyzw" not in label.lower() else NUMBERS
    )
    assert turned.orientation_xyzw == pytest.approx(XYZW, abs=2e-3) or "x" in label


def test_vectornavs_quaternion_has_its_scalar_last() -> None:
    parsed = read("$VNQTN,-0.017386,-0.000303,+0.055490,+0.998308*56")
    assert parsed.orientation_xyzw == pytest.approx((-0.017386, -0.000303, 0.05549, 0.998308), abs=1e-5)


@pytest.mark.parametrize(
    ("header", "line"),
    [
        ("qx,qy,qz,qw", "0.28,-0.64,0.48,0.5333"),
        ("time,x,y,z,w", "91000,0.28,-0.64,0.48,0.5333"),
        ("qw\tqx\tqy\tqz", NUMBERS),
        ("t [s],qx [1],qy [1],qz [1],qw [1]", "91000,0.28,-0.64,0.48,0.5333"),
        (
            "loggingTime(txt),motionQuaternionX(R),motionQuaternionY(R),motionQuaternionZ(R),motionQuaternionW(R)",
            "2024-05-01T12:00:00.250+02:00,0.28,-0.64,0.48,0.5333",
        ),
    ],
)
def test_order_in_a_header_is_used(header: str, line: str) -> None:
    parser = LineParser("xyzw" if line is NUMBERS else "wxyz")
    assert parser.parse(header.encode()) is None
    assert read(line, parser).orientation_xyzw == pytest.approx(XYZW, abs=2e-3)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (f"$QUAT,{NUMBERS}*00", "has the checksum 00, 3E was expected"),
        ("w:1 x:0 y:0 z:0 w:1 x:0 y:0 z:0", "has w twice"),
        ("r:1 i:0 j:0 k:0 r:1 i:0 j:0 k:0", "has r twice"),
        ("a.w:1 a.x:0 a.y:0 a.z:0 b.w:1 b.x:0 b.y:0 b.z:0", "has b.w twice"),
        (f"left={NUMBERS} right={NUMBERS}", "has several quaternions"),
        (f"nan,{NUMBERS}", "has 'nan' where a number was expected"),
        ("w:nan x:0.28 y:-0.64 z:0.48", "has 'nan' where a number was expected"),
        (f"{NUMBERS},0.1,0.2,9.8", "has 7 numbers"),
        (f"{NUMBERS}\x01\x02", "where a number was expected"),
        ("0.5333,0.28,-0.64,0.48q", "where a number was expected"),
        ("acc.x:0.6 acc.y:0 acc.z:0.8 w:0", "has 1 numbers"),
    ],
)
def test_what_may_be_misread_is_refused(line: str, reason: str) -> None:
    with pytest.raises(LineError, match=reason):
        LineParser().parse(line.encode())
