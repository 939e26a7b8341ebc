"""Hook of the build: refuses an archive or a checkout that has lost its symbolic links.

A zip archive that pip, uv, Python or Windows unpacks has text files in their place. A wheel of it would be
installed without an error, and none of its commands would start.
"""

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

LINKS = ("bridges", "schemas", "services")
"""Symbolic links in the folder `pointit`. In a source distribution they are folders."""


class LinksHook(BuildHookInterface[Any]):
    """Ends the build with a sentence if a link is a text file."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Check the links before anything is built."""
        del version, build_data
        root = Path(self.root)
        lost = [name for name in LINKS if (root / "pointit" / name).is_file()]
        if lost:
            sys.exit(
                f"{root}/pointit: {', '.join(lost)} are text files here, not symbolic links: {remedy(root)}"
            )


def remedy(root: Path) -> str:
    """Return what a person can do whose folder `root` has lost its links."""
    if (root / ".git").exists():
        return (
            "git wrote this checkout without links; on Windows, switch on its developer mode; then run "
            "`git config core.symlinks true`, then `git checkout -- pointit`"
        )
    return (
        "the archive was unpacked without them; install a wheel, or the .tar.gz archive instead of the .zip, "
        "or clone the repository with git"
    )
