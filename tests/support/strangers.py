"""Packages of strangers, installed for one test."""

import sys
from pathlib import Path

import pytest

from pointit.plugins import GROUPS


def install(folder: Path, patch: pytest.MonkeyPatch, module: str, source: str, **entries: str) -> None:
    """Install a package `strangers-parts` with one `module`.

    Args:
        folder: where.
        patch: forgets it after the test.
        module: name of its module, which no other test uses.
        source: text of the module.
        entries: lines of entry points by the last part of their group, such as `imu_sources`.
    """
    for group in GROUPS.values():
        assert group.names  # found without the package, to which the end of the test returns
    (folder / f"{module}.py").write_text(source, encoding="utf-8")
    info = folder / "strangers_parts-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: strangers-parts\nVersion: 1.0\n")
    groups = [f"[pointit.{group}]\n{lines}\n" for group, lines in entries.items()]
    (info / "entry_points.txt").write_text("\n".join(groups))
    patch.setattr(sys, "path", [str(folder), *sys.path])
    for group in GROUPS.values():
        patch.setattr(group, "_entries", type(group)._entries.func(group))
