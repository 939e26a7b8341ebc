"""Decompressors stand in one module, where each has a limit."""

import ast

from tests.architecture.sources import module_name, shipped, tree

LIMITED = "pointit.runtime.host.unpacking"
UNPACKING_MODULES = {"bz2", "lzma", "tarfile", "zipfile", "lz4", "brotli", "snappy", "backports"}
"""Modules that are used to unpack only."""
UNPACKING_CALLS = {"decompress", "decompressobj", "ZstdDecompressor", "GzipFile", "unpack_archive"}
"""Functions of modules that also pack or have checksums: gzip, zlib and zstandard."""


def test_data_are_unpacked_in_one_module() -> None:
    found: list[str] = []
    for path in shipped():
        module = module_name(path)
        if module == LIMITED:
            continue
        for node in ast.walk(tree(path)):
            names: set[str] = set()
            if isinstance(node, ast.Import):
                names = {each.name.partition(".")[0] for each in node.names} & UNPACKING_MODULES
            elif isinstance(node, ast.ImportFrom):
                names = {str(node.module).partition(".")[0]} & UNPACKING_MODULES
                names |= {each.name for each in node.names} & UNPACKING_CALLS
            elif isinstance(node, ast.Attribute):
                names = {node.attr} & UNPACKING_CALLS
            found += [f"{module}: {name}" for name in names]
    assert not found, f"use {LIMITED}"
