"""New maps on a disk that is full or has no links, and beside another writer."""

from pathlib import Path

import pytest

from pointit.maps.edit import write_new
from pointit.runtime.errors import ConfigError
from tests.support.full_disk import file_size_limit


def test_no_file_is_left_when_the_disk_is_full(tmp_path: Path) -> None:
    with file_size_limit(1000), pytest.raises(ConfigError, match=r"room\.yaml: cannot be written"):
        write_new(tmp_path / "room.yaml", b"#" * 100_000)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("has_links", [True, False])
def test_an_existing_file_stays_and_a_new_one_is_readable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, has_links: bool
) -> None:
    if not has_links:

        def refuse(*_: object) -> None:
            raise PermissionError(1, "Operation not permitted")  # as FAT does

        monkeypatch.setattr(Path, "hardlink_to", refuse)
    path = tmp_path / "room.yaml"
    write_new(path, "lamps: {}\n")
    with pytest.raises(ConfigError, match="exists already"):
        write_new(path, "lamps: {a: 1}\n")
    assert [(each.name, each.read_text()) for each in tmp_path.iterdir()] == [("room.yaml", "lamps: {}\n")]
    plain = tmp_path / "plain"
    plain.touch()
    assert path.stat().st_mode == plain.stat().st_mode
