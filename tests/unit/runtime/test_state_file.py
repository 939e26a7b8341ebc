"""State files: what is written can be read again, or the file stays as it was."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, Field

from pointit.bridges.home_assistant.hover_feedback import DimmedLight, DimmedLights
from pointit.bridges.home_assistant.setup.lit_lights import LitLight, LitLightsFile
from pointit.bridges.home_assistant.setup.progress import StoredSetup
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import MAX_BYTES, StateFile


class Words(BaseModel):
    words: tuple[str, ...] = ()
    share: float = Field(default=0.0, le=1.0)


def largest_value(model: type[BaseModel], count: int) -> BaseModel:
    """Return a value with `count` entries of the fields that may have any number."""
    names = [f"light.{number:0200}" for number in range(count)]
    if model is DimmedLights:
        return DimmedLights(lights={name: DimmedLight(before=1, during=2) for name in names})
    if model is LitLightsFile:
        return LitLightsFile(lights={name: LitLight() for name in names})
    if model is StoredSetup:
        return StoredSetup(offered=tuple(names))
    return Words(words=tuple(names))


@pytest.mark.parametrize("model", [DimmedLights, LitLightsFile, StoredSetup, Words])
@pytest.mark.parametrize("count", [10, 150, 300, 1300, 5000])
def test_value_of_any_size_is_read_again_or_the_file_stays(
    tmp_path: Path, model: type[Any], count: int
) -> None:
    file = StateFile[Any].at(tmp_path / "state.json", model)
    small = largest_value(model, 1)
    large = largest_value(model, count)
    file.write(small)
    try:
        file.write(large)
    except ConfigError as error:
        assert str(MAX_BYTES) in str(error)  # noqa: PT017 - either is right
        assert count >= 150
        assert file.read() == small
    else:
        assert file.read() == large


def test_value_that_its_own_model_refuses_is_not_written(tmp_path: Path) -> None:
    file = StateFile[Words].at(tmp_path / "state.json", Words)
    file.write(Words(words=("a",)))
    with pytest.raises(ConfigError, match="could not be read again; it stays as it was; share"):
        file.write(Words().model_copy(update={"share": 2.0}))
    assert file.read() == Words(words=("a",))


@given(st.text())
def test_any_text_is_read_again_or_refused(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    file = StateFile[Words].at(tmp_path_factory.getbasetemp() / "any.json", Words)
    value = Words(words=(text,))
    file.write(value)
    assert file.read() == value
