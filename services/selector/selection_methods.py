"""Selection methods by name: ours, and those of installed packages.

No core: it guards plug-ins and logs what they do wrong.
"""

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, Self, runtime_checkable

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.runtime.config.plugins import Plugin, PluginGroup
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import Announced, Cursor, Step, TrackedObject
from pointit.services.selector.seen_objects import View

MAX_DWELL_S = 10.0
"""Upper limit of the dwell time by any method, s."""

detached = Surroundings.detached
"""Returns the surroundings of a method for a person outside a site, such as in an evaluation."""


class PointingSample(NamedTuple):
    """One cursor of a person, later than the one before, and the objects that it is about."""

    cursor: Cursor
    """The cursor. Its `stamp_ns` is the only time that a method needs."""
    under: str | None
    """Object under the cursor by metres, or None. Methods by angle get it for cursors without a ray only."""
    view: View | None
    """Objects near the ray. None without a ray, without objects, or for methods by metres."""
    acts: Callable[[str], bool]
    """Returns True if staying on an object has an effect."""


class SelectionProgress(NamedTuple):
    """A method's result for one cursor."""

    object_id: str | None = None
    """Hovered object, or None."""
    progress: float = 0.0
    """Progress of that object towards its selection, 0 to 1."""
    fired: str | None = None
    """Object to select or deselect now, or None."""
    spent_s: float | None = None
    """Time that led to this progress, s. None: this share of the dwell time."""
    confidence: float | None = None
    """Probability that the object is meant. None: it is judged by the angles of those around it."""
    rival: str | None = None
    """Another object that is as probable although the person stays, of which they are told now, or None."""


NO_PROGRESS = SelectionProgress()
"""Result without an object, of most cursors. It is known by its identity, which saves its check."""


class PersonMethod(Protocol):
    """A method for one person. It decides from the stamps of the cursors.

    A new one is made when it must forget everything, since stamps went back or parameters changed.
    """

    @property
    def latched(self) -> Collection[str]:
        """Return the objects that fired or were latched, and were not left since. They do not fire again."""
        ...

    def step(self, pointing: PointingSample) -> SelectionProgress:
        """Process a cursor."""
        ...

    def latch(self, object_id: str) -> None:
        """Ignore `object_id` until it is left, since it was changed in another way."""
        ...


@runtime_checkable
class NameAwareMethod(Protocol):
    """A method that also uses the names that are spoken to the person."""

    def set_spoken(self, object_id: str, began_ns: int) -> None:
        """Set the hovered object if its name was spoken, else `""`, and the time at which it began, ns."""
        ...


class NameAnnouncer(Protocol):
    """Names that are spoken to one person, and the one that a press confirms. Cursors are its clock."""

    is_pressed: bool
    """The person selects by their button, not by staying."""

    @property
    def spoken(self) -> tuple[str, int]:
        """Return the arguments of `NameAwareMethod.set_spoken`."""
        ...

    def apply_focus(
        self, progress: SelectionProgress, cursor: Cursor, acts: Callable[[str], bool]
    ) -> SelectionProgress:
        """Return `progress` of the method, or that of an object to which the person stepped."""
        ...

    def step(self, objects: Iterable[TrackedObject], step: Step) -> tuple[str, int]:
        """Step to a neighbour, or to the nearest object. Return it, or `""`, and the time, ns."""
        ...

    def announce(self, object_id: str, label: str, stamp_ns: int) -> Announced | None:
        """Return the message that is due (about an object or `""`), or None. The first has no object."""
        ...

    def confirmed(self, press_ns: int) -> str:
        """Return the object that a press means, or `""`."""
        ...

    def is_silent(self, now_ns: int) -> bool:
        """Return True if something is announced although cursors have ended."""
        ...

    def forget(self) -> None:
        """Forget the pointing: the clock of its cursors was set back."""
        ...


class MethodConfig(Config):
    """Parameters of every selection method of an installed package."""

    dwell_s: float = Field(
        default=0.8, gt=0, le=MAX_DWELL_S, description="time on an object that selects it, s"
    )

    def with_dwell(self, dwell_s: float) -> Self:
        """Return the same parameters for another time on an object, s.

        Raises:
            ValueError: If it is impossible. The message gives the reason.
        """
        return self.model_copy(update={"dwell_s": dwell_s})


@dataclass(frozen=True, kw_only=True)
class SelectionMethod(Plugin):
    """A way to select an object by pointing at it, such as staying on it for a second, or pressing a button.

    It is a plug-in: `make` makes the method of one person, which gets their cursors and the objects near the
    ray, and says which object is hovered, how far its selection has come, and when it is claimed. Whether the
    claim is granted is the arbiter's decision. Its `config` is a `MethodConfig`. `examples/selection_method`
    is one as a package of its own.
    """

    make: Callable[[Any, Surroundings], PersonMethod]
    """Makes the method of one person with parameters of the class `config`."""
    by_angle: bool = False
    """True: it gets the objects near the ray and finds the hovered one itself, by its angle. False: it gets
    the object under the cursor, by metres."""
    announcer: Callable[[Any, str], NameAnnouncer | None] | None = None
    """Makes the announcer of a user with the same parameters, or None if no names are spoken to them."""


METHODS = PluginGroup("pointit.selection_methods", SelectionMethod, "selection method")
