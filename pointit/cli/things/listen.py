"""`pointit listen USER`: follow a person's spoken commands, with verbs of one's own."""

import asyncio
import contextlib
import sys
from collections import defaultdict
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pointit.cli.common.output import say
from pointit.cli.common.panels import PanelCommand
from pointit.cli.common.site_link import SiteAddress, site_command
from pointit.runtime.bus.contract import Bus
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.clock import Clock
from pointit.runtime.errors import AccessDeniedError, ConfigError, RefusedError
from pointit.runtime.service.carrier import Act, ActFailedError, Target
from pointit.schemas import NS_PER_S, Referent, SelectionEvent, Speech, Understood
from pointit.schemas.text import system_reason
from pointit.schemas.topics import SPEECH, check_name
from pointit.services.reactions.targets import Program, Reaction
from pointit.speech.grammar import RESERVED, spoken
from pointit.speech.verbs import Verb, VerbContext, verb_of_things

if TYPE_CHECKING:
    from pointit.bridges.speaker.speech_synthesizer import SpeechSynthesizer
    from pointit.speech.interpreter import Interpreter

ROOM_TIMEOUT_S = 2.0
END_TIMEOUT_S = 15.0
"""Time for the last utterance to be followed, questions included, s."""


def own_verbs(texts: Sequence[str]) -> tuple[dict[str, Verb], ConfigError | None]:
    """Return the verbs of `VERB THING=PROGRAM`, `VERB THING=URL` or `VERB THING`, and an error of a program.

    The error is the first of a program or URL that cannot be used. The caller raises it when the map has the
    things: a misspelt thing is the nearer mistake.

    Raises:
        ConfigError: If a text is none of these.
    """
    problem: ConfigError | None = None
    verbs = defaultdict[str, dict[str, Target | None]](dict)
    for text in texts:
        # A verb is one word as it is spoken
        words = text.partition("=")[0].split()
        if len(words) != 2 or spoken(words[0]) != (words[0],):
            raise ConfigError(
                f"--verb {text!r}: write 'VERB THING=PROGRAM', such as 'heat kettle=./heat.sh {{user}}'"
            )
        verb, thing = words
        if verb in RESERVED:
            raise ConfigError(f"--verb {text!r}: {verb!r} has a meaning in all rooms; choose another word")

        # The output of a program is shown, since nothing else says what it has done
        target: Target | None = None
        try:
            target = Reaction.parse(text).target if "=" in text else None
        except ConfigError as error:
            problem = problem or error
        if isinstance(target, Program):
            target = replace(target, is_shown=True)
        verbs[verb][thing] = target

    own: dict[str, Verb] = {}
    for verb, targets in verbs.items():
        own[verb] = verb_of_things(targets.keys(), _starts(targets))
    return own, problem


def _starts(targets: Mapping[str, Target | None]) -> Callable[[VerbContext, str, Referent], Awaitable[str]]:
    """Return the reaction that starts the program of a thing; it raises RefusedError if the program fails."""

    async def start_program(context: VerbContext, verb: str, referent: Referent) -> str:
        action = f"{verb} {context.room.label(referent)}"
        target = targets[referent.name]
        if target is None:
            return action
        event = SelectionEvent(
            stamp_ns=context.clock.now_ns(),
            event="selected",
            object_id=referent.name,
            user=context.user,
            confidence=referent.probability,
        )
        try:
            await target.carry_out(Act(event))
        except ActFailedError as error:
            raise RefusedError(f"{action}: {error}") from error
        return action

    return start_program


@site_command("listen", cls=PanelCommand, usual=("text", "audio", "recogniser", "verbs", "speak", "connect"))
@click.argument("user")
@click.option("--text", metavar="FILE", help="file with lines `TIME WORD` or `WORD`; - is standard input")
@click.option("--audio", metavar="FILE", help="a WAV file, - for raw samples of 16 kHz, or `microphone`")
@click.option("--recogniser", default="pocketsphinx", metavar="NAME", help="plug-in for --audio")
@click.option(
    "--verb",
    "verbs",
    multiple=True,
    metavar="'VERB THING=PROGRAM|URL'",
    help="a verb of a thing, one word, and its program or URL, as for `pointit run --on`; without =, your "
    "own programs follow the understood commands. Repeatable",
)
@click.option("--speak", is_flag=True, help="speak the understood sentence, by espeak-ng")
async def command(
    site: SiteAddress,
    user: str,
    *,
    text: str | None,
    audio: str | None,
    recogniser: str,
    verbs: tuple[str, ...],
    speak: bool,
) -> int:
    """Follow spoken commands of USER, who points: take that, put that there, turn this on, stop.

    Words come from --text or --audio, and from any program on the topic users/USER/speech; without either,
    only from that topic. Prints the understood commands. If one is unclear, its candidates blink in turn and
    the person confirms. The person needs the service listener, which `pointit run --with listener` starts.

    Example: echo "turn that on" | pointit listen anna --text -
    """
    check_name(user, "user")
    if text and audio:
        raise click.UsageError("--text and --audio exclude each other")

    from pointit.bridges.speaker.speech_synthesizer import SpeechSynthesizer  # noqa: PLC0415 - as above
    from pointit.speech.interpreter import Interpreter  # noqa: PLC0415 - as above

    own, problem = own_verbs(verbs)
    async with site.join() as bus:
        denied = await bus.denial_reason("writes", SPEECH, user)
        if denied:
            raise AccessDeniedError(denied)
        clock = SiteClock(bus)
        interpreter = Interpreter(bus, clock, user, own)
        synthesizer = SpeechSynthesizer(clock, on_problem=say) if speak else None

        def tell(understood: Understood) -> None:
            _print_understood(understood)
            if synthesizer is not None:
                synthesizer.say(understood)

        # The interpreter follows from now on, while words come from here or from others
        interpreter.on_understood = tell
        following = asyncio.create_task(interpreter.run())
        publishing: asyncio.Task[int] | None = None
        try:
            await interpreter.wait_for_room(ROOM_TIMEOUT_S)
            if problem is not None:
                raise problem
            say(f"listening to {user}; Ctrl-C ends it")
            spoken = _nothing()
            if text is not None:
                spoken = _typed(text, clock)
            elif audio is not None:
                spoken = _recognise(audio, recogniser, interpreter, clock, synthesizer)

            # Until there are no more words. If the interpreter ends before, that is an error
            publishing = asyncio.create_task(_publish(bus, user, spoken))
            await asyncio.wait({publishing, following}, return_when=asyncio.FIRST_COMPLETED)
            if following.done():
                following.result()
            count = await publishing
            await _finish(interpreter, count, synthesizer)
        finally:
            tasks: list[asyncio.Task[Any]] = list(filter(None, (following, publishing)))
            for task in tasks:
                task.cancel()
            await asyncio.wait(tasks)
    return 0


async def _finish(interpreter: "Interpreter", count: int, synthesizer: "SpeechSynthesizer | None") -> None:
    """Wait until `count` utterances are followed and the last sentence is spoken, but not forever."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(END_TIMEOUT_S):
            await interpreter.finish(count)
            if synthesizer is not None:
                await synthesizer.close()


async def _publish(bus: Bus, user: str, spoken: AsyncIterator[Speech]) -> int:
    """Publish utterances until there are no more. Return their number."""
    publisher = bus.publisher(SPEECH, user)
    count = 0
    async for speech in spoken:
        publisher.put(speech)
        count += 1
    return count


async def _nothing() -> AsyncIterator[Speech]:
    """Yield nothing, and never end: others publish."""
    await asyncio.Event().wait()
    yield Speech(stamp_ns=0)  # not reached


def _print_understood(understood: Understood) -> None:
    sentence = ": ".join(filter(None, (understood.result, understood.message)))
    referents: list[str] = []
    for referent in understood.referents:
        name = referent.name or referent.kind
        referents.append(f"{name} {referent.probability:.0%}")
    if referents:
        sentence += f" ({', '.join(referents)})"
    say(f'"{understood.text}": {sentence}')


async def _recognise(
    audio: str,
    recogniser: str,
    interpreter: "Interpreter",
    clock: Clock,
    synthesizer: "SpeechSynthesizer | None",
) -> AsyncIterator[Speech]:
    """Yield recognised words, without the synthesizer's own words from the microphone."""
    from pointit.speech.audio import MICROPHONE, Stream, WavFile  # noqa: PLC0415 - as above
    from pointit.speech.recogniser import make  # noqa: PLC0415 - as above

    plugin = make(recogniser, {})
    source: Stream | WavFile
    if audio in ("-", MICROPHONE):
        source = Stream(clock, is_microphone=audio == MICROPHONE)
    else:
        source = WavFile(Path(audio), clock)
    async for sentence in plugin.hear(source, interpreter.vocabulary):
        if synthesizer is None or not synthesizer.is_echo(sentence):
            yield sentence


async def _typed(text: str, clock: Clock) -> AsyncIterator[Speech]:
    """Yield utterances when they would have been said: each ends with its line, an empty one or a pause."""
    from pointit.speech.audio import lines_of  # noqa: PLC0415 - as above
    from pointit.speech.recogniser import PAUSE_S, TimedWord, speech, words_in  # noqa: PLC0415

    try:
        file = sys.stdin if text == "-" else Path(text).open("rb")  # noqa: SIM115, ASYNC230 - closed below
    except OSError as error:
        raise ConfigError(f"{text}: {system_reason(error)}") from error
    start_ns = clock.now_ns()
    timed_words = list[TimedWord]()
    try:
        async for line in _with_end(lines_of(file.fileno())):
            # An empty line, or one without a time, ends the utterance before it
            words = words_in(line)
            first_s = words[0].time_s if words else None
            last_s = timed_words[-1].time_s if timed_words else None
            is_apart = first_s is None
            if first_s is not None and last_s is not None:
                is_apart = first_s - last_s > PAUSE_S

            # It is said at its own time, which may still come
            if timed_words and is_apart:
                sentence = speech(timed_words, start_ns, clock.now_ns())
                wait_s = (sentence.stamp_ns - clock.now_ns()) / NS_PER_S
                await asyncio.sleep(max(wait_s, 0.0) / clock.speed)
                yield sentence
                timed_words = []
            if words and first_s is None:
                yield speech(words, start_ns, clock.now_ns())
            else:
                timed_words += words
    finally:
        if file is not sys.stdin:
            file.close()


async def _with_end(lines: AsyncIterator[str]) -> AsyncIterator[str]:
    """Yield the lines and an empty one, which ends the last utterance."""
    async for line in lines:
        yield line
    yield ""
