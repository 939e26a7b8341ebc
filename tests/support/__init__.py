"""Builders and benches that tests share; a package of its own, because nothing imports from a conftest."""

from typing import TypeVar

T = TypeVar("T")


def there(value: T | None) -> T:
    """Return `value`, which is expected not to be None."""
    assert value is not None
    return value
