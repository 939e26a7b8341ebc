"""Checks of things, lamps and their labels: places, lights, spoken names."""

import math
import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain, permutations

import numpy as np
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.solids import BoxSolid
from pointit.geometry.vector import Vec3
from pointit.maps.checks.finding import MapFinding, error, warning
from pointit.maps.checks.pacing import uncovered_things
from pointit.maps.model import ROUNDED_M, LampEntry, MapFile, broken_things, things_of
from pointit.runtime.errors import ConfigError
from pointit.schemas import Thing
from pointit.schemas.environment import PacedPlace
from pointit.schemas.text import first_of

SYLLABLE_S = 0.2
"""Time of one spoken syllable, s: synthesizers say four to five a second."""
MAX_SPOKEN_S = 0.6
"""Time above which a name is slow to point by, s."""
LETTERS = str.maketrans(
    {
        **dict.fromkeys("aeiouyhw", "a"),
        **dict.fromkeys("bpfv", "p"),
        **dict.fromkeys("dt", "t"),
        **dict.fromkeys("cgkqjx", "k"),
        **dict.fromkeys("sz", "s"),
        **dict.fromkeys("mn", "n"),
        **dict.fromkeys("lr", "l"),
    }
)
"""Letters whose sounds are mistaken for each other, by the groups of Soundex."""
NAMED = 10
"""Number of slow labels that are named."""
DIGITS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
TEENS = (
    *("ten", "eleven", "twelve", "thirteen", "fourteen", "fifteen"),
    *("sixteen", "seventeen", "eighteen", "nineteen"),
)
TENS = ("", "", "twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety")
ALIKE = {word: DIGITS[index] for words in (TEENS, TENS) for index, word in enumerate(words) if index and word}
"""Numbers that are taken for one below ten: `fifteen` and `fifty` for `five`, `eleven` for `one`."""
BEGIN = re.compile(r"(?:[^aeiouy]*[aeiouy]+){3}")
"""Begin of a label that takes `MAX_SPOKEN_S`: all that is heard before the next name."""

EYES_M = 1.64
"""Height of the eyes of a person of 1.76 m, m."""
APART_DEG = 5.0
"""Angle between two things, edge to edge, below which pointing alone does not tell which one is meant."""
TESTED = 200
"""Number of things up to which pointing at them is measured."""
FLOOR_M = 0.01
BEYOND_M = 3.0
"""Distance from all else in the map above which a thing is probably misplaced."""

LAMP_FLOOR_M = 0.0
HIGHEST_LAMP_M = 5.0
SAME_PLACE_M = 0.01
ONE_BEARING_M = 0.2
"""Width of a column of lamps that has the same bearing from everywhere, m."""
MIN_SPREAD_DEG = 5.0


def check_labels(things: Sequence[Thing]) -> Iterator[MapFinding]:
    """Yield labels that sound or begin alike, and one finding for those that take long to speak.

    Equal labels are left out, since `check_things` reports them; so are ids that are too long.
    """
    sounds: dict[str, tuple[str, str]] = {}
    begins: dict[str, tuple[str, str]] = {}
    slow: list[str] = []
    for thing in things:
        label = thing.label or thing.id
        words = spoken_words(label)
        duration_s = SYLLABLE_S * sum(map(syllable_count, words))
        if thing.label and duration_s > MAX_SPOKEN_S + 1e-9:
            slow.append(f"{label!r} ({duration_s:.1f} s)")
        sound = " ".join(sound_of(ALIKE.get(word, word)) for word in words)
        begin = BEGIN.match(" ".join(words)) if thing.label else None
        first, same = (thing.id, label) if begin is None else begins.setdefault(begin[0], (thing.id, label))
        duplicate, other = sounds.setdefault(sound, (thing.id, label)) if sound else (thing.id, label)
        if duplicate != thing.id and other != label:
            text = f"{label!r} sounds like {other!r} of {duplicate}; change one label"
            yield warning(f"things.{thing.id}", text)
        elif first != thing.id and same != label:
            text = f"{label!r} begins for {MAX_SPOKEN_S:g} s as {same!r} of {first}; say first what differs"
            yield warning(f"things.{thing.id}", text)
    if slow:
        limit = f"labels take longer than {MAX_SPOKEN_S:g} s to speak: {first_of(slow, NAMED)}"
        yield warning("things", f"{limit}; give shorter ones")


def spoken_words(label: str) -> list[str]:
    """Return the words of a label in small Latin letters without accents, numbers in English."""
    plain = unicodedata.normalize("NFKD", label).casefold()
    spelled = re.sub(r"[0-9]+", lambda digits: f" {_spelled(digits[0])} ", plain)
    letters = "".join(each for each in spelled if not unicodedata.combining(each))
    return re.findall(r"[^\W_]+", letters)


def _spelled(digits: str) -> str:
    """Return the words of a number below 100; of others, as of `007`, those of its digits."""
    if len(digits) != 2 or digits[0] == "0":
        return " ".join(DIGITS[int(digit)] for digit in digits)
    tens, ones = map(int, digits)
    return TEENS[ones] if tens == 1 else f"{TENS[tens]} {DIGITS[ones] if ones else ''}"


def syllable_count(word: str) -> int:
    """Return the approximate number of syllables: groups of vowels, without a silent e at the end."""
    groups = len(re.findall(r"[aeiouy]+", word))
    is_silent = word.endswith("e") and not word.endswith("le") and groups > 1
    return max(groups - is_silent, 1)


def sound_of(word: str) -> str:
    """Return one letter for each sound of `word`. A single letter is spoken by its name."""
    return word if len(word) == 1 else re.sub(r"(.)\1+", r"\1", word.translate(LETTERS))


def check_things(
    file: MapFile, clouds: Mapping[str, NDArray[np.float64]], places_m: Sequence[tuple[float, float]]
) -> Iterator[MapFinding]:
    """Yield problems of things, and those that are hard to tell apart as seen from each of `places_m`."""
    if not file.things or any(broken_things(file)):
        return
    everything = things_of(file)
    things = [thing for thing in everything if not thing.is_tracked]
    if len(things) > TESTED:
        text = f"are {len(things)}, tested are up to {TESTED}; leave out what nobody points at"
        yield warning("things", text)
    unplaced = [name for name, each in file.things.items() if not (each.center or each.light or each.at)]
    if unplaced:
        text = f"{first_of(unplaced, NAMED)}: without a position, nobody can point there"
        yield warning("things", f"{text}; place them by `pointit map point USER {unplaced[0]} --into MAP`")
    names: dict[str, str] = {}
    for thing in everything:
        if (twin := names.setdefault(thing.label or thing.id, thing.id)) != thing.id:
            yield warning(f"things.{thing.id}", f"is called as {twin} is; change one label")
    yield from _check_lights(everything)
    yield from _check_places(things, file, clouds)
    solids = [BoxSolid(thing.center_m, thing.size_m, thing.yaw_rad) for thing in things]
    for (inner, _), (outer, solid) in permutations(zip(things, solids, strict=True), 2):
        if solid.contains(inner.center_m):  # as is the case if more than half of it is inside
            yield warning(f"things.{inner.id}", f"lies in {outer.id}; move it, or make {outer.id} smaller")
    for x, y in places_m:
        yield from _confused(things, solids, (x, y, EYES_M))


def _check_lights(things: Sequence[Thing]) -> Iterator[MapFinding]:
    until: dict[str, tuple[float, str]] = {}
    for thing in sorted(things, key=lambda each: each.part_m):
        if light := thing.strip or (thing.lamp and f"lamp {thing.lamp}"):
            until_m, other = until.get(light, (-math.inf, ""))
            if other and (thing.lamp or thing.part_m[0] < until_m - ROUNDED_M):
                yield warning(f"things.{thing.id}", f"has the light of {other}; give each a light of its own")
            until[light] = max((until_m, other), (thing.part_m[1], thing.id))


def _check_places(
    things: Sequence[Thing], file: MapFile, clouds: Mapping[str, NDArray[np.float64]]
) -> Iterator[MapFinding]:
    places = line_places(file)
    for solids in (file.boxes, file.planes, file.cylinders, file.spheres):
        places += [solid.center for solid in solids.values()]
    places += [(x, y, 0.0) for fence in file.fences.values() for x, y in fence.outline]
    corners = [corner for points in clouds.values() for corner in (points.min(axis=0), points.max(axis=0))]
    room = np.array([*places, *corners]).reshape(-1, 3)
    room = np.array([room.min(axis=0), room.max(axis=0)]) if len(room) else room
    centers = np.array([thing.center_m for thing in things])
    for index, (thing, center) in enumerate(zip(things, centers, strict=True)):
        where = f"things.{thing.id}"
        half_m = thing.size_m[2] / 2.0
        if (top_m := thing.center_m[2] + half_m) <= 0.0:
            yield error(where, f"ends {-top_m:g} m below the floor; correct its center")
        elif (below_m := half_m - thing.center_m[2]) > FLOOR_M:
            yield warning(where, f"reaches {below_m:.2g} m below the floor; correct its center or size")
        if not len(rest := np.vstack([room, np.delete(centers, index, axis=0)])):
            continue
        beyond_m = float(np.maximum(rest.min(axis=0) - center, center - rest.max(axis=0)).max())
        if beyond_m > BEYOND_M:
            yield warning(where, f"is {beyond_m:.1f} m outside of all else in the map; correct its center")


def line_places(file: MapFile) -> list[Vec3]:
    """Return the places of lamps, strips and belts."""
    places = [lamp.position for lamp in file.lamps.values()]
    places += [place for strip in file.strips.values() for place in strip.line]
    return places + [place for belt in file.belts.values() for place in belt.centerline]


def _confused(things: Sequence[Thing], solids: Sequence[BoxSolid], eyes_m: Vec3) -> Iterator[MapFinding]:
    near = sorted(
        (apart_deg, things[one].id, things[other].id)
        for one, other in _near(things, eyes_m)
        if (apart_deg := _apart_deg(solids[one], solids[other], things[one].center_m, eyes_m)) < APART_DEG
    )
    place = f"{eyes_m[0]:g},{eyes_m[1]:g}"
    for apart_deg, name, other_name in near[:NAMED]:
        yield warning(
            f"things.{name}",
            f"is {apart_deg:.0f}° beside {other_name} as seen from {place}: people need light to tell them "
            "apart; move one, or let people stand nearer",
        )
    if (more := len(near) - NAMED) > 0:
        yield warning("things", f"{more} more pairs are as near as seen from {place}; stand nearer")


def confusions(things: Sequence[Thing]) -> Callable[[float, float], list[tuple[int, int]]]:
    """Return a function of a place (x, y) of a person: pairs of things that pointing does not tell apart.

    Pairs are of indices. Each thing that is not told apart from another is in a pair. Further pairs of
    such things are left out.

    Raises:
        ConfigError: If there are no things.
    """
    if not things:
        raise ConfigError("the map has no things that could be told apart; add a section `things`")
    solids = [BoxSolid(thing.center_m, thing.size_m, thing.yaw_rad) for thing in things]

    def pairs(x: float, y: float) -> list[tuple[int, int]]:
        eyes_m = (x, y, EYES_M)
        confused = set[int]()
        found = list[tuple[int, int]]()
        for one, other in _near(things, eyes_m):
            if not {one, other} <= confused:
                start_m = things[one].center_m
                if _apart_deg(solids[one], solids[other], start_m, eyes_m, APART_DEG) < APART_DEG:
                    confused |= {one, other}
                    found.append((one, other))
        return found

    return pairs


def separability(
    things: Sequence[Thing], paced_from: Sequence[PacedPlace] = ()
) -> Callable[[float, float], float]:
    """Return a function of a place (x, y) of a person: the share of things that pointing alone tells apart.

    Things to which a map `paced_from` places knows no direction from (x, y) are not told apart.

    Raises:
        ConfigError: If there are no things.
    """
    pairs = confusions(things)

    def share(x: float, y: float) -> float:
        unclear = {*chain(*pairs(x, y)), *uncovered_things(paced_from, things, x, y)}
        return 1.0 - len(unclear) / len(things)

    return share


def _near(things: Sequence[Thing], eyes_m: Vec3) -> Iterator[tuple[int, int]]:
    """Yield pairs that may be as near to each other, by the balls around them."""
    reach = np.array([thing.center_m for thing in things]).reshape(-1, 3) - eyes_m
    range_m = np.linalg.norm(reach, axis=1) + 1e-9
    sizes_m = np.array([thing.size_m for thing in things]).reshape(-1, 3)
    halves = np.arctan(np.linalg.norm(sizes_m, axis=1) / 2.0 / range_m)
    towards = reach / range_m[:, None]
    for one in range(len(things)):
        angles = np.arccos(np.clip(towards[one + 1 :] @ towards[one], -1.0, 1.0))
        close = angles - halves[one + 1 :] - halves[one] < math.radians(APART_DEG)
        yield from ((one, one + 1 + int(other)) for other in np.flatnonzero(close))


def _apart_deg(one: BoxSolid, other: BoxSolid, start_m: Vec3, eyes_m: Vec3, enough_deg: float = 0.0) -> float:
    """Return the angle from edge to edge, as seen from `eyes_m`, 0 if they overlap.

    The nearest point of one to the other is found in turns, from `start_m` on, each nearer than the one
    before. The search ends below `enough_deg`.
    """
    if one.contains(eyes_m) or other.contains(eyes_m):
        return 0.0
    point_m = start_m
    apart_rad = 0.0
    for solid in (other, one) * 4:
        towards = vector.normalized(vector.subtract(point_m, eyes_m))
        if solid.intersect(eyes_m, towards) is not None:
            return 0.0
        point_m = solid.closest_approach(eyes_m, towards)
        apart_rad = vector.angle_between(towards, vector.subtract(point_m, eyes_m))
        if apart_rad < math.radians(enough_deg):
            break
    return math.degrees(apart_rad)


def check_lamps(
    lamps: Mapping[str, LampEntry],
    person_m: tuple[float, float] | None,
    *,
    has_heights: bool = True,
    is_home: bool = False,
) -> Iterator[MapFinding]:
    """Yield problems of lamps, as seen from `person_m`, or from anywhere if it is None.

    Without `has_heights` heights are not compared with those of a room. A home (`is_home`) may do without
    lamps: people say where they stand, and its lights are things.
    """
    names = list(lamps)
    places = np.array([lamp.position for lamp in lamps.values()]).reshape(-1, 3)
    for name, z in zip(names, places[:, 2].tolist(), strict=True):
        if z < LAMP_FLOOR_M:
            yield error(f"lamps.{name}", f"is {-z:g} m below the floor; correct its z")
        elif z > HIGHEST_LAMP_M and has_heights:
            yield warning(
                f"lamps.{name}",
                f"is {z:g} m high, where pointing is difficult; mount it below {HIGHEST_LAMP_M:g} m",
            )
    for index, other in _at_one_place(places):
        yield error(
            f"lamps.{names[index]}",
            f"is where {names[other]} is, {places[index].tolist()}; correct one of them",
        )
    if is_home and not lamps:
        return
    if len(lamps) < 2:
        yield warning(
            "lamps",
            f"{'there is one lamp' if lamps else 'there are no lamps'} and localizing by pointing needs two; "
            "add lamps, or say where people stand",
        )
    elif _one_bearing([lamp.position for lamp in lamps.values()], person_m):
        seen = "one above the other" if person_m is None else f"in one direction from {list(person_m)}"
        yield error("lamps", f"all lie {seen}, which determines no position; move one of them aside")


def _at_one_place(places: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return pairs of a lamp and an earlier one where it is, at most one a lamp."""
    distinct, first, inverse = np.unique(places, axis=0, return_index=True, return_inverse=True)
    earlier = first[inverse.reshape(-1)]
    found = {int(index): int(earlier[index]) for index in np.flatnonzero(earlier != np.arange(len(places)))}
    if len(distinct) > 1:
        from scipy.spatial import KDTree  # noqa: PLC0415 - the page loads this module

        nearest = KDTree(distinct).query(distinct, k=[2])  # the first one is the lamp itself
        away_m, near = (np.asarray(each).reshape(-1) for each in nearest)
        for row in np.flatnonzero(away_m < SAME_PLACE_M):
            pair = sorted((int(first[row]), int(first[int(near[row])])))
            found.setdefault(pair[1], pair[0])
    return sorted(found.items())


def _one_bearing(places: Sequence[Vec3], person_m: tuple[float, float] | None) -> bool:
    flat = np.array(places)[:, :2]
    if person_m is None:
        return bool(np.linalg.norm(flat - flat[0], axis=1).max() < ONE_BEARING_M)
    bearings = np.arctan2(*(flat - person_m).T[::-1])
    apart = np.degrees(np.abs(np.angle(np.exp(1j * (bearings - bearings[0])))))
    return bool(apart.max() < MIN_SPREAD_DEG)
