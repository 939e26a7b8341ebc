"""Passes the site's messages about people to the wrists of its pages and phones."""

from pointit.bridges.web.model.people import People
from pointit.bridges.web.wrists.phone import Phones
from pointit.bridges.web.wrists.wrist_control import WristControl
from pointit.schemas import Environment, Feedback, Interaction, Localization, Message, UserPose, UserProfile


class PersonMessages:
    """Passes messages on, by their type."""

    def __init__(self, people: People, wrists: WristControl, phones: Phones) -> None:
        self._people = people
        self._wrists = wrists
        self._phones = phones

    def take(self, name: str, message: Message) -> None:
        """Take a message. `name` is that in its key: the person, if it is about one. Others do nothing."""
        match message:
            case Environment():
                self._wrists.room(message)
            case UserProfile():
                self._wrists.profile(name, message)
            case UserPose():
                self._wrists.pose(name, message)
            case Localization():
                self._wrists.localization(name, message)
                self._phones.localization(name, message)
            case Interaction():
                self._people.states[name] = message.state
                self._phones.interaction(name, message)
            case Feedback():
                self._phones.feedback(name, message)
            case _:
                pass
