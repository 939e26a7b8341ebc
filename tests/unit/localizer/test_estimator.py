"""The solver: exact rays, bias, noise, outliers, reflections, origin, refusals, honesty, recordings."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.services.localizer.estimator import Pointings, Refusal, Solution, Trust, solve
from pointit.services.localizer.sphere import PARAMETERS, Rays, residuals
from pointit.sim.recordings import read_imu_csv
from tests.support.data import data_file
from tests.unit.localizer.person import EYES_M, Person, pointings, yaw_difference

CORNERS: tuple[Vec3, ...] = ((3.0, 2.0, 0.1), (-3.0, 2.5, 0.9), (-2.5, -3.0, 2.0), (3.0, -2.0, 0.1))
LAB: tuple[Vec3, ...] = (
    (3.572, -2.946, 2.08),
    (1.699, -2.609, 0.85),
    (0.762, -1.031, 0.15),
    (3.239, -0.606, 0.15),
)
UNLIMITED = Trust(max_position_sigma_m=1e6, max_yaw_sigma_rad=1e6)
LAX = Trust(max_position_sigma_m=1e6, max_yaw_sigma_rad=1e6, bias_sigma_rad=math.radians(30.0))

coordinates = st.floats(-2.0, 2.0)
angles = st.floats(-math.pi, math.pi)
far = st.floats(-1000.0, 1000.0)
biases = st.floats(math.radians(-10.0), math.radians(10.0))


def solved(given_pointings: Pointings, trust: Trust | None = None, floor_m: float = 0.0) -> Solution:
    result = solve(given_pointings, trust, floor_m=floor_m)
    assert isinstance(result, Solution), result
    return result


def refused(given_pointings: Pointings, trust: Trust | None = None) -> str:
    result = solve(given_pointings, trust)
    assert isinstance(result, Refusal), result
    return result.reason


def position_error_m(solution: Solution, person: Person) -> float:
    return math.hypot(solution.x_m - person.x, solution.y_m - person.y)


@settings(deadline=None)
@given(coordinates, coordinates, angles, biases)
def test_exact_rays_give_the_exact_pose(x: float, y: float, yaw_rad: float, bias_rad: float) -> None:
    person = Person(x, y, yaw_rad, bias_rad)
    assume(min(math.hypot(target[0] - x, target[1] - y) for target in CORNERS) > 0.5)
    # a vague prior: what is left of its pull is below a millimetre and a tenth of a degree
    solution = solved(pointings(person, CORNERS), dataclasses.replace(UNLIMITED, bias_sigma_rad=10.0))
    assert position_error_m(solution, person) < 1e-3
    assert abs(yaw_difference(solution.yaw_rad, yaw_rad)) < 1e-3
    assert abs(solution.bias_rad - bias_rad) < 2e-3
    assert solution.residual_rad < 1e-3


@settings(deadline=None)
@given(coordinates, coordinates, angles, st.tuples(far, far, st.floats(-20, 20)))
def test_the_world_origin_does_not_matter(x: float, y: float, yaw_rad: float, shift: Vec3) -> None:
    east, north, up = shift
    here = pointings(Person(x, y, yaw_rad), CORNERS, each=10, noise_rad=0.03)
    there = dataclasses.replace(here, targets_m=here.targets_m + np.array(shift))
    a, b = solved(here, LAX), solved(there, LAX, floor_m=up)
    assert b.x_m - a.x_m == pytest.approx(east, abs=1e-6)
    assert b.y_m - a.y_m == pytest.approx(north, abs=1e-6)
    assert abs(yaw_difference(a.yaw_rad, b.yaw_rad)) < 1e-6
    assert np.allclose(a.covariance, b.covariance, rtol=1e-6, atol=1e-9)


@settings(deadline=None)
@given(coordinates, coordinates, angles, angles)
def test_turning_the_imu_turns_only_the_yaw(x: float, y: float, yaw_rad: float, turn_rad: float) -> None:
    a = solved(pointings(Person(x, y, yaw_rad), CORNERS, noise_rad=0.03), LAX)
    b = solved(pointings(Person(x, y, yaw_rad - turn_rad), CORNERS, noise_rad=0.03), LAX)
    assert a.x_m == pytest.approx(b.x_m, abs=1e-6)
    assert a.y_m == pytest.approx(b.y_m, abs=1e-6)
    assert abs(yaw_difference(a.yaw_rad - turn_rad, b.yaw_rad)) < 1e-6
    assert np.allclose(a.covariance, b.covariance, rtol=1e-6, atol=1e-9)


@given(st.integers(0, 1000))
def test_the_jacobian_is_that_of_the_residuals(seed: int) -> None:
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(10, 3))
    rays = Rays.of(generator.normal(0, 0.1, (10, 3)), directions, generator.uniform(-4, 4, (10, 3)))
    poses = generator.normal(size=(3, PARAMETERS))
    angles_rad, jacobian = residuals(rays, poses)
    near = np.broadcast_to(np.linalg.norm(angles_rad, axis=1, keepdims=True) < 5.0, angles_rad.shape)
    for parameter in range(PARAMETERS):
        step = np.zeros(PARAMETERS)
        step[parameter] = 1e-6
        slope = (residuals(rays, poses + step)[0] - residuals(rays, poses - step)[0]) / 2e-6
        # opposite to the ray there is no slope
        assert np.allclose(slope[near], jacobian[:, parameter][near], rtol=1e-4, atol=1e-4)


@given(st.integers(0, 1000))
def test_the_residual_is_the_angle_nearly(seed: int) -> None:
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(1, 3))
    target = generator.uniform(-4, 4, (1, 3))
    angle_rad = vector.angle_between(tuple(directions[0]), tuple(target[0]))
    rays = Rays.of(np.zeros((1, 3)), directions, target)
    out, _ = residuals(rays, np.zeros((1, PARAMETERS)))
    assert float(np.linalg.norm(out)) == pytest.approx(2.0 * math.tan(angle_rad / 2.0), rel=1e-6, abs=1e-9)


def test_one_target_in_five_missed_by_20_degrees_hardly_moves_the_pose() -> None:
    targets = (*CORNERS, (0.5, 3.0, 0.5))
    person = Person(0.4, -0.6, 1.0)
    clean = pointings(person, targets)
    wrong = Person(0.4, -0.6, 1.0 - math.radians(20.0))
    directions = clean.directions.copy()
    directions[-50:] = wrong.direction(targets[-1])
    solution = solved(dataclasses.replace(clean, directions=directions), Trust(max_act_residual_rad=0.3))
    assert position_error_m(solution, person) < 0.2
    assert abs(yaw_difference(solution.yaw_rad, person.yaw_rad)) < math.radians(5.0)


@settings(deadline=None)
@given(st.integers(0, 10_000))
def test_no_reflected_pose_with_three_targets(seed: int) -> None:
    """In random rooms what is accepted is never in another place altogether; nobody stands on a target."""
    generator = np.random.default_rng(seed)
    x, y = generator.uniform(-3, 3, 2)
    targets = [
        (float(a), float(b), float(c)) for a, b, c in generator.uniform((-3, -3, 0), (3, 3, 2.2), (3, 3))
    ]
    assume(min(math.hypot(target[0] - x, target[1] - y) for target in targets) > 0.5)
    person = Person(float(x), float(y), float(generator.uniform(-math.pi, math.pi)))
    result = solve(pointings(person, targets, each=30, noise_rad=0.005, seed=seed))
    if isinstance(result, Solution):
        assert position_error_m(result, person) < 1.0


def test_the_stated_uncertainty_is_honest() -> None:
    """Errors constant while a lamp is lit, of people who scatter more or less about what is believed."""
    generator = np.random.default_rng(7)
    distances: list[float] = []
    far: list[float] = []
    turned: list[float] = []
    trust = dataclasses.replace(UNLIMITED, body_sigma_m=0.0, model_sigma_rad=0.0, max_act_residual_rad=9.0)
    trust = dataclasses.replace(trust, bias_sigma_limit=9.0)
    for trial in range(200):
        x, y = generator.uniform(-1.5, 1.5, 2)
        person = Person(float(x), float(y), float(trial))
        gathered = pointings(person, CORNERS, each=48, rate_hz=24.0)
        rays = Rays.of(gathered.origins_m, gathered.directions, gathered.targets_m)
        sigmas = np.array([trust.act_sigma_rad, trust.elevation_sigma_rad])
        sigmas *= math.sqrt(4.0 / generator.chisquare(4.0))
        off = np.repeat(generator.normal(0.0, sigmas, (4, 2)), 48, axis=0)
        azimuths, elevations = rays.azimuths_rad + off[:, 0], rays.elevations_rad + off[:, 1]
        level = np.cos(elevations)
        directions = np.column_stack([level * np.cos(azimuths), level * np.sin(azimuths), np.sin(elevations)])
        solution = solved(dataclasses.replace(gathered, directions=directions), trust)
        error = np.array([solution.x_m - person.x, solution.y_m - person.y])
        distances.append(float(error @ np.linalg.solve(solution.covariance[:2, :2], error)) / 2.0)
        far.append(float(np.linalg.norm(error)) / solution.position_sigma_m)
        turned.append(abs(yaw_difference(solution.yaw_rad, person.yaw_rad)) / solution.yaw_sigma_rad)
    assert 0.6 < math.sqrt(float(np.median(distances)) / math.log(2.0)) < 1.2
    assert 0.88 < float(np.mean(np.array(far) < 2.0)) < 0.98
    assert 0.87 < float(np.mean(np.array(turned) < 2.0)) < 0.98


def test_a_longer_hold_at_a_lamp_tells_no_more_and_longer_following_does() -> None:
    person = Person(0.0, 0.0, 0.5)
    trust = Trust(body_sigma_m=0.0, model_sigma_rad=0.0, max_position_sigma_m=9.0, max_yaw_sigma_rad=9.0)
    base = solved(pointings(person, CORNERS, each=50, rate_hz=25.0), trust)
    denser = solved(pointings(person, CORNERS, each=200, rate_hz=100.0), trust)
    longer = solved(pointings(person, CORNERS, each=200, rate_hz=25.0), trust)
    again = solved(pointings(person, CORNERS * 4, each=50, rate_hz=25.0), trust)
    assert denser.yaw_sigma_rad == pytest.approx(base.yaw_sigma_rad, rel=0.05)
    assert longer.yaw_sigma_rad == pytest.approx(base.yaw_sigma_rad, rel=0.05)
    assert again.yaw_sigma_rad == pytest.approx(base.yaw_sigma_rad / 2.3, rel=0.25)
    path = [
        (2.5 * math.cos(a), 2.5 * math.sin(a), 0.5 + 0.3 * math.sin(3.0 * a)) for a in np.arange(100) / 16
    ]
    shorter = solved(pointings(person, path, each=1, rate_hz=25.0), trust)
    slower = solved(pointings(person, path, each=4, rate_hz=25.0), trust)
    assert slower.yaw_sigma_rad == pytest.approx(shorter.yaw_sigma_rad / 2.0, rel=0.25)


def test_what_no_number_of_rays_tells_stays() -> None:
    person = Person(0.0, 0.0, 0.5)
    hour = solved(pointings(person, CORNERS, each=2000, rate_hz=1.0 / 0.45))
    assert hour.position_sigma_m > math.hypot(0.1, 0.05)
    near = tuple((x / 3.0, y / 3.0, z) for x, y, z in CORNERS)
    close = solved(pointings(person, near, each=2000, rate_hz=1.0 / 0.45))
    assert close.position_sigma_m > 0.1


def test_following_something_is_believed_more_than_pointing_at_things_that_stand() -> None:
    person = Person(0.0, 0.0, 0.5)
    angles_rad = np.linspace(0.0, math.tau, 200)
    still = pointings(person, CORNERS, each=50, rate_hz=25.0)
    path = tuple((2.5 * math.cos(a), 2.5 * math.sin(a), 0.5 + 0.3 * math.sin(3.0 * a)) for a in angles_rad)
    moving = pointings(person, path, each=1, rate_hz=25.0)
    assert solved(moving).yaw_sigma_rad < 0.7 * solved(still).yaw_sigma_rad


def test_a_start_near_the_solution_leads_to_the_same() -> None:
    gathered = pointings(Person(1.0, 0.5, 0.3), CORNERS, noise_rad=0.03)
    cold = solved(gathered)
    warm = solve(gathered, start=cold)
    assert isinstance(warm, Solution)
    assert warm.is_near(cold)
    assert warm.x_m == pytest.approx(cold.x_m, abs=1e-3)


def test_the_height_is_found_when_it_is_left_free_and_believed_otherwise() -> None:
    person = Person(0.4, -0.6, 1.0)
    gathered = pointings(person, (*CORNERS, (0.5, 3.0, 0.5)))
    raised = dataclasses.replace(gathered, targets_m=gathered.targets_m + np.array([0.0, 0.0, 0.4]))
    free = solved(raised, Trust(height_sigma_m=3.0, bias_sigma_rad=math.radians(1.0)))
    assert free.z_m == pytest.approx(0.4, abs=0.05)
    assert position_error_m(free, person) < 0.05
    assert free.z_sigma_m > 0.03
    assert abs(solved(raised, Trust(max_position_sigma_m=1.0)).z_m) < 0.1


def test_a_known_bias_makes_the_pose_surer() -> None:
    gathered = pointings(Person(0.4, -0.6, 1.0), CORNERS[:3])
    unknown, known = (
        solved(gathered, UNLIMITED),
        solved(gathered, dataclasses.replace(UNLIMITED, bias_sigma_rad=math.radians(1.0))),
    )
    assert known.position_sigma_m < unknown.position_sigma_m
    assert known.bias_sigma_rad < unknown.bias_sigma_rad


def test_refusals_say_what_is_wrong_and_what_to_do() -> None:
    person = Person(1.0, 1.0, 0.5)
    few = pointings(person, CORNERS, each=2)
    assert refused(few) == "only 8 rays were gathered and 20 are needed; see the IMU"
    assert "at one place" in refused(pointings(person, CORNERS[:1] * 3))
    elsewhere = pointings(person, CORNERS)
    swapped = dataclasses.replace(elsewhere, targets_m=np.roll(elsewhere.targets_m, 50, axis=0))
    assert "the rays miss the targets by" in refused(swapped)
    lifted = pointings(dataclasses.replace(person, bias_rad=math.radians(35.0)), CORNERS, noise_rad=0.002)
    assert "+3" in refused(lifted, Trust(max_act_residual_rad=1.0))
    assert "too high all the time" in refused(lifted, Trust(max_act_residual_rad=1.0))


def test_targets_at_the_height_of_the_eyes_tell_no_position() -> None:
    level = tuple((x, y, EYES_M) for x, y, _ in CORNERS[:2])
    sentence = refused(pointings(Person(0.3, 0.2, 0.1), level))
    assert "at the height of the eyes" in sentence or "equally well" in sentence


@settings(deadline=None)
@given(st.floats(1.0, 4.0), st.floats(-1.0, 1.0), angles, st.integers(0, 100))
def test_nobody_is_found_with_their_eyes_at_a_target(x: float, y: float, yaw_rad: float, seed: int) -> None:
    level = ((0.0, 0.0, EYES_M), (1.0, -4.0, EYES_M))
    result = solve(pointings(Person(x, y, yaw_rad), level, noise_rad=0.05, seed=seed), UNLIMITED)
    if isinstance(result, Solution):
        assert min(math.hypot(t[0] - result.x_m, t[1] - result.y_m) for t in level) > 0.3


def test_an_arm_that_rests_while_targets_change_is_named() -> None:
    person = Person(0.3, 0.2, 0.1)
    gathered = pointings(person, CORNERS)
    still = np.tile(person.direction(CORNERS[0]), (len(gathered), 1))
    sentence = refused(dataclasses.replace(gathered, directions=still))
    assert "held in one direction" in sentence or "too high" in sentence


@settings(deadline=None)
@given(coordinates, coordinates, angles, st.floats(0.3, 3.0), st.sampled_from([0.0, 1e-9, 1e-4, 0.02]))
def test_targets_above_one_another_tell_no_direction(
    x: float, y: float, yaw_rad: float, height_m: float, noise_rad: float
) -> None:
    assume(math.hypot(x, y) > 0.3)
    pole = ((0.0, 0.0, 0.1), (0.0, 0.0, 0.1 + height_m))
    sentence = refused(pointings(Person(x, y, yaw_rad), pole, noise_rad=noise_rad), LAX)
    assert "above one another" in sentence


@settings(deadline=None)
@given(coordinates, coordinates, angles, st.floats(0.06, 0.5))
def test_where_little_is_told_little_is_stated(x: float, y: float, yaw_rad: float, apart_m: float) -> None:
    """Nearly a pole: whatever is found, its covariance is positive and covers the error."""
    assume(math.hypot(x, y) > 0.5)
    pole = ((0.0, 0.0, 0.1), (apart_m, 0.0, 2.1))
    person = Person(x, y, yaw_rad)
    result = solve(pointings(person, pole, noise_rad=0.02), UNLIMITED)
    if isinstance(result, Solution):
        assert float(np.linalg.eigvalsh(result.covariance)[0]) > 0.0
        assert position_error_m(result, person) < 4.0 * result.position_sigma_m


def test_a_target_straight_above_turns_with_the_imu() -> None:
    targets: tuple[Vec3, ...] = ((0.5, 0.3, 2.6), (3.0, 2.0, 0.1), (-2.0, 2.5, 0.9))
    a = solved(pointings(Person(0.5, 0.3, 0.2), targets), UNLIMITED)
    b = solved(pointings(Person(0.5, 0.3, 1.9), targets), UNLIMITED)
    assert a.x_m == pytest.approx(b.x_m, abs=1e-6)
    assert a.position_sigma_m == pytest.approx(b.position_sigma_m, rel=1e-6)


def test_targets_in_one_direction_are_named() -> None:
    line = tuple((2.0 + far, 0.0, 1.64 - 0.5 * (2.0 + far)) for far in (0.0, 0.3, 0.6))
    assert "in one direction" in refused(pointings(Person(), line))


def test_two_targets_that_fit_two_places_are_refused_and_a_third_tells() -> None:
    person = Person(1.2, 1.4, 0.5)
    assert "two places fit" in refused(pointings(person, LAB[:2]))
    assert position_error_m(solved(pointings(person, LAB[:3])), person) < 0.1


def synthetic_trials(scenario: int) -> list[tuple[Pointings, NDArray[np.float64], float]]:
    trials = np.load(data_file("recordings/synth_two_led/trials.npz"))
    cases: list[tuple[Pointings, NDArray[np.float64], float]] = []
    for trial in np.flatnonzero(trials["scenario"] == scenario):
        azimuths, elevations = trials["ray_az_rad"][trial], trials["ray_el_rad"][trial]
        level = np.cos(elevations)
        gathered = Pointings(
            trials["t_s"],
            np.tile([0.0, 0.0, float(trials["eye_height_m"])], (len(level), 1)),
            np.column_stack([level * np.cos(azimuths), level * np.sin(azimuths), np.sin(elevations)]),
            trials["led_xyz"][trials["led_of_sample"]],
        )
        cases.append((gathered, trials["truth_user_xy"][trial], -float(trials["truth_yaw_rad"][trial])))
    return cases


@pytest.mark.parametrize(
    ("scenario", "median_m", "wrong"),
    [
        (0, 0.012, 0),
        (1, 0.25, 8),
        (2, 0.28, 4),
        (3, 0.20, 3),
    ],  # measured: .009, .198, .232, .145 m; 0, 7, 3, 2
)
def test_two_synthetic_leds(scenario: int, median_m: float, wrong: int) -> None:
    errors_m: list[float] = []
    yaws: list[float] = []
    for gathered, place, yaw_rad in synthetic_trials(scenario):
        result = solve(gathered, UNLIMITED)
        if isinstance(result, Solution):
            errors_m.append(math.hypot(result.x_m - place[0], result.y_m - place[1]))
            yaws.append(abs(yaw_difference(result.yaw_rad, yaw_rad)))
    assert len(errors_m) >= 58  # of 60; one or two are refused
    assert float(np.median(errors_m)) < median_m
    assert float(np.median(yaws)) < math.radians(4.0)
    assert sum(error > 1.0 for error in errors_m) <= wrong


@pytest.mark.parametrize("name", ["idle_0", "idle_1", "idle_3", "idle_4"])
def test_who_does_not_point_is_refused(name: str) -> None:
    """Windows of 10 s in which the person was doing something else."""
    recording = read_imu_csv(data_file(f"recordings/motion_relloc/{name}.csv"))
    assert recording.robot_m is not None
    x, y, z, w = recording.orientation_xyzw.T
    arm = -np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)])
    reach = 0.69 * arm - [0.0, 0.0, 0.22]
    directions = reach / np.linalg.norm(reach, axis=1)[:, None]
    results: list[Solution | Refusal] = []
    for end_s in np.arange(3.0, recording.duration_s, 1.0):
        window = (recording.t_s > end_s - 10.0) & (recording.t_s <= end_s)
        origins = np.tile([0.0, 0.0, 1.69], (int(window.sum()), 1))
        results.append(
            solve(Pointings(recording.t_s[window], origins, directions[window], recording.robot_m[window]))
        )
    assert len(results) > 5
    assert not any(isinstance(result, Solution) for result in results)
