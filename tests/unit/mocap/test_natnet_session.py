"""A session with a server of NatNet: connection, clock, names, and streams that are not used."""

import random
import struct

import pytest

from pointit.bridges.mocap.bodies import Bodies, TimedFrame
from pointit.bridges.mocap.config import MocapConfig
from pointit.bridges.mocap.natnet_client import NatNetSession, ServerClock
from pointit.schemas import NS_PER_S
from tests.support.bench import START_NS
from tests.unit.mocap import natnet_encoder as natnet
from tests.unit.mocap.natnet_encoder import CLOCK_HZ, Body

MS = NS_PER_S // 1000
AHEAD_NS = 7 * 10**14


def ticks(time_ns: int) -> int:
    return (time_ns + AHEAD_NS) * CLOCK_HZ // NS_PER_S


class Conversation:
    """A session and what it used, with a server whose answers take a millisecond."""

    def __init__(self, version: tuple[int, int] = (3, 1), *, connected: bool = True) -> None:
        self.version = version
        self.used: list[TimedFrame] = []
        self.session = NatNetSession("motive-pc", self.used.append)
        self.session.restart(START_NS)
        self.now_ns = START_NS
        self.number = 0
        self.asked: list[int] = []
        if connected:
            self.session.receive(natnet.info(version), self.now_ns)
            self.answer({1: "cup", 2: "plate"})

    def answer(self, names: dict[int, str]) -> None:
        for request in self.session.requests(self.now_ns):
            self.asked.append(request[0])
            if request[0] == 4:
                self.session.receive(natnet.models(names, self.version), self.now_ns)
            elif request[0] == 12:
                self.session.receive(natnet.echo(request, ticks(self.now_ns + MS // 2)), self.now_ns + MS)

    def stream(
        self, frames: int, *bodies: Body, age_ns: int = 5 * MS, stands: bool = False, flags: int = 0
    ) -> None:
        for _ in range(frames):
            self.now_ns += 10 * MS
            self.number += not stands
            exposure_ns = START_NS if stands else self.now_ns - age_ns
            data = natnet.frame(
                bodies or (Body(1),),
                self.version,
                number=self.number,
                exposure=ticks(exposure_ns),
                flags=flags,
            )
            self.session.receive(data, self.now_ns)

    @property
    def problem(self) -> str:
        return self.session.problem(self.now_ns)


@pytest.mark.parametrize("version", [(3, 0), (3, 1), (4, 0), (4, 1)])
def test_bodies_come_with_their_names_and_the_time_of_their_exposure(version: tuple[int, int]) -> None:
    talk = Conversation(version)
    talk.stream(3, Body(2), Body(1))
    assert [name for name, _ in talk.used[-1].bodies] == ["plate", "cup"]
    assert talk.used[-1].stamp_ns == pytest.approx(talk.now_ns - 5 * MS, abs=MS)
    assert talk.used[-1].sigma_s < 0.0005
    assert talk.problem == ""


def test_servers_without_a_clock_are_stamped_at_arrival_with_a_larger_uncertainty() -> None:
    talk = Conversation((2, 9))
    talk.stream(1)
    assert (talk.used[-1].stamp_ns, talk.used[-1].sigma_s) == (talk.now_ns, 0.02)


def test_frames_without_a_time_of_exposure_are_stamped_when_they_were_sent() -> None:
    talk = Conversation()
    talk.now_ns += 10 * MS
    data = natnet.frame([Body(1)], exposure=0, sent=ticks(talk.now_ns - 3 * MS))
    talk.session.receive(data, talk.now_ns)
    assert talk.used[-1].stamp_ns == pytest.approx(talk.now_ns - 3 * MS, abs=MS)
    assert talk.used[-1].sigma_s >= 0.005


def test_a_server_that_does_not_answer_and_one_that_sends_no_frames_are_told_apart() -> None:
    talk = Conversation(connected=False)
    assert talk.problem == ""
    talk.now_ns += 4 * NS_PER_S
    assert "motive-pc does not answer" in talk.problem
    talk = Conversation()
    talk.now_ns += 4 * NS_PER_S
    assert "no frames come (unicast, port 1511)" in talk.problem


def test_frames_that_stand_still_are_not_used_and_reported() -> None:
    talk = Conversation()
    talk.stream(1)
    talk.stream(200, stands=True)
    assert len(talk.used) <= 2
    assert "stand still" in talk.problem
    talk.stream(2)
    assert talk.problem == ""


def test_a_recording_that_motive_plays_is_not_used() -> None:
    talk = Conversation()
    talk.stream(200, age_ns=90 * NS_PER_S)
    assert not talk.used
    assert "90.0 s old" in talk.problem


def test_frames_of_another_machine_are_not_used_and_reported_for_a_while() -> None:
    talk = Conversation()
    talk.stream(1)
    talk.session.receive_unknown(natnet.frame([Body(1)], number=9), "10.0.0.9", talk.now_ns)
    assert len(talk.used) == 1
    assert "10.0.0.9 streams here, too" in talk.problem
    talk.stream(1001)
    assert talk.problem == ""


def test_a_damaged_packet_costs_itself_only() -> None:
    talk = Conversation()
    talk.stream(1)
    talk.session.receive(natnet.frame([Body(1)])[:40], talk.now_ns)
    talk.session.receive(b"\x07", talk.now_ns)
    talk.stream(1)
    assert (len(talk.used), talk.session.damaged) == (2, 2)
    assert "sent no NatNet as it is known" in talk.problem


def test_names_are_asked_for_again_when_models_changed_or_an_unknown_body_comes() -> None:
    talk = Conversation()
    talk.stream(1, flags=2)
    talk.answer({1: "mug"})
    talk.stream(1)
    assert talk.used[-1].bodies[0][0] == "mug"
    talk.stream(1, Body(77))
    assert talk.used[-1].bodies[0][0] == "body 77"
    talk.answer({77: "hat"})
    talk.stream(1, Body(77))
    assert talk.used[-1].bodies[0][0] == "hat"
    talk.asked.clear()
    talk.answer({})
    assert 4 not in talk.asked, "names that are known are not asked for"


def test_bodies_of_one_streaming_id_are_not_used_and_both_are_named() -> None:
    talk = Conversation()
    talk.stream(1, flags=2)
    models = natnet.models({1: "cap", 2: "cup", 7: "cuff"}).replace(
        struct.pack("<ii", 7, -1), struct.pack("<ii", 1, -1)
    )
    talk.session.receive(models, talk.now_ns)
    bodies = Bodies(MocapConfig.model_validate({"up": "z", "bodies": {"cuff": {}}}))
    for _ in range(250):
        talk.stream(1, Body(1, (1.0, 1.0, 1.0)), Body(1, (3.0, 1.0, 1.0)), Body(2, (2.0, 2.0, 1.0)))
        assert [pose.name for pose in bodies.update(talk.used[-1], None)] == ["cup"]
    sentence = "the bodies cap, cuff have one streaming id, 1, and are not used: give each its own in Motive"
    assert sentence in bodies.problem(talk.now_ns)


def test_more_bodies_than_a_room_has_are_damage() -> None:
    talk = Conversation()
    talk.stream(1, *(Body(number) for number in range(257)))
    assert (talk.used, talk.session.damaged) == ([], 1)


def test_a_server_that_is_silent_is_connected_to_anew() -> None:
    talk = Conversation()
    talk.stream(1)
    talk.now_ns += 6 * NS_PER_S
    assert [request[0] for request in talk.session.requests(talk.now_ns)] == [0]
    talk.session.receive(natnet.info((4, 1)), talk.now_ns)
    talk.version = (4, 1)
    talk.answer({1: "cup"})
    talk.stream(1)
    assert talk.used[-1].bodies[0][0] == "cup"


@pytest.mark.parametrize("rate", [-40e-6, 0.0, 40e-6])
def test_the_clock_is_known_within_half_a_millisecond_though_it_drifts_and_echoes_are_late(
    rate: float,
) -> None:
    dice, clock = random.Random(3), ServerClock(CLOCK_HZ)
    errors: list[float] = []
    for second in range(120):
        sent_ns = START_NS + second * NS_PER_S // 2
        away_ns, back_ns = (int(dice.expovariate(1 / (0.3 * MS))) + MS // 20 for _ in range(2))
        there_ns = sent_ns + away_ns
        clock.add(sent_ns, there_ns + back_ns, ticks(there_ns + round(rate * (there_ns - START_NS))))
        now_ns = sent_ns + NS_PER_S // 3
        time = clock.time_ns(ticks(now_ns + round(rate * (now_ns - START_NS))), now_ns)
        assert time is not None
        errors.append(abs(time[0] - now_ns))
    assert sorted(errors)[-6] < MS // 2
    assert clock.steps == 0


@pytest.mark.parametrize("step_ns", [-30 * NS_PER_S, 8 * MS, 30 * NS_PER_S])
def test_a_clock_that_was_set_is_followed_from_the_next_echo_on(step_ns: int) -> None:
    clock = ServerClock(CLOCK_HZ)
    for index in range(40):
        sent_ns = START_NS + index * NS_PER_S // 2
        moved_ns = step_ns if index >= 20 else 0
        clock.add(sent_ns, sent_ns + MS, ticks(sent_ns + MS // 2 + moved_ns))
        time = clock.time_ns(ticks(sent_ns + moved_ns), sent_ns)
        assert time is not None
        assert time[0] == pytest.approx(sent_ns, abs=MS // 2)
    assert clock.steps == 1
