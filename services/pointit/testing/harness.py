"""Harness of a plug-in of any kind, given by its author, with which it can be checked."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from pointit.plugins import Plugin

P = TypeVar("P", bound=Plugin)


@dataclass(frozen=True, kw_only=True)
class Harness(Generic[P]):
    """A plug-in, and what its checks must know about it."""

    plugin: P
    wrong_parameters: tuple[Mapping[str, object], ...] = ()
    """Parameters that the plug-in must refuse."""
    virtual_time: bool = False
    """True if plug-in and device wait for timers of the event loop alone: checks then take no time."""
    patience_s: float = 10.0
    """Time that the plug-in may take to start, to connect, to notice a loss, and to warn, s."""
