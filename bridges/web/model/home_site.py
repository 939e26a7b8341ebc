"""The set-up of a home for pages: stores its token, asks `home-assistant`, and makes the site follow.

The token of a Home Assistant, or the password of a broker, goes into a file of its own in the folder of the
home and nowhere else. `home-assistant` puts it in place of the stored one once it was accepted. Answers call
for requests of an operator, which the server of the page may send: a map, the pose of the person, the light
of a strip.

No core: it writes files and asks a service.
"""

import asyncio
import contextlib
import re
from pathlib import Path
from typing import Any

from pydantic import SecretStr

from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import PointItError, RefusedError
from pointit.runtime.host.state_file import NO_MODES, expand_home, keeps_modes, write_atomically
from pointit.runtime.machine import this_machine
from pointit.runtime.mqtt.broker_config import is_broker_url
from pointit.schemas import HomeSetup, LitPixels, SetLamp, SetPose, SetUpHome, ShowPixels, UseMap
from pointit.schemas.base import Rgb
from pointit.schemas.home import LAMP, NEW_SECRET, STRIP
from pointit.schemas.printable import is_printable
from pointit.schemas.topics import SET_LAMP, SET_POSE, SET_UP_HOME, SHOW_PIXELS, USE_MAP

MAX_TOKEN = 4096
MAX_PASSWORD_BYTES = 1024
TOKEN_FORM = re.compile(r"[!-~]+")
"""One word of ASCII."""
WHITE: Rgb = (255, 255, 255)
SHOWN_S = 2.0
"""Time for which an end of a strip is lit, s. Pages ask more often."""
END_PIXELS = 3
TIMEOUT_S = 10.0
"""Time for the lamps to be located, s."""


class HomeSite:
    """The home of a run of `pointit home`."""

    def __init__(self, bus: Bus, folder: str) -> None:
        """Use the home in `folder`. There is none if it is empty."""
        self._bus = bus
        self._folder = folder
        self._used = ("", 0)
        """Path and time of change, ns, of the map that the site uses."""
        self._poses = 0
        self._lamp = ""
        """Lamp of the map that is lit, or `""`."""
        self._working = asyncio.Lock()

    @property
    def is_there(self) -> bool:
        """Return True if there is a home to be set up."""
        return bool(self._folder)

    async def set_up(
        self, query: SetUpHome, token: SecretStr | None, pixels: dict[str, int]
    ) -> dict[str, Any]:
        """Do what a person wants at the cards. Return the fields of `HomeSetup`.

        Args:
            query: the act.
            token: long-lived access token, or password of a broker, for the address of the act, or None.
            pixels: number of pixels of each strip of the map.

        Raises:
            PointItError: If it is not possible; the text has the reason, and never the token or password.
        """
        if not self._folder:
            raise RefusedError("this page belongs to no home: start `pointit home`")
        if token is None:
            reply = await self._bus.call(SET_UP_HOME, query, timeout_s=TIMEOUT_S)
        else:
            reply = await self._connect(query, token.get_secret_value())
        async with self._working:
            await self._apply_reply(reply, pixels)
        return reply.model_dump(mode="json")

    async def _connect(self, query: SetUpHome, secret: str) -> HomeSetup:
        """Try an address with its token or password, which is in a file as long as it may be accepted.

        Raises:
            PointItError: If it is no token or password, or the address is refused.
        """
        if query.act != "connect":
            raise RefusedError("a token or password belongs to an address: give both")
        content = _password_of(secret) if is_broker_url(query.url) else _token_of(secret)
        folder = expand_home(self._folder)
        if not await asyncio.to_thread(keeps_modes, Path(folder)):
            raise RefusedError(
                f"a token or password in {folder} could be read by others, as {NO_MODES}: start "
                "`pointit home` with --folder and a folder in your home directory"
            )
        name = this_machine().random_name(8)
        file = Path(folder) / f"{name}{NEW_SECRET}"
        await asyncio.to_thread(write_atomically, file, content, mode=0o600)
        query = query.model_copy(update={"secret": name})
        try:
            return await self._bus.call(SET_UP_HOME, query, timeout_s=TIMEOUT_S)
        except BaseException:
            file.unlink(missing_ok=True)
            raise

    async def _apply_reply(self, reply: HomeSetup, pixels: dict[str, int]) -> None:
        """Send the requests that an answer calls for: map, pose and light."""
        # The map of this home alone: the right to any map is an operator's
        version = await asyncio.to_thread(_version_of, reply.map)
        is_of_home = Path(reply.map).parent == expand_home(self._folder)
        if is_of_home and version != self._used:
            await self._bus.call(USE_MAP, UseMap(path=reply.map))
            self._used = version

        has_new_pose = reply.poses != self._poses
        if reply.pose_m is not None and has_new_pose and reply.user:
            x, y = reply.pose_m
            pose = SetPose(position_m=(x, y, 0.0), yaw_rad=reply.pose_yaw_rad)
            with contextlib.suppress(PointItError):  # of a person who has left: the next answer repeats it
                await self._bus.call(SET_POSE, pose, reply.user)
                self._poses = reply.poses

        # A light that fails is no reason to stop: the card has its name
        with contextlib.suppress(PointItError):
            await self._show_target(reply, pixels)

    async def _show_target(self, reply: HomeSetup, pixels: dict[str, int]) -> None:
        """Light the end of a strip, or the lamp of the map, whose turn it is."""
        # The previous lamp is its own again before the next one is lit
        lamp = ""
        if reply.target.startswith(LAMP):
            lamp = reply.target.removeprefix(LAMP)
        if lamp != self._lamp and self._lamp:
            await self._bus.call(SET_LAMP, SetLamp(color=None), self._lamp)
        if lamp and lamp != self._lamp:
            await self._bus.call(SET_LAMP, SetLamp(color=WHITE), lamp)
        self._lamp = lamp

        if not reply.target.startswith(STRIP):
            return
        strip = reply.target.removeprefix(STRIP)
        count = pixels.get(strip, 0)
        if not count:
            return
        end = range(max(count - END_PIXELS, 0), count)
        if reply.end == "first":
            end = range(min(END_PIXELS, count))
        lit = LitPixels(id=strip, pixels=tuple(end), color=WHITE)
        await self._bus.call(SHOW_PIXELS, ShowPixels(lit=(lit,), for_s=SHOWN_S))


def _token_of(secret: str) -> bytes:
    """Return the content of the file of a token. Raises RefusedError."""
    token = secret.strip()
    if len(token) > MAX_TOKEN or TOKEN_FORM.fullmatch(token) is None:
        raise RefusedError(
            "that is no access token: copy the whole long-lived access token, one long word, from your "
            "profile in Home Assistant"
        )
    return token.encode()


def _password_of(secret: str) -> bytes:
    """Return the content of the file of a password. Raises RefusedError."""
    content = secret.encode()
    if not is_printable(secret) or not 0 < len(content) <= MAX_PASSWORD_BYTES:
        raise RefusedError("that is no password: write it on one line, as the broker has it")
    return content


def _version_of(path: str) -> tuple[str, int]:
    try:
        return path, Path(path).stat().st_mtime_ns
    except OSError:
        return path, 0
