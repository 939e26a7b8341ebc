"""Stored values that several processes change."""

import contextlib
import multiprocessing
from pathlib import Path

import pytest
from pydantic import BaseModel

from pointit.bridges.web.devices import devices
from pointit.bridges.web.devices.devices import update_stored
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.host.store import acquire_lock


class Counted(BaseModel):
    count: int = 0


def count_up(path: Path) -> None:
    def add_one(stored: Counted | None) -> Counted:
        return Counted(count=(stored.count if stored else 0) + 1)

    for _ in range(50):
        update_stored(StateFile[Counted].at(path, Counted), add_one)


def test_no_update_of_two_processes_is_lost(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    path = tmp_path / "count.json"
    processes = [context.Process(target=count_up, args=(path,)) for _ in range(2)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
        assert process.exitcode == 0
    assert StateFile[Counted].at(path, Counted).read() == Counted(count=100)


def test_an_update_waits_for_no_lock_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "LOCK_TIMEOUT_S", 0.0)
    path = tmp_path / "count.json"
    lock = acquire_lock(path.with_suffix(".lock"))
    assert lock is not None
    with contextlib.closing(lock), pytest.raises(ConfigError, match="another process is changing it"):
        update_stored(StateFile[Counted].at(path, Counted), lambda _stored: Counted())
    assert not path.exists()
