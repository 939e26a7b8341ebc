"""State of the set-up of a home, and what each act at its cards does to it. Pure; stored after each act.

    connect ──▶ choose ──▶ hand ──▶ place ──▶ try ──▶ done        `go` returns to any card

In `place`, people point at each lamp from the place A, walk, and point at each again from B. Pointing after a
wide movement of the arm is less exact, so at A such lamps come once more, in the order in which they stand,
unless the first of them show that this person points well. At B all come in that order. The zero of their
device's yaw may change meanwhile, as after a restart. Then a lamp that was pointed at before finds it.
"""

import math
from collections.abc import Collection, Sequence
from typing import Literal

from pydantic import BaseModel, ConfigDict

from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.scan.by_pointing import TargetRay
from pointit.scan.paced import FIRST, SECOND, USUAL_M, PacedRoom, locate_paced, paced_ray
from pointit.schemas.home import STRIP, HomeHand, HomePlace, HomeStep

MAX_LAMPS = 64
TRIAL_SPREAD_RAD = math.radians(60.0)
TRIAL_HEIGHT_M = 1.4
"""Azimuth of the outermost lamps, and height of all, if nobody points at them: for a trial with the mouse."""
MIN_HEIGHT_M = 0.16
"""Least height of a lamp: half its size, so that it stands on the floor."""

MIN_AGAIN = 4
"""Number of lamps and ends from which wide movements of the arm are made up for by pressing once more."""
WIDE_REACH_RAD = math.radians(40.0)
"""Movement of the arm before a press, from which the lamp comes once more."""
JUDGED_AGAIN = 3
MAX_AGAIN_SPREAD_RAD = math.radians(3.0)
"""Rms of the differences of azimuths of lamps that came once more, up to which the others need not."""
AGAIN = "your arm came from far away, and a short way is more exact"
"""Reason for which a lamp comes once more."""

End = Literal["", "first", "last"]


class _Stored(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ChosenLamp(_Stored):
    """A lamp that people want to point at; `id` as in `HomeLamp`."""

    id: str
    label: str = ""
    area: str = ""

    @property
    def ends(self) -> tuple[End, ...]:
        """Return the ends that are pointed at: two of a strip."""
        return ("first", "last") if self.id.startswith(STRIP) else ("",)


class LampPress(_Stored):
    """A press of a person who pointed at a lamp, or at an end of a strip.

    Its azimuth is that at the first place, where the map's x axis is that of the device's yaw 0 then.
    """

    lamp: str
    end: End
    place: Literal["A", "B"]
    azimuth_rad: float
    elevation_rad: float
    eyes_m: float
    reach_rad: float | None = None
    """Angle from the press before, or None if that is not known."""


class PlacedLamp(_Stored):
    """Position of a lamp or of an end of a strip, and the standard deviation of its direction."""

    lamp: str
    end: End
    position_m: Vec3
    direction_sigma_rad: float


class UsedSecret(_Stored):
    """Address to which a token or password was sent, and the time (ns) at which its file was written."""

    url: str
    written_ns: int
    replacement: str = ""
    """Name as in `AddressTrial` of the one that replaces the file, `""` once it has."""


class AddressTrial(_Stored):
    """An address that nobody has accepted yet."""

    url: str
    secret: str = ""
    """Name as in `SetUpHome` of the token or password that was given with it, `""` for the stored one."""


class StoredSetup(_Stored):
    """The set-up of a home as it is stored."""

    step: HomeStep = "connect"
    url: str = ""
    """Address that was accepted last."""
    trial: AddressTrial | None = None
    has_home: bool = True
    """False if the person has said that there is no Home Assistant."""
    secrets: dict[str, UsedSecret] = {}
    """Use of each file with a token or password, by its name."""
    offered: tuple[str, ...] = ()
    """Ids of all lamps that there were when some were chosen."""
    lamps: tuple[ChosenLamp, ...] = ()
    hand: HomeHand = ""
    user: str = ""
    place: Literal["A", "B"] = FIRST
    has_one_place: bool = False
    presses: tuple[LampPress, ...] = ()
    repeated: tuple[tuple[str, End], ...] = ()
    """Targets that were pointed at once more, since their presses contradicted the others."""
    left_out: dict[str, str] = {}
    """Lamps that are not placed, with the reason."""
    turn_rad: float = 0.0
    """Azimuth at the first place of the device's yaw 0 as it is now."""
    placed: tuple[PlacedLamp, ...] = ()
    places_m: tuple[tuple[float, float], ...] = ()
    drift_rad: float = 0.0


class SetupProgress:
    """The set-up of a home. All methods that change it raise RefusedError if the act is not possible now."""

    def __init__(self, stored: StoredSetup | None = None) -> None:
        """Go on from what is stored."""
        self.state = stored or StoredSetup()
        self.is_aligning = self._must_align
        """The next press finds the zero of the device's yaw again."""
        self.poses = 0
        """Number of poses of the person so far."""
        self.pose: tuple[tuple[float, float], float] | None = None
        """Newest position (x, y) and azimuth of {H}, {W}."""
        self.reasons: dict[str, str] = {}
        """Lamps that are asked for once more, with the reason."""
        self._epoch: int | None = None
        self._arm_rad: tuple[float, float] | None = None
        """Azimuth and elevation of the last press, {H}."""

    @property
    def _must_align(self) -> bool:
        """Return True if presses refer to a zero of the yaw that may be another one in a new process."""
        state = self.state
        if state.hand not in ("phone", "wrist"):
            return False
        if state.step == "place":
            return bool(state.presses)
        return state.step in ("try", "done") and bool(state.placed)

    @property
    def targets(self) -> list[tuple[str, End]]:
        """Return the lamps and ends of strips to point at from each place, in order."""
        targets: list[tuple[str, End]] = []
        for lamp in self.state.lamps:
            if lamp.id not in self.state.left_out:
                targets += [(lamp.id, end) for end in lamp.ends]
        return targets

    @property
    def target(self) -> tuple[str, End] | None:
        """Return the lamp or end whose turn it is, or None."""
        if self.is_aligning:
            return self._known_target
        if self.state.step != "place":
            return None
        pressed = self._pressed_targets(self.state.place)
        for target in self._targets_in_order:
            if target not in pressed:
                return target
        return next(iter(self._targets_again), None)

    @property
    def is_again(self) -> bool:
        """Return True if the lamp whose turn it is comes once more because the arm moved far before."""
        if self.is_aligning or self.target is None:
            return False
        return self.target in self._pressed_targets(self.state.place)

    @property
    def _targets_in_order(self) -> list[tuple[str, End]]:
        """Return all targets: at the second place as they stand around the first one."""
        if self.state.place == FIRST:
            return self.targets
        azimuths_rad = {_target_of(press): press.azimuth_rad for press in self.state.presses[::-1]}
        return sorted(self.targets, key=lambda target: azimuths_rad.get(target, 0.0))

    @property
    def _targets_again(self) -> list[tuple[str, End]]:
        """Return the targets that come once more at the first place, as they stand around it."""
        if self.state.place != FIRST or len(self.targets) < MIN_AGAIN:
            return []
        first: dict[tuple[str, End], LampPress] = {}
        differences_rad: dict[tuple[str, End], float] = {}
        for press in self.state.presses:
            target = _target_of(press)
            if target in first:
                difference_rad = press.azimuth_rad - first[target].azimuth_rad
                differences_rad[target] = math.remainder(difference_rad, math.tau)
            first.setdefault(target, press)

        # Who points well has done enough
        spread_rad = math.hypot(*differences_rad.values()) / math.sqrt(max(len(differences_rad), 1))
        if len(differences_rad) >= JUDGED_AGAIN and spread_rad < MAX_AGAIN_SPREAD_RAD:
            return []
        again: list[tuple[str, End]] = []
        for target, press in first.items():
            is_wide = press.reach_rad is None or press.reach_rad > WIDE_REACH_RAD
            if is_wide and target not in differences_rad:
                again.append(target)
        return sorted(again, key=lambda target: first[target].azimuth_rad)

    @property
    def place(self) -> HomePlace:
        """Return the place at which the person is to stand, or `""` if that does not matter now."""
        if self.is_aligning:
            has_pressed_here = self.state.step == "place" and bool(self._pressed_targets(self.state.place))
            return self.state.place if has_pressed_here else FIRST
        return self.state.place if self.state.step == "place" else ""

    @property
    def may_walk(self) -> bool:
        """Return True if all lamps were pointed at from the first place, and nothing else is decided."""
        state = self.state
        if state.step != "place" or state.place != FIRST:
            return False
        return bool(state.presses) and self.target is None

    @property
    def is_complete(self) -> bool:
        """Return True if all lamps were pointed at from all places, so that they can be located."""
        state = self.state
        if state.step != "place":
            return False
        is_last_place = state.place == SECOND or state.has_one_place
        return is_last_place and self.target is None

    def connect(self, url: str, secret: str = "") -> None:
        """Try the home at `url`. Its lamps are chosen once it has accepted. `secret` as in `AddressTrial`."""
        self._change(trial=AddressTrial(url=url, secret=secret), step="connect")

    def accept_trial(self, name: str, secret: UsedSecret | None) -> None:
        """Use the address that was tried. `secret`: that of the file `name`, if it is another one."""
        trial = self.state.trial
        if trial is None:
            return
        secrets = self.state.secrets
        if secret is not None:
            secrets = {**secrets, name: secret}
        self._change(url=trial.url, trial=None, has_home=True, secrets=secrets)
        self.on_connected()

    def end_trial(self) -> None:
        """Go on with the address that was accepted last. The card stays, for another one."""
        self._change(trial=None)

    def use_secret(self, name: str, url: str, written_ns: int) -> None:
        """Note that the token or password in the file `name` is sent to `url`.

        Raises:
            RefusedError: If it was given for another address: nobody gets it but whom it was given for.
        """
        used = self.state.secrets.get(name)
        if used is not None:
            is_unwritten = used.written_ns == written_ns
            if is_unwritten and used.url != url:
                raise RefusedError(
                    f"the stored token or password is that of {used.url}: give that of the new address, too"
                )
        secret = UsedSecret(url=url, written_ns=written_ns)
        self._change(secrets={**self.state.secrets, name: secret})

    def on_replaced(self, name: str) -> None:
        """Note that the file `name` has the token or password that was accepted."""
        secret = self.state.secrets[name].model_copy(update={"replacement": ""})
        self._change(secrets={**self.state.secrets, name: secret})

    def on_connected(self) -> None:
        """Go on to the choice of lamps, since the home has accepted."""
        if self.state.step == "connect":
            self._change(step="choose")

    def without_home(self) -> None:
        """Go on without a Home Assistant: there are the lights of the map."""
        self._change(has_home=False, url="", trial=None, step="choose")

    def choose(self, lamps: Sequence[ChosenLamp], offered: Collection[str]) -> None:
        """Point at `lamps` from now on, among those `offered`."""
        if not lamps:
            raise RefusedError("choose at least one lamp")
        if len(lamps) > MAX_LAMPS:
            raise RefusedError(f"{len(lamps)} lamps are chosen, limit {MAX_LAMPS}: choose those you point at")
        chosen = {lamp.id for lamp in lamps}
        presses = tuple(press for press in self.state.presses if press.lamp in chosen)
        self._change(lamps=tuple(lamps), offered=tuple(offered), presses=presses, step="hand", left_out={})

    def take_hand(self, hand: HomeHand, user: str) -> None:
        """Use `hand` of `user` from now on. With the mouse, lamps get places for a trial."""
        if hand == "" or not user:
            raise RefusedError("say who points, and with what")
        if not self.state.lamps:
            raise RefusedError("choose lamps first")
        self._change(hand=hand, user=user)
        if hand == "mouse":
            self._place_for_trial()
            return
        self._change(step="place")
        if self.state.placed:
            self._clear_presses()

    def on_epoch(self, epoch: int) -> None:
        """Note the number of the zero of the device's yaw: with another one, azimuths mean something else."""
        if self._epoch is not None and epoch != self._epoch:
            self.is_aligning = self._must_align
            self._arm_rad = None
        self._epoch = epoch

    def press(self, azimuth_rad: float, elevation_rad: float, eyes_m: float) -> None:
        """Note that the person points at the target: azimuth and elevation in {H}, height of their eyes."""
        target = self.target
        if target is None:
            raise RefusedError("it is no lamp's turn now")
        if self.is_aligning:
            self._align_yaw(target, azimuth_rad)
            return
        lamp, end = target
        press = LampPress(
            lamp=lamp,
            end=end,
            place=self.state.place,
            azimuth_rad=math.remainder(azimuth_rad + self.state.turn_rad, math.tau),
            elevation_rad=elevation_rad,
            eyes_m=eyes_m,
            reach_rad=self._reach_to(azimuth_rad, elevation_rad),
        )
        self._change(presses=(*self.state.presses, press))
        self.reasons.pop(lamp, None)

    def _reach_to(self, azimuth_rad: float, elevation_rad: float) -> float | None:
        """Return the angle by which the arm has moved since the last press, and note where it is now."""
        previous = self._arm_rad
        self._arm_rad = (azimuth_rad, elevation_rad)
        if previous is None:
            return None
        return math.hypot(math.remainder(azimuth_rad - previous[0], math.tau), elevation_rad - previous[1])

    def take_back(self) -> None:
        """Forget the last press. At the second place without presses, return to the first one."""
        presses = self.state.presses
        if self.state.step != "place" or not presses:
            raise RefusedError("there is no press to take back")
        self._change(presses=presses[:-1], place=presses[-1].place, has_one_place=False)

    def walk(self) -> None:
        """Note that the person stands at the second place."""
        if not self.may_walk:
            raise RefusedError("point at all lamps from the first place before you walk")
        self._arm_rad = None
        self._change(place=SECOND)

    def stay(self) -> None:
        """Note that the person points from one place only."""
        if not self.may_walk:
            raise RefusedError("point at all lamps first")
        self._change(has_one_place=True)

    def skip(self) -> None:
        """Leave out the lamp whose turn it is, or point without finding the zero of the device again."""
        if self.is_aligning and self.state.step != "place":
            self.is_aligning = False
            return
        target = self.target
        if target is None or self.is_aligning:
            raise RefusedError("there is nothing to skip now")
        if len({lamp for lamp, _ in self.targets}) == 1:
            raise RefusedError("one lamp must remain: go back and choose another one")
        self._leave_out({target[0]: "you left it out"})

    def start_aligning(self) -> None:
        """Find the zero of the device's yaw with the next press."""
        if not self.state.placed:
            raise RefusedError("no lamp is placed yet")
        self.is_aligning = True

    def stand(self, place: HomePlace) -> None:
        """Note that the person stands at a place, with their device as it is."""
        index = (FIRST, SECOND).index(place) if place else -1
        if not 0 <= index < len(self.state.places_m):
            raise RefusedError(f"nobody has pointed from place {place or '?'}")
        yaw_rad = self.pose[1] if self.pose is not None else self.state.turn_rad
        self._set_pose(self.state.places_m[index], yaw_rad)

    def go(self, step: HomeStep) -> None:
        """Return to a card, or go on to one that is complete."""
        state = self.state
        has_placed = bool(state.placed)
        is_possible = {
            "hand": bool(state.lamps),
            "place": bool(state.hand),
            "try": has_placed,
            "done": has_placed,
        }
        if not is_possible.get(step, True):
            raise RefusedError("do the steps before it first")
        is_repeated = step == "place" and state.step in ("try", "done")
        self._change(step=step)
        if is_repeated:
            self._clear_presses()
        self.is_aligning = self.is_aligning and self._must_align

    def finish(self) -> None:
        """End the trial."""
        if not self.state.placed:
            raise RefusedError("no lamp is placed yet")
        self._change(step="done")

    def fit(self) -> PacedRoom:
        """Return the room of the presses. May take half a second."""
        state = self.state
        rays: list[TargetRay] = []
        for press in state.presses:
            if press.lamp in state.left_out:
                continue
            key = target_key(press.lamp, press.end)
            eyes_m = (0.0, 0.0, press.eyes_m)
            reach_rad = math.pi if press.reach_rad is None else press.reach_rad
            rays.append(paced_ray(key, press.place, eyes_m, _direction(press), reach_rad))
        return locate_paced(rays)

    def on_room(self, room: PacedRoom) -> None:
        """Place the lamps as in `room`. Lamps whose presses contradict the others are asked for once more."""
        # A lamp that contradicts the others again is left out
        asked_again: list[tuple[str, End]] = []
        left_out: dict[str, str] = {}
        for lamp, end in self.targets:
            reason = room.targets[target_key(lamp, end)].reason
            if reason and (lamp, end) in self.state.repeated:
                left_out[lamp] = reason
            elif reason:
                asked_again.append((lamp, end))
                self.reasons[lamp] = reason
        if asked_again:
            # The presses of other places stay: only those of this place are made once more.
            remaining: list[LampPress] = []
            for press in self.state.presses:
                is_repeated = (press.lamp, press.end) in asked_again
                if press.place != self.state.place or not is_repeated:
                    remaining.append(press)
            self._change(presses=tuple(remaining), repeated=(*self.state.repeated, *asked_again))
            return
        lamps = {lamp for lamp, _ in self.targets}
        if left_out and len(left_out) < len(lamps):
            self._leave_out(left_out)  # it is complete without them, and fitted once more
            return
        self._on_located(room)

    def _on_located(self, room: PacedRoom) -> None:
        placed: list[PlacedLamp] = []
        for lamp, end in self.targets:
            target = room.targets[target_key(lamp, end)]
            x, y, z = target.position_m
            placed.append(
                PlacedLamp(
                    lamp=lamp,
                    end=end,
                    position_m=(x, y, max(z, MIN_HEIGHT_M)),
                    direction_sigma_rad=max(target.direction_sigmas_rad),
                )
            )
        self._change(placed=tuple(placed), places_m=room.places_m, drift_rad=room.drift_rad, step="try")
        self._set_pose(room.places_m[-1], self.state.turn_rad - room.drift_rad)

    def _place_for_trial(self) -> None:
        targets = self.targets
        placed: list[PlacedLamp] = []
        for index, (lamp, end) in enumerate(targets):
            share = 0.5 if len(targets) == 1 else index / (len(targets) - 1)
            azimuth_rad = TRIAL_SPREAD_RAD * (1.0 - 2.0 * share)
            position_m = (USUAL_M * math.cos(azimuth_rad), USUAL_M * math.sin(azimuth_rad), TRIAL_HEIGHT_M)
            placed.append(PlacedLamp(lamp=lamp, end=end, position_m=position_m, direction_sigma_rad=0.0))
        self._change(placed=tuple(placed), places_m=((0.0, 0.0),), drift_rad=0.0, step="try", presses=())
        self._set_pose((0.0, 0.0), 0.0)

    @property
    def _known_target(self) -> tuple[str, End] | None:
        """Return a target of which the azimuth is known: of this place, else of the first one."""
        if self.state.step == "place":
            place = self.place
            for press in self.state.presses:
                if press.place == place:
                    return press.lamp, press.end
            return None
        if not self.state.placed:
            return None
        first = self.state.placed[0]
        return (first.lamp, first.end)

    def _align_yaw(self, target: tuple[str, End], azimuth_rad: float) -> None:
        """Find the zero of the device's yaw from the azimuth in {H} of a lamp that is known."""
        state = self.state
        known_rad = self._known_azimuth(target)
        turn_rad = math.remainder(known_rad - azimuth_rad, math.tau)
        self.is_aligning = False
        self._change(turn_rad=turn_rad)
        if state.step != "place":
            self._set_pose((0.0, 0.0), turn_rad)

    def _known_azimuth(self, target: tuple[str, End]) -> float:
        """Return the azimuth of `_known_target`: as pressed from this place, or else on the map."""
        if self.state.step == "place":
            place = self.place
            presses = [press for press in self.state.presses if press.place == place]
            press = next(press for press in presses if (press.lamp, press.end) == target)
            return press.azimuth_rad
        placed = next(lamp for lamp in self.state.placed if (lamp.lamp, lamp.end) == target)
        x, y, _ = placed.position_m
        return math.atan2(y, x)

    def _clear_presses(self) -> None:
        self.is_aligning = False
        self._change(
            presses=(),
            repeated=(),
            left_out={},
            place=FIRST,
            has_one_place=False,
            turn_rad=0.0,
            drift_rad=0.0,
        )

    def _leave_out(self, reasons: dict[str, str]) -> None:
        presses = tuple(press for press in self.state.presses if press.lamp not in reasons)
        self._change(left_out=self.state.left_out | reasons, presses=presses)

    def _pressed_targets(self, place: str) -> set[tuple[str, End]]:
        return {(press.lamp, press.end) for press in self.state.presses if press.place == place}

    def _set_pose(self, position_m: tuple[float, float], yaw_rad: float) -> None:
        self.pose = (position_m, math.remainder(yaw_rad, math.tau))
        self.poses += 1

    def _change(self, **values: object) -> None:
        self.state = self.state.model_copy(update=values)


def target_key(lamp: str, end: End) -> str:
    """Return the name of a lamp or of an end of a strip in the fit."""
    return f"{lamp}|{end}"


def _target_of(press: LampPress) -> tuple[str, End]:
    return press.lamp, press.end


def _direction(press: LampPress) -> Vec3:
    level = math.cos(press.elevation_rad)
    return (
        level * math.cos(press.azimuth_rad),
        level * math.sin(press.azimuth_rad),
        math.sin(press.elevation_rad),
    )
