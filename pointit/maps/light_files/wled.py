"""WLED's JSON: segments of a state, a preset or the configured outputs, the cells of a ledmap."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

from pointit.runtime.config.validation_message import format_value, join_names
from pointit.runtime.errors import ConfigError

Json = Mapping[str, Any]

MAX_CELLS = 1_000_000
"""Limit of the cells of a ledmap."""
MAX_PIXELS = 16_384
"""Limit of the pixels of a ledmap, WLED's own."""
MAX_SEGMENTS = 1000
LAST_PIXEL = 262_143
"""Largest number of a pixel on the wire, and of a column or row."""
GAP = -1
"""Cell of a ledmap without a pixel."""
_NO_PIXEL = 65535
"""Smallest number that WLED treats as a gap in a ledmap."""
_EXAMPLE = '{"seg": [{"start": 0, "stop": 60, "n": "desk"}]}'


@dataclass(frozen=True, kw_only=True)
class WledSegment:
    """Pixels that WLED shows as one."""

    name: str
    number: int
    """Its id."""
    start: int | None
    """Number of its first pixel on the wire. None in a matrix, whose wiring is not given."""
    columns: int
    rows: int
    """1, unless it is a part of a matrix."""
    row: int = 0
    """Row of a matrix in which it begins."""
    panels: int = 0
    """Number of panels of a matrix that its pixels are on, of a configured output."""

    @property
    def pixels(self) -> int:
        """Return the number of its pixels."""
        return self.columns * self.rows


def read_segments(text: str, preset: int | None = None) -> list[WledSegment]:
    """Return the segments with pixels: of a state, of presets, or the configured outputs.

    Args:
        text: JSON of `/json/state`, `/json` (the state and more), `presets.json` or `cfg.json`.
        preset: number of the preset. None: the only one, or any if all have the same segments.

    Raises:
        ConfigError: If there are none, or several presets differ. One sentence.
    """
    data = read_json(text)
    state = cast("Json", data) if isinstance(data, dict) else {}
    if isinstance(state.get("state"), dict):
        state = state["state"]

    # Presets have numbers as keys, the configuration has outputs, and a state has segments
    has_presets = bool(state) and all(key.isdecimal() for key in state)
    if preset is not None or has_presets:
        state = _preset(state, preset)
    else:
        outputs = list_of(inside(state, "hw", "led", "ins"))
        if outputs:
            used = _used([_output(number, output) for number, output in enumerate(outputs)])
            return _on_panels(used, list_of(inside(state, "hw", "led", "matrix", "panels")))
    seg = state.get("seg")
    entries = [seg] if isinstance(seg, dict) else list_of(seg)
    if not entries:
        raise ConfigError(f"has no segments of WLED; give its state, such as {_EXAMPLE}")
    if len(entries) > MAX_SEGMENTS:
        raise ConfigError(f"has more than {MAX_SEGMENTS} segments, and WLED has 64; give its state")
    segments = [_segment(number, entry) for number, entry in enumerate(entries)]
    return _behind_matrix(_used(segments))


def read_ledmap(text: str) -> tuple[list[tuple[int, int, int]], int]:
    """Return number, column and row (from 0, the first at the top) of each pixel, and the number of rows.

    Raises:
        ConfigError: If it is no ledmap with width and height, or a pixel is in two cells. One sentence.
    """
    # A grid with as many cells as its width and height say
    data = read_json(text)
    cells = list_of(inside(data, "map"))
    if not cells:
        raise ConfigError('is no ledmap of WLED; give {"width": 2, "height": 1, "map": [0, 1]}')
    if len(cells) > MAX_CELLS:
        raise ConfigError(f"map has {len(cells)} cells, limit {MAX_CELLS}; give a smaller one")
    for key in ("width", "height"):
        if key not in data:
            raise ConfigError(
                f"has no {key}, without which a ledmap has no positions; add width and height of the grid"
            )
    width = whole_number(data["width"], "width")
    height = whole_number(data["height"], "height")
    if width * height != len(cells) or width < 1:
        raise ConfigError(
            f"width {width} times height {height} are {width * height} cells, and map has {len(cells)}; "
            "correct them"
        )

    # Cell of each pixel
    cell_of: dict[int, int] = {}
    for index, value in enumerate(cells):
        number = whole_number(value, f"cell {index} of map")
        if number < 0 or number >= _NO_PIXEL:
            continue
        other = cell_of.setdefault(number, index)
        if other != index:
            first = f"column {other % width}, row {other // width}"
            second = f"column {index % width}, row {index // width}"
            raise ConfigError(
                f"pixel {number} is in two cells ({first}; {second}); remove it from one, write -1"
            )
    if not cell_of:
        raise ConfigError("has no pixels, all cells are -1; write their numbers")
    _check_pixels(len(cell_of))
    pixels = [(number, index % width, index // width) for number, index in sorted(cell_of.items())]
    return pixels, height


def _check_pixels(count: int) -> None:
    if count > MAX_PIXELS:
        raise ConfigError(f"has {count} pixels, limit {MAX_PIXELS}, as of WLED; import its parts one by one")


def _used(segments: Sequence[WledSegment | None]) -> list[WledSegment]:
    """Return the segments with pixels. Raises ConfigError if there are none."""
    used = [segment for segment in segments if segment]
    if not used:
        raise ConfigError("has no segments with pixels; save it with its bounds (stop above start)")
    return used


def _behind_matrix(segments: list[WledSegment]) -> list[WledSegment]:
    """Return `segments`, those of a matrix first and without start: its wire has an order of its own.

    A segment of one row is behind the matrix if it starts at or after its last pixel.
    """
    # Size of the matrix
    columns = rows = 0
    for segment in segments:
        if _is_of_matrix(segment):
            columns = max(columns, (segment.start or 0) + segment.columns)
            rows = max(rows, segment.row + segment.rows)
    if not rows:
        return segments

    in_matrix: list[WledSegment] = []
    behind: list[WledSegment] = []
    for segment in segments:
        starts_behind = (segment.start or 0) >= columns * rows
        if starts_behind and not _is_of_matrix(segment):
            behind.append(segment)
        else:
            in_matrix.append(replace(segment, start=None))
    return [*in_matrix, *behind]


def _is_of_matrix(segment: WledSegment) -> bool:
    """Return True if only a matrix has the rows of `segment`."""
    return segment.rows > 1 or segment.row > 0


def _segment(number: int, data: Any) -> WledSegment | None:
    """Return a segment, None if WLED does not use it."""
    if not isinstance(data, dict):
        raise ConfigError(f"segment {number} is {format_value(data)}; write such as {_EXAMPLE}")
    data = cast("Json", data)
    where = f"segment {data.get('id', number)}"
    if not {"stop", "len"} & data.keys():
        raise ConfigError(f"{where} has neither stop nor len; save the segments with their bounds")

    # Old versions have a length in place of the stop
    start = _count(data, "start", where, 0)
    if "stop" in data:
        stop = _count(data, "stop", where, 0)
    else:
        stop = start + _count(data, "len", where, 0)
    start_y = _count(data, "startY", where, 0)
    stop_y = max(1, _count(data, "stopY", where, start_y + 1))
    rows = stop_y - start_y
    if stop <= start:
        return None
    if rows < 1:
        raise ConfigError(f"{where} has startY {start_y} and stopY {stop_y}; stopY must be above startY")
    return WledSegment(
        name=str(data.get("n") or ""),
        number=whole_number(data.get("id", number), f"id of segment {number}"),
        start=start,
        columns=stop - start,
        rows=rows,
        row=start_y,
    )


def _output(number: int, data: Any) -> WledSegment | None:
    """Return the pixels of an output of WLED's configuration, None if it has none."""
    if not isinstance(data, dict):
        raise ConfigError(f"output {number} of hw.led.ins is {format_value(data)}; give WLED's cfg.json")
    output = cast("Json", data)
    where = f"output {number} of hw.led.ins"
    length = _count(output, "len", where, 0)
    start = _count(output, "start", where, 0)
    if not length:
        return None
    return WledSegment(name=f"output_{number}", number=number, start=start, columns=length, rows=1)


def _on_panels(outputs: Sequence[WledSegment], panels: Sequence[Any]) -> list[WledSegment]:
    """Return `outputs` with the number of `panels`, whose pixels are on the wire one after the other."""
    counts: Counter[int] = Counter()
    first = 0
    for number, data in enumerate(panels[:MAX_SEGMENTS]):
        if not isinstance(data, dict):
            raise ConfigError(f"panel {number} is {format_value(data)}; give WLED's cfg.json")
        panel = cast("Json", data)
        where = f"panel {number} of hw.led.matrix"
        width = _count(panel, "w", where, 0)
        height = _count(panel, "h", where, 0)
        end = first + width * height
        for output in outputs:
            start = output.start or 0
            if start < end and first < start + output.pixels:
                counts[output.number] += 1
        first = end
    return [replace(output, panels=counts[output.number]) for output in outputs]


def _preset(data: Json, wanted: int | None) -> Json:
    """Return the state of the preset `wanted`, or of any if all have the same segments."""
    presets: dict[str, Json] = {}
    for number, preset in data.items():
        if _has_bounds(preset):
            presets[number] = cast("Json", preset)
    if not presets:
        raise ConfigError("has no preset with segments; save one in WLED with *Save segment bounds*")
    if wanted is not None:
        if str(wanted) not in presets:
            raise ConfigError(f"has no preset {wanted} with segments; use one of {join_names(presets)}")
        return presets[str(wanted)]

    # Any will do if all agree
    layouts = [_used_segments(preset) for preset in presets.values()]
    if any(layout != layouts[0] for layout in layouts):
        names: list[str] = []
        for number, preset in presets.items():
            name = preset.get("n")
            names.append(f"{number} ({name})" if name else number)
        raise ConfigError(f"presets {join_names(names)} have other segments; choose one by --preset")
    return next(iter(presets.values()))


def _segments_of(preset: Json) -> Iterator[Json]:
    """Yield the entries of the segments: of a list, or the only one."""
    seg = preset.get("seg")
    for segment in list_of(seg) or [seg]:
        if isinstance(segment, dict):
            yield cast("Json", segment)


def _used_segments(preset: Json) -> list[WledSegment]:
    """Return the segments with pixels. Presets have more, which fill up their list."""
    used: list[WledSegment] = []
    for number, data in enumerate(_segments_of(preset)):
        segment = _segment(number, data)
        if segment:
            used.append(replace(segment, number=0))
    return sorted(used, key=lambda segment: (segment.row, segment.start or 0))


def _has_bounds(preset: object) -> bool:
    if not isinstance(preset, dict):
        return False
    for segment in _segments_of(cast("Json", preset)):
        if segment.get("stop") or segment.get("len"):
            return True
    return False


def inside(data: Any, *keys: str) -> Any:
    """Return the value at `keys`, one below the other, None if there is none."""
    for key in keys:
        if not isinstance(data, dict):
            return None
        data = cast("Json", data).get(key)
    return data


def list_of(value: object) -> list[Any]:
    """Return `value`, an empty list if it is none."""
    return list(cast("Sequence[Any]", value)) if isinstance(value, list) else []


def _count(data: Json, key: str, where: str, otherwise: int) -> int:
    """Return the count at `key`, `otherwise` if there is none. Raises ConfigError if it is no count."""
    value = data.get(key)
    if value is None:
        return otherwise
    number = whole_number(value, f"{key} of {where}")
    if not 0 <= number <= LAST_PIXEL:
        raise ConfigError(f"{key} of {where} is {number}; write a whole number from 0 to {LAST_PIXEL}")
    return number


def whole_number(value: object, where: str) -> int:
    """Return the whole number `value`. Raises: ConfigError: If it is none."""
    if not isinstance(value, int) or isinstance(value, bool) or abs(value) > 2**32:
        raise ConfigError(f"{where} is {format_value(value)}; write a whole number")
    return value


def read_json(text: str) -> Any:
    """Return the value in `text`. Raises: ConfigError: If it is no JSON, or a key is there twice."""
    try:
        return json.loads(text, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"is no JSON: {error}; export it again") from None


def _unique(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    names = Counter(name for name, _ in pairs)
    if len(names) < len(pairs):
        [(name, _)] = names.most_common(1)
        raise ConfigError(f"the key {name!r} occurs twice; keep one")
    return dict(pairs)
