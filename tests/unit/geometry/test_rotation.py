"""Rotations, compared with SciPy's."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion

angles = st.floats(-3.1, 3.1)
quaternions = st.builds(rotation.from_roll_pitch_yaw, angles, angles, angles)


@given(quaternions, quaternions)
def test_angle_between_is_that_of_scipy_for_both_signs(a: Quaternion, b: Quaternion) -> None:
    wanted_rad = float((Rotation.from_quat(a).inv() * Rotation.from_quat(b)).magnitude())
    x, y, z, w = b

    assert rotation.angle_between(a, b) == pytest.approx(wanted_rad, abs=1e-7)
    assert rotation.angle_between(a, (-x, -y, -z, -w)) == pytest.approx(wanted_rad, abs=1e-7)
