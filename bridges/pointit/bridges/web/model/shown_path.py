"""Paths as pages show them: pages are on other machines, too, whose users do not know this one's folders."""

import os
from pathlib import Path


def shown_path(path: Path) -> str:
    """Return `path` relative to the folder in which PointIt was started.

    A path elsewhere is shortened to its folder's name and its own: `…/maps/room.yaml`.
    """
    path, start = path.absolute(), Path.cwd()
    return str(path.relative_to(start) if path.is_relative_to(start) else Path("…", *path.parts[-2:]))


def with_shown_path(sentence: str, path: Path) -> str:
    """Return `sentence` with `path`, and other files of its folder, as of `shown_path`."""
    return sentence.replace(f"{path.absolute().parent}{os.sep}", shown_path(path).removesuffix(path.name))
