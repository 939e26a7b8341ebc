"""A trial of a plan."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One trial of a plan."""

    number: int
    """In the plan of the participant, from 1."""
    block: int
    """From 1."""
    place: int
    """In its block, from 0."""
    practice: bool
    cell: dict[str, str]
    """Level by factor, of all factors."""
    seed: int
