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
"""Number from which on WLED takes a cell of a ledmap as a gap."""
_EXAMPLE = '{"seg": [{"start": 0, "stop": 60, "n": "desk"}]}'


@dataclass(frozen=True, kw_only=True)
class WledSegment:
    """Pixels that WLED shows as one."""

    name: str
    number: int
    """Its id."""
    start: int | None
    """Number of its first pixel on the wire. None in a matrix, where the wire is not told."""
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
    if preset is not None or (state and all(key.isdecimal() for key in state)):
        state = _preset(state, preset)
    elif outputs := list_of(inside(state, "hw", "led", "ins")):
        used = _used([_output(number, each) for number, each in enumerate(outputs)])
        return _on_panels(used, list_of(inside(state, "hw", "led", "matrix", "panels")))
    seg = state.get("seg")
    if not (listed := [seg] if isinstance(seg, dict) else list_of(seg)):
        raise ConfigError(f"has no segments of WLED; give its state, such as {_EXAMPLE}")
    if len(listed) > MAX_SEGMENTS:
        raise ConfigError(f"has more than {MAX_SEGMENTS} segments, and WLED has 64; give its state")
    segments = [_segment(number, each) for number, each in enumerate(listed)]
    return _behind_matrix(_used(segments))


def read_ledmap(text: str) -> tuple[list[tuple[int, int, int]], int]:
    """Return number, column and row (from 0, the first at the top) of each pixel, and the number of rows.

    Raises:
        ConfigError: If it is no ledmap with width and height, or a pixel is in two cells. One sentence.
    """
    data = read_json(text)
    if not (cells := list_of(inside(data, "map"))):
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
    places: dict[int, int] = {}
    for index, value in enumerate(cells):
        number = whole_number(value, f"cell {index} of map")
        if number < 0 or number >= _NO_PIXEL:
            continue
        if (other := places.setdefault(number, index)) != index:
            first, second = (f"column {at % width}, row {at // width}" for at in (other, index))
            raise ConfigError(
                f"pixel {number} is in two cells ({first}; {second}); remove it from one, write -1"
            )
    if not places:
        raise ConfigError("has no pixels, all cells are -1; write their numbers")
    _check_pixels(len(places))
    return [(number, at % width, at // width) for number, at in sorted(places.items())], height


def _check_pixels(count: int) -> None:
    if count > MAX_PIXELS:
        raise ConfigError(f"has {count} pixels, limit {MAX_PIXELS}, as of WLED; import its parts one by one")


def _used(segments: Sequence[WledSegment | None]) -> list[WledSegment]:
    if not (used := [each for each in segments if each]):
        raise ConfigError("has no segments with pixels; save it with its bounds (stop above start)")
    return used


def _behind_matrix(segments: list[WledSegment]) -> list[WledSegment]:
    """Return `segments`, those of a matrix first and without start: its wire has an order of its own.

    A segment of one row is behind the matrix if it starts at or after its last pixel.
    """
    of_matrix = [each for each in segments if each.rows > 1 or each.row]
    if not of_matrix:
        return segments
    columns = max((each.start or 0) + each.columns for each in of_matrix)
    rows = max(each.row + each.rows for each in of_matrix)
    behind = [each for each in segments if each not in of_matrix and (each.start or 0) >= columns * rows]
    return [*(replace(each, start=None) for each in segments if each not in behind), *behind]


def _segment(number: int, data: Any) -> WledSegment | None:
    """Return a segment, None if WLED does not use it."""
    if not isinstance(data, dict):
        raise ConfigError(f"segment {number} is {format_value(data)}; write such as {_EXAMPLE}")
    data = cast("Json", data)
    where = f"segment {data.get('id', number)}"
    if not {"stop", "len"} & data.keys():
        raise ConfigError(f"{where} has neither stop nor len; save the segments with their bounds")
    start = _count(data, "start", where, 0)
    stop = _count(data, "stop", where, 0) if "stop" in data else start + _count(data, "len", where, 0)
    start_y = _count(data, "startY", where, 0)
    rows = max(1, _count(data, "stopY", where, start_y + 1)) - start_y
    if stop <= start:
        return None
    if rows < 1:
        raise ConfigError(
            f"{where} has startY {start_y} and stopY {start_y + rows}; stopY must be above startY"
        )
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
    where = f"output {number} of hw.led.ins"
    length, start = (_count(cast("Json", data), key, where, 0) for key in ("len", "start"))
    name = f"output_{number}"
    return WledSegment(name=name, number=number, start=start, columns=length, rows=1) if length else None


def _on_panels(outputs: Sequence[WledSegment], panels: Sequence[Any]) -> list[WledSegment]:
    """Return `outputs` with the number of `panels`, whose pixels are on the wire one after the other."""
    counts: Counter[int] = Counter()
    first = 0
    for number, each in enumerate(panels[:MAX_SEGMENTS]):
        if not isinstance(each, dict):
            raise ConfigError(f"panel {number} is {format_value(each)}; give WLED's cfg.json")
        panel = cast("Json", each)
        where = f"panel {number} of hw.led.matrix"
        end = first + _count(panel, "w", where, 0) * _count(panel, "h", where, 0)
        for output in outputs:
            start = output.start or 0
            if start < end and first < start + output.pixels:
                counts[output.number] += 1
        first = end
    return [replace(output, panels=counts[output.number]) for output in outputs]


def _preset(data: Json, wanted: int | None) -> Json:
    """Return the state of the preset `wanted`, or of any if all have the same segments."""
    presets = {number: cast("Json", each) for number, each in data.items() if _has_bounds(each)}
    if not presets:
        raise ConfigError("has no preset with segments; save one in WLED with *Save segment bounds*")
    if wanted is not None:
        if str(wanted) not in presets:
            raise ConfigError(f"has no preset {wanted} with segments; use one of {join_names(presets)}")
        return presets[str(wanted)]
    kinds = [_used_segments(preset) for preset in presets.values()]
    if any(each != kinds[0] for each in kinds):
        names = [f"{number} ({each['n']})" if each.get("n") else number for number, each in presets.items()]
        raise ConfigError(f"presets {join_names(names)} have other segments; choose one by --preset")
    return next(iter(presets.values()))


def _segments_of(preset: Json) -> Iterator[Json]:
    segments = preset.get("seg")
    for each in list_of(segments) or [segments]:
        if isinstance(each, dict):
            yield cast("Json", each)


def _used_segments(preset: Json) -> list[WledSegment]:
    """Return the segments with pixels. Presets have more, which fill up their list."""
    segments = [_segment(number, each) for number, each in enumerate(_segments_of(preset))]
    used = [replace(each, number=0) for each in segments if each]
    return sorted(used, key=lambda each: (each.row, each.start or 0))


def _has_bounds(preset: object) -> bool:
    if not isinstance(preset, dict):
        return False
    return any(each.get("stop") or each.get("len") for each in _segments_of(cast("Json", preset)))


def inside(data: Any, *keys: str) -> Any:
    """Return the value at `keys`, one below the other, None if there is none."""
    for key in keys:
        data = cast("Json", data).get(key) if isinstance(data, dict) else None
    return data


def list_of(value: object) -> list[Any]:
    """Return `value`, an empty list if it is none."""
    return list(cast("Sequence[Any]", value)) if isinstance(value, list) else []


def _count(data: Json, key: str, where: str, otherwise: int) -> int:
    if (value := data.get(key)) is None:
        return otherwise
    if not 0 <= (number := whole_number(value, f"{key} of {where}")) <= LAST_PIXEL:
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
        raise ConfigError(f"the key {names.most_common(1)[0][0]!r} occurs twice; keep one")
    return dict(pairs)
