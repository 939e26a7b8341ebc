"""The keys below which permissions are tested. The access rules allow them and the self-test writes them."""

ROOM = "@may"
"""The part of a key that stands before the identity and the permission under test."""

VERBS = ("writes", "reads", "serves", "asks")
"""The permissions."""

JOIN = "joins"
"""Permission to join, granted below `ROOM` to every identity with any right."""
