"""The address of a home that works, and one that is tried and replaces it once the home has accepted it.

A token or password that comes with an address is in a file of its own until then. If the address or the
secret is refused, the working ones are as they were. A secret is sent to no other address than its own.

No core: it writes files.
"""

from pathlib import Path
from urllib.parse import urlsplit

from pydantic import ValidationError

from pointit.bridges.home_assistant.config import FORM, HomeAssistantConfig
from pointit.bridges.home_assistant.setup.home_files import HomeFiles, needs_secret
from pointit.bridges.home_assistant.setup.progress import SetupProgress
from pointit.bridges.home_assistant.setup.stored_setup import AddressTrial, UsedSecret
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.mqtt.broker_config import BrokerConfig, is_broker_url
from pointit.schemas.text import system_reason

USUAL_PORT = 8123


class HomeAddress:
    """Address and secret of the home in a folder. Changes the state of its set-up, and its files."""

    def __init__(self, files: HomeFiles, progress: SetupProgress) -> None:
        """Continue with what is stored. Raises ConfigError: a file cannot be written."""
        self._files = files
        self._progress = progress
        self._given_address = ""
        """Address in the parameters of the run, which counts until one is set up."""
        self._attempt: AddressTrial | None = None
        """Trial whose address is being used, or None if it is the working one."""
        self._has_failed = False
        """The last trial has failed."""

        # After a kill
        state = progress.state
        self._replace_secrets()
        files.remove_new_secrets(except_for=state.trial.secret if state.trial is not None else "")

    @property
    def url(self) -> str:
        """Return the address that is tried, or else the one that was set up, `""` if there is none."""
        state = self._progress.state
        return state.url if state.trial is None else state.trial.url

    @property
    def has_secret(self) -> bool:
        """Return True if there is a token or password for `url`."""
        trial = self._progress.state.trial
        if trial is not None and trial.secret:
            return True
        return self._files.secret_of(self.url).exists()

    def config_of(self, config: HomeAssistantConfig) -> HomeAssistantConfig:
        """Return `config`, parameters of the run, with the address to use now and the file of its secret."""
        state = self._progress.state
        self._given_address = config.broker or config.url
        self._attempt = state.trial
        if state.trial is not None:
            return _config_with(config, state.trial.url, self._files.secret_of_trial(state.trial))
        if not state.url and state.has_home:
            return config
        return _config_with(config, state.url, self._files.secret_of(state.url))

    def connect(self, text: str, secret: str) -> None:
        """Try an address. `secret` as in `SetUpHome`.

        Raises:
            RefusedError: If it is no address, needs no secret, or the stored one belongs to another address.
        """
        url = _checked_url(text)
        if secret and not needs_secret(url):
            raise RefusedError(
                "a password needs a user name: write mqtt://USER@HOST, or leave the password out"
            )
        trial = self._progress.state.trial
        if trial is not None and trial.url == url:
            secret = secret or trial.secret

        # The stored secret belongs to the first address to which it is sent
        written_ns = self._files.secret_written_ns(url)
        if not secret and written_ns is not None:
            self._progress.use_secret(self._files.secret_of(url).name, url, written_ns)
        self._progress.connect(url, secret)
        self._has_failed = False
        if trial is not None and trial.secret != secret:
            self._files.remove_new_secret(trial.secret)

    def without_home(self) -> None:
        """Use no home: there are the lights of the map."""
        trial = self._progress.state.trial
        self._progress.without_home()
        if trial is not None:
            self._files.remove_new_secret(trial.secret)

    def accept(self) -> None:
        """Note that the address in use is accepted: one that was tried is the working one from now on.

        Once the state is stored, `write` makes the files follow.

        Raises:
            ConfigError: If its token or password has been removed meanwhile.
        """
        trial = self._progress.state.trial
        if trial is None:
            # The parameters of the run have an address, which needs no card unless somebody tries another
            if not self._progress.state.url and not self._has_failed:
                self._progress.on_connected()
            return
        if trial != self._attempt:
            return
        name = ""
        used: UsedSecret | None = None
        if trial.secret:
            name = self._files.secret_of(trial.url).name
            written_ns = _written_ns(self._files.secret_of_trial(trial))
            used = UsedSecret(url=trial.url, written_ns=written_ns, replacement=trial.secret)
        self._progress.accept_trial(name, used)

    def write(self) -> None:
        """Make the files follow an accepted address. Raises ConfigError."""
        self._replace_secrets()
        state = self._progress.state
        if state.trial is None and state.url:
            self._files.write_site(state)

    def end_trial(self) -> str:
        """End the trial of the address in use, which has failed, if another one works.

        Return that one, or `""` if none does: the trial goes on then.
        """
        state = self._progress.state
        trial = state.trial
        if trial is None or trial != self._attempt:
            return ""
        working = state.url
        if not working and state.has_home:
            working = self._given_address
        if not working:
            return ""
        self._progress.end_trial()
        self._has_failed = True
        self._files.remove_new_secret(trial.secret)
        return working

    def _replace_secrets(self) -> None:
        """Put accepted secrets in place of the stored ones, unless that was done."""
        for name, used in self._progress.state.secrets.items():
            if used.replacement:
                self._files.replace_secret(name, used.replacement)
                self._progress.on_replaced(name)


def _written_ns(secret: Path) -> int:
    try:
        return secret.stat().st_mtime_ns
    except OSError as error:
        raise ConfigError(f"{secret}: cannot be read ({system_reason(error)}); connect again") from error


def _config_with(config: HomeAssistantConfig, url: str, secret: Path) -> HomeAssistantConfig:
    """Return `config` with another address, and the file of its token or password."""
    if not is_broker_url(url):
        return config.model_copy(update={"url": url, "token_file": str(secret), "broker": ""})

    # A broker without a user name asks for no password
    broker = BrokerConfig(broker=url)
    values = broker.model_dump(include={"broker", "tls", "username"})
    has_password = bool(broker.username) and secret.exists()
    values["password_file"] = str(secret) if has_password else ""
    changed = config.model_copy(update={"url": "", "token_file": "", **values})

    # The password in the environment is for a broker that the run's own parameters have without a file. Those
    # that a card has written name one.
    is_own = (broker.broker, broker.tls, broker.username) == (config.broker, config.tls, config.username)
    if is_own and not config.password_file:
        return changed
    return changed.without_variable()


def _checked_url(text: str) -> str:
    url = text.strip()
    if url and "://" not in url:
        url = f"http://{url}"
    if is_broker_url(url):
        return _checked_broker(url)
    try:
        checked = HomeAssistantConfig(url=url).url
    except ValidationError:
        checked = ""
    if not checked:
        raise RefusedError(f"that is no address of a Home Assistant: {FORM}")
    if "://" not in text and urlsplit(checked).port is None:
        return f"{checked}:{USUAL_PORT}"  # a host alone, as people type it
    return checked


def _checked_broker(url: str) -> str:
    try:
        host = BrokerConfig(broker=url).broker
    except ValidationError:
        host = ""
    if not host:
        raise RefusedError(
            "that is no address of a broker: write mqtt://HOST, or mqtt://USER@HOST and the password below"
        )
    return url.rstrip("/")
