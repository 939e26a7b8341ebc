"""The keys below which permissions are tested. The access rules allow them and the self-test writes them."""

ROOM = "@may"
"""The part of a key that stands before the identity and the permission under test."""

VERBS = ("writes", "reads", "serves", "asks")
"""The permissions."""

JOIN = "joins"
"""What every identity with any right may write below `ROOM`."""
