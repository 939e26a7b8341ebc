"""Packages of strangers, installed for one test."""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from pointit.plugins import GROUPS
from pointit.schemas.topics import REQUESTS, TOPICS
from pointit.services.registry import PROCESSES

TABLES: tuple[list[Any], ...] = (TOPICS, REQUESTS, PROCESSES)


@contextmanager
def installed(folder: Path, module: str, source: str, **entries: str) -> Generator[None]:
    """Install a package `strangers-parts` in `folder` for the body.

    Its one `module` has a name that no other test uses, and `entries` are lines of entry points by the last
    part of their group, such as `imu_sources`.
    """
    for group in GROUPS.values():
        assert isinstance(group.names, tuple)  # found without the package, to which the end returns
    (folder / f"{module}.py").write_text(source, encoding="utf-8")
    info = folder / "strangers_parts-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: strangers-parts\nVersion: 1.0\n")
    groups = [f"[pointit.{group}]\n{lines}\n" for group, lines in entries.items()]
    (info / "entry_points.txt").write_text("\n".join(groups))
    before = [list(table) for table in TABLES]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "path", [str(folder), *sys.path])
        for group in GROUPS.values():
            patch.setattr(group, "_entries", group.find())
        try:
            yield
        finally:
            for table, rows in zip(TABLES, before, strict=True):
                table[:] = rows
