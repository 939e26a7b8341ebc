"""The colormaps beside matplotlib's, and what is asked of them wrongly."""

import subprocess
import sys

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry.colormap import ERROR, UnknownColormapError, colormap, names

STEPS = np.linspace(0.0, 1.0, 256)
BOTH_WAYS = [name + suffix for name in names() for suffix in ("", "_r")]


@pytest.mark.parametrize("name", BOTH_WAYS)
def test_every_step_is_as_matplotlibs(name: str) -> None:
    theirs = np.rint(np.asarray(mpl.colormaps[name](STEPS))[:, :3] * 255.0)
    apart = np.abs(colormap(name)(STEPS).astype(float) - theirs)
    assert apart.max() <= (8 if name.startswith("jet") else ERROR)
    assert apart.mean() < 1.0


@given(st.sampled_from(BOTH_WAYS), st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=9))
def test_any_fractions_have_a_colour_each(name: str, fractions: list[float]) -> None:
    colors = colormap(name)(fractions)
    assert colors.shape == (len(fractions), 3)
    assert colors.dtype == np.uint8
    for fraction, color in zip(fractions, colors, strict=True):
        inside = 0.0 if np.isnan(fraction) else min(max(fraction, 0.0), 1.0)
        assert tuple(color) == colormap(name).rgb(inside)


def test_the_shape_of_the_fractions_is_kept() -> None:
    assert (colormap("turbo")(np.zeros((2, 3))).shape, colormap("turbo")(0.5).shape) == ((2, 3, 3), (3,))


def test_grey_is_exact_and_reversed_is_reversed() -> None:
    assert colormap("gray")(STEPS)[:, 1].tolist() == list(range(256))
    assert colormap("hot_r")(STEPS).tolist() == colormap("hot")(STEPS)[::-1].tolist()


@pytest.mark.parametrize("name", ["", "_r", "Viridis", "viridis_r_r", "rainbow"])
def test_an_unknown_name_is_told_which_there_are(name: str) -> None:
    with pytest.raises(UnknownColormapError, match=r"viridis, plasma.*RdYlGn, with _r for reversed"):
        colormap(name)


def test_matplotlib_is_not_imported() -> None:
    code = (
        "import sys; from pointit.geometry.colormap import colormap; colormap('turbo');"
        "assert 'matplotlib' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
