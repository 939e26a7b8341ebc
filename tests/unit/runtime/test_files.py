"""Files that are replaced: all or nothing, for their owner, on the disk if asked; states of one person."""

import os
import stat
from pathlib import Path

import pytest
from pydantic import BaseModel

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import (
    MAX_BYTES,
    StateFile,
    read_limited,
    replaced_file,
    write_atomically,
)
from pointit.schemas import KeyNameError
from tests.support.full_disk import file_size_limit


def names(folder: Path) -> list[str]:
    return sorted(each.name for each in folder.iterdir())


def mode_of(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.skipif(os.name != "posix", reason="modes are POSIX's")
def test_written_file_and_new_folders_are_private_without_a_mode(tmp_path: Path) -> None:
    write_atomically(tmp_path / "a" / "b" / "secret", b"")
    assert [mode_of(tmp_path / path) for path in ("a", "a/b", "a/b/secret")] == [0o700, 0o700, 0o600]
    write_atomically(tmp_path / "a" / "b" / "secret", b"", mode=0o644)
    assert mode_of(tmp_path / "a/b/secret") == 0o644


def test_error_names_the_file_and_leaves_it_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(ConfigError, match=r"folder: cannot be written \(.+\)"):
        write_atomically(tmp_path / "folder", b"new")
    write_atomically(tmp_path / "file", b"old")
    with pytest.raises(ConfigError, match=r"file/x: cannot be written"):
        write_atomically(tmp_path / "file" / "x", b"new")
    with pytest.raises(ConfigError, match=r"folder: cannot be read \(.+\)"):
        read_limited(tmp_path / "folder", 10)
    assert read_limited(tmp_path / "file", 2) == b"ol"
    assert (tmp_path / "file").read_bytes() == b"old"
    assert names(tmp_path) == ["file", "folder"]


def test_only_what_must_last_waits_for_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    waited: list[bool] = []

    def wait(handle: int) -> None:
        waited.append(stat.S_ISDIR(os.fstat(handle).st_mode))

    monkeypatch.setattr(os, "fsync", wait)
    write_atomically(tmp_path / "x", b"")
    assert waited == []
    write_atomically(tmp_path / "x", b"", durable=True)
    assert waited == ([False] if os.name == "nt" else [False, True])  # the file, then its name


def test_replaced_file_keeps_its_mode_or_gets_the_default(tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.touch()
    for mode in (mode_of(other), 0o640):
        with replaced_file(tmp_path / "x.json") as part:
            assert part.suffix == ".json"
            part.write_text("new")
        assert mode_of(tmp_path / "x.json") == mode
        (tmp_path / "x.json").chmod(0o640)
    assert names(tmp_path) == ["other", "x.json"]


def test_kept_file_is_as_it_was_if_its_writer_fails(tmp_path: Path) -> None:
    (tmp_path / "x").write_text("old")
    with pytest.raises(ZeroDivisionError), replaced_file(tmp_path / "x") as part:
        part.write_text(f"half{1 // 0}")  # pyrefly: ignore[division-by-zero]
    assert ((tmp_path / "x").read_text(), names(tmp_path)) == ("old", ["x"])


def test_links_to_a_kept_file_stay(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "x").symlink_to(tmp_path / "folder" / "y")
    for text in ("a", "b"):
        with replaced_file(tmp_path / "x") as part:
            part.write_text(text)
        assert (tmp_path / "x").is_symlink()
        assert (tmp_path / "folder" / "y").read_text() == text


def test_replaced_file_writes_to_pipes_and_devices_themselves(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    try:
        with replaced_file(tmp_path / "pipe") as part:
            part.write_text("through")
        assert os.read(reader, 100) == b"through"
    finally:
        os.close(reader)
    with replaced_file(Path("/dev/null")) as part:
        part.write_text("away")

    assert Path("/dev/null").is_char_device()
    with (
        pytest.raises(ConfigError, match="/dev/full: cannot be written"),
        replaced_file(Path("/dev/full")) as part,
    ):
        part.write_text("too much")
    with pytest.raises(ConfigError, match=r"cannot be written"), replaced_file(tmp_path) as part:
        part.write_text("a folder")


@pytest.mark.parametrize("mode", [None, 0o600])
def test_full_disk_leaves_the_earlier_file_and_nothing_else(tmp_path: Path, mode: int | None) -> None:
    (tmp_path / "x").write_text("old")
    with (
        file_size_limit(1000),
        pytest.raises(ConfigError, match=r"/x: cannot be written"),
        replaced_file(tmp_path / "x", mode=mode) as part,
    ):
        part.write_bytes(bytes(100_000))
    assert ((tmp_path / "x").read_text(), names(tmp_path)) == ("old", ["x"])


class Shoe(BaseModel):
    size: int


def test_stored_value_is_read_by_the_same_person_until_erased(own_state: Path) -> None:
    file = StateFile(Shoe, "anna", "shoe")
    assert file.read() is None
    assert not file.erase()
    for size in (40, 41):
        file.write(Shoe(size=size))
    assert StateFile(Shoe, "anna", "shoe").read() == Shoe(size=41)
    assert StateFile(Shoe, "berta", "shoe").read() is None
    assert own_state in file.path.parents
    assert stat.S_IMODE(file.path.stat().st_mode) == 0o600
    assert file.erase()
    assert file.read() is None


@pytest.mark.parametrize("text", ["", "{", '{"size": "big"}', "[1]", "x" * (MAX_BYTES + 2)])
def test_a_spoilt_file_is_named(text: str) -> None:
    file = StateFile(Shoe, "anna", "shoe")
    file.write(Shoe(size=40))
    file.path.write_text(text)
    with pytest.raises(ConfigError, match=r"shoe\.json: .*move it away"):
        file.read()


def test_a_name_cannot_lead_elsewhere() -> None:
    with pytest.raises(KeyNameError):
        StateFile(Shoe, "../anna", "shoe")
