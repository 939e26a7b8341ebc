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
from pointit.maps.model import LampEntry, MapFile
from pointit.maps.things import ROUNDED_M, broken_things, things_of
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
"""Start of a label that takes `MAX_SPOKEN_S`: all that is heard before the next name."""

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
    # First thing and label of each sound, and of each begin
    sounds: dict[str, tuple[str, str]] = {}
    begins: dict[str, tuple[str, str]] = {}
    slow: list[str] = []
    for thing in things:
        label = thing.label or thing.id
        words = spoken_words(label)
        duration_s = SYLLABLE_S * sum(map(syllable_count, words))
        if thing.label and duration_s > MAX_SPOKEN_S + 1e-9:
            slow.append(f"{label!r} ({duration_s:.1f} s)")

        # Both are noted before either is reported, so that later things are compared with this one
        sound = " ".join(sound_of(ALIKE.get(word, word)) for word in words)
        own = (thing.id, label)
        sound_id, sound_label = sounds.setdefault(sound, own) if sound else own
        begin = BEGIN.match(" ".join(words)) if thing.label else None
        begin_id, begin_label = own if begin is None else begins.setdefault(begin[0], own)

        if sound_id != thing.id and sound_label != label:
            text = f"{label!r} sounds like {sound_label!r} of {sound_id}; change one label"
            yield warning(f"things.{thing.id}", text)
        elif begin_id != thing.id and begin_label != label:
            text = (
                f"{label!r} begins for {MAX_SPOKEN_S:g} s as {begin_label!r} of {begin_id}; "
                "say first what differs"
            )
            yield warning(f"things.{thing.id}", text)
    if slow:
        limit = f"labels take longer than {MAX_SPOKEN_S:g} s to speak: {first_of(slow, NAMED)}"
        yield warning("things", f"{limit}; give shorter ones")


def spoken_words(label: str) -> list[str]:
    """Return the words of a label in small Latin letters without accents, numbers in English."""
    plain = unicodedata.normalize("NFKD", label).casefold()
    spelled = re.sub(r"[0-9]+", lambda digits: f" {_spelled(digits[0])} ", plain)
    letters = "".join(letter for letter in spelled if not unicodedata.combining(letter))
    return re.findall(r"[^\W_]+", letters)


def _spelled(digits: str) -> str:
    """Return the words of a number below 100; of others, as of `007`, those of its digits."""
    if len(digits) != 2 or digits[0] == "0":
        return " ".join(DIGITS[int(digit)] for digit in digits)
    tens, ones = map(int, digits)
    if tens == 1:
        return TEENS[ones]
    ones_word = DIGITS[ones] if ones else ""
    return f"{TENS[tens]} {ones_word}"


def syllable_count(word: str) -> int:
    """Return the approximate number of syllables: groups of vowels, without a silent e at the end."""
    groups = len(re.findall(r"[aeiouy]+", word))
    ends_with_silent_e = word.endswith("e") and not word.endswith("le")
    if ends_with_silent_e:
        groups -= 1
    return max(groups, 1)


def sound_of(word: str) -> str:
    """Return one letter for each sound of `word`. A single letter is spoken by its name."""
    if len(word) == 1:
        return word
    return re.sub(r"(.)\1+", r"\1", word.translate(LETTERS))


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
    yield from _check_unplaced(file)

    # Names, lights and places of each
    names: dict[str, str] = {}
    for thing in everything:
        twin = names.setdefault(thing.label or thing.id, thing.id)
        if twin != thing.id:
            yield warning(f"things.{thing.id}", f"is called as {twin} is; change one label")
    yield from _check_lights(everything)
    yield from _check_places(things, file, clouds)

    # Pairs that overlap, or are too close for pointing
    solids = [BoxSolid(thing.center_m, thing.size_m, thing.yaw_rad) for thing in things]
    for (inner, _), (outer, solid) in permutations(zip(things, solids, strict=True), 2):
        if solid.contains(inner.center_m):  # as is the case if more than half of it is inside
            yield warning(f"things.{inner.id}", f"lies in {outer.id}; move it, or make {outer.id} smaller")
    for x, y in places_m:
        yield from _check_confused(things, solids, (x, y, EYES_M))


def _check_unplaced(file: MapFile) -> Iterator[MapFinding]:
    """Yield one finding for all things without a place."""
    unplaced: list[str] = []
    for name, entry in file.things.items():
        has_place = bool(entry.center or entry.light or entry.at)
        if not has_place:
            unplaced.append(name)
    if unplaced:
        text = f"{first_of(unplaced, NAMED)}: without a position, nobody can point there"
        yield warning("things", f"{text}; place them by `pointit map point USER {unplaced[0]} --into MAP`")


def _check_lights(things: Sequence[Thing]) -> Iterator[MapFinding]:
    """Yield things with the light of another one: the same lamp, or a common part of a strip."""
    ends: dict[str, tuple[float, str]] = {}
    for thing in sorted(things, key=lambda thing: thing.part_m):
        light = thing.strip
        if not light and thing.lamp:
            light = f"lamp {thing.lamp}"
        if not light:
            continue
        start_m, end_m = thing.part_m
        previous_end_m, previous_id = ends.get(light, (-math.inf, ""))
        is_shared = bool(thing.lamp) or start_m < previous_end_m - ROUNDED_M
        if previous_id and is_shared:
            yield warning(
                f"things.{thing.id}", f"has the light of {previous_id}; give each a light of its own"
            )
        ends[light] = max((previous_end_m, previous_id), (end_m, thing.id))


def _check_places(
    things: Sequence[Thing], file: MapFile, clouds: Mapping[str, NDArray[np.float64]]
) -> Iterator[MapFinding]:
    """Yield things below the floor, and those far from all else."""
    # Extent of all else but things, empty if there is nothing
    places = line_places(file)
    for solids in (file.boxes, file.planes, file.cylinders, file.spheres):
        places += [solid.center for solid in solids.values()]
    for fence in file.fences.values():
        places += [(x, y, 0.0) for x, y in fence.outline]
    corners: list[NDArray[np.float64]] = []
    for points in clouds.values():
        corners += (points.min(axis=0), points.max(axis=0))
    room = np.array([*places, *corners]).reshape(-1, 3)
    if len(room):
        room = np.array([room.min(axis=0), room.max(axis=0)])

    centers = np.array([thing.center_m for thing in things])
    for index, (thing, center) in enumerate(zip(things, centers, strict=True)):
        where = f"things.{thing.id}"
        half_m = thing.size_m[2] / 2.0
        top_m = thing.center_m[2] + half_m
        below_m = half_m - thing.center_m[2]
        if top_m <= 0.0:
            yield error(where, f"ends {-top_m:g} m below the floor; correct its center")
        elif below_m > FLOOR_M:
            yield warning(where, f"reaches {below_m:.2g} m below the floor; correct its center or size")
        others = np.vstack([room, np.delete(centers, index, axis=0)])
        if not len(others):
            continue
        below_low = others.min(axis=0) - center
        above_high = center - others.max(axis=0)
        offsets = np.maximum(below_low, above_high)
        beyond_m = float(offsets.max())
        if beyond_m > BEYOND_M:
            yield warning(where, f"is {beyond_m:.1f} m outside of all else in the map; correct its center")


def line_places(file: MapFile) -> list[Vec3]:
    """Return the places of lamps, strips and belts."""
    places = [lamp.position for lamp in file.lamps.values()]
    for strip in file.strips.values():
        places += strip.line
    for belt in file.belts.values():
        places += belt.centerline
    return places


def _check_confused(
    things: Sequence[Thing], solids: Sequence[BoxSolid], eyes_m: Vec3
) -> Iterator[MapFinding]:
    """Yield the pairs of things that pointing does not tell apart from `eyes_m`, the nearest first."""
    near: list[tuple[float, str, str]] = []
    for one, other in _close_pairs(things, eyes_m):
        start_m = things[one].center_m
        apart_deg = _apart_deg(solids[one], solids[other], start_m, eyes_m)
        if apart_deg < APART_DEG:
            near.append((apart_deg, things[one].id, things[other].id))
    near.sort()
    place = f"{eyes_m[0]:g},{eyes_m[1]:g}"
    for apart_deg, name, other_name in near[:NAMED]:
        yield warning(
            f"things.{name}",
            f"is {apart_deg:.0f}° beside {other_name} as seen from {place}: people need light to tell them "
            "apart; move one, or let people stand nearer",
        )
    remaining = len(near) - NAMED
    if remaining > 0:
        yield warning("things", f"{remaining} more pairs are as near as seen from {place}; stand nearer")


def confusions(things: Sequence[Thing]) -> Callable[[float, float], list[tuple[int, int]]]:
    """Return a function of a place (x, y) of a person: pairs of things that pointing does not tell apart.

    Pairs are of indices. Each thing that is not told apart from another is in a pair. Further pairs of
    such things are left out.

    Raises:
        ConfigError: If there are no things.
    """
    if not things:
        raise ConfigError("the map has no things that could be told apart; add a section `things`")

    # Solids keep their outlines as seen from a place, so that they are made once for all places
    solids = [BoxSolid(thing.center_m, thing.size_m, thing.yaw_rad) for thing in things]

    def pairs(x: float, y: float) -> list[tuple[int, int]]:
        eyes_m = (x, y, EYES_M)
        confused = set[int]()
        confused_pairs = list[tuple[int, int]]()
        for one, other in _close_pairs(things, eyes_m):
            if {one, other} <= confused:  # a further pair of theirs, which is slow to measure
                continue
            start_m = things[one].center_m
            if _apart_deg(solids[one], solids[other], start_m, eyes_m, APART_DEG) < APART_DEG:
                confused |= {one, other}
                confused_pairs.append((one, other))
        return confused_pairs

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
        confused = chain(*pairs(x, y))
        uncovered = uncovered_things(paced_from, things, x, y)
        unclear = {*confused, *uncovered}
        return 1.0 - len(unclear) / len(things)

    return share


def _close_pairs(things: Sequence[Thing], eyes_m: Vec3) -> Iterator[tuple[int, int]]:
    """Yield pairs that may be as near to each other, by the balls around them."""
    centers_m = np.array([thing.center_m for thing in things]).reshape(-1, 3)
    sizes_m = np.array([thing.size_m for thing in things]).reshape(-1, 3)
    reach = centers_m - eyes_m
    range_m = np.linalg.norm(reach, axis=1) + 1e-9
    radii_m = np.linalg.norm(sizes_m, axis=1) / 2.0
    radii_rad = np.arctan(radii_m / range_m)
    towards = reach / range_m[:, None]
    for one in range(len(things)):
        later = one + 1
        cosines = towards[later:] @ towards[one]
        angles = np.arccos(np.clip(cosines, -1.0, 1.0))
        gaps = angles - radii_rad[later:] - radii_rad[one]
        is_close = gaps < math.radians(APART_DEG)
        for other in np.flatnonzero(is_close):
            yield one, later + int(other)


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
    # Heights
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

    # Lamps too few or too close to one another for a pose
    for index, other in _lamps_at_one_place(places):
        yield error(
            f"lamps.{names[index]}",
            f"is where {names[other]} is, {places[index].tolist()}; correct one of them",
        )
    if is_home and not lamps:
        return
    if len(lamps) < 2:
        count_text = "there is one lamp" if lamps else "there are no lamps"
        yield warning(
            "lamps",
            f"{count_text} and localizing by pointing needs two; add lamps, or say where people stand",
        )
    elif _have_one_bearing([lamp.position for lamp in lamps.values()], person_m):
        arrangement = "one above the other"
        if person_m is not None:
            arrangement = f"in one direction from {list(person_m)}"
        yield error("lamps", f"all lie {arrangement}, which determines no position; move one of them aside")


def _lamps_at_one_place(places: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return pairs of a lamp and an earlier one where it is, at most one a lamp."""
    # Exactly at one place
    distinct, first, inverse = np.unique(places, axis=0, return_index=True, return_inverse=True)
    earlier = first[inverse.reshape(-1)]
    twins: dict[int, int] = {}
    for index in np.flatnonzero(earlier != np.arange(len(places))):
        twins[int(index)] = int(earlier[index])

    # Nearly so
    if len(distinct) > 1:
        from scipy.spatial import KDTree  # noqa: PLC0415 - the page loads this module

        distances, neighbours = KDTree(distinct).query(distinct, k=[2])  # the first one is the lamp itself
        distances_m = np.asarray(distances).reshape(-1)
        neighbour_of = np.asarray(neighbours).reshape(-1)
        for row in np.flatnonzero(distances_m < SAME_PLACE_M):
            neighbour = int(neighbour_of[row])
            pair = (int(first[row]), int(first[neighbour]))
            twins.setdefault(max(pair), min(pair))
    return sorted(twins.items())


def _have_one_bearing(places: Sequence[Vec3], person_m: tuple[float, float] | None) -> bool:
    flat = np.array(places)[:, :2]
    if person_m is None:
        distances_m = np.linalg.norm(flat - flat[0], axis=1)
        return bool(distances_m.max() < ONE_BEARING_M)
    east, north = (flat - person_m).T
    bearings = np.arctan2(north, east)
    phasors = np.exp(1j * (bearings - bearings[0]))
    turns = np.angle(phasors)
    apart_deg = np.degrees(np.abs(turns))
    return bool(apart_deg.max() < MIN_SPREAD_DEG)
