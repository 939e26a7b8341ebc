"""Parameters of home-assistant."""

import re
from pathlib import Path
from typing import Annotated
from urllib.parse import urlsplit

from pydantic import AfterValidator, Field, field_validator

from pointit.bridges.home_assistant.home_connection import HomeWords
from pointit.runtime.address_config import (
    MissingInterfaceError,
    described_error,
    parse_address,
    with_plain_scope,
)
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import expand_home, read_secret
from pointit.runtime.mqtt.broker_config import BrokerConfig
from pointit.schemas.text import LANGUAGE

MAX_TOKEN_BYTES = 4096
"""Maximum size of the file of a token. A token of Home Assistant has about 200 bytes."""
FORM = "write http://HOST:8123, or https://HOST if it encrypts"
SCHEMES = {"http": "ws", "ws": "ws", "https": "wss", "wss": "wss"}
_TOKEN = re.compile(r"eyJ[\w-]+\.[\w-]+")
"""Start of a long-lived access token, a JSON Web Token."""


def _entity(domain: str) -> AfterValidator:
    """Return a validator of entities of `domain`, or `""`."""

    def check(entity: str) -> str:
        if entity and not re.fullmatch(rf"{domain}\.[a-z0-9_]+", entity):
            raise described_error(f"write {domain}.NAME, an entity of Home Assistant")
        return entity

    return AfterValidator(check)


class HomeAssistantConfig(BrokerConfig):
    """A Home Assistant with the file of its token, or an MQTT broker on which lamps announce themselves."""

    url: str = Field(
        default="", description="address of Home Assistant, as in a browser: http://homeassistant.local:8123"
    )
    token_file: str = Field(
        default="", description="file with a long-lived access token, made in your profile there, Security"
    )
    setup: str = Field(
        default="",
        description="folder of `pointit home`, which sets it: its cards set up address, token and lamps",
    )
    say_online: bool = Field(
        default=True,
        description="without a Home Assistant, say `online` on its status topic at the broker: some lamps "
        "announce themselves only then",
    )
    hover: bool = Field(
        default=True, description="lamps that are on brighten or dim by a fifth while somebody points at them"
    )
    max_hover_latency_s: float = Field(
        default=1.0, gt=0, le=10, description="lamps that take longer show no hover, s"
    )
    limit_s: float = Field(
        default=5.0,
        gt=1,
        le=60,
        description="time for an entity to follow, s. Covers, locks, vacuums and valves have 60 s",
    )
    speaker: Annotated[str, _entity("media_player")] = Field(
        default="", description="media player that announces names, such as media_player.kitchen"
    )
    voice: Annotated[str, _entity("tts")] = Field(
        default="", description="text-to-speech entity, such as tts.piper; the first one if empty"
    )
    language: str = Field(
        default="", pattern=LANGUAGE, description="language of the names, such as de; the voice's if empty"
    )
    people: tuple[str, ...] = Field(
        default=("*",), description="people whose names of things the speaker says, `*` for all"
    )
    actions: tuple[str, ...] = Field(
        default=(),
        description="actions of other domains than the entity's, `scene` and `script` that things may run, "
        "such as notify.anna",
    )
    rate_hz: float = Field(
        default=5.0, gt=0, le=50, description="maximum rate of commands to one entity; the newest counts, Hz"
    )

    @field_validator("url")
    @classmethod
    def _is_url(cls, url: str) -> str:
        if not url:
            return ""
        try:
            parts = urlsplit(url.strip())
            parts = parts._replace(netloc=with_plain_scope(parts.netloc))
            port = parse_address(parts.netloc)[1] if parts.netloc else None
        except MissingInterfaceError as error:
            raise described_error(str(error)) from None
        except ValueError:  # its text has the URL, which may have a password
            raise described_error(FORM) from None

        # A scheme and a host, without a login
        if parts.scheme not in SCHEMES or not parts.hostname:
            raise described_error(FORM)
        if "@" in parts.netloc or port == 0:
            raise described_error(FORM)
        if parts.netloc.count(":") > 1 and not parts.netloc.startswith("["):
            raise described_error("write an IPv6 address in brackets: http://[fd00::5]:8123")
        if parts.query or parts.fragment:
            raise described_error(f"{FORM}, without the address of a page")
        path = parts.path.rstrip("/")
        return f"{parts.scheme}://{parts.netloc}{path}"

    @field_validator("token_file")
    @classmethod
    def _is_path(cls, path: str) -> str:
        if _TOKEN.search(path):
            raise described_error("is a token itself: write it into a file and name the file")
        return path

    @property
    def websocket_url(self) -> str:
        """Return the address of the websocket."""
        scheme, _, host = self.url.partition("://")
        return f"{SCHEMES[scheme]}://{host}/api/websocket"

    @property
    def words(self) -> HomeWords:
        """Return the words for this home in sentences."""
        return HomeWords.of_broker() if self.broker else HomeWords.of_home_assistant()

    def check_home_assistant(self) -> None:
        """Check that there are an address and a file of a Home Assistant. Raises ConfigError."""
        self.check()
        if self.broker:
            raise ConfigError("broker: this needs a Home Assistant; set `url` and `token_file` instead")

    def check(self) -> None:
        """Check that there are an address and a file, or a broker alone. Raises ConfigError."""
        if self.broker and self.url:
            raise ConfigError(
                "url: a Home Assistant has the lamps of its broker, too: leave `broker` or `url` out"
            )
        if self.broker:
            return
        if not self.url:
            raise ConfigError(f"url: is missing; {FORM}")
        if not self.token_file:
            raise ConfigError(
                "token_file: is missing; make a long-lived access token in your profile of Home Assistant, "
                "Security, write it into a file and name that file"
            )

    def read_token(self) -> str:
        """Return the token. Errors quote no content of its file.

        Raises:
            ConfigError: If the file has none.
        """
        path = expand_home(self.token_file)
        try:
            content = read_secret(Path(path), MAX_TOKEN_BYTES + 1)
        except FileNotFoundError:
            raise ConfigError(f"token_file: {path} does not exist; correct the path") from None
        except ConfigError as error:
            raise ConfigError(f"token_file: {error}") from None

        # One word of ASCII. Editors of some systems put a mark before it.
        try:
            token = content.decode("utf-8-sig").strip()
        except UnicodeDecodeError:
            token = ""
        if token[:1] in ("'", '"'):
            raise ConfigError(f"token_file: {path} has quotation marks around the token; remove them")
        is_word = token.isascii() and len(token.split()) == 1
        if not is_word or len(content) > MAX_TOKEN_BYTES:
            raise ConfigError(
                f"token_file: {path} does not hold one token and nothing else; copy the long-lived access "
                "token of Home Assistant into it"
            )
        return token
