"""The interaction's life cycle: its promises for any sequence of inputs."""

from typing import Literal

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from pointit.schemas import ButtonEvent, Feedback, Interaction, Localization, UserPose
from pointit.services.supervisor.life_cycle import Cancel, Output, Start
from tests.unit.supervisor.played import Gesture, Phase, S, life_cycle, sample

Purpose = Literal["pose", "anchor"]
Doing = str
"""Reaction of a person who only hears the cues: `rest`, `go on`, `point at led_0`."""


class AnyLife(RuleBasedStateMachine):
    """Throws everything at a life cycle, also late, early and out of order."""

    LEGAL = frozenset(
        {
            ("idle", "localizing"),
            ("idle", "pointing"),
            ("localizing", "pointing"),
            ("localizing", "idle"),
            ("pointing", "idle"),
            ("pointing", "localizing"),  # hold: localize again; double: an anchor
        }
    )

    @initialize(localize=st.booleans(), each_time=st.booleans(), autostart=st.booleans())
    def start(self, *, localize: bool, each_time: bool, autostart: bool) -> None:
        self.cycle = life_cycle(localize=localize, relocalize_each_time=each_time, autostart=autostart)
        self.localize = localize
        self.now_ns = 1000 * S
        self.asked: list[int] = []
        self.cancels = 0
        self.heard: Doing = "rest"
        self.flashes_ns: list[int] = []
        self.last: Interaction | None = None
        self.seqs = [0]
        self.joined = 0
        """Searches that others may have asked for."""
        self.anchors = 0
        self.has_pose = False
        self.take(self.cycle.begin(self.now_ns))

    def take(self, outputs: list[Output]) -> None:
        for output in outputs:
            if isinstance(output, Start):
                self.asked.append(output.run)
            elif isinstance(output, Cancel):
                self.cancels += 1
            elif isinstance(output, Feedback):
                self.hear(output)
            else:
                assert output != self.last
                if self.last is not None and self.last.state != output.state:
                    assert (self.last.state, output.state) in self.LEGAL
                self.seqs.append(output.seq)
                self.last = output

    def hear(self, cue: Feedback) -> None:
        """Do what a cue asks for, by what the life cycle's own words say of cues."""
        assert bool(cue.target_id) <= (cue.cue == "target")
        assert cue.text
        assert cue.chime
        assert cue.haptic_ms
        if cue.color is not None:
            self.flashes_ns.append(cue.stamp_ns)
        if cue.cue in {"stopped", "refused"}:
            self.heard = "rest"
        elif cue.cue in {"started", "target"}:
            self.heard = f"point at {cue.target_id}" if cue.target_id else "go on"

    @rule()
    def called_off(self) -> None:
        if self.cancels:
            self.cancels -= 1
            self.cycle.on_cancel_reply(self.now_ns)

    @rule(span_s=st.floats(0, 100))
    def time(self, span_s: float) -> None:
        self.now_ns += round(span_s * S)
        self.take(self.cycle.tick(self.now_ns))

    @rule(span_s=st.floats(0, 3))
    def little_time_with_imu(self, span_s: float) -> None:
        self.now_ns += round(span_s * S)
        self.take(self.cycle.imu(*sample(self.now_ns / S)))

    @rule(gesture=st.sampled_from(["press", "double", "hold"]))
    def button(self, gesture: Gesture) -> None:
        self.now_ns += 1
        self.anchors += gesture == "double" and self.has_pose
        self.take(self.cycle.button(ButtonEvent(stamp_ns=self.now_ns, gesture=gesture), self.now_ns))

    @rule(
        phase=st.sampled_from(["idle", "sampling", "solved", "refused", "cancelled"]),
        age_s=st.sampled_from([0.0, 0.5, 100.0]),
        lamp=st.sampled_from(["", "wait", "led_0", "led_1"]),
        purpose=st.sampled_from(["pose", "anchor"]),
    )
    def localization(self, phase: Phase, age_s: float, lamp: str, purpose: Purpose) -> None:
        stamp_ns = self.now_ns - round(age_s * S)
        is_on = phase == "sampling"
        message = Localization(
            stamp_ns=stamp_ns,
            phase=phase,
            target_id=lamp if is_on and lamp != "wait" else "",
            target_index=int(lamp == "led_1"),
            ahead=("ben",) if is_on and lamp == "wait" else (),
            purpose=purpose,
        )
        self.joined += phase == "sampling"
        self.take(self.cycle.localization(message, self.now_ns))

    @rule(age_s=st.sampled_from([0.0, 50.0]))
    def pose(self, age_s: float) -> None:
        stamp_ns = self.now_ns - round(age_s * S)
        self.has_pose = True
        message = UserPose(stamp_ns=stamp_ns, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0)
        self.take(self.cycle.pose(message, self.now_ns))

    @rule(which=st.integers(0, 100), answers=st.booleans())
    def reply(self, which: int, *, answers: bool) -> None:
        if not self.asked:
            return
        run = self.asked[which % len(self.asked)]
        if answers:
            self.take(self.cycle.on_start_accepted(run))
        else:
            self.take(self.cycle.on_start_failed(run, "no answer", self.now_ns))

    @invariant()
    def what_is_shown_is_so(self) -> None:
        if not hasattr(self, "cycle"):
            return
        assert self.last is not None
        assert self.last.state == self.cycle.state
        assert self.last.next_step.endswith((".", ")."))
        assert self.seqs == sorted(set(self.seqs))
        assert (self.cycle.deadline_ns is None) == (self.cycle.state == "idle")
        assert bool(self.last.ahead) <= (self.last.state == "localizing")
        assert bool(self.last.ahead) == self.last.next_step.startswith("Wait: ben is pointing")
        # who hears the cues alone does what they should
        assert (self.heard == "rest") == (self.cycle.state == "idle")
        if self.heard.startswith("point at"):
            assert self.last.next_step.startswith(f"P{self.heard[1:]} ")
        if self.last.next_step.startswith("Point at "):
            assert self.heard.startswith("point at")
        flashes_ns = self.flashes_ns
        assert all(late - early >= S for early, late in zip(flashes_ns, flashes_ns[3:], strict=False))
        assert self.localize or self.anchors or self.joined or self.cycle.state != "localizing"

    def teardown(self) -> None:
        """Whatever happened: left alone it comes to rest, and a press then works as on the first day."""
        if not hasattr(self, "cycle"):
            return
        for _ in range(2):
            if self.cycle.deadline_ns is not None:
                self.now_ns = max(self.now_ns, self.cycle.deadline_ns)
                self.take(self.cycle.tick(self.now_ns))
        assert self.cycle.state == "idle"
        self.button("press")
        if self.localize or self.has_pose:
            assert self.cycle.state in ("localizing", "pointing")
            if self.cycle.state == "localizing":
                self.localization("solved", 0.0, "", "pose")
            assert self.cycle.state == "pointing"
        else:
            assert self.cycle.state == "idle"


TestAnyLife = AnyLife.TestCase
