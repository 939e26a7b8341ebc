"""Runs seeds of the simulated site, as docs/explanation/simulation.md describes."""

import ctypes
import os
import sys

HASH_SEED = "PYTHONHASHSEED"
NO_RANDOM_ADDRESSES = 0x0040000
"""ADDR_NO_RANDOMIZE of Linux' personality(2)."""

if os.environ.get(HASH_SEED) != "0":
    # Sets of strings, and of objects by their addresses, then have one order in each run
    ctypes.CDLL(None).personality(NO_RANDOM_ADDRESSES)
    environment = {**os.environ, HASH_SEED: "0", "OPENBLAS_NUM_THREADS": "1"}
    os.execve(sys.executable, [sys.executable, "-m", "tests.simulation", *sys.argv[1:]], environment)  # noqa: S606

from tests.simulation.kernel import patched_python  # noqa: E402

patched_python.install()  # before any module of PointIt is imported

from tests.simulation.run.command import main  # noqa: E402

raise SystemExit(main())
