"""The home to which lamps belong, as the bridge uses it: a Home Assistant, or an MQTT broker alone."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, TypeGuard, cast

from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.runtime.errors import PointItError, RefusedError

BROKER_CODE = "broker"
"""Code of an error whose sentence says all there is to say."""


class NoHomeAssistantError(PointItError):
    """There is no Home Assistant or broker at the address, or it is gone."""


class ActionRefusedError(RefusedError):
    """The home does not carry out a command. `code`: its kind, such as `unauthorized`."""

    def __init__(self, text: str, code: str) -> None:
        """Use the sentence and the code of the home."""
        super().__init__(text)
        self.code = code


@dataclass(frozen=True, kw_only=True)
class HomeWords:
    """Parts of sentences about entities, which differ for what has them.

    Attributes:
        name: of the home, as the subject of a sentence.
        place: where its entities are: `in Home Assistant`.
        starting: sentence while it does not know all its entities yet.
        remedy: what to do for an entity that is unavailable.
        silence: end of the sentence on one that says nothing after the login.
    """

    name: str
    place: str
    starting: str
    remedy: str
    silence: str

    @classmethod
    def of_home_assistant(cls) -> Self:
        """Return the words for a Home Assistant."""
        return cls(
            name="Home Assistant",
            place="in Home Assistant",
            starting="Home Assistant is still starting: wait",
            remedy="look into its integration there",
            silence="accepts the token but then does not answer: restart Home Assistant",
        )

    @classmethod
    def of_broker(cls) -> Self:
        """Return the words for a broker."""
        return cls(
            name="the broker",
            place="on the broker",
            starting="the lamps on the broker are still being read: wait",
            remedy="switch it on at the wall, or look into its bridge",
            silence="accepts the login but then does not answer: restart the broker",
        )


class HomeConnection(Protocol):
    """Commands to a home and its states, while it is connected."""

    @property
    def refusals(self) -> Sequence[str]:
        """Return sentences on what cannot be used, with its name."""
        ...

    async def request(self, command: str, **fields: Any) -> Any:
        """Return the result of a command. Raises RefusedError if it does not have it."""
        ...

    async def states(self) -> dict[str, Mapping[str, Any]]:
        """Return the states of all entities, by entity."""
        ...

    async def is_starting(self) -> bool:
        """Return True if entities may be missing that come later."""
        ...

    async def subscribe(self, event: str, handler: Callable[[Mapping[str, Any]], None]) -> None:
        """Call `handler` with the data of all events of a type."""
        ...

    async def call(self, call: ServiceCall) -> str:
        """Run an action. Return the id of the context of its changes, or `""`.

        Raises:
            RefusedError: If it is not run.
            TimeoutError: If there is no answer.
            NoHomeAssistantError: If the connection is lost.
        """
        ...

    async def read(self) -> None:
        """Hand on replies and events until the connection is lost. Raises NoHomeAssistantError."""
        ...


def is_list(value: object) -> TypeGuard[list[object]]:
    """Return True for a list."""
    return isinstance(value, list)


def is_state(state: object) -> TypeGuard[Mapping[str, Any]]:
    """Return True for the state of an entity: its name, a text, and attributes if there are some."""
    if not isinstance(state, dict):
        return False
    fields = cast("Mapping[str, object]", state)
    for key in ("entity_id", "state"):
        if not isinstance(fields.get(key), str):
            return False
    return isinstance(fields.get("attributes", {}), dict)
