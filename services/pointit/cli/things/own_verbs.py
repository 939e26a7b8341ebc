"""Option `--verb` of `pointit listen`: verbs of things, and the programs that they start."""

from collections import defaultdict
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import replace

from pointit.cli.things.program import Program
from pointit.cli.things.reactions import Reaction, ReactionTarget
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.schemas import Referent
from pointit.speech.grammar import RESERVED, spoken
from pointit.speech.verbs import Verb, VerbContext, verb_of_things


def own_verbs(texts: Sequence[str]) -> tuple[dict[str, Verb], ConfigError | None]:
    """Return the verbs of `VERB THING=PROGRAM`, `VERB THING=URL` or `VERB THING`, and an error of a program.

    The error is the first of a program or URL that cannot be used. The caller raises it when the map has the
    things: a misspelt thing is the nearer mistake.

    Raises:
        ConfigError: If a text is none of these.
    """
    problem: ConfigError | None = None
    verbs = defaultdict[str, dict[str, ReactionTarget | None]](dict)
    for text in texts:
        words = text.partition("=")[0].split()
        if len(words) != 2 or spoken(words[0]) != (words[0],):
            raise ConfigError(
                f"--verb {text!r}: write 'VERB THING=PROGRAM', such as 'heat kettle=./heat.sh {{user}}'"
            )
        verb, thing = words
        if verb in RESERVED:
            raise ConfigError(f"--verb {text!r}: {verb!r} has a meaning in all rooms; choose another word")
        target: ReactionTarget | None = None
        try:
            target = Reaction.parse(text).target if "=" in text else None
        except ConfigError as error:
            problem = problem or error
        verbs[verb][thing] = replace(target, is_shown=True) if isinstance(target, Program) else target
    own = {verb: verb_of_things(targets.keys(), _starts(targets)) for verb, targets in verbs.items()}
    return own, problem


def _starts(
    targets: Mapping[str, ReactionTarget | None],
) -> Callable[[VerbContext, str, Referent], Awaitable[str]]:
    """Return the reaction that starts the program of a thing; it raises RefusedError if the program fails."""

    async def do(context: VerbContext, verb: str, one: Referent) -> str:
        what = f"{verb} {context.room.label(one)}"
        if (target := targets[one.name]) is None:
            return what
        values = {
            "thing": one.name,
            "user": context.user,
            "confidence": f"{one.probability:.2f}",
            "state": "on",
        }
        if problem := await target.react({**values, "stamp_ns": str(context.clock.now_ns())}):
            raise RefusedError(f"{what}: {target.describe(values)} {problem}")
        return what

    return do
