"""Yaw of a person's frame {H} from a marker body on the forearm, by least squares. Pure.

The orientation of an IMU has errors that stay similar for seconds. They average out slowly, and a slow
movement cannot be distinguished from them. Each residual is therefore the sum of white noise, whose variance
is that inside short blocks of time, and of a lasting error with a covariance that decays exponentially.
Size and duration of the lasting error are not known: the results for all of `LASTING_ERRORS` are averaged,
each weighted by its probability under the residuals (restricted likelihood).

Both see the same turns of the arm, in frames that differ by the yaw: W = Rz(yaw) · H · C, with the
orientations W of the body and H of the arm, and the constant C of the body on the arm. Yaw, its drift, C and
the delay between both are estimated together by least squares from the last turns. An arm at rest, or one
that only turns level, does not show the yaw: then there is no estimate.
"""

import bisect
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.spatial.transform import Rotation

from pointit.geometry.array_types import Array
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S

BLOCK_NS = NS_PER_S // 10
"""Duration of a block, within which a lasting error does not change, ns."""
LASTING_ERRORS = tuple(
    (math.radians(sigma_deg), time_s)
    for sigma_deg in (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
    for time_s in (0.3, 1.0, 4.0)
)
"""1 sigma, rad, and correlation time, s, of the lasting errors that are considered equally probable."""
MIN_BLOCKS = 10
"""Number of blocks, 1 s of movement, below which the parameters fit anything."""
MIN_WHITE_RAD = math.radians(0.05)
"""Least white noise, 1 sigma."""
MIN_SIGMA_RAD = math.radians(0.1)
"""Least 1 sigma of a yaw: errors that are constant do not show."""
MIN_PROBABILITY = 0.01
"""Probability of a lasting error below which its result is left out."""

MAX_GAP_NS = NS_PER_S // 20
"""Largest time between two orientations of the body between which one is interpolated, ns."""
MIN_TURN_RAD = math.radians(2.0)
"""Turn after which an orientation is stored, so that a resting arm replaces nothing."""
HOLD_NS = NS_PER_S
"""Time for which an arm that came to rest still adds orientations, ns."""
MAX_PAIRS = 600
"""Number of stored orientations, 12 s of a moving arm at 50 Hz."""
SOLVE_PERIOD_NS = NS_PER_S // 2
"""Least time between two estimates, ns."""
MIN_PAIRS = 12
MAX_AGE_NS = 60 * NS_PER_S
"""Age at which a stored orientation is dropped, since the IMU's yaw drifts."""
DRIFT_RADPS = math.radians(0.03)
"""Assumed drift of the IMU's yaw, by which an estimate ages."""
DELAY_SIGMA_S = 0.05
"""1 sigma of the delay between IMU and body, before it is estimated."""
NOISE_RAD = math.radians(0.3)
"""Least noise of the difference of two orientations."""
MAX_NOISE_RAD = math.radians(3.0)
"""Largest difference of the two orientations, 1 sigma: beyond it, the body is not on the arm with the IMU."""
SWITCH_SIGMAS = 4.0
"""Difference from the estimate before, in its sigmas, at which a worse but newer one counts."""
ITERATIONS = 4
PRECISION = np.diag([0.0, 0.0, 0.0, 0.0, DELAY_SIGMA_S**-2, DRIFT_RADPS**-2])
"""Prior precision of yaw, turn of the mount, delay and drift."""
MAX_YAW_SIGMA_RAD = math.radians(1.0)
"""Largest 1 sigma of a yaw that is used for the first time since the IMU's yaw origin changed."""
MAX_LATER_SIGMA_RAD = math.radians(5.0)
"""The same later, while the arm rests and the IMU's yaw drifts."""
CONTRADICTION_NS = NS_PER_S
"""Time of the newest samples whose median difference from the estimate ends it, ns."""
CONTRADICTION_STEP_NS = CONTRADICTION_NS // 20
MIN_CONTRADICTIONS = 10
"""Number of samples, at most one each `CONTRADICTION_STEP_NS`, below which nothing is contradicted."""
CHECK_PERIOD_NS = NS_PER_S // 4
"""Least time between two comparisons of the newest samples with the estimate, ns."""
ANY_YAW_SIGMA_RAD = math.pi / math.sqrt(3.0)
"""1 sigma of a yaw of which nothing is known."""
DISAGREEMENT = ", as wrist and body turn differently: correct `up`, or wear both on one arm, and"
MOVE = "move the arm with the wrist and the body up, down and sideways for 5 s"
"""Advice if the yaw is not known."""


class Linearization(NamedTuple):
    """Residuals about an estimate, and their derivatives by the parameters."""

    stamps_ns: NDArray[np.int64]
    """Times (n), ascending."""
    weights: Array
    """Weights (n) of robust least squares, at most 1."""
    columns: Array
    """Derivatives (n x 3 x p) by parameters, the yaw first."""
    residuals: Array
    """Residuals (n x 3), rad."""
    precision: Array
    """Prior precision (p x p) of the parameters."""
    offset: Array
    """Parameters (p) less their prior means."""


class YawStep(NamedTuple):
    """Correction of an estimate."""

    parameters: Array
    """Difference from the estimate (p)."""
    variance: float
    """Variance of the yaw, rad²."""


def solve_lasting(linearization: Linearization) -> YawStep | None:
    """Return the correction of the estimate, or None if the turns are too few or only noise."""
    # Weighted means of blocks: of columns, residuals and times
    blocks = linearization.stamps_ns // BLOCK_NS
    starts = np.flatnonzero(np.diff(blocks, prepend=-1))
    count = len(starts)
    if count < MIN_BLOCKS:
        return None
    weights = linearization.weights[:, None]
    ages_s = (linearization.stamps_ns - linearization.stamps_ns[-1]) / NS_PER_S
    samples = len(ages_s)
    flat_columns = linearization.columns.reshape(samples, -1)
    values = np.column_stack([flat_columns, linearization.residuals, ages_s])
    sums = np.add.reduceat(values * weights, starts)
    sizes = np.add.reduceat(linearization.weights, starts)
    means = sums / sizes[:, None]

    # Variance of the white noise, from that inside the blocks
    block_samples = np.diff(starts, append=samples)
    block_of = np.repeat(np.arange(count), block_samples)
    mean_residuals = means[block_of, -4:-1]
    squares = (linearization.residuals - mean_residuals) ** 2
    freedom = 3 * max(1, samples - count)
    square_sum = float((weights * squares).sum())
    white = max(MIN_WHITE_RAD**2, square_sum / freedom)

    # Generalized least squares for each size and duration of the lasting error
    mean_ages_s = means[:, -1]
    apart_s = np.abs(mean_ages_s[:, None] - mean_ages_s)
    precision = linearization.precision
    steps = list[Array]()
    variances = list[float]()
    scores = list[float]()
    for sigma_rad, time_s in LASTING_ERRORS:
        lasting = sigma_rad**2 * np.exp(-apart_s / time_s)
        covariance = np.diag(white / sizes) + lasting
        root = np.linalg.cholesky(covariance)
        whitened = solve_triangular(root, means[:, :-1], lower=True, check_finite=False)
        matrix = whitened[:, :-3].reshape(3 * count, -1)
        residuals = whitened[:, -3:].ravel()
        information = matrix.T @ matrix + precision
        try:
            inverse = np.linalg.inv(information)
        except np.linalg.LinAlgError:  # level turns without any noise, of simulations: the yaw does not show
            return None
        prior_gradient = precision @ linearization.offset
        step = inverse @ (matrix.T @ residuals - prior_gradient)
        steps.append(step)

        # Restricted log-likelihood, up to a constant
        remaining = residuals - matrix @ step
        offset = linearization.offset + step
        prior_misfit = float(offset @ precision @ offset)
        misfit = float(remaining @ remaining) + prior_misfit
        log_root = float(np.log(np.diag(root)).sum())
        _, log_det = np.linalg.slogdet(information)
        log_volume = 6.0 * log_root + float(log_det)
        scores.append(-0.5 * (misfit + log_volume))

        # Noise of the turns themselves shows no yaw
        yaw_variance = float(inverse[0, 0])
        yaw_information = 1.0 / yaw_variance - 2.0 * count
        variances.append(1.0 / yaw_information if yaw_information > 0.0 else math.inf)

    return _average_step(steps, variances, scores)


def _average_step(
    steps: Sequence[Array], variances: Sequence[float], scores: Sequence[float]
) -> YawStep | None:
    """Return the mean of the probable `steps` by their log-likelihoods `scores`, None if it is unknown.

    The variance includes the spread of their yaws.
    """
    likelihoods = np.exp(np.array(scores) - max(scores))
    is_likely = likelihoods > MIN_PROBABILITY * likelihoods.sum()
    shares = likelihoods[is_likely] / likelihoods[is_likely].sum()
    likely_steps = np.array(steps)[is_likely]
    mean_step = shares @ likely_steps
    yaw_steps = likely_steps[:, 0]
    spreads = (yaw_steps - mean_step[0]) ** 2
    likely_variances = np.array(variances)[is_likely]
    variance = MIN_SIGMA_RAD**2 + float(shares @ (likely_variances + spreads))
    return YawStep(mean_step, variance) if math.isfinite(variance) else None


@dataclass(frozen=True)
class ForearmYawEstimate:
    """Azimuth of {H}'s x axis in {W}."""

    yaw_rad: float
    sigma_rad: float
    """1 sigma."""
    stamp_ns: int
    delay_s: float = 0.0
    """Time by which the IMU's stamps are later than the body's."""

    def aged(self, now_ns: int) -> "ForearmYawEstimate":
        """Return the estimate with its uncertainty at `now_ns`."""
        drift_rad = DRIFT_RADPS * max(0, now_ns - self.stamp_ns) / NS_PER_S
        sigma_rad = math.hypot(self.sigma_rad, drift_rad)
        return ForearmYawEstimate(self.yaw_rad, sigma_rad, now_ns, self.delay_s)


@dataclass(frozen=True)
class _Pair:
    """Orientations of arm and body at one time."""

    stamp_ns: int
    arm: Array
    body: Array
    before: Array
    """Orientation of the body shortly before, from which its angular velocity follows."""
    after: Array
    turn_s: float
    """Time from `before` to `after`, s."""


class ForearmYaw:
    """Estimates the yaw of one person from orientations as they come."""

    def __init__(self) -> None:
        self._epoch: int | None = None
        self._stated_estimate: ForearmYawEstimate | None = None
        self._clear()

    def _clear(self) -> None:
        self._bodies: deque[tuple[int, Array]] = deque(maxlen=512)
        self._arms: deque[tuple[int, Array]] = deque(maxlen=64)
        self._recent: deque[tuple[int, Array, Array]] = deque(maxlen=5)
        self._pairs: deque[_Pair] = deque(maxlen=MAX_PAIRS)
        self._estimate: ForearmYawEstimate | None = None
        self._arm_ns = 0
        self._solved_ns = 0
        self._moved_ns = 0
        self._is_known = False
        self._mount_rotation: Rotation | None = None
        """Orientation of the body on the arm, as estimated with the yaw."""
        self._newest: deque[_Pair] = deque(maxlen=CONTRADICTION_NS // CONTRADICTION_STEP_NS)
        self._checked_ns = 0
        self._level_rad = 0.0
        """Median level difference of the newest samples from the estimate."""
        self._reason = ""
        """Reason why there is no estimate, or `""`."""

    def known(self, now_ns: int) -> ForearmYawEstimate | None:
        """Return the estimate at `now_ns` if it is certain enough to be used, else None."""
        estimate = self.estimate(now_ns)
        limit_rad = MAX_LATER_SIGMA_RAD if self._is_known else MAX_YAW_SIGMA_RAD
        self._is_known = estimate is not None and estimate.sigma_rad <= limit_rad
        return estimate if self._is_known else None

    def stated(self, now_ns: int) -> ForearmYawEstimate | None:
        """Return `known`. Once after it is lost, return that any yaw is possible, else a pose would stay."""
        last = self._stated_estimate
        self._stated_estimate = self.known(now_ns)
        if self._stated_estimate is None and last is not None:
            return replace(last, sigma_rad=ANY_YAW_SIGMA_RAD, stamp_ns=now_ns)
        return self._stated_estimate

    def problem(self, person: str, now_ns: int) -> str:
        """Return a sentence if the yaw of `person` is not known, else `""`."""
        if self.known(now_ns) is not None:
            return ""
        estimate = self.estimate(now_ns)
        if estimate is None:
            reason = self._reason or ":"
            return f"the yaw of {person} is not known{reason} {MOVE}"
        sigma_deg = math.degrees(estimate.sigma_rad)
        limit_deg = math.degrees(MAX_YAW_SIGMA_RAD)
        return f"the yaw of {person} is uncertain by {sigma_deg:.1f}°, limit {limit_deg:.1f}°: {MOVE}"

    def add_arm(self, stamp_ns: int, orientation: Quaternion, epoch: int) -> None:
        """Add the orientation of the arm in {H}. Another `epoch` than before is another yaw: begin again."""
        if epoch != self._epoch:
            self._clear()
            self._epoch = epoch
        if stamp_ns < self._arm_ns - NS_PER_S:  # the clock was set back
            self._clear()
        if stamp_ns > self._arm_ns:
            self._arm_ns = stamp_ns
            self._arms.append((stamp_ns, np.array(orientation)))
        self._match()

    def add_body(self, stamp_ns: int, orientation: Quaternion) -> None:
        """Add the orientation of the body in {W}."""
        if not self._bodies or stamp_ns > self._bodies[-1][0]:
            self._bodies.append((stamp_ns, np.array(orientation)))
            self._match()

    def estimate(self, now_ns: int) -> ForearmYawEstimate | None:
        """Return the best estimate at `now_ns`, or None if there is none yet."""
        while self._pairs and now_ns - self._pairs[0].stamp_ns > MAX_AGE_NS:
            self._pairs.popleft()
        self._end_contradicted()
        if len(self._pairs) >= MIN_PAIRS:
            newest_ns = self._pairs[-1].stamp_ns
            if newest_ns - self._solved_ns >= SOLVE_PERIOD_NS:
                self._solved_ns = newest_ns
                self._update_estimate(_solve(list(self._pairs)))
        estimate = self._estimate and self._estimate.aged(now_ns)
        if estimate is None or self._level_rad <= SWITCH_SIGMAS * estimate.sigma_rad:
            return estimate

        # The newest samples differ more than the estimate admits, but not enough to end it
        return replace(estimate, sigma_rad=math.hypot(estimate.sigma_rad, self._level_rad))

    def _update_estimate(self, fit: "_Fit | str | None") -> None:
        """Replace the estimate by a better `fit`. Without an estimate, store the reason why there is none."""
        previous = self._estimate and self._estimate.aged(self._solved_ns)
        if isinstance(fit, _Fit):
            if previous is None or _replaces(fit.estimate, previous):
                self._estimate = fit.estimate
                self._mount_rotation = fit.mount_rotation
                self._level_rad = 0.0
                self._reason = ""
        elif previous is None and fit is not None:
            self._reason = fit

    def _end_contradicted(self) -> None:
        """End the estimate if the newest samples contradict it: most by more than noise and drift explain."""
        mount = self._mount_rotation
        newest = self._newest
        if self._estimate is None or mount is None or len(newest) < MIN_CONTRADICTIONS:
            return
        now_ns = newest[-1].stamp_ns
        if now_ns - self._checked_ns < CHECK_PERIOD_NS:
            return
        self._checked_ns = now_ns

        # Medians, so that a few wrong samples do not count. That about the vertical also makes the estimate
        # less certain: see `estimate`.
        estimate = self._estimate.aged(now_ns)
        turns = _Turns.of(newest)
        residuals = turns.residuals(estimate.yaw_rad, mount, estimate.delay_s)
        vertical_rad = float(np.median(residuals[:, 2]))
        self._level_rad = abs(vertical_rad)
        squares = (residuals**2).mean(axis=1)
        limit = MAX_NOISE_RAD**2 + estimate.sigma_rad**2
        if float(np.median(squares)) > limit:
            turns_rad = np.linalg.norm(residuals, axis=1)
            turned_deg = math.degrees(float(np.median(turns_rad)))
            self._pairs.clear()
            newest.clear()
            self._estimate = self._mount_rotation = None
            self._level_rad = 0.0
            self._reason = f", as wrist and body have turned by {turned_deg:.0f}° against each other:"

    def _match(self) -> None:
        """Interpolate the body at the times of the arm, once it is known after them."""
        while self._arms and self._bodies and self._arms[0][0] <= self._bodies[-1][0]:
            stamp_ns, arm = self._arms.popleft()
            index = bisect.bisect_left(self._bodies, stamp_ns, key=lambda body: body[0])
            before_ns, before = self._bodies[max(0, index - 1)]
            after_ns, after = self._bodies[index]
            if before_ns > stamp_ns or after_ns - before_ns > MAX_GAP_NS:
                continue

            # Both signs of a quaternion are the same rotation: the nearer one
            share = (stamp_ns - before_ns) / max(1, after_ns - before_ns)
            near_after = after if before @ after >= 0.0 else -after
            body = (1.0 - share) * before + share * near_after
            self._add_pair(stamp_ns, arm, body / np.linalg.norm(body))

    def _add_pair(self, stamp_ns: int, arm: Array, body: Array) -> None:
        """Store orientations of arm and body at one time, once those after them show the angular velocity."""
        # The middle of the recent ones, without a long gap between
        if self._recent and stamp_ns - self._recent[-1][0] > 4 * MAX_GAP_NS:
            self._recent.clear()
        self._recent.append((stamp_ns, arm, body))
        if len(self._recent) < (self._recent.maxlen or 0):
            return
        begin_ns, _, first_body = self._recent[0]
        middle_ns, middle_arm, middle_body = self._recent[2]
        end_ns, _, last_body = self._recent[-1]
        turn_s = (end_ns - begin_ns) / NS_PER_S
        pair = _Pair(middle_ns, middle_arm, middle_body, first_body, last_body, turn_s)

        # Those that may contradict the estimate, also at rest
        newest = self._newest
        if not newest or middle_ns - newest[-1].stamp_ns >= CONTRADICTION_STEP_NS:
            newest.append(pair)
            while middle_ns - newest[0].stamp_ns > CONTRADICTION_NS:
                newest.popleft()

        # Those of which the estimate is made, only while the arm moves
        if self._pairs:
            last_pair = self._pairs[-1]
            cosine = min(1.0, abs(float(middle_body @ last_pair.body)))
            turn_rad = 2.0 * math.acos(cosine)
            if turn_rad >= MIN_TURN_RAD:
                self._moved_ns = middle_ns
            if middle_ns - self._moved_ns > HOLD_NS:
                return
        self._pairs.append(pair)


def _replaces(new: ForearmYawEstimate, old: ForearmYawEstimate) -> bool:
    """Return True if `new` is at least as certain, or contradicts the older estimate."""
    if new.sigma_rad <= old.sigma_rad:
        return True
    apart_rad = abs(math.remainder(new.yaw_rad - old.yaw_rad, math.tau))
    return apart_rad > SWITCH_SIGMAS * math.hypot(new.sigma_rad, old.sigma_rad)


class _Turns(NamedTuple):
    """Orientations of arm and body, and the angular velocity of the body, rad/s."""

    arm_rotations: Rotation
    body_rotations: Rotation
    rates: Array

    @classmethod
    def of(cls, pairs: Sequence[_Pair]) -> "_Turns":
        arms = Rotation.from_quat([pair.arm for pair in pairs])
        bodies = Rotation.from_quat([pair.body for pair in pairs])
        before = Rotation.from_quat([pair.before for pair in pairs])
        after = Rotation.from_quat([pair.after for pair in pairs])
        turns_s = np.array([[pair.turn_s] for pair in pairs])
        rates = (after * before.inv()).as_rotvec() / turns_s
        return cls(arms, bodies, rates)

    def residuals(self, yaw_rad: float, mount_rotation: Rotation, delay_s: float) -> Array:
        """Return the turns (n x 3) in {W} by which the bodies differ from an estimate, rad."""
        turned_arms = _about_z(yaw_rad) * self.arm_rotations
        expected_bodies = turned_arms * mount_rotation
        differences = (self.body_rotations * expected_bodies.inv()).as_rotvec()
        return np.asarray(differences - delay_s * self.rates)


def _about_z(angle_rad: float) -> Rotation:
    """Return the rotation about z."""
    return Rotation.from_rotvec((0.0, 0.0, angle_rad))


class _Fit(NamedTuple):
    estimate: ForearmYawEstimate
    mount_rotation: Rotation


def _solve(pairs: list[_Pair]) -> _Fit | str | None:
    """Return the yaw of the latest pair, by least squares over all.

    Returns the reason if the turns do not agree, None if they do not show the yaw.
    """
    # Derivatives that do not depend on the parameters
    turns = _Turns.of(pairs)
    arms, bodies, rates = turns
    stamps_ns = np.array([pair.stamp_ns for pair in pairs], dtype=np.int64)
    columns = np.zeros((len(pairs), 3, 6))
    columns[:, 2, 0] = 1.0
    columns[:, :, 4] = rates
    ages_s = (stamps_ns - stamps_ns[-1]) / NS_PER_S
    columns[:, 2, 5] = ages_s

    # Start: yaw, turn of the mount (3), delay, drift of the yaw; and the mount that fits on average
    parameters = np.zeros(6)
    parameters[0] = _first_yaw(arms, bodies)
    turned_arms = _about_z(parameters[0]) * arms
    mount = (turned_arms.inv() * bodies).mean()

    def linearize() -> Linearization:
        turned = _about_z(parameters[0]) * arms
        residuals = turns.residuals(parameters[0], mount, parameters[4])
        residuals[:, 2] -= parameters[5] * ages_s
        columns[:, :, 1:4] = turned.as_matrix()
        lengths = np.linalg.norm(residuals, axis=1)
        limit_rad = 3.0 * max(NOISE_RAD, float(np.median(lengths)))
        weights = np.minimum(1.0, limit_rad / np.maximum(lengths, 1e-12))
        offset = np.array((0.0, 0.0, 0.0, 0.0, *parameters[4:]))
        return Linearization(stamps_ns, weights, columns, residuals, PRECISION, offset)

    # Gauss-Newton steps. The turn of the mount is applied to the mount itself: its sum has no meaning.
    linearization = linearize()
    for _ in range(ITERATIONS):
        step = _white_step(linearization)
        mount = Rotation.from_rotvec(step[1:4]) * mount
        parameters += step
        linearization = linearize()

    # A last step with errors that last
    if float((linearization.residuals**2).mean()) > MAX_NOISE_RAD**2:
        return DISAGREEMENT
    result = solve_lasting(linearization)
    if result is None:
        return None
    parameters += result.parameters
    mount = Rotation.from_rotvec(result.parameters[1:4]) * mount
    yaw_rad = math.remainder(float(parameters[0]), math.tau)
    sigma_rad = math.sqrt(result.variance)
    delay_s = float(parameters[4])
    estimate = ForearmYawEstimate(yaw_rad, sigma_rad, pairs[-1].stamp_ns, delay_s)
    return _Fit(estimate, mount)


def _white_step(linearization: Linearization) -> Array:
    """Return the correction of the parameters as if all errors were independent."""
    matrix = linearization.columns.reshape(-1, 6)
    weights = np.repeat(linearization.weights, 3)
    weighted = matrix * weights[:, None]
    precision = NOISE_RAD**2 * PRECISION
    information = weighted.T @ matrix + precision
    prior_gradient = precision @ linearization.offset
    gradient = weighted.T @ linearization.residuals.ravel() - prior_gradient
    solution, *_ = np.linalg.lstsq(information, gradient, rcond=None)  # yaw and mount may be undetermined
    return solution.astype(np.float64)


def _first_yaw(arm_rotations: Rotation, body_rotations: Rotation) -> float:
    """Return the yaw by which the axes of turns agree. How the body sits on the arm does not matter."""
    # Turns between all pairs of some samples, evenly over the time
    count = min(len(arm_rotations), 40)
    last = len(arm_rotations) - 1
    chosen = np.linspace(0, last, count).astype(int)
    first_indices, second_indices = np.triu_indices(count, 1)
    first = chosen[first_indices]
    second = chosen[second_indices]
    a = (arm_rotations[second] * arm_rotations[first].inv()).as_rotvec()
    b = (body_rotations[second] * body_rotations[first].inv()).as_rotvec()

    # Yaw that turns the level parts of one into those of the other, by least squares
    ax, ay, _ = a.T
    bx, by, _ = b.T
    cross = float((ax * by - ay * bx).sum())
    products = a[:, :2] * b[:, :2]
    dot = float(products.sum())
    return math.atan2(cross, dot)
