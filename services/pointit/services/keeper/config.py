"""Parameters of keeper."""

from pydantic import Field

from pointit.runtime.config.config import Config


class FileConfig(Config):
    """What a restarted keeper finds."""

    enabled: bool = Field(default=True, description="keep states on disk too, for this service's own restart")
    write_every_s: float = Field(
        default=1.0, gt=0.0, le=60.0, description="write at most so often, s; what is newer dies with us"
    )
    restore_within_s: float = Field(
        default=600.0, ge=0.0, le=86_400.0, description="take up what was written at most so long ago, s"
    )


class KeeperConfig(Config):
    """How much is kept, and for how long."""

    forget_person_after_s: float = Field(
        default=30.0,
        ge=0.0,
        le=3600.0,
        description="what is a person's is forgotten when nothing of theirs was present for so long, s; it "
        "is handed out to nobody meanwhile",
    )
    forget_deployment_after_s: float = Field(
        default=86_400.0,
        ge=0.0,
        le=604_800.0,
        description="what `run` or `user` has started is missed for so long after the last of it was present"
        ", s, and told to `doctor` meanwhile; what was started again and ended by Ctrl-C is missed no more",
    )
    forget_site_after_s: float = Field(
        default=3600.0,
        ge=0.0,
        le=604_800.0,
        description="what all share is forgotten when nobody who may write it was present for so long, s",
    )
    max_values: int = Field(default=4096, ge=1, le=65_536, description="keep at most so many states")
    max_mb: float = Field(default=32.0, ge=1.0, le=64.0, description="keep at most so many megabytes of them")
    file: FileConfig = Field(default=FileConfig(), description="what a restarted keeper finds")
