"""Row of home-assistant in the tables of processes, topics and requests."""

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.service import HomeAssistant
from pointit.schemas.topics import HOVER, MAP, SELECTION, SELECTION_EVENTS, SET_THING
from pointit.services.service_plugin import ServicePlugin

HOME_ASSISTANT = ServicePlugin(
    summary="things that are entities of a Home Assistant: actions there, and their state back",
    config=HomeAssistantConfig,
    make=HomeAssistant,
    reads=(MAP, HOVER, SELECTION, SELECTION_EVENTS),
    asks=(SET_THING,),
)
