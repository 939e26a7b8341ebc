"""Disks of simulated machines: full, slow, and torn by the death of a process between two of its steps."""

import errno
import functools
import os
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pointit.runtime.host.store import Store
from tests.simulation.kernel.process import PROCESS, Process

_replace = Path.replace
_unlink = Path.unlink
_write_bytes = Path.write_bytes
_open = Store.open
_write = Store.write


def install_disks() -> None:
    """Make files and databases of simulated processes fail as their machine's disk does.

    Call this in a child process that runs one seed.
    """
    for owner, name, function in (
        (Path, "write_bytes", _write_file),
        (Path, "replace", _rename_file),
        (Path, "unlink", _remove_file),
        (Store, "open", _open_store),
        (Store, "write", _write_store),
    ):
        setattr(owner, name, function)


def _dead() -> OSError:
    return OSError(errno.EIO, "the process is dead")


def _write_file(path: Path, data: bytes) -> int:
    process = PROCESS.get()
    if process is None:
        return _write_bytes(path, data)
    if process.is_dead:
        raise _dead()
    process.pass_point("file")
    if process.is_dead:
        _write_bytes(path, data[: len(data) // 2])
        raise _dead()
    if process.host.disk_is_full:
        _write_bytes(path, data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    return _write_bytes(path, data)


def _rename_file(path: Path, target: Any) -> Path:
    process = PROCESS.get()
    if process is None:
        return _replace(path, target)
    process.pass_point("rename")
    if process.is_dead:
        raise _dead()
    if process.host.disk_delay_s > 0.0:
        process.stand_still(process.host.disk_delay_s, by_signal=False)
    return _replace(path, target)


def _remove_file(path: Path, *arguments: Any, **options: Any) -> None:
    process = PROCESS.get()
    if process is None or not process.is_dead:
        _unlink(path, *arguments, **options)


def _open_store(store: Store, now_ns: int, read: Callable[[sqlite3.Connection], Any]) -> Any:
    process = PROCESS.get()
    if process is not None:
        process.stores.append(store)
    return _open(store, now_ns, read)


def _write_store(store: Store, now_ns: int, write: Callable[[sqlite3.Connection], object]) -> bool:
    process = PROCESS.get()
    if process is None:
        return _write(store, now_ns, write)
    process.pass_point("commit")
    if process.is_dead:
        return False
    if process.host.disk_is_full:
        return _write(store, now_ns, _fail)
    delay_s = process.host.disk_delay_s
    if delay_s <= 0.0:
        is_written = _write(store, now_ns, write)
    else:
        is_written = _write(store, now_ns, functools.partial(_write_slowly, process, write))
        process.stand_still(delay_s, by_signal=False)
    process.pass_point("committed")
    return is_written


def _write_slowly(
    process: Process, write: Callable[[sqlite3.Connection], object], database: sqlite3.Connection
) -> None:
    write(database)
    process.disk_time_s += process.host.disk_delay_s


def _fail(_database: sqlite3.Connection) -> None:
    raise sqlite3.OperationalError("database or disk is full")
