"""Bags as crashed recorders, full disks and interrupted copies leave them; written by third-party writers."""

import re
import shutil
import sqlite3
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from pointit.schemas.topics import IMU
from tests.unit.conversion.session import at
from tests.unit.conversion.test_import_bag import ROTATION, TYPES, bag, imported, rotation, run

COUNT = 300
SAID = [rotation(number / 50, z=0.6, w=0.8) for number in range(COUNT)]
IMU_KEY = IMU.at("user1")
STORAGES = {StoragePlugin.MCAP: ".mcap", StoragePlugin.SQLITE3: ".db3"}


def compressed(path: Path, storage: StoragePlugin, mode: CompressionMode) -> Path:
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection(*ROTATION, typestore=TYPES._definitions.store)
        for time_s, _, kind, value in SAID:
            writer.write(connection, at(time_s), TYPES.encode(kind, value))
    return path


def plain_mcap(path: Path, *, chunks: bool, compression: CompressionType = CompressionType.NONE) -> Path:
    """Write an MCAP file as other programs do: without chunks, or packed by LZ4."""
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=8192, compression=compression, use_chunking=chunks)
        writer.start(profile="ros2", library="another program")
        schema = writer.register_schema(ROTATION[1], "ros2msg", b"")
        channel = writer.register_channel(ROTATION[0], "cdr", schema)
        for time_s, _, kind, value in SAID:
            time_ns = at(time_s)
            writer.add_message(channel, time_ns, TYPES.encode(kind, value), publish_time=time_ns)
        writer.finish()
    return path


def cut(path: Path, share: float) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: round(len(data) * share)])


@pytest.mark.parametrize(
    ("storage", "share"),
    [
        (StoragePlugin.MCAP, 0.5),
        (StoragePlugin.MCAP, 0.7),
        (StoragePlugin.SQLITE3, 0.72),
        (StoragePlugin.SQLITE3, 0.9),
    ],
)
@pytest.mark.parametrize("is_folder", [True, False])
def test_a_bag_that_is_cut_off_is_read_up_to_the_cut(
    tmp_path: Path, storage: StoragePlugin, share: float, *, is_folder: bool
) -> None:
    folder = bag(tmp_path / "take", SAID, storage)
    file = folder / f"take{STORAGES[storage]}"
    cut(file, share)
    source = folder if is_folder else file
    result = run(source)
    assert result.exit_code == 0, result.output
    (note,) = result.stderr.splitlines()
    assert note.startswith(f"note: {file.name}: is ")
    assert f"of {COUNT} messages of " in note
    assert "writes a whole file" in note
    found = imported(source, "--overwrite")[IMU_KEY]
    assert 0.1 * COUNT < len(found) < COUNT
    assert [each.stamp_ns for each in found] == [at(number / 50 - 0.01) for number in range(len(found))]
    assert f" {len(found)} of {COUNT} messages" in note


@pytest.mark.parametrize(
    "options",
    [
        {"chunks": False},
        {"chunks": True},
        {"chunks": True, "compression": CompressionType.LZ4},
        {"chunks": True, "compression": CompressionType.ZSTD},
    ],
)
def test_files_of_other_writers_are_read_up_to_the_cut(tmp_path: Path, options: dict[str, object]) -> None:
    source = plain_mcap(tmp_path / "other.mcap", **options)  # pyrefly: ignore[bad-argument-type]
    assert len(imported(source)[IMU_KEY]) == COUNT
    cut(source, 0.6)
    result = run(source, "--overwrite")
    assert result.exit_code == 0, result.output
    assert "note: other.mcap: is cut off after" in result.stderr
    assert 0.3 * COUNT < len(imported(source, "--overwrite")[IMU_KEY]) < COUNT


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_compressed_bags_are_read_without_metadata(
    tmp_path: Path, storage: StoragePlugin, mode: CompressionMode
) -> None:
    folder = compressed(tmp_path / "take", storage, mode)
    assert len(imported(folder)[IMU_KEY]) == COUNT
    (folder / "metadata.yaml").unlink()
    assert len(imported(folder, "--overwrite")[IMU_KEY]) == COUNT
    (file,) = folder.iterdir()
    assert len(imported(file, "--to", str(folder / "session.mcap"), "--overwrite")[IMU_KEY]) == COUNT


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize(
    "text", [None, "", "rosbag2_bagfile_information:\n  files: [", "rosbag2_bagfile_informa"]
)
def test_metadata_that_are_missing_or_cut_off_are_named_with_the_remedy(
    tmp_path: Path, storage: StoragePlugin, text: str | None
) -> None:
    folder = bag(tmp_path / "take", SAID, storage)
    (folder / "metadata.yaml").unlink() if text is None else (folder / "metadata.yaml").write_text(text)
    result = run(folder)
    assert result.exit_code == 0
    note = f"note: metadata.yaml is missing or damaged; `ros2 bag reindex {folder}` writes a new one"
    assert result.stderr.splitlines() == [note]
    assert len(imported(folder, "--overwrite")[IMU_KEY]) == COUNT


def test_a_part_that_is_missing_is_named_and_the_others_are_read_in_the_order_of_their_numbers(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "take"
    folder.mkdir()
    for number, said in ((0, SAID[:100]), (2, SAID[100:200]), (10, SAID[200:])):
        shutil.copy(
            bag(tmp_path / f"part{number}", said) / f"part{number}.db3", folder / f"take_{number}.db3"
        )
    found = imported(folder)[IMU_KEY]
    assert [each.seq for each in found] == list(range(1, COUNT + 1))
    assert [each.stamp_ns for each in found] == [at(number / 50 - 0.01) for number in range(COUNT)]
    names = "[take_0.db3, take_1.db3, take_2.db3, take_10.db3]"
    metadata = f"{{version: 5, relative_file_paths: {names}, topics_with_message_count: []}}"
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information: {metadata}")
    result = run(folder, "--overwrite")
    assert result.stderr.splitlines() == [f"note: take_1.db3: is missing; copy it into {folder}"]
    assert f"{ROTATION[0]}: {COUNT} messages" in result.stdout


def test_messages_in_the_log_of_a_database_that_was_not_closed_are_read(tmp_path: Path) -> None:
    folder = bag(tmp_path / "take", SAID[:200])
    file = folder / "take.db3"
    database = sqlite3.connect(file)
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("PRAGMA wal_autocheckpoint=0")
    for time_s, _, kind, value in SAID[200:]:
        row = (at(time_s), TYPES.encode(kind, value))
        database.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, ?, ?)", row)
    database.commit()
    crashed = tmp_path / "crashed"
    shutil.copytree(folder, crashed)
    database.close()
    (crashed / "take.db3-shm").unlink()
    files = {each.name: each.read_bytes() for each in crashed.iterdir()}
    assert len(imported(crashed)[IMU_KEY]) == COUNT
    assert {each.name: each.read_bytes() for each in crashed.iterdir()} == files, "the bag is not changed"


@pytest.mark.parametrize("name", ["take.mcap", "take.db3", "take.mcap.zstd", "take.db3.zstd"])
def test_an_empty_file_makes_one_sentence(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    result = run(tmp_path / name)
    assert result.exit_code != 0
    assert str(result.exception) == (
        f"{tmp_path / name}: cannot be read as a ROS 2 bag ({name}: is empty); record or copy it again"
    )
    assert not (tmp_path / "session.mcap").exists()


@pytest.mark.parametrize("storage", STORAGES)
def test_a_bag_that_is_cut_off_anywhere_is_read_or_refused_with_one_sentence(
    tmp_path: Path, storage: StoragePlugin
) -> None:
    file = bag(tmp_path / "take", SAID[:120], storage) / f"take{STORAGES[storage]}"
    whole = file.read_bytes()
    counts: list[int] = []
    for size in range(1, len(whole), len(whole) // 40):
        file.write_bytes(whole[:size])
        result = run(file, "--overwrite")
        if result.exit_code:
            assert str(result.exception).startswith(f"{file}: cannot be read as a ROS 2 bag (")
            assert "\n" not in str(result.exception)
        else:
            counts.append(int(result.stdout.split(": ")[1].split()[0]))
    assert counts == sorted(counts)
    assert counts[-1] > 20


def test_a_damaged_chunk_is_left_out_and_the_others_are_read(tmp_path: Path) -> None:
    source = plain_mcap(tmp_path / "other.mcap", chunks=True)
    data = bytearray(source.read_bytes())
    data[len(data) // 2] ^= 0xFF
    source.write_bytes(data[:-20])
    result = run(source)
    assert "note: other.mcap: has a chunk whose checksum differs; " in result.stderr
    assert 0.5 * COUNT < len(imported(source, "--overwrite")[IMU_KEY]) < COUNT


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
def test_zeros_amid_a_file_whose_end_is_whole_lose_only_their_chunk(
    tmp_path: Path, compression: CompressionType
) -> None:
    source = plain_mcap(tmp_path / "other.mcap", chunks=True, compression=compression)
    with source.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    begin = summary.chunk_indexes[2].chunk_start_offset + 100
    data = source.read_bytes()
    source.write_bytes(data[:begin] + bytes(64) + data[begin + 64 :])
    result = run(source)
    assert result.exit_code == 0, result.exception
    assert result.stderr.startswith("note: other.mcap: ")
    assert 0.1 * COUNT < len(imported(source, "--overwrite")[IMU_KEY]) < COUNT


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize(("at_byte", "value"), [(1, b"\xff" * 8), (0, b"\0"), (60, b"\xa5" * 9)])
def test_damage_in_the_first_chunk_loses_only_its_messages(
    tmp_path: Path, compression: CompressionType, at_byte: int, value: bytes
) -> None:
    """Types and channels are in the first chunk alone, and once more at the end."""
    source = plain_mcap(tmp_path / "other.mcap", chunks=True, compression=compression)
    with source.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    lost = summary.chunk_indexes[0].message_index_length  # 16 bytes a message
    begin = summary.chunk_indexes[0].chunk_start_offset + at_byte
    data = source.read_bytes()
    source.write_bytes(data[:begin] + value + data[begin + len(value) : -20])  # its index is lost, too
    result = run(source)
    assert result.exit_code == 0, result.exception
    assert result.stderr.startswith("note: other.mcap: "), result.stderr
    assert "damaged" in result.stderr or "chunk" in result.stderr
    kept = len(imported(source, "--overwrite")[IMU_KEY])
    assert kept == COUNT - (lost - 15) // 16


def test_messages_whose_channel_is_described_nowhere_are_counted(tmp_path: Path) -> None:
    source = plain_mcap(tmp_path / "other.mcap", chunks=True)
    with source.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    begin = summary.chunk_indexes[0].chunk_start_offset + 60
    data = source.read_bytes()
    source.write_bytes(data[:begin] + b"\xa5" * 9 + data[begin + 9 : -len(data) // 3])
    message = str(run(source).exception)
    assert re.search(r"has a chunk whose checksum differs, and \d\d+ messages have lost their", message), (
        message
    )


def test_a_recording_of_pointit_is_no_bag(tmp_path: Path) -> None:
    imported(bag(tmp_path / "take", SAID[:5]))
    recording = (tmp_path / "session.mcap").rename(tmp_path / "own.mcap")
    assert f"{recording}: is a recording of PointIt; give it to" in str(run(recording).exception)


def test_a_bag_of_ros_1_is_named_with_its_converter(tmp_path: Path) -> None:
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n")
    assert "`rosbags-convert --src " in str(run(tmp_path / "old.bag").exception)
