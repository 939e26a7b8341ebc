"""Recorded motion as other programs write it: each refusal names a parameter, and it works."""

from pathlib import Path

import numpy as np
import pytest

from pointit.geometry.rotation import from_yaw, inverse, multiply, rotate
from pointit.maps.units import UP_AXES
from pointit.runtime.errors import ConfigError
from pointit.sim.motion_table import MotionForm
from pointit.sim.recordings import read_imu_csv, read_robot_csv

COUNT = 30
RATE_HZ = 100
TIMES_S = [row / RATE_HZ for row in range(COUNT)]
TURNS = [from_yaw(0.5 * time_s) for time_s in TIMES_S]
"""Orientations, {H}."""
PLACES = [(1.5 + 0.4 * time_s, -0.75, 1.25) for time_s in TIMES_S]
"""Positions of the robot, {W}, m."""
BACK = inverse(UP_AXES["y"])
Y_UP_TURNS = [multiply(BACK, turn) for turn in TURNS]
Y_UP_PLACES = [rotate(BACK, place) for place in PLACES]


def csv(header: str, rows: list[list[float]], separator: str = ",") -> str:
    return header + "".join(separator.join(f"{value:.7g}" for value in row) + "\n" for row in rows)


MOTIVE = (
    "Format Version,1.23,Take Name,Take 1,Capture Frame Rate,100.0,Length Units,Millimeters\n\n"
    ",,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body\n"
    ",,Wrist,Wrist,Wrist,Wrist,Drone,Drone,Drone\n"
    ',,"AB12","AB12","AB12","AB12","CD34","CD34","CD34"\n'
    ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position\n"
    "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z\n"
)
STEAMVR = "stamp,px,py,pz,qw,qx,qy,qz,confidence\n"
QTM = (
    "NO_OF_FRAMES\t30\nFREQUENCY\t100\nTIME_STAMP\t2026-11-21, 12:30:07.001\nBODY_NAMES\tdrone\n"
    "Frame\tTime\tdrone X\tY\tZ\tResidual\n"
)
VICON = "Trajectories\n100\n,,drone:top,,\nFrame,Sub Frame,TX,TY,TZ\n,,mm,mm,mm\n"
NUMBERED = list(enumerate(TIMES_S))
EXCEL = "Zeit;qw;qx;qy;qz\r\n"
FILES: dict[str, tuple[str, dict[str, str]]] = {
    "optitrack_motive.csv": (
        csv(
            MOTIVE,
            [
                [n, time_s, *Y_UP_TURNS[n], *(1000 * value for value in Y_UP_PLACES[n])]
                for n, time_s in NUMBERED
            ],
        ),
        {"columns": "t=2,qx=3,qy=4,qz=5,qw=6,robot_x=7/mm,robot_y=8/mm,robot_z=9/mm", "up": "y"},
    ),
    "pandas.csv": (
        csv(",t,qx,qy,qz,qw,robot_x,robot_y,robot_z\n", [[n, t, *TURNS[n], *PLACES[n]] for n, t in NUMBERED]),
        {},
    ),
    "pandas_dates.csv": (
        ",stamp,qx,qy,qz,qw\n"
        + "".join(
            f"{n},2026-11-21 12:30:{7 + t:09.6f}+01:00,{','.join(f'{v:.7g}' for v in TURNS[n])}\n"
            for n, t in NUMBERED
        ),
        {"columns": "t=stamp/iso"},
    ),
    "excel_german.csv": (
        csv(EXCEL, [[1000 * t, TURNS[n][3], *TURNS[n][:3]] for n, t in NUMBERED], ";").replace(".", ","),
        {"columns": "t=Zeit/ms"},
    ),
    "logger_us.tsv": (
        csv("us\tw\tx\ty\tz\n", [[1e6 * t, TURNS[n][3], *TURNS[n][:3]] for n, t in NUMBERED], "\t"),
        {"columns": "t=us/us,qw=w,qx=x,qy=y,qz=z"},
    ),
    "frames_without_names.txt": (
        csv("", [[n, *TURNS[n], *PLACES[n]] for n, _ in NUMBERED], " "),
        {"columns": "t=1/0.01,qx=2,qy=3,qz=4,qw=5,robot_x=6,robot_y=7,robot_z=8"},
    ),
}
FILES["steamvr_log.csv"] = (
    STEAMVR
    + "".join(
        f"{1_700_000_000 + t:.3f},{','.join(f'{v:.7g}' for v in Y_UP_PLACES[n])},{Y_UP_TURNS[n][3]:.7g},"
        f"{','.join(f'{v:.7g}' for v in Y_UP_TURNS[n][:3])},1\n"
        for n, t in NUMBERED
    ),
    {"columns": "t=stamp,robot_x=px,robot_y=py,robot_z=pz", "up": "y"},
)
UNASKED = {"optitrack_motive.csv": ("up",), "steamvr_log.csv": ("up",)}
"""A robot and a wrist are as plausible on their sides: the documents name the parameter."""


@pytest.mark.parametrize("name", FILES)
def test_motion_is_read_right_or_refused_with_parameters_that_work(tmp_path: Path, name: str) -> None:
    content, parameters = FILES[name]
    path = tmp_path / name
    path.write_bytes(content.encode())
    missing = {**parameters}
    form = {each: missing.pop(each) for each in UNASKED.get(name, ())}
    while missing:
        with pytest.raises(ConfigError, match="|".join(f"set {each} to" for each in missing)) as caught:
            read_imu_csv(path, MotionForm.model_validate(form))
        named = next(each for each in missing if f"set {each} to" in str(caught.value))
        form[named] = missing.pop(named)

    recording = read_imu_csv(path, MotionForm.model_validate(form))
    np.testing.assert_allclose(recording.t_s, TIMES_S, atol=1e-5)
    np.testing.assert_allclose(recording.orientation_xyzw, TURNS, atol=1e-5)
    if "robot" in content + parameters.get("columns", ""):
        assert recording.robot_m is not None
        np.testing.assert_allclose(recording.robot_m, PLACES, atol=1e-4)


ROBOTS = {
    "qualisys.tsv": (
        csv(QTM, [[n + 1, t, *(1000 * value for value in PLACES[n]), 0.4] for n, t in NUMBERED], "\t"),
        "t=time,robot_x=drone X/mm,robot_y=Y/mm,robot_z=Z/mm",
    ),
    "vicon_nexus.csv": (
        csv(VICON, [[n, 0, *(1000 * value for value in PLACES[n])] for n, _ in NUMBERED]),
        "t=1/0.01,robot_x=3/mm,robot_y=4/mm,robot_z=5/mm",
    ),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_robot_is_read_with_the_columns_that_its_refusal_names(tmp_path: Path, name: str) -> None:
    content, columns = ROBOTS[name]
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(ConfigError, match="set columns to those of the file by name or number"):
        read_robot_csv(path)
    recording = read_robot_csv(path, MotionForm(columns=columns))
    assert recording.robot_m is not None
    np.testing.assert_allclose(recording.robot_m, PLACES, atol=1e-4)
