"""Summary of a map for listings: its first comment, and the number of its things of each kind."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pointit.maps.model import MapFile


def about_map(path: Path) -> str:
    """Return the first line of the file at `path` if it is a comment, without its end, or `""`."""
    with path.open(encoding="utf-8") as file:
        line = file.readline().strip()
    return line.lstrip("# ").rstrip(".:") if line.startswith("#") else ""


def contents(file: MapFile, clouds: Mapping[str, NDArray[np.float64]]) -> str:
    """Return a summary of a map, `8 belts, 8 links, 4 bays, 22 strips with 1228 pixels, 3 lamps`."""
    counts = (
        (len(file.belts), "belt", ""),
        (len(file.links), "link", ""),
        (len(file.bays), "bay", ""),
        (len(file.strips), "strip", _with(sum(strip.pixels for strip in file.strips.values()), "pixel")),
        (len(file.lamps), "lamp", ""),
        (len(file.boxes), "box", ""),
        (len(file.planes), "plane", ""),
        (len(file.cylinders), "cylinder", ""),
        (len(file.spheres), "sphere", ""),
        (len(clouds), "cloud", _with(sum(len(points) for points in clouds.values()), "point")),
        (len(file.fences), "fence", ""),
        (len(file.frames), "frame", ""),
        (len(file.things), "thing", ""),
    )
    return ", ".join(
        f"{count} {word}{'' if count == 1 else 'es' if word == 'box' else 's'}{more}"
        for count, word, more in counts
        if count
    )


def _with(count: int, what: str) -> str:
    return f" with {count} {what}{'s' if count > 1 else ''}"
