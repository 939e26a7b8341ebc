"""Inputs and outputs of the life cycle for its tests: samples of a wrist, outputs in short."""

from collections.abc import Sequence
from typing import Literal

from pointit.geometry.rotation import IDENTITY
from pointit.schemas import ButtonEvent, Feedback, ImuSample, Interaction, Localization, UserPose
from pointit.schemas.person import Gesture
from pointit.services.supervisor.config import SupervisorConfig
from pointit.services.supervisor.life_cycle import Cancel, LifeCycle, Output, Start

S = 1_000_000_000

Phase = Literal["idle", "sampling", "solved", "refused", "cancelled"]


def life_cycle(**fields: object) -> LifeCycle:
    return LifeCycle(SupervisorConfig.model_validate(fields))


def sample(now_s: float, late_s: float = 0.0) -> tuple[ImuSample, int]:
    now_ns = round(now_s * S)
    return ImuSample(stamp_ns=now_ns - round(late_s * S), orientation_xyzw=IDENTITY), now_ns


def press(now_s: float, gesture: Gesture = "press") -> tuple[ButtonEvent, int]:
    now_ns = round(now_s * S)
    return ButtonEvent(stamp_ns=now_ns, gesture=gesture), now_ns


def pose(now_s: float = 0.0) -> tuple[UserPose, int]:
    return UserPose(stamp_ns=round(now_s * S), position_m=(0.0, 0.0, 0.0), yaw_rad=0.0), round(now_s * S)


def news(now_s: float, phase: Phase, **more: object) -> tuple[Localization, int]:
    now_ns = round(now_s * S)
    return Localization.model_validate({"stamp_ns": now_ns, "phase": phase, **more}), now_ns


def told(outputs: Sequence[Output]) -> list[str]:
    """Return outputs in short: states, cues, requests."""
    short: list[str] = []
    for output in outputs:
        match output:
            case Interaction():
                short.append(output.state)
            case Feedback():
                short.append(f"cue {output.cue}")
            case Start():
                short.append("anchor" if output.is_anchor else "start")
            case Cancel():
                short.append("cancel")
    return short


def shown(outputs: Sequence[Output]) -> Interaction:
    return next(output for output in outputs if isinstance(output, Interaction))


def localizing() -> LifeCycle:
    """Return a life cycle whose localizer has agreed to begin, 10 s after its own begin."""
    cycle = life_cycle(localize=True)
    cycle.begin(0)
    assert told(cycle.button(*press(10))) == ["start", "localizing", "cue started"]
    cycle.on_start_accepted(cycle.run)
    return cycle
