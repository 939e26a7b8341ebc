"""Reads a map and checks it: all mistakes of a file that cannot be read, or the findings of one that can."""

from collections.abc import Callable, Sequence
from pathlib import Path

from pointit.maps.checks.check import Point, check_map
from pointit.maps.checks.contents import contents
from pointit.maps.checks.finding import MapFinding, error
from pointit.maps.file import MapError, read_clouds, to_message
from pointit.maps.model import MapFile
from pointit.runtime.errors import ConfigError


def examined(
    name: str,
    path: Path,
    read: Callable[[], MapFile],
    person_m: Point | None = None,
    poses_m: Sequence[Point] = (),
) -> tuple[str, list[MapFinding]]:
    """Return a map's contents in words, `""` if it cannot be read, and findings on all readable sections.

    Args:
        name: name of the map, for findings without a section.
        path: its current or future path; its clouds lie beside it.
        read: returns the map, or raises `ConfigError`.
        person_m: position of the person. None: anywhere.
        poses_m: further positions from which people point at things.
    """
    has = ""
    try:
        file = read()
        clouds = read_clouds(path, file)
    except MapError as unreadable:
        return has, [error(where, text) for where, text in unreadable.mistakes]
    except ConfigError as unreadable:
        return has, [error(name, str(unreadable).removeprefix(f"{path}: "))]
    has = contents(file, clouds)
    findings = check_map(file, clouds, person_m=person_m, poses_m=poses_m)
    if not any(each.severity == "error" for each in findings):
        try:
            to_message(path, file, clouds, 0)
        except ConfigError as too_large:
            findings.append(error(name, str(too_large).removeprefix(f"{path}: ")))
    return has, findings
