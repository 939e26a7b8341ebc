"""Orders of conditions: squares, and whether the orders of all participants are balanced."""

import itertools
from collections import Counter
from collections.abc import Sequence
from typing import Literal

Order = Literal["latin_square", "williams", "blocked_random", "as_written"]


def square(order: Order, conditions: int) -> list[tuple[int, ...]]:
    """Return the rows of the square of `order`, each a permutation of 0 to `conditions` - 1.

    `latin_square`: each condition once at each position. `williams`: also each before each other one equally
    often (Williams 1949), in two squares if their number is odd. Others: one row, as written.
    """
    if order == "latin_square":
        return [
            tuple((row + column) % conditions for column in range(conditions)) for row in range(conditions)
        ]
    if order != "williams":
        return [tuple(range(conditions))]
    first = [0]
    first += [(step + 1) // 2 if step % 2 else conditions - step // 2 for step in range(1, conditions)]
    rows = [tuple((row + column) % conditions for column in first) for row in range(conditions)]
    return rows if conditions == 1 or conditions % 2 == 0 else rows + [row[::-1] for row in rows]


def imbalance(orders: Sequence[Sequence[str]], order: Order) -> str:
    """Return an error message if `orders`, one a participant, are not balanced by `order`, else `""`."""
    if order not in ("latin_square", "williams") or not orders:
        return ""
    conditions = sorted({name for row in orders for name in row})
    positions = Counter((name, place) for row in orders for place, name in enumerate(row))
    counts = {positions[name, place] for name in conditions for place in range(len(conditions))}
    if len(counts) > 1:
        name, place = min(
            ((name, place) for name in conditions for place in range(len(conditions))),
            key=positions.__getitem__,
        )
        return (
            f"{name} comes {positions[name, place]} times at position {place + 1}, others {max(counts)} times"
        )
    followers = Counter(pair for row in orders for pair in itertools.pairwise(row))
    pairs = [(one, other) for one in conditions for other in conditions if one != other]
    if order == "williams" and len({followers[pair] for pair in pairs}) > 1:
        one, other = min(pairs, key=followers.__getitem__)
        max_followers = max(followers.values())
        return f"{other} follows {one} {followers[one, other]} times, other pairs {max_followers} times"
    return ""
