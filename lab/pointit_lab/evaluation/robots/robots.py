"""Evaluation of robots: flights of simulated people, distributed over processes."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from typing import Any

from pointit_lab.evaluation.recordings.parallel import map_parallel
from pointit_lab.evaluation.recordings.row import Row
from pointit_lab.evaluation.robots.choice import Reliability
from pointit_lab.evaluation.robots.flight import FlightScore, fly
from pointit_lab.evaluation.robots.flight_row import FlightRow, flight_row
from pointit_lab.evaluation.robots.flight_setup import Flight, FlightCondition, flight_of
from pointit_lab.evaluation.robots.following import of_every_set
from pointit_lab.evaluation.robots.identification import Rate

CHUNK = 4
"""Maximum of flights in one piece of work."""


def flight_rows(
    conditions: Sequence[FlightCondition],
    *,
    people: int,
    seed: int,
    jobs: int,
    tick: Callable[[int, int], None],
) -> list[FlightRow]:
    """Return the results of simulated people by condition.

    Args:
        conditions: conditions to evaluate.
        people: number of people in each, one flight a person.
        seed: seed of the first person, incremented for each.
        jobs: number of processes; 1: this one alone.
        tick: called with the number of finished flights and of all.

    Raises:
        PointItError: If a process ended unexpectedly.
    """
    flights = [flight_of(condition, seed + number) for condition in conditions for number in range(people)]
    pieces = [flights[first : first + CHUNK] for first in range(0, len(flights), CHUNK)]
    results: dict[int, list[FlightScore]] = {}
    done = 0
    tick(done, len(flights))
    for number, scores in _worked(pieces, jobs):
        results[number] = scores
        done += len(scores)
        tick(done, len(flights))
    groups: dict[FlightCondition, list[FlightScore]] = defaultdict(list)
    for number, piece in enumerate(pieces):
        for flight, score in zip(piece, results[number], strict=True):
            groups[flight.condition].append(score)
    return [flight_row(condition, scores) for condition, scores in groups.items()]


def document(
    flights: Sequence[FlightRow],
    identified: Sequence[Rate],
    following: Sequence[Row],
    chosen: Sequence[Reliability],
) -> dict[str, Any]:
    """Return the document for `--json FILE`."""
    return {
        "flights": [row.as_json() for row in flights],
        "identification": [rate.as_json() for rate in identified],
        "choice": [asdict(row) for row in chosen],
        "following": [row.as_json() for row in following],
        "following_over_people": [row.as_json() for row in of_every_set(following)],
    }


def flown(flights: Sequence[Flight]) -> list[FlightScore]:
    """Return the scores of `flights`. Runs in other processes."""
    return [fly(flight) for flight in flights]


def _worked(flights: Sequence[Sequence[Flight]], jobs: int) -> Iterator[tuple[int, list[FlightScore]]]:
    if jobs > 1:
        yield from map_parallel(flown, flights, jobs)
    else:
        for number, piece in enumerate(flights):
            yield number, flown(piece)
