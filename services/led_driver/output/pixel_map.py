"""Pixels of strips on the pixels of an output: parts, order of colours, gamma, current limit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pointit.geometry.array_types import Indices
from pointit.schemas import Strip, StripsFrame
from pointit.services.led_driver.outputs import OutputConfig, Segment

FULL_PIXEL = 3 * 255
"""Sum of a white pixel's bytes."""

WHOLE = 1 << 40
"""Pixels of a block where an output is not divided."""
_COLORS = "RGB"


@dataclass(frozen=True, slots=True)
class PowerLoad:
    """Current of one frame."""

    wanted_a: float
    """Current of the frame as requested, A."""
    drawn_a: float
    """Current of the frame as sent, A: the same, or the limit."""

    @property
    def limited(self) -> bool:
        """True if the frame was dimmed."""
        return self.drawn_a < self.wanted_a


class Power:
    """Converts frames as perceived to the values sent.

    Perceived brightness is nonlinear, LEDs are linear: a byte v becomes 255·(v / 255)^gamma. The current is
    estimated from the sum of the bytes that are sent, without that of dark LEDs. Above the limit the whole
    frame is scaled down, so that colours keep their hue.
    """

    def __init__(self, config: OutputConfig) -> None:
        """Set gamma and limits of one output."""
        shares = np.arange(256) / 255.0
        self._sent = np.rint(255.0 * shares**config.gamma)
        self._table = self._sent.astype(np.uint8).tobytes()
        self._a_per_count = config.current_per_pixel_ma / 1000.0 / FULL_PIXEL
        self._limit_a = config.max_current_a

    def send(self, pixels: bytes) -> tuple[bytes, PowerLoad]:
        """Return the bytes to send for the `pixels` of a frame, and their current."""
        sent = pixels.translate(self._table)
        wanted_a = self._current_a(sent)
        drawn_a = wanted_a
        if self._limit_a is not None and wanted_a > self._limit_a:
            scaled = np.floor(self._sent * (self._limit_a / wanted_a))  # rounding must not exceed the limit
            sent = pixels.translate(scaled.astype(np.uint8).tobytes())
            drawn_a = self._current_a(sent)
        return sent, PowerLoad(wanted_a, drawn_a)

    def _current_a(self, sent: bytes) -> float:
        values = np.frombuffer(sent, dtype=np.uint8)
        count = int(values.sum(dtype=np.uint32))
        return count * self._a_per_count


@dataclass(frozen=True, slots=True)
class PixelBlock:
    """Consecutive bytes of an output's pixels that are addressed together, such as those of a universe."""

    number: int
    """Number of the universe."""
    start: int
    """First byte."""
    size: int
    """Number of bytes, up to the last pixel that is in use."""


class PixelMap:
    """Source of each byte that an output sends."""

    def __init__(
        self, strips: Sequence[Strip], gather: Indices, colors: int, blocks: tuple[PixelBlock, ...]
    ) -> None:
        """Map `strips`; `map_pixels` does so by segments.

        Args:
            strips: strips in use.
            gather: for each byte of the output, the index of its source in the bytes of `strips` one behind
                the other, 3 a pixel, and of a dark byte behind them.
            colors: bytes of a pixel of the output, 3 or 4.
            blocks: division of the output's bytes.
        """
        self._strips = strips
        self._sizes = {strip.id: 3 * strip.pixels for strip in strips}
        self._gather = gather
        self.colors = colors
        """Bytes of a pixel of the output: 3, or 4 with white."""
        self.blocks = blocks
        """Division of the output's bytes, by number. Without divisions there is one, of the first number."""

    @property
    def size(self) -> int:
        """Return the number of bytes of a frame of the output."""
        return len(self._gather)

    @property
    def pixels(self) -> int:
        """Return the number of pixels of the output, with those in gaps."""
        return self.size // self.colors

    def covering(self, old: "PixelMap") -> "PixelMap":
        """Return this map with the pixels and blocks that only `old` has, dark: none of them stays lit."""
        own: dict[int, Indices] = {}
        for block in self.blocks:
            end = block.start + block.size
            own[block.number] = self._gather[block.start : end]
        old_sizes = {block.number: block.size for block in old.blocks}

        # Each block becomes as long as the longer one, filled up by the dark byte behind all strips
        dark = sum(self._sizes.values())
        gather = np.zeros(0, dtype=np.intp)
        blocks: list[PixelBlock] = []
        for number in sorted(own.keys() | old_sizes.keys()):
            part = own.get(number, gather[:0])
            size = max(len(part), old_sizes.get(number, 0))
            filling = np.full(size - len(part), dark, dtype=np.intp)
            blocks.append(PixelBlock(number, len(gather), size))
            gather = np.concatenate((gather, part, filling))
        return PixelMap(self._strips, gather, self.colors, tuple(blocks))

    def output_bytes(self, frame: StripsFrame) -> bytes:
        """Return the pixels of the output that show `frame`. Pixels without a value in it are dark."""
        shown = {strip.id: strip.rgb for strip in frame.strips}
        parts: list[bytes] = []
        for name, size in self._sizes.items():
            rgb = shown.get(name, b"")
            parts.append(rgb[:size].ljust(size, b"\0"))
        parts.append(b"\0")  # the source of dark bytes
        source = np.frombuffer(b"".join(parts), dtype=np.uint8)
        return source.take(self._gather, mode="clip").tobytes()  # all are valid: skips the check


@dataclass(frozen=True, slots=True)
class _Output:
    """Division of an output into universes."""

    block_pixels: int
    """Number of pixels of a universe, or `WHOLE`."""
    first_block: int
    """Number of the first universe."""


@dataclass(frozen=True, slots=True)
class _MappedSegment:
    """One segment on the pixels of an output."""

    start: int
    """First pixel of the output, negative if it lies before it."""
    end: int
    """Pixel behind the last one, where the next segment continues."""
    numbers: Indices
    """Pixels of the strip, in the order of the output."""
    problems: list[str]


def map_pixels(
    segments: Sequence[Segment], strips: Sequence[Strip], *, block_pixels: int = WHOLE, first_block: int = 0
) -> tuple[PixelMap, list[str]]:
    """Return the pixels of `strips` on an output, and sentences about what cannot be shown.

    Args:
        segments: parts of strips; all strips in their order if empty.
        strips: strips of the map.
        block_pixels: number of pixels of a universe. What does not fit continues in the next one.
        first_block: number of the output's first universe.
    """
    output = _Output(block_pixels, first_block)
    by_id = {strip.id: strip for strip in strips}
    segments = segments or [Segment(strip=name) for name in by_id]
    colors = len(segments[0].order) if segments else len(_COLORS)

    # the bytes of the strips in use, one strip behind the other, and a dark byte behind them
    used: list[Strip] = []
    first_byte: dict[str, int] = {}
    dark = 0
    for segment in segments:
        name = segment.strip
        if name in by_id and name not in first_byte:
            used.append(by_id[name])
            first_byte[name] = dark
            dark += 3 * by_id[name].pixels

    # each segment continues at the end of the one before, unless it has an offset
    problems: list[str] = []
    targets: list[Indices] = []
    sources: list[Indices] = []
    end = 0
    for segment in segments:
        strip = by_id.get(segment.strip)
        if strip is None:
            problems.append(f"the map has no strip {segment.strip}: correct `segments`")
            continue
        mapped = _map_segment(segment, strip, output, previous_end=end)
        problems += mapped.problems
        if mapped.start < 0:
            continue
        end = mapped.end
        targets.append(np.arange(mapped.start, mapped.end, dtype=np.intp))
        first = first_byte[strip.id]
        sources.append(_byte_sources(mapped.numbers, segment.order, first, dark))

    # only universes in use are sent
    target = np.concatenate(targets) if targets else np.zeros(0, dtype=np.intp)
    if len(np.unique(target)) < len(target):
        problems.append("two segments share pixels of the output, which show the later one: correct `offset`")
    positions, blocks = _divide(target, colors, output)
    size = sum(block.size for block in blocks) // colors
    gather = np.full((size, colors), dark, dtype=np.intp)
    if sources:
        gather[positions] = np.concatenate(sources)
    return PixelMap(used, gather.ravel(), colors, blocks), problems


def _map_segment(segment: Segment, strip: Strip, output: _Output, *, previous_end: int) -> _MappedSegment:
    """Return the pixels of one segment. `previous_end`: end of the segment before, 0 for the first one."""
    # Pixels that the strip has
    problems: list[str] = []
    available = strip.pixels - segment.first
    count = available if segment.pixels is None else segment.pixels
    if count > available or count <= 0:
        last = segment.first + max(count, 1) - 1
        problems.append(
            f"strip {strip.id} has {strip.pixels} pixels, a segment wants {segment.first} to {last}: "
            "correct `segments`"
        )
        count = max(0, available)

    # First pixel of the output: in the segment's universe, at its offset, or next to the segment before
    universe = segment.universe
    if universe is not None and output.block_pixels == WHOLE:
        problems.append(f"the output has no universes: remove `universe: {universe}`")
        universe = None

    if universe is not None:
        universe_start = (universe - output.first_block) * output.block_pixels
        start = universe_start + (segment.offset or 0)
    elif segment.offset is not None:
        start = segment.offset
    else:
        start = previous_end
    if start < 0:
        problems.append(f"universe {universe} lies before the output's first, {output.first_block}")

    numbers = np.arange(segment.first, segment.first + count, dtype=np.intp)
    if segment.reversed:
        numbers = numbers[::-1]
    return _MappedSegment(start=start, end=start + count, numbers=numbers, problems=problems)


def _byte_sources(numbers: Indices, order: str, first_byte: int, dark: int) -> Indices:
    """Return the index of the source of each byte, pixels x colours.

    Args:
        numbers: pixels of the strip.
        order: order of the colours on the wire; what is not red, green or blue has the source `dark`.
        first_byte: index of the strip's first byte.
        dark: index of a dark byte.
    """
    bytes_of_pixel = np.array([_COLORS.find(color) for color in order], dtype=np.intp)
    source: Indices = first_byte + 3 * numbers[:, None] + bytes_of_pixel
    source[:, bytes_of_pixel < 0] = dark
    return source


def _divide(target: Indices, colors: int, output: _Output) -> tuple[Indices, tuple[PixelBlock, ...]]:
    """Return the places of the pixels `target` where only blocks in use are kept, and these."""
    numbers, block_of = np.unique(target // output.block_pixels, return_inverse=True)
    counts = np.zeros(len(numbers), dtype=np.intp)
    within = target % output.block_pixels
    np.maximum.at(counts, block_of, within + 1)
    starts = np.cumsum(counts) - counts
    blocks: list[PixelBlock] = []
    for number, start, count in zip(numbers.tolist(), starts.tolist(), counts.tolist(), strict=True):
        block_number = output.first_block + number
        blocks.append(PixelBlock(block_number, start * colors, count * colors))
    return starts[block_of] + within, tuple(blocks)
