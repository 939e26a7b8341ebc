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
    first_row = list(range(conditions))
    if order == "latin_square":
        return _shifted_rows(first_row)
    if order != "williams":
        return [tuple(first_row)]

    # 0, 1, n - 1, 2, n - 2 …: all differences of neighbours occur once.
    first_row = [0]
    for step in range(1, conditions):
        first_row.append((step + 1) // 2 if step % 2 else conditions - step // 2)
    rows = _shifted_rows(first_row)
    if conditions == 1 or conditions % 2 == 0:
        return rows
    return rows + [row[::-1] for row in rows]


def _shifted_rows(first_row: Sequence[int]) -> list[tuple[int, ...]]:
    """Return the rows that follow from the first one by adding 1 to each condition, again and again."""
    conditions = len(first_row)
    rows: list[tuple[int, ...]] = []
    for shift in range(conditions):
        rows.append(tuple((shift + condition) % conditions for condition in first_row))
    return rows


def imbalance(orders: Sequence[Sequence[str]], order: Order) -> str:
    """Return an error message if `orders`, one a participant, are not balanced by `order`, else `""`."""
    if order not in ("latin_square", "williams") or not orders:
        return ""
    conditions = sorted(set[str]().union(*orders))

    # Each condition at each position as often as any other.
    position_counts: Counter[tuple[str, int]] = Counter()
    for row in orders:
        position_counts.update((name, place) for place, name in enumerate(row))
    positions = list(itertools.product(conditions, range(len(conditions))))
    counts = {position_counts[position] for position in positions}
    if len(counts) > 1:
        rarest = min(positions, key=position_counts.__getitem__)
        name, place = rarest
        count = position_counts[rarest]
        return f"{name} comes {count} times at position {place + 1}, others {max(counts)} times"
    if order != "williams":
        return ""

    # Each condition after each other one as often as any pair.
    pair_counts: Counter[tuple[str, str]] = Counter()
    for row in orders:
        pair_counts.update(itertools.pairwise(row))
    pairs = list(itertools.permutations(conditions, 2))
    if len({pair_counts[pair] for pair in pairs}) > 1:
        first, second = min(pairs, key=pair_counts.__getitem__)
        count = pair_counts[first, second]
        return f"{second} follows {first} {count} times, other pairs {max(pair_counts.values())} times"
    return ""
