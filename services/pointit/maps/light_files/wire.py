"""Numbers of pixels on the wire, where the strips of a map are one behind the other, or at their offsets."""

from collections.abc import Iterator, Mapping
from itertools import pairwise

from pointit.maps.model import StripEntry


def first_pixels(strips: Mapping[str, StripEntry]) -> dict[str, int]:
    """Return the number on the wire of the first pixel of each strip."""
    firsts: dict[str, int] = {}
    end = 0
    for name, strip in strips.items():
        firsts[name] = end if strip.offset is None else strip.offset
        end = firsts[name] + strip.pixels
    return firsts


def unused_pixels(strips: Mapping[str, StripEntry]) -> Iterator[tuple[int, int]]:
    """Yield first and last of the pixels of the wire that are in no strip, before or between others."""
    end = 0
    for first, name in sorted((first, name) for name, first in first_pixels(strips).items()):
        if first > end:
            yield end, first - 1
        end = max(end, first + strips[name].pixels)


def shared_pixels(strips: Mapping[str, StripEntry]) -> Iterator[tuple[str, str]]:
    """Yield pairs of strips with common pixels of the wire, the later one first.

    There are none unless a strip has an offset.
    """
    if all(strip.offset is None for strip in strips.values()):
        return
    firsts = first_pixels(strips)
    ordered = sorted((first, first + strips[name].pixels, name) for name, first in firsts.items())
    longest = ordered[0]
    for before, (first, end, name) in pairwise(ordered):
        longest = max(longest, before, key=lambda each: each[1])
        if first < longest[1]:
            yield name, longest[2]
        longest = max(longest, (first, end, name), key=lambda each: each[1])
