"""Types of arrays of numbers, of indices and of truth values."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers. Docstrings state shape, unit and frame."""
Indices = NDArray[np.intp]
"""Positions in another array."""
Mask = NDArray[np.bool_]
"""Truth values that select from another array."""
