"""Files of a home in the folder of `pointit home`: its map, its parameters, its token, its state.

No core: it reads and writes files.
"""

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from pointit.bridges.home_assistant.setup.stored_setup import (
    AddressTrial,
    ChosenLamp,
    PlacedLamp,
    StoredSetup,
)
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.maps.checks.check import check_map
from pointit.maps.checks.things import check_labels
from pointit.maps.edit import Add, Edit, Remove, SetValue, edited
from pointit.maps.file import parse_map_file
from pointit.maps.light_files.strip_fit import free_name
from pointit.maps.model import MAX_LABEL, MapFile
from pointit.maps.things import things_of
from pointit.runtime.config.yaml_edit import quoted, with_values
from pointit.runtime.config.yaml_file import MAX_YAML_BYTES, parse_yaml
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.state_file import StateFile, read_limited, write_atomically
from pointit.runtime.mqtt.broker_config import BrokerConfig, is_broker_url
from pointit.scan.paced_model import FIRST, SECOND
from pointit.schemas.home import LAMP, NEW_SECRET, PASSWORD_FILE, STRIP, TOKEN_FILE
from pointit.schemas.printable import is_printable
from pointit.schemas.text import system_reason

MAP = "home.yaml"
DRAFT = "placing.yaml"
"""Map while lamps are pointed at: without things, so that none of them reacts."""
SITE = "site.yaml"
STATE = "setup.json"
MAX_STATE_BYTES = 8 * 2**20
"""Room for the ids of all lamps that can be offered, and for what is known of the chosen ones."""
SIZE_M = 0.3
"""Size of a thing that was placed by pointing, m."""
SECTIONS = ("home_assistant", "home-assistant")
"""Names of the section of the Home Assistant in a file of parameters."""
ADDRESS = ("url", "token_file", "broker", "username", "password_file")
"""Parameters that are of an address, and change with it. All others are as people have written them."""
ENCRYPTION = ("tls", "ca_file")
"""Parameters of encrypted brokers, which no other broker may have."""

EMPTY_MAP = """# The lamps of your home, placed by `pointit home`. Edit this file as you like: names, modes
# and all else that docs/reference/maps.md has stay as they are when lamps are placed again.
paced_from:
  A: {position: [0, 0]}
"""
EMPTY_SITE = """# Parameters of services, read by `pointit home`, in sections SERVICE: {PARAMETER: VALUE}.
"""


class HomeFiles:
    """The files in one folder."""

    def __init__(self, folder: Path) -> None:
        """Use `folder`, which need not exist."""
        self._folder = folder
        self.map = folder / MAP
        self.draft = folder / DRAFT
        self.site = folder / SITE
        self.token = folder / TOKEN_FILE
        self.password = folder / PASSWORD_FILE
        self.state = StateFile[StoredSetup].at(folder / STATE, StoredSetup, MAX_STATE_BYTES)

    def create(self) -> None:
        """Write the map and the parameters of a new home, unless they are there. Raises ConfigError."""
        for path, text in ((self.map, EMPTY_MAP), (self.site, EMPTY_SITE)):
            if not path.exists():
                write_atomically(path, text.encode())

    def read_map(self) -> bytes:
        """Return the content of the map, that of an empty one if there is none. Raises ConfigError."""
        try:
            return read_limited(self.map, MAX_YAML_BYTES + 1)
        except FileNotFoundError:
            return EMPTY_MAP.encode()

    def write_draft(self) -> Path:
        """Write the map without things, and return its path. Raises PointItError."""
        write_atomically(self.draft, draft_map(self.read_map(), self.map))
        return self.draft

    def write_map(self, setup: StoredSetup) -> Path:
        """Write the lamps of `setup` into the map, and return its path. Raises PointItError."""
        content = placed_map(self.read_map(), self.map, setup)
        parse_map_file(content, self.map)
        write_atomically(self.map, content)
        return self.map

    def write_site(self, setup: StoredSetup) -> None:
        """Write the address of the home into the parameters. Raises ConfigError."""
        content = EMPTY_SITE.encode()
        if self.site.exists():
            content = read_limited(self.site, MAX_YAML_BYTES + 1)
        changed = with_home_assistant(content, self.site, setup.url, self.secret_of(setup.url))
        if changed != content:
            write_atomically(self.site, changed)

    def secret_of(self, url: str) -> Path:
        """Return the file with the password of the broker at `url`, or with the token of a Home Assistant."""
        return self.password if is_broker_url(url) else self.token

    def secret_of_trial(self, trial: AddressTrial) -> Path:
        """Return the file with the token or password that is sent to an address that is tried."""
        return self._new_secret(trial.secret) if trial.secret else self.secret_of(trial.url)

    def replace_secret(self, name: str, new_name: str) -> None:
        """Replace the file `name` by that of a new secret, with its rights and time, unless that was done.

        Raises:
            ConfigError: If it cannot be replaced. Both are as before.
        """
        path = self._folder / name
        try:
            self._new_secret(new_name).replace(path)
        except FileNotFoundError:
            return
        except OSError as error:
            raise ConfigError(f"{path}: cannot be written ({system_reason(error)})") from error

    def remove_new_secret(self, name: str) -> None:
        """Remove the file of a token or password that was not accepted, if it is there."""
        if not name:
            return
        # A folder that cannot be changed stops nobody: the next start tries again
        with contextlib.suppress(OSError):
            self._new_secret(name).unlink(missing_ok=True)

    def remove_new_secrets(self, *, except_for: str) -> None:
        """Remove all files of tokens and passwords that were not accepted, except for one."""
        for path in self._folder.glob(f"*{NEW_SECRET}"):
            if path.stem != except_for:
                self.remove_new_secret(path.stem)

    def _new_secret(self, name: str) -> Path:
        return self._folder / f"{name}{NEW_SECRET}"

    def secret_written_ns(self, url: str) -> int | None:
        """Return the time at which the secret of `url` was written, ns, or None if it needs or has none."""
        if not needs_secret(url):
            return None
        try:
            return self.secret_of(url).stat().st_mtime_ns
        except OSError:
            return None


def needs_secret(url: str) -> bool:
    """Return True for the address of a Home Assistant, or of a broker with a user name."""
    return "@" in url or not is_broker_url(url)


def with_home_assistant(content: bytes, path: Path, url: str, secret_file: Path) -> bytes:
    """Return the parameters in `content` of `path` with the address of a Home Assistant or a broker.

    `secret_file` has the token or the password. A broker without a user name asks for none. All that people
    have written stays, but for another address and what is of it.

    Raises:
        ConfigError: If `content` is not YAML, or its form does not allow the change.
    """
    values = {"url": url, "token_file": str(secret_file)}
    if is_broker_url(url):
        values = {"broker": url}
        if needs_secret(url):
            values["password_file"] = str(secret_file)
    data = dict(parse_yaml(content, path))
    name = next((section for section in SECTIONS if section in data), SECTIONS[0])
    written = data.get(name)
    section = dict(cast("dict[str, Any]", written)) if isinstance(written, dict) else {}
    if values.items() <= section.items():
        return content

    former = [key for key in ADDRESS if key not in values]
    if is_broker_url(url) and not BrokerConfig(broker=url).tls:
        former += ENCRYPTION
    for key in former:
        section.pop(key, None)
    data[name] = section | values
    try:
        return with_values(content, data, path)
    except RefusedError as error:
        fields = ", ".join(f"{key}: {quoted(value)}" for key, value in values.items())
        raise ConfigError(f"{error}: `{name}` needs {fields}") from error


def draft_map(content: bytes, path: Path) -> bytes:
    """Return the map at `path` without its things. Raises PointItError."""
    data = dict(parse_yaml(content, path))
    data.pop("things", None)
    draft = with_values(content, data, path)
    parse_map_file(draft, path)
    return draft


def placed_map(content: bytes, path: Path, setup: StoredSetup) -> bytes:
    """Return the map with the lamps of `setup`, where their presses have placed them.

    Things that people have written or changed stay; those of lamps that were deselected go.

    Raises:
        PointItError: If the form of the file does not allow it.
    """
    file = parse_map_file(content, path)
    names = {_light_of(entry): name for name, entry in file.things.items()}
    positions: dict[str, dict[str, Vec3]] = {}
    for placed in setup.placed:
        positions.setdefault(placed.lamp, {})[placed.end] = placed.position_m
    edits: list[Edit] = []
    added: list[str] = []
    for lamp in setup.lamps:
        if lamp.id in positions:
            edits += _edits_of(file, lamp, positions[lamp.id], names.get(lamp.id, ""), added)
    chosen = {lamp.id for lamp in setup.lamps}
    for light, name in names.items():
        if light in setup.offered and light not in chosen:
            edits.append(Remove(section="things", name=name))
    edits += _edits_of_places(file, setup.places_m)
    return edited(content, edits, path)


def _light_of(entry: Any) -> str:
    """Return the id of the light of an entry of `things` as in `HomeLamp`, or `""`."""
    if isinstance(entry.home_assistant, str):
        return entry.home_assistant
    if isinstance(entry.light, str):
        return f"{LAMP}{entry.light}"
    if entry.light is None:
        return ""
    return f"{STRIP}{entry.light.line}"


def _edits_of(
    file: MapFile, lamp: ChosenLamp, ends: Mapping[str, Vec3], name: str, added: list[str]
) -> list[Edit]:
    """Return the edits that place one lamp; a name that they take is appended to `added`."""
    # The light itself, and the thing that people point at: on a strip, a lamp, or of Home Assistant
    edits: list[Edit] = []
    value: dict[str, Any] = {}
    if lamp.id.startswith(STRIP):
        strip = lamp.id.removeprefix(STRIP)
        if strip not in file.strips:
            raise RefusedError(f"the map has no strip {strip} any more: choose the lamps again")
        line = [_rounded(ends["first"]), _rounded(ends["last"])]
        edits.append(SetValue(section="strips", name=strip, key="line", value=line))
        length_m = round(Polyline((ends["first"], ends["last"])).length_m, 2)
        value = {"light": {"strip": strip, "from": 0, "to": max(length_m - 0.01, 0.01)}, "mode": "switch"}
    elif lamp.id.startswith(LAMP):
        light = lamp.id.removeprefix(LAMP)
        if light not in file.lamps:
            raise RefusedError(f"the map has no lamp {light} any more: choose the lamps again")
        edits.append(SetValue(section="lamps", name=light, key="position", value=_rounded(ends[""])))
        value = {"light": light, "mode": "switch"}
    else:
        value = {"home_assistant": lamp.id, "center": _rounded(ends[""]), "size": [SIZE_M] * 3}
        if lamp.kind == "danger":
            value["press"] = True  # staying on it is not enough

    if name:
        return edits + _edits_of_thing(file, lamp, name, value)

    # A new thing has the name of its entity or light, and its label if a map may have it
    separator = "." if "." in lamp.id else ":"
    _, _, light_name = lamp.id.partition(separator)
    thing = free_name(light_name[:64], file.things, added)
    added.append(thing)
    is_allowed = is_printable(lamp.label) and len(lamp.label) <= MAX_LABEL
    if is_allowed and lamp.label not in ("", thing):
        value["label"] = lamp.label
    edits.append(Add(section="things", name=thing, value=value))
    return edits


def _edits_of_thing(file: MapFile, lamp: ChosenLamp, name: str, value: Mapping[str, Any]) -> list[Edit]:
    """Return the edits of a thing that is there: only its place changes, not what people wrote."""
    keys = ["center"]
    if file.things[name].size is None:
        keys = ["center", "size", "light"]
    elif lamp.id.startswith(STRIP):
        keys = ["center", "light"]
    edits: list[Edit] = []
    for key in keys:
        if key in value:
            edits.append(SetValue(section="things", name=name, key=key, value=value[key]))
    return edits


def _edits_of_places(file: MapFile, places_m: Sequence[tuple[float, float]]) -> list[Edit]:
    edits: list[Edit] = []
    for name, place_m in zip((FIRST, SECOND), places_m, strict=False):
        position = [round(value, 2) for value in place_m]
        if name in file.paced_from:
            edits.append(SetValue(section="paced_from", name=name, key="position", value=position))
        else:
            edits.append(Add(section="paced_from", name=name, value={"position": position}))
    if len(places_m) < 2 and SECOND in file.paced_from:
        edits.append(Remove(section="paced_from", name=SECOND))
    return edits


def lights_of(file: MapFile) -> list[ChosenLamp]:
    """Return the lights of a map that people can point at: those of controllers in the network."""
    strips = [ChosenLamp(id=f"{STRIP}{name}", label=name, kind="strip") for name in file.strips]
    return strips + [ChosenLamp(id=f"{LAMP}{name}", label=name) for name in file.lamps]


def advice_on(content: bytes, path: Path, places_m: Sequence[tuple[float, float]]) -> list[str]:
    """Return sentences on lamps and names of a map that are confused. Raises PointItError."""
    file = parse_map_file(content, path)
    findings = [*check_map(file, {}, poses_m=places_m), *check_labels(things_of(file))]
    sentences: list[str] = []
    for finding in findings:
        section, _, name = finding.where.partition(".")
        if section == "things":
            entry = file.things.get(name)
            label = name
            if entry is not None and entry.label:
                label = entry.label
            sentences.append(f"{label} {finding.text}".strip())
    return sentences


def sigmas_of(placed: Sequence[PlacedLamp]) -> dict[str, float]:
    """Return the standard deviation (rad) of the direction to each lamp, the worst of its ends."""
    sigmas: dict[str, float] = {}
    for placed_lamp in placed:
        sigma_rad = sigmas.get(placed_lamp.lamp, 0.0)
        sigmas[placed_lamp.lamp] = max(sigma_rad, placed_lamp.direction_sigma_rad)
    return sigmas


def _rounded(position_m: Vec3) -> list[float]:
    return [round(value, 2) for value in position_m]
