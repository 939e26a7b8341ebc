"""Lengths of a person's body from their stature, standing or seated."""

import math
from collections.abc import Mapping

from pointit.schemas import BodyMeasures

DEFAULT_STATURE_M = 1.835
"""Stature of the default measures (pointing.md §1), m."""

SITTING_HEIGHT = 0.520
"""Height from the seat to the crown, as a share of the stature: men 0.5205, women 0.5229 (Gordon et al., 1988
Anthropometric Survey of U.S. Army Personnel, 1989). Sitting down lowers the neck by the rest of the stature,
less the height of the seat."""
SEAT_HEIGHT = 0.247
"""Popliteal height in the same survey: height of a seat on which the feet stand flat, as a share."""

MIN_REACH_M = 0.05
"""Minimum distance of the finger of a straight arm beyond the eyes, m."""


def measures(
    stature_m: float,
    given_m: Mapping[str, float],
    *,
    ray_model: str = "eye_finger",
    seated: bool = False,
    seat_height_m: float | None = None,
) -> BodyMeasures:
    """Return the lengths for `stature_m`. Those in `given_m` replace the scaled ones.

    Raises:
        ValueError: If they contradict each other. The message says which, and what to do.
    """
    if seat_height_m is not None and not seated:
        raise ValueError(
            f"seat_height_m ({seat_height_m}) is given, but the person stands: set seated, or leave it out"
        )
    if seated and "footprint_to_neck_m" in given_m:
        raise ValueError(
            f"body.footprint_to_neck_m ({given_m['footprint_to_neck_m']}) and seated exclude each other: "
            "give that height as it is when sitting and leave seated out, or give stature_m"
        )
    factor = stature_m / DEFAULT_STATURE_M
    scaled = {name: factor * value for name, value in BodyMeasures().model_dump().items()}
    if seated:
        seat_m = SEAT_HEIGHT * stature_m if seat_height_m is None else seat_height_m
        scaled["footprint_to_neck_m"] += seat_m - (1.0 - SITTING_HEIGHT) * stature_m
    body = BodyMeasures(**{**scaled, **given_m})
    arm_m = body.shoulder_to_wrist_m + body.wrist_to_finger_m
    to_eyes_m = math.hypot(body.neck_to_shoulder_m, body.neck_to_eyes_m)
    if ray_model == "eye_finger" and arm_m < to_eyes_m + MIN_REACH_M:
        raise ValueError(
            f"an arm of {arm_m:.2f} m does not reach past eyes {to_eyes_m:.2f} m from the shoulder: correct "
            "body.shoulder_to_wrist_m or body.neck_to_eyes_m, or choose another ray_model"
        )
    return body
