"""Draws the rooms and their imports, docs/explanation/rooms.svg: `python docs/pictures/rooms.py`.

An arrow is drawn where no longer way leads to the same room. The most frequent of the other imports are
listed in the room's box, which is filled by as much as its lines are of the core.
"""

from collections import Counter
from importlib.machinery import SourceFileLoader
from pathlib import Path
from xml.sax.saxutils import escape

import grimp

import pointit  # noqa: F401  # loads all its three folders

ROOT = Path(__file__).resolve().parents[2]
WIDTH = 1650
HEIGHT = 1176
BOX_HEIGHT = 66
LAB = "lab"
ROOMS = {
    LAB: (750, 16, 1180, "the laboratory, not in the wheel: evaluation, load test, benchmarks"),
    "cli": (750, 114, 1180, "the commands of the program pointit"),
    "assistants": (1400, 212, 430, "a site for assistants: pointit mcp"),
    "api": (1400, 310, 430, "a site from Python: import pointit"),
    "launch": (1400, 408, 430, "a scenario becomes running services"),
    "conversion": (860, 506, 270, "export and import of recordings"),
    "replay": (570, 604, 310, "a recording in virtual time"),
    "testing": (1060, 604, 310, "checks of plug-ins"),
    "bridges": (1430, 604, 360, "web page, ROS 2, Foxglove"),
    "plugins": (1010, 702, 290, "names for authors of plug-ins"),
    "access": (1280, 702, 230, "rights and certificates"),
    "diagnosis": (1530, 702, 220, "faults of a site, and remedies"),
    "scan": (740, 702, 210, "photographs of strips to maps"),
    "services": (740, 800, 1000, "one folder per process"),
    "sim": (400, 898, 260, "recordings, simulated arms"),
    "recording": (740, 898, 260, "files of messages (MCAP)"),
    "maps": (1080, 898, 260, "map files and checks"),
    "vda5050": (1420, 898, 260, "messages of AGVs"),
    "runtime": (640, 996, 260, "bus, clock, configuration, health"),
    "schemas": (640, 1094, 260, "messages, codec, topic table"),
    "geometry": (1080, 1094, 260, "pure mathematics"),
}
"""Middle x, top y and width of each room's box, px, and its purpose. The order is that of the layers."""
MOST_OTHERS = 2
"""Number of imports in the room's box, the most frequent ones."""
STYLE = """
text{font:13px system-ui,sans-serif;text-anchor:middle;fill:#1c2733}
.name{font-weight:600;font-size:15px}
.small{font-size:11px;fill:#52606d}
.count{font-size:12px;stroke:#fff;stroke-width:4px;paint-order:stroke}
rect{fill:#fff;stroke:#7b93ab}
.core{fill:#cfe2f3;stroke:none}
.lab{stroke-dasharray:6 4}
path{fill:none;stroke:#52708f;stroke-width:1.5}
"""


def room_of(module: str) -> str:
    """Return the room of a module, or "" for that of no room."""
    top, _, rest = module.partition(".")
    return LAB if top == "pointit_lab" else rest.partition(".")[0]


def count_imports() -> Counter[tuple[str, str]]:
    """Return the number of imports between modules, by pair of rooms."""
    graph = grimp.build_graph("pointit", "pointit_lab", cache_dir=None)
    arrows = Counter[tuple[str, str]]()
    for module in graph.modules:
        for imported in graph.find_modules_directly_imported_by(module):
            arrows[room_of(module), room_of(imported)] += 1
    return Counter({pair: count for pair, count in arrows.items() if ROOMS.keys() >= set(pair)})


def count_lines() -> dict[str, tuple[int, int]]:
    """Return the number of lines of the core, and of all, by room."""
    loader = SourceFileLoader("house", str(ROOT / "scripts/house"))
    house = loader.load_module()  # pyrefly: ignore[deprecated]
    _, optional = house.core_contract((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    core = Counter[str]()
    every = Counter({LAB: house.line_count(house.python_files([house.LAB]))})
    for path in house.python_files(house.PRODUCT):
        module = house.module_of(path)
        lines = house.line_count([path])
        every[room_of(module)] += lines
        core[room_of(module)] += 0 if house.is_below(module, optional) else lines
    return {room: (core[room], lines) for room, lines in every.items()}


def direct(arrows: Counter[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the arrows that no longer way replaces."""
    rooms = list(ROOMS)
    reached: dict[str, set[str]] = {}
    for room in reversed(rooms):
        targets = {target for source, target in arrows if source == room and target != room}
        reached[room] = targets.union(*(reached[target] for target in targets))
    return {
        (source, target)
        for source, target in arrows
        if source != target
        and not any(
            target in reached[other] for other in rooms if (source, other) in arrows and other != source
        )
    }


def picture() -> str:
    """Return the SVG."""
    lines = count_lines()
    arrows = count_imports()
    drawn = direct(arrows)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img">',
        "<title>Rooms of PointIt and the number of imports between them</title>",
        f"<style>{STYLE}</style>",
        '<defs><marker id="tip" refX="7" refY="4" orient="auto" markerWidth="8" markerHeight="8">',
        '<path d="M0 0 8 4 0 8" style="fill:#52708f;stroke:none"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{HEIGHT}" style="fill:#fff;stroke:none"/>',
    ]
    labels: list[str] = []
    for source, target in sorted(drawn):
        (from_x, from_y, from_width, _), (to_x, to_y, to_width, _) = ROOMS[source], ROOMS[target]
        half = from_width / 2 - 24
        to_half = to_width / 2 - 24
        x1 = min(max(to_x, from_x - half), from_x + half)
        x2 = min(max(from_x, to_x - to_half), to_x + to_half)
        y1 = from_y + BOX_HEIGHT
        y2 = to_y
        parts.append(f'<path d="M{x1:.0f} {y1} L{x2:.0f} {y2}" marker-end="url(#tip)"/>')
        at = f'x="{(x1 + x2) / 2:.0f}" y="{(y1 + y2) / 2 + 4:.0f}"'
        labels.append(f'<text class="count" {at}>{arrows[source, target]}</text>')
    for room, (x, y, width, purpose) in ROOMS.items():
        others = [
            f"{target} {count}"
            for (source, target), count in sorted(arrows.items(), key=lambda each: (-each[1], each[0]))
            if source == room != target and (source, target) not in drawn
        ][:MOST_OTHERS]
        core, all_lines = lines[room]
        sizes = f"{all_lines / 1000:.1f} k lines" + (f", core {core / 1000:.1f} k" if core else "")
        at = f'x="{x - width / 2:.0f}" y="{y}" height="{BOX_HEIGHT}"'
        style = f'class="{room}" rx="6"'
        parts += [
            f'<rect {at} width="{width}" {style}/>',
            f'<rect {at} width="{width * core / all_lines:.0f}" class="core"/>',
            f'<text class="name" x="{x}" y="{y + 20}">{room}</text>',
            f'<text x="{x}" y="{y + 38}">{escape(purpose)}</text>',
            f'<text class="small" x="{x}" y="{y + 55}">{sizes}'
            + (f"; also {', '.join(others)}" if others else "")
            + "</text>",
        ]
    return "\n".join([*parts, *labels, "</svg>\n"])


if __name__ == "__main__":
    (ROOT / "docs/explanation/rooms.svg").write_text(picture(), encoding="utf-8")
