"""Pose of one person from all sources; decides which procedure runs.

Pure: messages, requests and the time go in; outputs to publish come out.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from pointit.geometry import floor_sigma
from pointit.geometry.vector import Vec3
from pointit.runtime.host.advised_commands import advised_commands
from pointit.schemas import (
    NS_PER_S,
    Announced,
    Environment,
    ImuSample,
    Interaction,
    Localization,
    PointingRay,
    RobotState,
    SelectionEvent,
    SetPose,
    UserPose,
)
from pointit.schemas.topics import SET_POSE, START_LOCALIZATION
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import Refusal
from pointit.services.localizer.heading_window import HeadingWindow
from pointit.services.localizer.landing_detector import LandingDetector
from pointit.services.localizer.outputs import Output, WithdrawPose
from pointit.services.localizer.procedure_runner import ProcedureRunner
from pointit.services.localizer.tracking import PoseTracker

Change = Literal["", "set", "restarted"]
"""No change, a new yaw origin, or a restarted device."""
Method = Literal["fixed", "static_targets", "moving_target"]

MAX_SIGMA_GROWTH = 1.2
"""Largest sigma of a yaw that was accepted, as a multiple of its sigma then: sigmas are cautious."""
MAX_SIGMA_DEG = 25.0
"""Largest sigma of such a yaw, degrees."""

MAX_POSE_AGE_S = 2.0
"""Age up to which the tracker's last pose is valid."""

BACK_NS = NS_PER_S
"""Device time that falls by more is a restart; by less, samples came out of order."""
IDLE_S = 2.0
"""Longest wait between checks while no pose is tracked, s."""

NO_COVARIANCE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class ExternalPose:
    """Last pose of an external tracker and the time of its arrival."""

    def __init__(self) -> None:
        self.pose: UserPose | None = None
        """The last one. None before the first, or after the localizer was asked to take over."""
        self._received_ns = 0

    def hear(self, pose: UserPose, now_ns: int) -> bool:
        """Store a tracker's pose. Return True if it is the first, also after `take_over`."""
        is_first = self.pose is None
        self.pose = pose
        self._received_ns = now_ns
        return is_first

    def take_over(self) -> None:
        """Discard the tracker's pose so that the localizer publishes again."""
        self.pose = None

    def age_s(self, now_ns: int) -> float:
        """Return the age of the tracker's pose, s, by its arrival on this machine's clock."""
        return (now_ns - self._received_ns) / NS_PER_S

    def is_fresh(self, now_ns: int) -> bool:
        """Return True if the tracker currently provides the pose."""
        return self.pose is not None and self.age_s(now_ns) <= MAX_POSE_AGE_S

    def busy_reason(self, user: str, now_ns: int) -> str:
        """Return the reason why the localizer is inactive, or `""` if it may act."""
        if not self.is_fresh(now_ns):
            return ""
        return (
            f"a tracker provides the pose of {user}, last {self.age_s(now_ns):.1f} s ago; stop the "
            "tracker before asking the localizer"
        )


class YawOrigin:
    """Compares each sample with the ones before."""

    def __init__(self) -> None:
        self._epoch: int | None = None
        self._device_ns: int | None = None

    def add(self, sample: ImuSample) -> Change:
        """Return the change since the sample before."""
        previous_epoch = self._epoch
        self._epoch = sample.yaw_epoch
        previous_ns = self._device_ns
        device_ns = sample.device_time_ns
        fallen_ns = 0
        if previous_ns is not None and device_ns is not None:
            fallen_ns = previous_ns - device_ns

        # A sample out of order leaves the time of the newest one
        if device_ns is not None and not 0 < fallen_ns <= BACK_NS:
            self._device_ns = device_ns
        if fallen_ns > BACK_NS:
            return "restarted"
        if previous_epoch is not None and previous_epoch != sample.yaw_epoch:
            return "set"
        return ""


@dataclass(frozen=True)
class Response:
    """Answer to a request."""

    message: str
    outputs: Sequence[Output] = ()


class PoseManager:
    """Keeps the pose that was found or set, and starts procedures on request."""

    def __init__(self, user: str, config: LocalizerConfig) -> None:
        self._user = user
        self._config = config
        self._tracking = PoseTracker(config.drift.settings(), follow=config.track_drift)
        self._external_pose = ExternalPose()
        self._heading_window = HeadingWindow()
        self._landing_detector = LandingDetector()
        self._has_names = False
        """True once a name was spoken to the person."""
        self._things_m: dict[str, Vec3] = {}
        """Centre of each thing that does not move, {W}."""
        self._origin = YawOrigin()
        self.procedures = ProcedureRunner(user, config, self._tracking)
        """Procedures of the person, which get leases, objects and the time without a detour."""
        self._is_cursor_shown = False
        self._drivers: dict[str, str] = {}
        """User who steers each robot, or `""`."""

    @property
    def is_followed(self) -> bool:
        """Return True if the pose must be checked periodically."""
        return self._tracking.follows or self._external_pose.pose is not None

    def begin(self, now_ns: int) -> list[Output]:
        """Publish the idle phase, and start what the configuration starts automatically."""
        outputs: list[Output] = [Localization(stamp_ns=now_ns, phase="idle")]
        config = self._config
        if config.method == "fixed":
            outputs.append(self._tracking.set_exact(config.fixed(now_ns), now_ns))
        elif config.method == "moving_target" and config.autostart:
            outputs += self.procedures.start_moving_target(now_ns)
        return outputs

    def on_map(self, room: Environment, now_ns: int) -> list[Output]:
        """Update the map."""
        self._things_m = {thing.id: thing.center_m for thing in room.fixed_things}
        return self.procedures.on_map(room, now_ns)

    def on_ray(self, ray: PointingRay, now_ns: int) -> list[Output]:
        """Process a ray of the person."""
        self._heading_window.add(ray)
        if self._tracking.follows:  # no other pose is corrected by landings
            self._landing_detector.add(ray)
        self.procedures.on_ray(ray)
        changed_pose = self._tracking.on_ray(ray, now_ns)
        return [] if changed_pose is None else [changed_pose]

    def on_robot(self, state: RobotState, robot: str, now_ns: int) -> list[Output]:
        """Correct a drifting pose when the person takes a robot, since they point at it then."""
        previous_driver = self._drivers.get(robot)
        self._drivers[robot] = state.user
        if previous_driver is None:  # it may have been taken long ago
            return []
        has_taken = state.user == self._user and previous_driver != self._user
        if not has_taken or not self._tracking.follows:
            return []
        mean = self._heading_window.mean(now_ns)
        if self._config.anchor_at_robots is False or isinstance(mean, Refusal):
            return []
        return self.procedures.taken_robot(state, robot, mean, now_ns)

    def on_announced(self, announced: Announced, _user: str = "") -> None:
        """Process the name that is spoken to the person."""
        self._has_names |= bool(announced.object_id)

    def on_selection(self, event: SelectionEvent, now_ns: int) -> list[Output]:
        """Correct a pose that drifts by the landing of a reach whose name the person confirms."""
        if event.user != self._user or event.event not in ("selected", "deselected"):
            return []
        landing = self._landing_detector.pop_landing()
        position_m = self._things_m.get(event.object_id)
        if landing is None or position_m is None:
            return []
        is_confirmed = event.cause == "button" and self._has_names
        if not is_confirmed or self.procedures.is_busy or not self._tracking.follows:
            return []

        # The elevation first: the anchor then has the new bias
        outputs = self._tracking.learn_elevation(position_m, landing, now_ns)
        if self._config.anchor_at_things:
            outputs += self._tracking.anchor_at(event.object_id, position_m, landing, now_ns)
        return outputs

    def on_imu(self, sample: ImuSample, now_ns: int) -> list[Output]:
        """Process an orientation of the arm.

        If its yaw has another origin than before, the pose's yaw is unknown. While no cursor is shown, a
        resting arm shows the IMU's drift.
        """
        self.procedures.on_wrist(sample.latency_sigma_s, sample.mounting)
        change = self._origin.add(sample)
        outputs: list[Output] = []
        if change:
            self._heading_window = HeadingWindow()
            self._landing_detector = LandingDetector()

            # The tracking first, whose pose is published after the end of the procedure
            pose = self._tracking.on_yaw_origin_changed(now_ns, is_restarted=change == "restarted")
            outputs += self.procedures.on_yaw_origin_changed(now_ns)
            if pose is not None:
                outputs.append(pose)
        if not self._is_cursor_shown and not self.procedures.is_following:
            self._tracking.on_orientation(sample.orientation_xyzw, sample.stamp_ns, now_ns)
        return outputs

    def on_interaction(self, interaction: Interaction) -> None:
        """Update the interaction state of the person."""
        self._is_cursor_shown = interaction.state == "pointing"
        if self._is_cursor_shown:
            self._tracking.end_rest()

    def on_pose(self, pose: UserPose, now_ns: int) -> list[Output]:
        """Stop localizing if a tracker publishes the pose."""
        if pose.method != "external":
            return []
        is_first = self._external_pose.hear(pose, now_ns)
        self._tracking.set_external(pose)
        if not is_first:
            return []
        reason = (
            f"a tracker provides the pose of {self._user} now, so the localizer pauses; "
            "stop the tracker to localize"
        )
        outputs = self.procedures.stop(now_ns, reason)
        if not outputs:
            outputs.append(Localization(stamp_ns=now_ns, phase="idle", reason=reason))
        outputs.append(WithdrawPose())
        return outputs

    def due(self, now_ns: int) -> list[Output]:
        """Return the pose if it is time to publish it again."""
        pose = self._tracking.due(now_ns)
        return [] if pose is None else [pose]

    def wait_s(self, now_ns: int) -> float:
        """Return the time until the next check of `due`, s."""
        return min(IDLE_S, self._tracking.wait_s(now_ns))

    def figures(self, now_ns: int) -> Iterator[tuple[str, float | None, str]]:
        """Yield name, value and unit of the health metrics. None removes a metric."""
        yield "external pose", 1.0 if self._external_pose.pose is not None else None, ""
        yield from self._tracking.figures(now_ns)

    @property
    def _anchor_command(self) -> str:
        return advised_commands().command(f"pointit person anchor {self._user}", self._user)

    def problem(self, now_ns: int) -> str:
        """Return a problem of the pose and what to do, or `""` if there is none."""
        if self._external_pose.pose is not None and not self._external_pose.is_fresh(now_ns):
            return self._silence_text(now_ns)
        if self._tracking.has_lost_yaw:
            user = self._user
            facing = advised_commands().command(f"pointit person pose {user} --facing …", user)
            return (
                f"the IMU of {user} was restarted or turned: its yaw is unknown; localize again, point at "
                f"a lamp ({self._anchor_command}), or face a known direction ({facing})"
            )

        # Any configured limit, or somewhat more than was accepted
        sigma_deg = math.degrees(self._tracking.yaw_sigma_rad(now_ns))
        accepted_deg = 0.0
        if self._tracking.base is not None:
            accepted_deg = math.degrees(floor_sigma.yaw_sigma_rad(self._tracking.base.covariance))
        grown_deg = min(MAX_SIGMA_GROWTH * accepted_deg, MAX_SIGMA_DEG)
        config = self._config
        if sigma_deg <= max(config.drift.max_yaw_sigma_deg, config.trust.max_yaw_sigma_deg, grown_deg):
            return ""
        return (
            f"the yaw of {self._user} is uncertain by {sigma_deg:.0f}°, since IMUs drift; have them "
            f"point at a lamp once: {self._anchor_command}, or a double press of the button"
        )

    def start(self, method: Method | None, now_ns: int) -> Response | Refusal:
        """Start localization by `method` or as configured. A refused start stops nothing."""
        method = method or self._config.method
        busy_reason = self._external_pose.busy_reason(self._user, now_ns)
        if busy_reason:
            return Refusal(busy_reason)

        # The tracker's pose is discarded only if the localizer really starts
        if method == "fixed":
            outputs = self.procedures.stop(now_ns)
            self._external_pose.take_over()
            outputs.append(self._tracking.set_exact(self._config.fixed(now_ns), now_ns))
            outputs.append(Localization(stamp_ns=now_ns, phase="solved", progress=1.0))
            return Response("the pose is fixed by the configuration", outputs)
        started: list[Output] | Refusal
        if method == "moving_target":
            started = self.procedures.start_moving_target(now_ns)
        else:
            started = self.procedures.start_static_targets(now_ns)
        if isinstance(started, Refusal):
            return started
        self._external_pose.take_over()
        message = self._queue_text() or f"localizing by {method.replace('_', ' ')}"
        return Response(message, started)

    def cancel(self, now_ns: int, *, forget_bias: bool = False) -> Response:
        """Stop the running procedure. With `forget_bias`, also forget the person's elevation bias."""
        outputs = self.procedures.stop(now_ns)
        if not forget_bias:
            message = "cancelled; the last pose stays" if outputs else "nothing was going on"
            return Response(message, outputs)

        # The pose again, since its message holds the remembered bias
        self.procedures.bias_memory.remembered = None
        pose = self._tracking.pose(now_ns)
        if pose is not None:
            outputs.append(pose)
        if self._config.autostart and self._config.method == "moving_target":
            outputs += self.procedures.start_moving_target(now_ns)
        return Response("forgotten: the next localization expects no elevation bias", outputs)

    def set_pose(self, query: SetPose, now_ns: int) -> Response | Refusal:
        """Set the pose on request."""
        busy_reason = self._external_pose.busy_reason(self._user, now_ns)
        if busy_reason:
            return Refusal(busy_reason)
        outputs = self.procedures.stop(now_ns)
        self._external_pose.take_over()
        if query.remembered_bias is not None:
            self.procedures.bias_memory.remembered = query.remembered_bias
        pose = UserPose(
            stamp_ns=now_ns,
            position_m=query.position_m,
            yaw_rad=query.yaw_rad,
            method=query.method,
            covariance=query.covariance or NO_COVARIANCE,
            elevation_bias_rad=query.elevation_bias_rad,
        )
        if query.covariance is None:
            outputs.append(self._tracking.set_exact(pose, now_ns))
        else:  # found by pointing before, and its localizer died
            outputs.append(self._tracking.restore(pose, now_ns))
        return Response(f"the pose is set; yaw {math.degrees(query.yaw_rad):.1f}°", outputs)

    def set_heading(self, azimuth_rad: float, now_ns: int) -> Response | Refusal:
        """Set the yaw from the direction `azimuth_rad` at which the person points now."""
        busy_reason = self._external_pose.busy_reason(self._user, now_ns)
        if busy_reason:
            return Refusal(busy_reason)
        if self.procedures.is_busy:
            return Refusal(f"{self._user} is being localized now; wait until that is done, or cancel it")
        mean = self._heading_window.mean(now_ns)
        if isinstance(mean, Refusal):
            return mean

        # A direction alone is no pose: without one, or with a silent tracker's, only a configured one will do
        if self._tracking.base is None or self._external_pose.pose is not None:
            if self._config.method != "fixed":
                return Refusal(self._no_pose_text())
            self._external_pose.take_over()
            self._tracking.set_exact(self._config.fixed(now_ns), now_ns)
        result = self._tracking.heading(mean, azimuth_rad, now_ns)
        pose = self._tracking.pose(now_ns)
        if not result.accepted or pose is None:
            return Refusal(result.reason)
        note = f"; {result.note}" if result.note else ""
        return Response(f"the yaw is set; {math.degrees(pose.yaw_rad):.1f}°{note}", [pose])

    def point_anchor(self, lamp_id: str, now_ns: int) -> Response | Refusal:
        """Start pointing at the lamp `lamp_id`, or at the most informative one if `""`."""
        if self.procedures.is_localizing:
            return Refusal(f"{self._user} is being localized now; wait until that is done, or cancel it")
        if self._tracking.base is None:
            return Refusal(self._no_pose_text())
        if self._external_pose.pose is not None and not self._external_pose.is_fresh(now_ns):
            return Refusal(self._silence_text(now_ns))
        outputs = self.procedures.anchor(lamp_id, self._heading_window.eyes_m, now_ns)
        if isinstance(outputs, Refusal):
            return outputs
        message = self._queue_text() or f"point at {self.procedures.lit}"
        return Response(message, outputs)

    def _queue_text(self) -> str:
        ahead = self.procedures.ahead
        return f"{self._user} waits in turn: {', '.join(ahead)} first" if ahead else ""

    def _no_pose_text(self) -> str:
        user = self._user
        commands = advised_commands()
        start = commands.command(f"pointit service call {START_LOCALIZATION.at(user)}", user)
        set_pose = commands.command(f"pointit service call {SET_POSE.at(user)}", user)
        return f"no pose of {user} is known; localize first ({start}), or set it ({set_pose})"

    def _silence_text(self, now_ns: int) -> str:
        age_s = self._external_pose.age_s(now_ns)
        return (
            f"the tracker that gave the pose of {self._user} is silent for {age_s:.0f} s; start it again, or "
            "localize"
        )
