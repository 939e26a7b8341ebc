"""Bags as crashed recorders, full disks and interrupted copies leave them; written by third-party writers.

Each refusal names a command. The tests run it, or the part of it that Python has, and import the result.
"""

import contextlib
import shutil
import sqlite3
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import lz4.frame
import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer, storage_mcap
from zstandard import ZstdCompressor, ZstdDecompressor

from pointit.conversion import bag_file
from pointit.runtime.host.unpacking import MAX_BYTES, UNPACKERS, TooLargeError
from pointit.schemas.topics import IMU
from tests.unit.conversion.session import at
from tests.unit.conversion.test_import_bag import ROTATION, TYPES, bag, imported, run, turned

COUNT = 300
SAID = [turned(number / 50, (0.0, 0.0, 0.6, 0.8)) for number in range(COUNT)]
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


def recover_mcap(path: Path) -> Path:
    """Write what `mcap recover` writes: the messages before the damage, with an index."""
    whole = path.with_name("whole.mcap")
    with path.open("rb") as source, whole.open("wb") as target:
        writer = McapWriter(target)
        writer.start(profile="ros2")
        ids: dict[tuple[type, int], int] = {}
        try:
            for record in StreamReader(source).records:
                if isinstance(record, Schema):
                    schema = writer.register_schema(record.name, record.encoding, record.data)
                    ids[Schema, record.id] = schema
                elif isinstance(record, Channel):
                    schema = ids[Schema, record.schema_id]
                    ids[Channel, record.id] = writer.register_channel(
                        record.topic, record.message_encoding, schema
                    )
                elif isinstance(record, Message):
                    writer.add_message(
                        ids[Channel, record.channel_id], record.log_time, record.data, record.publish_time
                    )
        except (McapError, struct.error):  # the end of what is there
            pass
        writer.finish()
    return whole


def refused(source: Path) -> str:
    """Return the sentence with which a bag is refused, and check that nothing is written."""
    result = run(source)
    assert result.exit_code != 0
    sentence = str(result.exception)
    assert "\n" not in sentence
    assert not (source.parent / "session.mcap").exists()
    return sentence


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_compressed_bags_are_read_as_folder_and_as_file(
    tmp_path: Path, storage: StoragePlugin, mode: CompressionMode
) -> None:
    folder = compressed(tmp_path / "take", storage, mode)
    assert len(imported(folder)[IMU_KEY]) == COUNT
    (file,) = (each for each in folder.iterdir() if each.name != "metadata.yaml")
    assert len(imported(file)[IMU_KEY]) == COUNT


@pytest.mark.parametrize(
    "options",
    [
        {"chunks": False},
        {"chunks": True},
        {"chunks": True, "compression": CompressionType.LZ4},
        {"chunks": True, "compression": CompressionType.ZSTD},
    ],
)
def test_foreign_mcap_is_read_whole_and_after_its_recovery(tmp_path: Path, options: dict[str, Any]) -> None:
    source = plain_mcap(tmp_path / "other.mcap", **options)
    assert len(imported(source)[IMU_KEY]) == COUNT
    (tmp_path / "session.mcap").unlink()
    cut(source, 0.6)
    sentence = refused(source)
    assert sentence.startswith(f"{source}: is damaged (")
    assert "`mcap recover other.mcap -o whole.mcap` writes a whole file" in sentence
    assert 0.3 * COUNT < len(imported(recover_mcap(source))[IMU_KEY]) < COUNT


@pytest.mark.skipif(shutil.which("sqlite3") is None, reason="needs the command sqlite3")
def test_database_that_is_cut_off_is_read_after_its_recovery(tmp_path: Path) -> None:
    folder = bag(tmp_path / "take", SAID)
    file = folder / "take.db3"
    cut(file, 0.9)
    sentence = refused(file)
    assert refused(folder) == sentence
    command = sentence.split("`")[1]
    subprocess.run(command, shell=True, cwd=folder, capture_output=True, check=False)  # noqa: S602 - our own
    assert 0.3 * COUNT < len(imported(folder / "whole.db3")[IMU_KEY]) < COUNT


@pytest.mark.parametrize("storage", STORAGES)
def test_truncated_bag_is_refused_in_one_sentence(tmp_path: Path, storage: StoragePlugin) -> None:
    file = bag(tmp_path / "take", SAID[:120], storage) / f"take{STORAGES[storage]}"
    whole = file.read_bytes()
    for size in range(1, len(whole), len(whole) // 40):
        file.write_bytes(whole[:size])
        assert refused(file).startswith(f"{file}: is damaged (")


@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize(("at_byte", "value"), [(100, bytes(64)), (0, b"\0"), (60, b"\xa5" * 9)])
def test_damage_in_the_middle_of_a_file_is_refused(
    tmp_path: Path, compression: CompressionType, at_byte: int, value: bytes
) -> None:
    source = plain_mcap(tmp_path / "other.mcap", chunks=True, compression=compression)
    with source.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    begin = summary.chunk_indexes[2].chunk_start_offset + at_byte
    data = source.read_bytes()
    source.write_bytes(data[:begin] + value + data[begin + len(value) :])
    assert "`mcap recover other.mcap" in refused(source)


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize(
    "text",
    [
        *(None, "", "rosbag2_bagfile_information:\n  files: [", "rosbag2_bagfile_informa"),
        "rosbag2_bagfile_information: {version: 99}",
    ],
)
def test_bag_without_metadata_is_refused_but_its_file_is_read(
    tmp_path: Path, storage: StoragePlugin, text: str | None
) -> None:
    folder = bag(tmp_path / "take", SAID, storage)
    (folder / "metadata.yaml").unlink() if text is None else (folder / "metadata.yaml").write_text(text)
    sentence = refused(folder)
    assert (
        f"metadata.yaml: is missing or damaged: `ros2 bag reindex {folder}` writes it again, or" in sentence
    )
    assert len(imported(folder / f"take{STORAGES[storage]}")[IMU_KEY]) == COUNT


def test_bag_parts_are_read_in_order_and_missing_ones_named(tmp_path: Path) -> None:
    folder = tmp_path / "take"
    folder.mkdir()
    names = ["take_10.db3", "take_2.db3"]
    for name, said in zip(names, (SAID[:100], SAID[100:]), strict=True):
        shutil.copy(bag(tmp_path / name[:-4], said) / name, folder / name)
    metadata = {
        "version": 5,
        "relative_file_paths": names,
        "topics_with_message_count": [],
        "message_count": 300,
    }
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information: {metadata}")
    found = imported(folder)[IMU_KEY]

    assert [each.stamp_ns for each in found] == [at(number / 50 - 0.01) for number in range(COUNT)]
    (tmp_path / "session.mcap").unlink()
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information: {metadata | {'message_count': 301}}")
    assert "has 300 messages, and 301 by its metadata.yaml" in refused(folder)

    (folder / names[1]).unlink()
    assert refused(folder) == f"{folder}: take_2.db3 is missing: copy it there, or give another file alone"
    assert len(imported(folder / names[0])[IMU_KEY]) == 100


def test_unclosed_database_is_refused_and_read_after_its_repair(
    tmp_path: Path,
) -> None:
    folder = bag(tmp_path / "take", SAID[:200])
    database = sqlite3.connect(folder / "take.db3")
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
    file = crashed / "take.db3"
    files = {each.name: each.read_bytes() for each in crashed.iterdir()}

    assert f"`sqlite3 {file} 'PRAGMA integrity_check'` moves them into the file" in refused(file)
    assert {each.name: each.read_bytes() for each in crashed.iterdir()} == files, "the bag is not changed"
    repaired = sqlite3.connect(file)
    repaired.execute("PRAGMA integrity_check").fetchall()
    repaired.close()
    assert len(imported(file)[IMU_KEY]) == COUNT


@pytest.mark.parametrize("name", ["take.mcap", "take.db3", "take.mcap.zstd", "take.db3.zstd"])
def test_empty_file_makes_one_sentence(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    assert refused(tmp_path / name) == f"{tmp_path / name}: is empty: record or copy it again"


def unpacked(path: Path) -> Path:
    """Run `zstd -d`."""
    target = path.with_suffix("")
    with path.open("rb") as packed, target.open("wb") as file:
        ZstdDecompressor().copy_stream(packed, file)
    return target


def full_disk(folder: object) -> SimpleNamespace:
    del folder
    return SimpleNamespace(free=bag_file.RESERVE_BYTES + 1000)


@pytest.mark.parametrize(
    ("disk", "padding", "limit"),
    [(shutil.disk_usage, 30_000_000, "20 times its size"), (full_disk, 0, "the free space (1000 bytes)")],
)
def test_packed_file_beyond_limits_is_refused_until_unpacked_by_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, disk: Callable[[Path], object], padding: int, limit: str
) -> None:
    folder = bag(tmp_path / "take", SAID)
    database = sqlite3.connect(folder / "take.db3")
    database.execute("CREATE TABLE zeros AS SELECT zeroblob(?) AS zero", (padding,))
    database.commit()
    database.close()
    packed = tmp_path / "take.db3.zstd"
    packed.write_bytes(ZstdCompressor().compress((folder / "take.db3").read_bytes()))
    monkeypatch.setattr(bag_file.shutil, "disk_usage", disk)
    sentence = refused(packed)
    assert limit in sentence
    assert f"`zstd -d {packed}` unpacks it: give the unpacked file" in sentence
    assert len(imported(unpacked(packed))[IMU_KEY]) == COUNT


def test_truncated_packed_file_is_refused_with_its_repair(tmp_path: Path) -> None:
    folder = compressed(tmp_path / "take", StoragePlugin.MCAP, CompressionMode.FILE)
    file = folder / "take.mcap.zstd"
    plain = plain_mcap(tmp_path / "other.mcap", chunks=True)
    file.write_bytes(ZstdCompressor().compress(plain.read_bytes()))
    cut(file, 0.6)
    sentence = refused(file)
    assert f"`zstd -dcf {file} > take.mcap` unpacks what is there" in sentence
    assert "`mcap recover take.mcap -o whole.mcap`" in sentence


def test_zstd_chunk_that_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    source = tmp_path / "bomb.mcap"
    with source.open("wb") as file:
        writer = McapWriter(file, chunk_size=1 << 30, compression=CompressionType.ZSTD)
        writer.start(profile="ros2")
        schema = writer.register_schema(ROTATION[1], "ros2msg", b"")
        channel = writer.register_channel(ROTATION[0], "cdr", schema)
        writer.add_message(channel, at(0.0), bytes(40_000_000), publish_time=at(0.0))
        writer.finish()
    assert source.stat().st_size < 10_000
    assert "a chunk of it unpacks to more than 33554432 bytes" in refused(source)


def test_lz4_chunk_that_unpacks_to_too_much_is_refused(tmp_path: Path) -> None:
    source = tmp_path / "bomb.mcap"
    with source.open("wb") as file:
        writer = McapWriter(file, chunk_size=1 << 30, compression=CompressionType.LZ4)
        writer.start(profile="ros2")
        schema = writer.register_schema(ROTATION[1], "ros2msg", b"")
        channel = writer.register_channel(ROTATION[0], "cdr", schema)
        writer.add_message(channel, at(0.0), bytes(40_000_000), publish_time=at(0.0))
        writer.finish()
    assert source.stat().st_size < 200_000
    assert "a chunk of it unpacks to more than 33554432 bytes" in refused(source)


@pytest.mark.parametrize("packing", ["zstd", "lz4"])
def test_unpacking_is_limited_whatever_the_index_of_a_bag_says(packing: str) -> None:
    zeros = bytes(2 * MAX_BYTES)
    bomb = ZstdCompressor().compress(zeros) if packing == "zstd" else lz4.frame.compress(zeros)
    with pytest.raises(TooLargeError):
        storage_mcap.DECOMPRESSORS[packing](bomb, len(zeros))
    assert {*storage_mcap.DECOMPRESSORS} == {"", *UNPACKERS}, "another packing needs a limit, too"


ENDLESS_ROWS = """
CREATE VIEW messages AS
WITH RECURSIVE endless(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM endless)
SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM endless
"""
LARGE_ROWS = """
CREATE TABLE messages(
    id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB GENERATED ALWAYS AS (zeroblob(500000000))
)
"""


@pytest.mark.parametrize("computed", [ENDLESS_ROWS, LARGE_ROWS], ids=["view", "generated column"])
def test_database_whose_messages_are_computed_is_refused(tmp_path: Path, computed: str) -> None:
    source = bag(tmp_path / "take", SAID[:3], StoragePlugin.SQLITE3)
    (file,) = source.glob("*.db3")
    with contextlib.closing(sqlite3.connect(file)) as database:
        database.execute("DROP TABLE messages")
        database.execute(computed)
        database.commit()
    assert "'messages' is computed, and no plain table" in refused(file)


def test_recording_of_pointit_is_no_bag(tmp_path: Path) -> None:
    imported(bag(tmp_path / "take", SAID[:5]))
    recording = (tmp_path / "session.mcap").rename(tmp_path / "own.mcap")
    assert "if it is a recording of PointIt, give it to `pointit export`" in str(run(recording).exception)


def test_bag_of_ros_1_is_named_with_its_converter(tmp_path: Path) -> None:
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n")
    assert "`rosbags-convert --src " in str(run(tmp_path / "old.bag").exception)


def test_bag_is_read_when_no_temporary_folder_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = plain_mcap(tmp_path / "bag.mcap", chunks=True)
    packed = tmp_path / "packed.mcap.zstd"
    packed.write_bytes(ZstdCompressor().compress(source.read_bytes()))

    def refused(*_: object, **__: object) -> None:
        raise FileNotFoundError(2, "No usable temporary directory found in ['/tmp', '/var/tmp', '/usr/tmp']")

    monkeypatch.setattr(bag_file.tempfile, "TemporaryDirectory", refused)

    assert len(imported(source)[IMU_KEY]) == COUNT
    assert "set TMPDIR to a folder that can be, or unpack the file by `zstd -d`" in str(run(packed).exception)
