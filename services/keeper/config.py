"""Parameters of keeper."""

from pydantic import Field

from pointit.runtime.config.config import Config


class FileConfig(Config):
    """Storage of states on disk, for a restarted keeper."""

    enabled: bool = Field(
        default=True, description="store states on disk, too, for a restart of this service"
    )
    write_every_s: float = Field(
        default=1.0,
        gt=0.0,
        le=60.0,
        description="shortest time between writes, s; newer states die with the process",
    )
    restore_within_s: float = Field(
        default=600.0, ge=0.0, le=86_400.0, description="largest age of states that are restored, s"
    )


class KeeperConfig(Config):
    """Amount of retained states and their retention times."""

    forget_person_after_s: float = Field(
        default=30.0,
        ge=0.0,
        le=3600.0,
        description="retention of a person's states after their last service has left, s; they "
        "are not handed out meanwhile",
    )
    forget_deployment_after_s: float = Field(
        default=86_400.0,
        ge=0.0,
        le=604_800.0,
        description="retention of what `run` or `user` has started after its last service has left"
        ", s; `doctor` reports it as missing meanwhile, until it is started again and ended by Ctrl-C",
    )
    forget_site_after_s: float = Field(
        default=3600.0,
        ge=0.0,
        le=604_800.0,
        description="retention of shared states after the last of their possible writers has left, s",
    )
    max_values: int = Field(default=4096, ge=1, le=65_536, description="largest number of states")
    max_mb: float = Field(default=32.0, ge=1.0, le=64.0, description="largest total size of states, MB")
    file: FileConfig = Field(default=FileConfig(), description="storage on disk")
