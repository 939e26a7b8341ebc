"""Option `--verb` of `pointit listen`: verbs of things, and the programs that they start."""

from collections import defaultdict
from collections.abc import Sequence

from pointit.cli.things.reactions import Reaction, Target
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.schemas import Referent
from pointit.speech.grammar import spoken
from pointit.speech.verbs import Site, Verb, own


def own_verbs(texts: Sequence[str]) -> dict[str, Verb]:
    """Return the verbs of `VERB THING=PROGRAM`, `VERB THING=URL` or `VERB THING`.

    Raises:
        ConfigError: If one is none of these, or what it names cannot be used.
    """
    verbs = defaultdict[str, dict[str, Target | None]](dict)
    for text in texts:
        words = text.partition("=")[0].split()
        if len(words) != 2 or spoken(words[0]) != (words[0],):
            raise ConfigError(
                f"--verb {text!r}: write 'VERB THING=PROGRAM', such as 'heat kettle=./heat.sh {{user}}'"
            )
        verb, thing = words
        verbs[verb][thing] = Reaction.parse(text).target if "=" in text else None
    return {verb: own(targets.keys(), _Reactions(targets)) for verb, targets in verbs.items()}


class _Reactions:
    """Starts the program of a thing."""

    def __init__(self, targets: dict[str, Target | None]) -> None:
        self._targets = targets

    async def __call__(self, site: Site, verb: str, one: Referent) -> str:
        """Do it. Raises RefusedError, if the program fails."""
        what = f"{verb} {site.room.label(one)}"
        if (target := self._targets[one.name]) is None:
            return what
        values = {"thing": one.name, "user": site.user, "confidence": f"{one.probability:.2f}", "state": "on"}
        if problem := await target.react({**values, "stamp_ns": str(site.clock.now_ns())}):
            raise RefusedError(f"{what}: {target.describe(values)} {problem}")
        return what
