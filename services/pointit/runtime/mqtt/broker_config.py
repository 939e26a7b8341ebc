"""Parameters of a connection to an MQTT broker."""

from urllib.parse import urlsplit

from pydantic import Field, field_validator

from pointit.runtime.config.config import Config

PORT = 1883
TLS_PORT = 8883


def split_address(address: str) -> tuple[str, int | None]:
    """Return host and port of `HOST` or `HOST:PORT`; the port is None if there is none.

    Raises:
        ValueError: If it is neither.
    """
    parts = urlsplit(f"//{address}")
    if not parts.hostname or parts.username is not None or parts.path or parts.query or parts.fragment:
        raise ValueError("write HOST or HOST:PORT")
    return parts.hostname, parts.port


class BrokerConfig(Config):
    """A broker, and how to log in to it."""

    broker: str = Field(default="", description="HOST or HOST:PORT of the broker")
    tls: bool = Field(default=False, description="encrypt the connection; the default port is 8883 then")
    ca_file: str = Field(
        default="", description="file with the authority of the broker's certificate; the system's if empty"
    )
    username: str = Field(default="", description="user name at the broker, if it asks for one")
    password_file: str = Field(
        default="", description="file with the password; the variable MQTT_PASSWORD has it if empty"
    )

    @field_validator("broker")
    @classmethod
    def _is_address(cls, broker: str) -> str:
        if broker:
            split_address(broker)
        return broker

    def address(self) -> tuple[str, int]:
        """Return the host and the port of the broker."""
        host, port = split_address(self.broker)
        return host, port if port is not None else TLS_PORT if self.tls else PORT
