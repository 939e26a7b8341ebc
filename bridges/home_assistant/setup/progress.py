"""State of the set-up of a home, and what each act at its cards does to it. Pure; stored after each act.

    connect ──▶ choose ──▶ hand ──▶ place ──▶ try ──▶ done        `go` returns to any card

In `place`, people point at each lamp from the place A, walk, and point at each again from B. Pointing after a
wide movement of the arm is less exact, so at A such lamps come once more, in the order in which they stand,
unless the first of them show that this person points well. At B all come in that order. The zero of their
device's yaw may change meanwhile, as after a restart. Then a lamp that was pointed at before finds it.
"""

import math
from collections.abc import Collection, Sequence

from pointit.bridges.home_assistant.setup.contradiction import (
    contradiction,
    repeated_contradiction,
)
from pointit.bridges.home_assistant.setup.lamp_presses import (
    MIN_AGAIN,
    exactest_press,
    lamp_beside,
    rays_of,
    target_apart,
    target_key,
    targets_again,
    without_presses,
)
from pointit.bridges.home_assistant.setup.placed_lamps import (
    exchanged,
    placed_for_trial,
    placed_in,
    tried_lamp,
)
from pointit.bridges.home_assistant.setup.stored_setup import (
    AddressTrial,
    ChosenLamp,
    End,
    LampPress,
    StoredSetup,
    UsedSecret,
)
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.runtime.errors import RefusedError
from pointit.scan.paced import MIN_WALK_M, locate_paced
from pointit.scan.paced_model import FIRST, SECOND, PacedRoom
from pointit.schemas.home import HomeHand, HomePlace, HomeStep

MAX_LAMPS = 64
AGAIN = "your arm came from far away, and a short way is more exact"
"""Reason for which a lamp comes once more."""
APART = "your presses at it lie far apart: point at it once more"
AWAY_RAD = math.radians(12.0)
"""Angle from a press from which the arm points elsewhere."""


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
        self.beside = ""
        """Lamp at which the arm still points, by the press `_pending`, or `""`."""
        self._pending: LampPress | None = None
        """Press that counts once the person says that both lamps are beside each other."""
        self._has_left = False
        """The arm has pointed elsewhere since `_pending`."""

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
        if self.state.is_short_walk:
            return None
        apart = self._target_apart
        if apart is not None:
            return apart
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
        azimuths_rad = {press.target: press.azimuth_rad for press in self.state.presses[::-1]}
        return sorted(self.targets, key=lambda target: azimuths_rad.get(target, 0.0))

    @property
    def _target_apart(self) -> tuple[str, End] | None:
        """Return the target of the newest press if it agrees with none of the others at it from there."""
        target = target_apart(self.state.presses, self.state.place)
        return target if target in self.targets else None

    @property
    def _targets_again(self) -> list[tuple[str, End]]:
        """Return the targets that come once more at the first place, as they stand around it."""
        if self.state.place != FIRST or len(self.targets) < MIN_AGAIN:
            return []
        return targets_again(self.state.presses)

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
        if state.step != "place" or state.place != FIRST or self.is_complete:
            return False
        return bool(state.presses) and self.target is None

    @property
    def is_complete(self) -> bool:
        """Return True if all lamps were pointed at from all places, so that they can be located."""
        state = self.state
        if state.step != "place" or state.is_short_walk or self.target is not None:
            return False
        places = (FIRST,) if state.has_one_place else (FIRST, SECOND)
        return all(set(self.targets) <= self._pressed_targets(place) for place in places)

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

    def on_arm(self, direction: Vec3) -> None:
        """Note the direction of the arm, {H}."""
        if self._pending is not None:
            azimuth_rad = self._pending.azimuth_rad - self.state.turn_rad
            asked_at = self._pending.model_copy(update={"azimuth_rad": azimuth_rad}).direction
            self._has_left |= vector.angle_between(asked_at, direction) > AWAY_RAD

    def press(self, azimuth_rad: float, elevation_rad: float, eyes_m: float, spread_rad: float = 0.0) -> None:
        """Note that the person points at the target.

        A press in the direction of another lamp does not count at once: `beside` is that lamp until `confirm`
        or `replace_beside`. It counts also if they point elsewhere and come back to it.

        Args:
            azimuth_rad: {H}.
            elevation_rad: {H}.
            eyes_m: height of their eyes.
            spread_rad: rms angle of the rays of the press around their mean.

        Raises:
            RefusedError: If it is no lamp's turn.
        """
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
            spread_rad=spread_rad,
            zero=self.state.zero,
        )
        beside = lamp_beside(self.state.presses, press)
        has_come_back = self._pending is not None and self._has_left and beside == self.beside
        if beside and not has_come_back:
            self.beside = beside
            self._pending = press
            self._has_left = False
            return
        self._count(press)

    def confirm(self) -> None:
        """Count the press in the direction of another lamp: they are beside each other."""
        if self._pending is None:
            raise RefusedError("there is nothing to confirm now")
        self._count(self._pending)

    def replace_beside(self) -> None:
        """Count the press in the direction of another lamp, whose own press was wrong: it comes again."""
        pending = self._pending
        if pending is None:
            raise RefusedError("there is nothing to correct now")
        self._change(presses=without_presses(self.state.presses, self.beside, pending.place))
        self._count(pending)

    def _count(self, press: LampPress) -> None:
        self._forget_pending()
        self._change(presses=(*self.state.presses, press))
        self.reasons.pop(press.lamp, None)
        if self._target_apart is not None:
            self.reasons[press.lamp] = APART

    def _forget_pending(self) -> None:
        self.beside = ""
        self._pending = None

    def _reach_to(self, azimuth_rad: float, elevation_rad: float) -> float | None:
        """Return the angle by which the arm has moved since the last press, and note where it is now."""
        previous = self._arm_rad
        self._arm_rad = (azimuth_rad, elevation_rad)
        if previous is None:
            return None
        return math.hypot(math.remainder(azimuth_rad - previous[0], math.tau), elevation_rad - previous[1])

    def take_back(self) -> None:
        """Forget the last press. At the second place without presses, return to the first one."""
        if self._pending is not None:
            self._forget_pending()
            return
        presses = self.state.presses
        if self.state.step != "place" or not presses:
            raise RefusedError("there is no press to take back")
        self._change(presses=presses[:-1], place=presses[-1].place, has_one_place=False, is_short_walk=False)

    def repeat(self, lamp: str, place: HomePlace) -> None:
        """Point at a lamp once more from a place, where the presses at it so far do not count any more."""
        state = self.state
        if state.hand not in ("phone", "wrist") or not state.presses:
            raise RefusedError("nobody has pointed at lamps yet: place them first")
        if lamp not in {chosen.id for chosen in state.lamps}:
            raise RefusedError("that lamp is not chosen: choose it first")
        has_walked = any(press.place == SECOND for press in state.presses)
        if place not in (FIRST, SECOND) or (place == SECOND and not has_walked):
            raise RefusedError("nobody has pointed from the second place yet")
        self._forget_pending()
        self.reasons.pop(lamp, None)
        self._arm_rad = None
        self._change(
            step="place",
            place=place,
            presses=without_presses(state.presses, lamp, place),
            repeated=tuple(target for target in state.repeated if target[0] != lamp),
            dropped=tuple(press for press in state.dropped if press.lamp != lamp),
            left_out={name: reason for name, reason in state.left_out.items() if name != lamp},
            met=tuple(name for name in state.met if name != lamp),
            zero=state.zero + 1,
        )

    def walk(self) -> None:
        """Note that the person stands at the second place, or has walked further from the first one."""
        if not self.may_walk and not self.state.is_short_walk:
            raise RefusedError("point at all lamps from the first place before you walk")
        self._arm_rad = None
        self._forget_pending()
        presses = self.state.presses
        if self.state.is_short_walk:
            presses = tuple(press for press in presses if press.place == FIRST)
        self._change(place=SECOND, presses=presses, is_short_walk=False)

    def stay(self) -> None:
        """Note that the person points from one place only."""
        if not self.may_walk and not self.state.is_short_walk:
            raise RefusedError("point at all lamps first")
        presses = tuple(press for press in self.state.presses if press.place == FIRST)
        self._change(has_one_place=True, place=FIRST, presses=presses, is_short_walk=False)

    def skip(self) -> None:
        """Leave out the lamp whose turn it is, or point without finding the zero of the device again."""
        if self.is_aligning and self.state.step != "place":
            self.is_aligning = False
            return
        if self.tried_lamp:
            self._change(aside=(*self.state.aside, self.tried_lamp))
            return
        target = self.target
        if target is None or self.is_aligning:
            raise RefusedError("there is nothing to skip now")
        if len({lamp for lamp, _ in self.targets}) == 1:
            raise RefusedError("one lamp must remain: go back and choose another one")
        self._forget_pending()
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
        presses = [press for press in state.presses if press.lamp not in state.left_out]
        return locate_paced(rays_of(presses))

    def on_room(self, room: PacedRoom) -> None:
        """Place the lamps as in `room`. Lamps whose presses contradict the others are asked for once more.

        After a walk of less than a step the person decides: no distance was learned.
        """
        # A lamp that contradicts the others again is left out
        asked_again: list[tuple[str, End]] = []
        left_out: dict[str, str] = {}
        for lamp, end in self.targets:
            target = room.targets[target_key(lamp, end)]
            reason = contradiction(self.state, target)
            if reason and (lamp, end) in self.state.repeated:
                left_out[lamp] = repeated_contradiction(self.state, (lamp, end), reason)
            elif reason:
                asked_again.append((lamp, end))
                self.reasons[lamp] = reason
        if asked_again:
            # The presses of other places stay: only those of this place are made once more.
            remaining: list[LampPress] = []
            dropped: list[LampPress] = []
            for press in self.state.presses:
                is_repeated = press.target in asked_again and press.place == self.state.place
                (dropped if is_repeated else remaining).append(press)
            self._change(
                presses=tuple(remaining),
                repeated=(*self.state.repeated, *asked_again),
                dropped=(*self.state.dropped, *dropped),
            )
            return
        lamps = {lamp for lamp, _ in self.targets}
        if left_out and len(left_out) < len(lamps):
            self._leave_out(left_out)  # it is complete without them, and fitted once more
            return
        if len(room.places_m) > 1 and room.walk_m < MIN_WALK_M:
            self._change(is_short_walk=True)
            return
        self._on_located(room)

    @property
    def tried_lamp(self) -> str:
        """Return the placed lamp that is to be tried next, unsure ones first, or `""`."""
        return tried_lamp(self.state)

    def meet(self, lamp: str = "") -> None:
        """Note that a lamp has reacted when it was meant; `""`: the one that is tried."""
        lamp = lamp or self.tried_lamp
        if lamp not in {placed.lamp for placed in self.state.placed}:
            raise RefusedError("that lamp is not placed yet")
        if lamp not in self.state.met:
            self._change(met=(*self.state.met, lamp))

    def correct(self, reacted: str) -> None:
        """Correct the lamp that is tried, since another one reacted: `reacted`, or `""` if not known."""
        tried = self.tried_lamp
        if not tried:
            raise RefusedError("no lamp is tried now")
        if reacted and reacted != tried:
            self.exchange((tried, reacted))
        else:
            self.repeat(tried, FIRST)

    def exchange(self, lamps: Sequence[str]) -> None:
        """Exchange the places of two lamps, and their presses: each was taken for the other."""
        placed = {lamp.lamp for lamp in self.state.placed if not lamp.end}
        if len(set(lamps)) != 2 or not set(lamps) <= placed:
            raise RefusedError("say which two lamps, both placed, were taken for each other")
        other = {lamps[0]: lamps[1], lamps[1]: lamps[0]}
        self._change(
            placed=tuple(exchanged(lamp, other) for lamp in self.state.placed),
            presses=tuple(exchanged(press, other) for press in self.state.presses),
            met=tuple(lamp for lamp in self.state.met if lamp not in other),
        )

    def reason_of(self, lamp: str) -> str:
        """Return the reason for which a lamp is left out or comes once more, or `""`."""
        reason = self.state.left_out.get(lamp, "") or self.reasons.get(lamp, "")
        if not reason and self.is_again and self.target is not None and self.target[0] == lamp:
            return AGAIN
        return reason

    def _on_located(self, room: PacedRoom) -> None:
        placed = placed_in(room, self.targets)
        self._change(
            placed=placed, places_m=room.places_m, drift_rad=room.drift_rad, step="try", met=(), aside=()
        )
        self._set_pose(room.places_m[-1], self.state.turn_rad - room.drift_rad)

    def _place_for_trial(self) -> None:
        placed = placed_for_trial(self.targets)
        self._change(
            placed=placed, places_m=((0.0, 0.0),), drift_rad=0.0, step="try", presses=(), met=(), aside=()
        )
        self._set_pose((0.0, 0.0), 0.0)

    @property
    def _known_target(self) -> tuple[str, End] | None:
        """Return the target of which the azimuth is known best: of this place, else of the first one."""
        if self.state.step == "place":
            press = exactest_press(self.state.presses, self.place)
            return None if press is None else press.target
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
        self._change(turn_rad=turn_rad, zero=state.zero + 1)
        if state.step != "place":
            self._set_pose((0.0, 0.0), turn_rad)

    def _known_azimuth(self, target: tuple[str, End]) -> float:
        """Return the azimuth of `_known_target`: as pressed from this place, or else on the map."""
        if self.state.step == "place":
            press = exactest_press(self.state.presses, self.place)
            if press is not None:
                return press.azimuth_rad
        placed = next(lamp for lamp in self.state.placed if (lamp.lamp, lamp.end) == target)
        x, y, _ = placed.position_m
        return math.atan2(y, x)

    def _clear_presses(self) -> None:
        self.is_aligning = False
        self._forget_pending()
        self._change(
            presses=(),
            repeated=(),
            dropped=(),
            is_short_walk=False,
            met=(),
            aside=(),
            zero=0,
            left_out={},
            place=FIRST,
            has_one_place=False,
            turn_rad=0.0,
            drift_rad=0.0,
        )

    def _leave_out(self, reasons: dict[str, str]) -> None:
        self._change(left_out=self.state.left_out | reasons)

    def _pressed_targets(self, place: str) -> set[tuple[str, End]]:
        return {(press.lamp, press.end) for press in self.state.presses if press.place == place}

    def _set_pose(self, position_m: tuple[float, float], yaw_rad: float) -> None:
        self.pose = (position_m, math.remainder(yaw_rad, math.tau))
        self.poses += 1

    def _change(self, **values: object) -> None:
        self.state = self.state.model_copy(update=values)
