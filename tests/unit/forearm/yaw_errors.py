"""Table of the yaw's error over simulated arms, for the documents: `python -m tests.unit.forearm.yaw_errors`.

Takes minutes: not in CI. Each row: median and 95 % of the error of the arms that have an estimate, and the
share of them within 2 sigma.
"""

import argparse
import math

import numpy as np

from tests.unit.forearm.simulated_arm import Arm, pointing, small, waving

FIRST_SEED = 1000
"""First seed for claims: the tests have smaller ones."""
MOVEMENTS = {
    "waving for 2 s": (waving, 2.0),
    "pointing about for 5 s": (pointing, 5.0),
    "pointing about for 15 s": (pointing, 15.0),
    "small movements for 5 s": (small, 5.0),
}
LASTING_S = (0.0, 1.0)
"""Times for which errors of the IMU last."""


def main() -> None:
    """Print a row for each movement and time for which errors last."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--arms", type=int, default=100, help="arms for each row")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="first seed")
    parser.add_argument("--movement", choices=MOVEMENTS, action="append", help="only this; may be repeated")
    options = parser.parse_args()
    for name in options.movement or MOVEMENTS:
        make, duration_s = MOVEMENTS[name]
        for lasting_s in LASTING_S:
            errors_deg: list[float] = []
            within: list[bool] = []
            for seed in range(options.seed, options.seed + options.arms):
                arm = Arm(seed, delay_s=0.02 * (seed % 3), error_time_s=lasting_s)
                arm.move(make(arm.dice), duration_s)
                if (estimate := arm.estimator.estimate(arm.now_ns)) is not None:
                    errors_deg.append(math.degrees(arm.error_rad()))
                    within.append(arm.error_rad() < 2.0 * estimate.sigma_rad)
            median, most = np.quantile(errors_deg, (0.5, 0.95))
            print(  # noqa: T201
                f"{name}, errors of the IMU last {lasting_s:g} s: {len(errors_deg)} of {options.arms} arms, "
                f"{median:.2f}°, {most:.2f}°, {np.mean(within):.0%} within 2 sigma",
                flush=True,
            )


if __name__ == "__main__":
    main()
