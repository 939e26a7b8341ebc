"""Persistent state: written whole, read again, private to one person, or refused by name."""

import stat
from pathlib import Path

import pytest
from pydantic import BaseModel

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import MAX_BYTES, StateFile, state_directory
from pointit.schemas import KeyNameError


class Shoe(BaseModel):
    size: int


def test_a_stored_value_is_read_again_by_the_same_person_only_until_it_is_erased(own_state: Path) -> None:
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


def test_the_system_has_a_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("POINTIT_STATE")
    assert state_directory().is_absolute()
    assert "pointit" in state_directory().parts
