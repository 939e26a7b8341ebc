"""Yaw of a person's frame {H} from a marker body on the forearm, by least squares. Pure.

The orientation of an IMU has errors that stay similar for seconds. They average out slowly, and a slow
movement cannot be told from them. Each residual is therefore the sum of white noise, whose variance is that
inside short blocks of time, and of a lasting error with a covariance that decays exponentially with time.
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
    starts = np.flatnonzero(np.diff(linearization.stamps_ns // BLOCK_NS, prepend=-1))
    if len(starts) < MIN_BLOCKS:
        return None
    sizes = np.add.reduceat(linearization.weights, starts)
    ages_s = (linearization.stamps_ns - linearization.stamps_ns[-1]) / NS_PER_S
    count = len(starts)
    values = np.column_stack(
        [linearization.columns.reshape(len(ages_s), -1), linearization.residuals, ages_s]
    )
    means = np.add.reduceat(values * linearization.weights[:, None], starts) / sizes[:, None]
    block_of = np.repeat(np.arange(count), np.diff(starts, append=len(ages_s)))
    within = (linearization.residuals - means[block_of, -4:-1]) ** 2
    freedom = 3 * max(1, len(ages_s) - count)
    white = max(MIN_WHITE_RAD**2, float((linearization.weights[:, None] * within).sum()) / freedom)
    apart_s = np.abs(means[:, -1, None] - means[None, :, -1])
    steps = list[Array]()
    variances = list[float]()
    scores = list[float]()
    for sigma_rad, time_s in LASTING_ERRORS:
        covariance = np.diag(white / sizes) + sigma_rad**2 * np.exp(-apart_s / time_s)
        root = np.linalg.cholesky(covariance)
        whitened = solve_triangular(root, means[:, :-1], lower=True, check_finite=False)
        matrix = whitened[:, :-3].reshape(3 * count, -1)
        residuals = whitened[:, -3:].ravel()
        information = matrix.T @ matrix + linearization.precision
        try:
            inverse = np.linalg.inv(information)
        except np.linalg.LinAlgError:  # level turns without any noise, of simulations: the yaw does not show
            return None
        step = inverse @ (matrix.T @ residuals - linearization.precision @ linearization.offset)
        left = residuals - matrix @ step
        offset = linearization.offset + step
        misfit = float(left @ left) + float(offset @ linearization.precision @ offset)
        log_volume = 6.0 * float(np.log(np.diag(root)).sum()) + float(np.linalg.slogdet(information)[1])
        steps.append(step)
        scores.append(-0.5 * (misfit + log_volume))
        shown = 1.0 / float(inverse[0, 0]) - 2.0 * count  # noise of the turns themselves shows no yaw
        variances.append(1.0 / shown if shown > 0.0 else math.inf)
    likelihoods = np.exp(np.array(scores) - max(scores))
    likely = likelihoods > MIN_PROBABILITY * likelihoods.sum()
    shares = likelihoods[likely] / likelihoods[likely].sum()
    step = shares @ np.array(steps)[likely]
    spread = (np.array(steps)[likely, 0] - step[0]) ** 2
    variance = MIN_SIGMA_RAD**2 + float(shares @ (np.array(variances)[likely] + spread))
    return YawStep(step, variance) if math.isfinite(variance) else None


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
        return ForearmYawEstimate(self.yaw_rad, math.hypot(self.sigma_rad, drift_rad), now_ns, self.delay_s)


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
        if len(self._pairs) >= MIN_PAIRS and self._pairs[-1].stamp_ns - self._solved_ns >= SOLVE_PERIOD_NS:
            self._solved_ns = self._pairs[-1].stamp_ns
            fit = _solve(list(self._pairs))
            old = self._estimate and self._estimate.aged(self._solved_ns)
            if isinstance(fit, _Fit) and (old is None or _replaces(fit.estimate, old)):
                self._estimate, self._mount_rotation, self._level_rad, self._reason = *fit, 0.0, ""
            elif old is None:
                self._reason = fit if isinstance(fit, str) else self._reason
        estimate = self._estimate and self._estimate.aged(now_ns)
        if estimate is None or self._level_rad <= SWITCH_SIGMAS * estimate.sigma_rad:
            return estimate
        return replace(estimate, sigma_rad=math.hypot(estimate.sigma_rad, self._level_rad))

    def _end_contradicted(self) -> None:
        """End the estimate if the newest samples contradict it: most by more than noise and drift explain."""
        old = self._estimate
        mount = self._mount_rotation
        newest = self._newest
        if old is None or mount is None or len(newest) < MIN_CONTRADICTIONS:
            return
        now_ns = newest[-1].stamp_ns
        if now_ns - self._checked_ns < CHECK_PERIOD_NS:
            return
        self._checked_ns, old = now_ns, old.aged(now_ns)
        turns = _Turns.of(newest)
        residuals = turns.residuals(old.yaw_rad, mount, old.delay_s)
        self._level_rad = abs(float(np.median(residuals[:, 2])))
        squares = (residuals**2).mean(axis=1)
        if float(np.median(squares)) > MAX_NOISE_RAD**2 + old.sigma_rad**2:
            turned_deg = math.degrees(float(np.median(np.linalg.norm(residuals, axis=1))))
            self._pairs.clear()
            newest.clear()
            self._estimate = self._mount_rotation = None
            self._level_rad = 0.0
            self._reason = f", as wrist and body have turned by {turned_deg:.0f}° against each other:"

    def _match(self) -> None:
        while self._arms and self._bodies and self._arms[0][0] <= self._bodies[-1][0]:
            stamp_ns, arm = self._arms.popleft()
            after = bisect.bisect_left(self._bodies, stamp_ns, key=lambda each: each[0])
            (begin_ns, first), (end_ns, second) = self._bodies[max(0, after - 1)], self._bodies[after]
            if begin_ns > stamp_ns or end_ns - begin_ns > MAX_GAP_NS:
                continue
            share = (stamp_ns - begin_ns) / max(1, end_ns - begin_ns)
            body = (1.0 - share) * first + share * (second if first @ second >= 0.0 else -second)
            self._add(stamp_ns, arm, body / np.linalg.norm(body))

    def _add(self, stamp_ns: int, arm: Array, body: Array) -> None:
        if self._recent and stamp_ns - self._recent[-1][0] > 4 * MAX_GAP_NS:
            self._recent.clear()
        self._recent.append((stamp_ns, arm, body))
        if len(self._recent) < (self._recent.maxlen or 0):
            return
        middle_ns, arm, body = self._recent[2]
        (begin_ns, _, first), (end_ns, _, last) = self._recent[0], self._recent[-1]
        pair = _Pair(middle_ns, arm, body, first, last, (end_ns - begin_ns) / NS_PER_S)
        newest = self._newest
        if not newest or middle_ns - newest[-1].stamp_ns >= CONTRADICTION_STEP_NS:
            newest.append(pair)
            while middle_ns - newest[0].stamp_ns > CONTRADICTION_NS:
                newest.popleft()
        if self._pairs:
            moved = 2.0 * math.acos(min(1.0, abs(float(body @ self._pairs[-1].body)))) >= MIN_TURN_RAD
            self._moved_ns = middle_ns if moved else self._moved_ns
            if middle_ns - self._moved_ns > HOLD_NS:
                return
        self._pairs.append(pair)


def _replaces(new: ForearmYawEstimate, old: ForearmYawEstimate) -> bool:
    apart_rad = abs(math.remainder(new.yaw_rad - old.yaw_rad, math.tau))
    return new.sigma_rad <= old.sigma_rad or apart_rad > SWITCH_SIGMAS * math.hypot(
        new.sigma_rad, old.sigma_rad
    )


class _Turns(NamedTuple):
    """Orientations of arm and body, and the angular velocity of the body, rad/s."""

    arm_rotations: Rotation
    body_rotations: Rotation
    rates: Array

    @classmethod
    def of(cls, pairs: Sequence[_Pair]) -> "_Turns":
        before = Rotation.from_quat([each.before for each in pairs])
        after = Rotation.from_quat([each.after for each in pairs])
        return cls(
            Rotation.from_quat([each.arm for each in pairs]),
            Rotation.from_quat([each.body for each in pairs]),
            (after * before.inv()).as_rotvec() / np.array([[each.turn_s] for each in pairs]),
        )

    def residuals(self, yaw_rad: float, mount_rotation: Rotation, delay_s: float) -> Array:
        """Return the turns (n x 3) in {W} by which the bodies differ from an estimate, rad."""
        turned = Rotation.from_rotvec((0.0, 0.0, yaw_rad)) * self.arm_rotations
        return np.asarray(
            (self.body_rotations * (turned * mount_rotation).inv()).as_rotvec() - delay_s * self.rates
        )


class _Fit(NamedTuple):
    estimate: ForearmYawEstimate
    mount_rotation: Rotation


def _solve(pairs: list[_Pair]) -> _Fit | str | None:
    """Return the yaw of the latest pair, by least squares over all.

    Returns the reason if the turns do not agree, None if they do not show the yaw.
    """
    turns = _Turns.of(pairs)
    arms, bodies, rates = turns
    stamps_ns = np.array([each.stamp_ns for each in pairs], dtype=np.int64)
    columns = np.zeros((len(pairs), 3, 6))
    columns[:, 2, 0] = 1.0
    columns[:, :, 4] = rates
    columns[:, 2, 5] = (stamps_ns - stamps_ns[-1]) / NS_PER_S
    parameters = np.zeros(6)  # yaw, turn of the mount (3), delay, drift of the yaw
    parameters[0] = _first_yaw(arms, bodies)
    mount = ((Rotation.from_rotvec((0.0, 0.0, parameters[0])) * arms).inv() * bodies).mean()

    def linearize() -> Linearization:
        turned = Rotation.from_rotvec((0.0, 0.0, parameters[0])) * arms
        residuals = turns.residuals(parameters[0], mount, parameters[4])
        residuals[:, 2] -= parameters[5] * columns[:, 2, 5]
        columns[:, :, 1:4] = turned.as_matrix()
        lengths = np.linalg.norm(residuals, axis=1)
        limit_rad = 3.0 * max(NOISE_RAD, float(np.median(lengths)))
        weights = np.minimum(1.0, limit_rad / np.maximum(lengths, 1e-12))
        offset = np.array((0.0, 0.0, 0.0, 0.0, *parameters[4:]))
        return Linearization(stamps_ns, weights, columns, residuals, PRECISION, offset)

    linearization = linearize()
    for _ in range(ITERATIONS):
        step = _white_step(linearization)
        mount = Rotation.from_rotvec(step[1:4]) * mount
        parameters += step
        linearization = linearize()
    if float((linearization.residuals**2).mean()) > MAX_NOISE_RAD**2:
        return DISAGREEMENT
    result = solve_lasting(linearization)
    if result is None:
        return None
    parameters += result.parameters
    yaw_rad = math.remainder(float(parameters[0]), math.tau)
    sigma_rad = math.sqrt(result.variance)
    estimate = ForearmYawEstimate(yaw_rad, sigma_rad, pairs[-1].stamp_ns, float(parameters[4]))
    return _Fit(estimate, Rotation.from_rotvec(result.parameters[1:4]) * mount)


def _white_step(linearization: Linearization) -> Array:
    """Return the correction of the parameters as if all errors were independent."""
    matrix = linearization.columns.reshape(-1, 6)
    weighted = matrix * np.repeat(linearization.weights, 3)[:, None]
    information = weighted.T @ matrix + NOISE_RAD**2 * PRECISION
    gradient = weighted.T @ linearization.residuals.ravel() - NOISE_RAD**2 * PRECISION @ linearization.offset
    return np.linalg.lstsq(information, gradient, rcond=None)[0].astype(np.float64)


def _first_yaw(arm_rotations: Rotation, body_rotations: Rotation) -> float:
    """Return the yaw by which the axes of turns agree. How the body sits on the arm does not matter."""
    chosen = np.linspace(0, len(arm_rotations) - 1, min(len(arm_rotations), 40)).astype(int)
    first, second = np.triu_indices(len(chosen), 1)
    first = chosen[first]
    second = chosen[second]
    a = (arm_rotations[second] * arm_rotations[first].inv()).as_rotvec()
    b = (body_rotations[second] * body_rotations[first].inv()).as_rotvec()
    across = float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    return math.atan2(across, float((a[:, :2] * b[:, :2]).sum()))
