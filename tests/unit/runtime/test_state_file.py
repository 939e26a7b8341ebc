"""Persistent state: written whole, read again, private to one person, or refused by name."""

import os
import stat
from pathlib import Path

import pytest
from pydantic import BaseModel

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import MAX_BYTES, StateFile, state_directory
from pointit.schemas import KeyNameError


class Shoe(BaseModel):
    size: int


def test_nothing_is_kept_at_first() -> None:
    assert StateFile(Shoe, "anna", "shoe").read() is None
    assert not StateFile(Shoe, "anna", "shoe").erase()


def test_a_stored_value_is_read_again_by_the_same_person_only() -> None:
    StateFile(Shoe, "anna", "shoe").write(Shoe(size=40))
    StateFile(Shoe, "anna", "shoe").write(Shoe(size=41))
    assert StateFile(Shoe, "anna", "shoe").read() == Shoe(size=41)
    assert StateFile(Shoe, "berta", "shoe").read() is None
    assert StateFile(Shoe, "anna", "shoe").erase()
    assert StateFile(Shoe, "anna", "shoe").read() is None


def test_only_the_owner_may_read_the_file(own_state: Path) -> None:
    file = StateFile(Shoe, "anna", "shoe")
    file.write(Shoe(size=40))
    assert own_state in file.path.parents
    assert stat.S_IMODE(file.path.stat().st_mode) == 0o600
    assert os.listdir(file.path.parent) == ["shoe.json"]  # noqa: PTH208 - no temporary file is left


@pytest.mark.parametrize("text", ["", "{", '{"size": "big"}', "[1]", "x" * (MAX_BYTES + 2)])
def test_a_spoilt_file_is_named(text: str) -> None:
    file = StateFile(Shoe, "anna", "shoe")
    file.write(Shoe(size=40))
    file.path.write_text(text)
    with pytest.raises(ConfigError, match=r"shoe\.json: .*move it away"):
        file.read()


def test_a_place_that_cannot_be_written_is_named(own_state: Path) -> None:
    own_state.write_text("in the way")
    with pytest.raises(ConfigError, match="cannot be written"):
        StateFile(Shoe, "anna", "shoe").write(Shoe(size=40))


def test_a_name_cannot_lead_elsewhere() -> None:
    with pytest.raises(KeyNameError):
        StateFile(Shoe, "../anna", "shoe")


def test_the_system_has_a_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("POINTIT_STATE")
    assert state_directory().is_absolute()
    assert "pointit" in state_directory().parts
