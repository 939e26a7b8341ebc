"""Colormaps by name, without matplotlib: tables of 33 colours with linear interpolation.

The colours are those of matplotlib's maps of the same names, fitted so that all 256 steps are within `ERROR`
of 255 (measured against matplotlib in the tests). RdYlGn is ColorBrewer's (colorbrewer2.org, C. Brewer),
turbo is A. Mikhailov's, coolwarm is K. Moreland's.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

NODES = 33

ERROR = 4
"""Maximum difference of a channel from matplotlib's, of 255. 8 at the corners of jet."""

REVERSED = "_r"

_TABLES: dict[str, str] = {
    "viridis": (
        "440154470d6048186a482374472d7b4536814240863f49893b528b375a8d33638d2f6a8e2c728e297a8e26818e23898e"
        "21908d1f988b1e9f8821a68527ae8031b57b3dbc744cc26c5cc9636ece5881d44c96d840abdc32c0df24d5e219eae519"
        "fde724"
    ),
    "plasma": (
        "0e07872206903105973f049c4c02a15901a56600a77200a87e03a88908a69511a29f1a9ca92396b32c8fbb3587c33e80"
        "cb4778d25071d9596ae06263e66c5ceb7555f07f4ff48a48f89441fb9f3afdab33feb72dfdc328fcd025f9dd24f5eb27"
        "f0f924"
    ),
    "inferno": (
        "0000030303120a0724150b37210c4a2e0a5b3c09654a0b6b57106e63146f70196e7d1e6d89226a962766a32b62af315c"
        "bb3755c63d4dd14545db4f3ce45932eb6528f1711ef67f14f98d09fb9c05fcab0ffbba1ff9ca32f5d949f2e865f2f586"
        "fcffa5"
    ),
    "magma": (
        "0000030303110a0822130d331d114628125a36106b430f7650127c5d177f691c817621818226828f2a819c2e7fa9327d"
        "b6377ac33b75d04170db486ae65063ef5c5ef5695bf9785cfc8761fd9668fea571feb47bfec387fed194fde0a1fceeb0"
        "fcfdbf"
    ),
    "cividis": (
        "00234e00285b002e6b0433721c386f273e6e32436d3b496c434e6c4b546c52596d5a5f6e61646f686a716f7073757676"
        "7c7b788481798b8778938d789b9376a39a75aba072b3a670bbad6dc3b469ccba64d4c15fddc958e6d051efd748f9df3b"
        "ffe734"
    ),
    "turbo": (
        "31123c3a2a744040a24556c7476be4477ff74393ff37a8fb29bbec1ccdd817dcc31de8b030f2994cf97e6bfe638aff4c"
        "a3fd3cb8f734cced34dee037edd03af8c03afdae35fe982cfc8022f56817ec520ee14009d23105c12302ac1701950c01"
        "7a0403"
    ),
    "jet": (
        "00007f0000a40000c70000ef0000ff0020fe0040ff0060ff0080ff009fff00bfff00dffd14ffe22fffc948ffaf62ff95"
        "7bff7b95ff62afff48c9fe2fe2ff14fdf200ffd200ffb500ff9700ff7a00ff5c00fe3e00ff2100ef0200c70000a40000"
        "7f0000"
    ),
    "hot": (
        "0b00002000003400004900005e00007300008800009d0000b20000c70000db0000f20000ff0500ff1c00ff3000ff4500"
        "ff5a00ff6f00ff8400ff9900ffae00ffc300ffd800ffed00ffff02ffff24ffff43ffff62ffff81ffffa1ffffc0ffffe0"
        "ffffff"
    ),
    "coolwarm": (
        "3b4cc0445acc4d68d75775e16282ea6c8ef1779af782a5fb8db0fe98b9ffa3c2ffaec9fdb8d0f9c2d5f4ccd9eed5dbe6"
        "dddddde5d8d1ecd3c5f1ccb9f5c4adf7bba0f7b194f7a687f49a7bf18d6fec7f63e57058de604dd55042cb3e38c0282f"
        "b40426"
    ),
    "gray": (
        "000000080808101010181818202020282828303030383838404040484848505050585858606060686868707070787878"
        "8080808787878f8f8f9797979f9f9fa7a7a7afafafb7b7b7bfbfbfc7c7c7cfcfcfd7d7d7dfdfdfe7e7e7efefeff7f7f7"
        "ffffff"
    ),
    "RdYlGn": (
        "a50026b50f26c41e27d42d26df3f2ee75237f1653ff67949f88d52fca25bfdb566fdc473fed480fee28efeec9ffff5af"
        "ffffbff3faafe7f59fdcf08eccea83bce379addc6d9ad46886cb6772c2655db96145ad5b2da15517954f11864708773f"
        "006837"
    ),
}


class UnknownColormapError(ValueError):
    """There is no colormap of that name. The message lists the existing ones."""


class Colormap:
    """Map from fractions to colours."""

    def __init__(self, name: str, colors: NDArray[np.uint8]) -> None:
        self.name = name
        self._colors = colors

    def __call__(self, fractions: ArrayLike) -> NDArray[np.uint8]:
        """Return the colours at `fractions` (any shape), clipped to 0 to 1: red green blue in a last axis.

        NaN has the colour of 0.
        """
        finite = np.nan_to_num(np.asarray(fractions, dtype=np.float64), nan=0.0)
        clipped = np.clip(finite, 0.0, 1.0)
        return self._colors[np.rint(clipped * 255.0).astype(np.intp)]

    def rgb(self, fraction: float) -> tuple[int, int, int]:
        """Return the colour at `fraction`."""
        red, green, blue = self(fraction).tolist()
        return (red, green, blue)


def names() -> tuple[str, ...]:
    """Return all names. Each also exists reversed, with `_r`."""
    return tuple(_TABLES)


@lru_cache(maxsize=64)
def colormap(name: str) -> Colormap:
    """Return the colormap `name`, such as `viridis`, or `viridis_r` for the reversed one.

    Raises:
        UnknownColormapError: If there is none. The message lists the existing ones.
    """
    table = _TABLES.get(name.removesuffix(REVERSED))
    if table is None:
        raise UnknownColormapError(
            f"there is no colormap {name!r}; use one of {', '.join(_TABLES)}, with _r for reversed"
        )
    nodes = np.frombuffer(bytes.fromhex(table), dtype=np.uint8).reshape(NODES, 3)
    node_fractions = np.linspace(0.0, 1.0, NODES)
    fractions = np.linspace(0.0, 1.0, 256)
    colors = np.empty((len(fractions), 3), dtype=np.uint8)
    for channel in range(3):
        colors[:, channel] = np.rint(np.interp(fractions, node_fractions, nodes[:, channel]))
    if name.endswith(REVERSED):
        colors = np.ascontiguousarray(colors[::-1])
    return Colormap(name, colors)
