"""`pointit study`: checks, power, report, and the experiment itself."""

import asyncio
import importlib.util
import os
import tempfile
from collections import deque
from functools import partial
from pathlib import Path

import click

from pointit.cli.common.keyboard import check_keyboard, key_bytes
from pointit.commands import (
    EXIT_FAILED,
    ConfigError,
    OutputSection,
    ProgressCallback,
    interruptible,
    json_option,
    progress,
    remedy,
    replaced_file,
    run_until_shutdown,
    say,
    show,
)
from pointit.runtime.host.extras import has_extra
from pointit.schemas.printable import is_printable
from pointit.schemas.text import system_reason
from pointit.study.check import StudyFinding, check_folder
from pointit.study.lsl import check_lsl
from pointit.study.model import Study, read_study
from pointit.study.page.view import PageView
from pointit.study.plan import check_sequences, plan_of
from pointit.study.questionnaire import Scale
from pointit.study.scenario import check_ready
from pointit.study.session import Session, StoppedError
from pointit.study.simulated import simulate
from pointit.study.study_folder import StudyFolder
from pointit.study.study_site import SiteOptions
from pointit.study.study_step import StudyStep
from pointit.study.view import StudyCommand, StudyStatus

KEYS = {"r": StudyCommand("repeat"), "p": StudyCommand("pause"), "q": StudyCommand("stop")}
HELP = "r repeat  s skip  p pause  q stop"

PATH = click.Path(path_type=Path)


@click.command("check")
@click.argument("path", metavar="FOLDER|FILE", type=click.Path(path_type=Path))
@json_option
def check(*, path: Path, as_json: bool) -> int:
    """Find missing trials, wrong clocks, broken balance and mixed-up participants in FOLDER.

    Check the FILE of a study for errors that would stop it later: values of services in all cells, pictures,
    the function that ends a trial, and blocks with too few trials for a throughput. The exit code is 1 if
    something is wrong. Trials that are not done yet are only a note.

    Example: pointit study check three_methods-data
    """
    findings: list[StudyFinding] = []
    if path.is_file():
        study = read_study(path)
        check_ready(study)
        check_sequences(study)
    else:
        findings = check_folder(path)
    if findings or as_json:
        rows = tuple(finding._asdict() for finding in findings)
        show([OutputSection(name="findings", about="missing or wrong", rows=rows)], as_json=as_json)
    else:
        say(f"{path}: nothing is missing or wrong")
    has_error = any(finding.severity == "error" for finding in findings)
    return EXIT_FAILED if has_error else 0


@click.command("power")
@click.argument("file", required=False, metavar="[FILE]", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--pilot",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    metavar="FOLDER",
    help="draw participants from the data of a study instead",
)
@click.option("--factor", required=True, metavar="NAME", help="factor whose effect is sought")
@click.option(
    "--levels", type=(str, str), metavar="A B", help="levels that are compared  [default: the first two]"
)
@click.option(
    "--effect",
    metavar="SIZE",
    help="mean of B minus mean of A, in the unit of the measure, or as a share of A, such as -10%"
    "  [default: that of the pilot]",
)
@click.option("--measure", default="selection_s", help="column of trials.csv")
@click.option("--most", default=100, type=click.IntRange(4, 1000), help="maximum number of participants")
@click.option(
    "--runs", default=2000, type=click.IntRange(100, 100_000), help="number of drawn studies of each size"
)
@click.option("--seed", default=0, type=click.IntRange(0), help="seed of the draws")
@json_option
def power(
    *,
    file: Path | None,
    pilot: Path | None,
    factor: str,
    levels: tuple[str, str] | None,
    effect: str | None,
    measure: str,
    most: int,
    runs: int,
    seed: int,
    as_json: bool,
) -> None:
    """Print the number of participants that find an effect of a stated size with 80 and with 90 %.

    Simulated participants run the study FILE, as many as it names. Participants are drawn from them, or from
    --pilot, with replacement. Their differences are centred, and the effect is added. Each drawn study is
    tested at 5 %: by a paired two-sided t-test of the participants' medians, or by Welch's test if the factor
    is between participants (then numbers are of each group). Intervals reflect the number of runs only, not
    how representative the pilot is.

    Example: pointit study power my_study.yaml --factor method --levels dwell press --effect -10%
    """
    from pointit import study_report  # noqa: PLC0415 - only what is needed is loaded
    from pointit.study_report import power  # noqa: PLC0415

    if (file is None) == (pilot is None):
        raise ConfigError("give either the FILE of a study or --pilot FOLDER")
    with interruptible(), progress() as on_progress:
        # Participants: those of the pilot, or simulated ones
        if pilot is not None:
            study = study_report.trials(pilot)
        else:
            with tempfile.TemporaryDirectory() as folder:
                _simulate_power(file or Path(), Path(folder), on_progress)
                study = study_report.trials(folder)
        compared = levels or study.levels(factor)[:2]
        if len(compared) < 2:
            raise ConfigError(f"--factor {factor}: has one level only; give a factor with two")

        # Drawn studies of each number of participants
        level_a, level_b = compared
        people = power.spread(study, factor, level_a, level_b, measure)
        size = people.difference if effect is None else _size(effect, people.mean)

        def tell(count: int) -> None:
            on_progress(f"{count} participants")

        counts = range(4, most + 1)
        table = power.power(people, size, counts, runs=runs, seed=seed, tell=tell)

    about = f"{people.test}, {measure}: {level_b} - {level_a} = {size:+.4g}, {runs} studies each, seed {seed}"
    show([OutputSection(name="power", about=about, rows=tuple(table))], as_json=as_json)
    if as_json:
        return
    group = "" if people.is_within else " in each group"
    for goal in power.GOALS:
        needed, low, high = power.needed(table, goal)
        share = f"{goal:.0%} of studies"
        if needed is None:
            click.echo(f"{share}: not with {most} participants{group}; try --most")
        else:
            maximum = f"more than {most}" if high is None else str(high)
            interval = f"{low} to {maximum}"
            click.echo(f"{share}: {needed} participants{group} ({interval})")


def _simulate_power(file: Path, folder: Path, on_progress: ProgressCallback) -> None:
    study = read_study(file)
    data = StudyFolder(folder, study, file.read_text(encoding="utf-8"))
    for participant in study.people:
        on_progress(f"simulated participant {participant}")
        simulate(study, data, participant, lambda _: None)


def _size(text: str, mean: float) -> float:
    number = text.removesuffix("%")
    unit = mean / 100 if number != text else 1
    try:
        size = float(number) * unit
    except ValueError:
        raise ConfigError(f"--effect {text}: not a number or a share such as -10%") from None
    if not abs(size) < float("inf"):
        raise ConfigError(f"--effect {text}: not a finite number")
    return size


@click.command("report")
@click.argument("folder", metavar="FOLDER", type=click.Path(path_type=Path, file_okay=False, exists=True))
@click.option(
    "--to",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="folder for the report; created if it does not exist  [default: FOLDER]",
)
def report(*, folder: Path, to: Path | None) -> None:
    """Write the report of the study in FOLDER, and its trials as one table.

    report.html has medians with intervals over participants, differences, outcomes, learning, throughput,
    Fitts' law, questionnaires and a mixed model, each with the line of Python that makes it. report.ipynb
    repeats it as a notebook. all_trials.csv has the trials of all participants, also as Parquet if pyarrow is
    installed. Needs the extra `plot`: matplotlib

    Example: pointit study report my_study
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise ConfigError(f"reports need matplotlib, which is not installed; run {remedy('plot')}")
    from pointit import study_report  # noqa: PLC0415 - only what is needed is loaded
    from pointit.study_report import page  # noqa: PLC0415 - takes half a second and an extra

    study = study_report.trials(folder)
    target = to or folder

    # Each file replaces an earlier one whole, so that Ctrl-C leaves a report that can be read
    try:
        target.mkdir(parents=True, exist_ok=True)
        with interruptible(), progress() as tell:
            html, notebook = page.report(study, _seen_from(target, folder), tell)
        for name, text in (("report.html", html), ("report.ipynb", notebook)):
            with replaced_file(target / name) as part:
                part.write_text(text, encoding="utf-8")
        tables = study_report.write_all_trials(folder, target)
    except OSError as error:
        raise ConfigError(f"{target}: cannot be written ({system_reason(error)})") from error

    # Paths on standard output are for programs
    for note in page.notes_of(study):
        click.echo(f"note: {note}", err=True)
    for path in (target / "report.html", target / "report.ipynb", *tables):
        click.echo(path)


def _seen_from(target: Path, folder: Path) -> str:
    """Return the path of `folder` from `target`, where notebooks run; absolute on another drive."""
    try:
        return os.path.relpath(folder, target)
    except ValueError:
        return str(folder.resolve())


def _values_of(scale: Scale) -> range:
    low, high = scale.points
    return range(low, high + 1, scale.step)


class TerminalView:
    """Shows one line that changes, and reads keys. Pass `on_bytes` to the keyboard."""

    def __init__(self) -> None:
        """Create without commands."""
        self._commands = deque[StudyCommand]()
        self._typed: str | None = None
        """Text that is being typed, or None while keys are commands."""
        self._entered = asyncio.Event()
        self._asks_reason = False
        self._shown = ""
        self._is_paused = False

    def on_bytes(self, data: bytes) -> None:
        """Process pressed keys."""
        for key in data.decode(errors="ignore"):
            self._on_key(key)

    async def tell(self, *steps: StudyStep, go: str) -> bool:
        """Show `steps` until Enter, of pictures their names; `agree` wants an answer."""
        lines: list[str] = []
        for step in steps:
            lines.append(step.text)
            if step.image:
                lines.append(f"[picture {step.image}]")
        text = "\n".join(filter(None, lines))
        question = "agree? y or n, then Enter: " if go == "agree" else f"Enter to {go} "
        while True:
            typed = await self._read(f"{text}\n{question}")
            answer = typed.strip().lower()
            if go != "agree" or answer in ("y", "yes"):
                return True
            if answer in ("n", "no"):
                return False

    async def ask(self, scale: Scale, block: str = "") -> list[int]:
        """Ask all items of `scale`, each until the answer is one of its values."""
        if block:
            click.echo(f"Questions on {block}:")
        low, high = scale.points
        low_end, high_end = scale.ends
        ends = f"{low} = {low_end}, {high} = {high_end}"
        values = {str(value): value for value in _values_of(scale)}
        steps = f" in steps of {scale.step}" if scale.step != 1 else ""
        answers: list[int] = []
        for item in scale.items:
            question = f"{item}\n{ends}: "
            while True:
                typed = await self._read(question)
                answer = typed.strip()
                if answer in values:
                    break
                click.echo(f"write a whole number from {low} to {high}{steps}")
            answers.append(values[answer])
        return answers

    def status(self, status: StudyStatus) -> None:
        """Show where the study stands, in one line."""
        self._is_paused = status.state == "paused"
        if self._typed is not None:
            return
        trial = f"trial {status.trial}, {status.left} left"
        state: str = status.state
        if status.target:
            state += f" at {status.target}"
        line = f"{status.participant}  {trial}  {status.condition}  {state}  [{HELP}]"
        if line != self._shown:
            self._shown = line
            self._write(f"\r\x1b[K{line}")

    def command(self) -> StudyCommand | None:
        """Return the next command of the experimenter."""
        return self._commands.popleft() if self._commands else None

    def _on_key(self, key: str) -> None:
        # Commands, while nothing is asked
        if self._typed is None:
            if key == "s":
                if not self._is_paused:  # the trial does not go on while the reason is typed
                    self._commands.append(StudyCommand("pause"))
                self._typed = ""
                self._asks_reason = True
                self._write("\r\x1b[Kskip this trial; why? ")
            elif key in KEYS:
                self._commands.append(KEYS[key])
            return

        # Text, which the terminal does not echo
        if key in "\r\n":
            self._write("\n")
            if self._asks_reason:
                self._commands.append(StudyCommand("skip", self._typed.strip()))
                self._typed = None
                self._asks_reason = False
            else:
                self._entered.set()
        elif key in "\x7f\b":
            self._typed = self._typed[:-1]
            self._write("\b \b")
        elif is_printable(key):
            self._typed += key
            self._write(key)

    async def _read(self, text: str) -> str:
        self._write(f"\r\x1b[K{text}")
        self._typed = ""
        self._asks_reason = False
        self._entered.clear()
        await self._entered.wait()
        typed = self._typed or ""
        self._typed = None
        return typed

    def _write(self, text: str) -> None:
        click.echo(text, nl=False)


@click.command("run")
@click.argument("file", metavar="FILE", type=PATH)
@click.option("--to", type=PATH, metavar="DIR", help="folder of the data; by default NAME-data")
@click.option(
    "--participant",
    default="",
    show_default=False,
    metavar="NAME",
    help="participant; default: the next one of the plan",
)
@click.option("--simulated", type=click.IntRange(min=1), metavar="N", help="first N participants, simulated")
@click.option(
    "--imu",
    default="",
    show_default=False,
    metavar="SOURCE",
    help="the participant's wrist, as for `pointit run`",
)
@click.option(
    "--output", default="", show_default=False, metavar="OUTPUT", help="output of light, as for `pointit run`"
)
@click.option("--localize", is_flag=True, help="first localize the participant by pointing at lamps")
@click.option(
    "--listen",
    default="",
    show_default=False,
    metavar="ADDRESS",
    help="address at which dashboards join, such as tcp/127.0.0.1:7447",
)
@click.option(
    "--record/--no-record",
    default=None,
    help="write session.mcap  [default: for people, not for simulated participants]",
)
@click.option("--lsl", is_flag=True, help="streams in the Lab Streaming Layer, open to the local network")
@click.option("--page", "in_page", is_flag=True, help="show it in two browser pages, not in the terminal")
@click.option("--lan", is_flag=True, help="the pages are open to the local network, by HTTPS")
def command(
    *,
    file: Path,
    to: Path | None,
    participant: str,
    simulated: int | None,
    imu: str,
    output: str,
    localize: bool,
    listen: str,
    record: bool | None,
    lsl: bool,
    in_page: bool,
    lan: bool,
) -> int:
    """Run the study FILE with one participant, from their first trial that is not done.

    Each trial is stored when it ends. After a crash, the same command continues. Keys: r repeats the trial, s
    skips it with a reason, p pauses, q stops; --page prints the links of two pages instead, which are secret.
    --simulated takes virtual time. Without --simulated and --imu, the participant is simulated in real time.

    Example: pointit study run my_study.yaml --imu page
    """
    study = read_study(file)
    if simulated is not None:
        given = {"--participant": participant, "--imu": imu, "--output": output, "--localize": localize}
        given |= {"--listen": listen, "--page": in_page, "--lan": lan, "--lsl": lsl}
        _check_simulated(study, simulated, list(filter(given.get, given)))
    pictures = check_ready(study)

    # Who has not finished
    source = file.read_text(encoding="utf-8-sig")
    data = to or Path(f"{study.name}-data")
    folder = StudyFolder(data, study, source, partial(say, err=True))
    people = study.people[:simulated]
    unfinished = [name for name in people if not folder.about(name).get("ended")]
    if not participant and not unfinished:
        raise ConfigError(
            f"{people[0]} to {people[-1]} have finished, with data in {folder.path}; give --to another "
            "folder to begin again"
        )
    if simulated is not None:
        return _simulate(study, folder, unfinished, bool(record))

    # All that a trial needs is checked before the participant begins
    if lan and not in_page:
        raise ConfigError("--lan opens pages; give --page, too")
    if in_page and not has_extra("web"):
        raise ConfigError(f"--page needs {remedy('web')}")
    if lsl:
        check_lsl()
    if not in_page:
        check_keyboard("--page or --simulated")
    if record is None:
        record = importlib.util.find_spec("mcap") is not None
        if not record:
            say(f"no recording: it needs {remedy('record')}; the tables are written", err=True)

    options = SiteOptions(imu=imu, output=output, localize=localize, listen=listen, record=record, lsl=lsl)
    name = participant or unfinished[0]
    view = PageView(study.name, name, pictures) if in_page else TerminalView()
    session = Session(study, folder, name, view, options)
    return run_until_shutdown(_run(session, folder.path / name, view, lan=lan))


def _check_simulated(study: Study, simulated: int, given: list[str]) -> None:
    if given:
        raise ConfigError(f"--simulated {simulated}: {given[0]} is for people; leave one of the two out")
    most = len(study.people)
    if simulated > most:
        raise ConfigError(
            f"--simulated {simulated}: {study.name} has {most} participants; give at most {most}"
        )


async def _run(session: Session, data: Path, view: PageView | TerminalView, *, lan: bool) -> int:
    if isinstance(view, TerminalView):
        with key_bytes(view.on_bytes):
            outcome = await _outcome(session, data)
            click.echo()
            say(outcome)
        return 0
    from pointit.study.page.server import served  # noqa: PLC0415 - needs the extra `web`

    async with served(view, lan=lan) as (participants, experimenters):
        say(f"page of {data.name}: {participants}")
        say(f"page of the experimenter: {experimenters}")
        outcome = await _outcome(session, data)
        view.end("You may close this page.")
    say(outcome)
    return 0


async def _outcome(session: Session, data: Path) -> str:
    """Run `session`; return how it ended."""
    try:
        await session.run()
    except StoppedError as stopped:
        return str(stopped)
    except asyncio.CancelledError:  # Ctrl-C
        click.echo()  # behind the line that changes
        say(session.stop_sentence)
        raise
    return f"{data.name} has finished; the data are in {data}"


def _tell_trial(on_progress: ProgressCallback, last: int, status: StudyStatus) -> None:
    on_progress(status.participant, last - status.left)


def _simulate(study: Study, folder: StudyFolder, people: list[str], record: bool) -> int:
    plans = {name: plan_of(study, name) for name in people}
    trials = {name: len(plan.trials) for name, plan in plans.items()}
    done = 0
    try:
        with interruptible(), progress(sum(trials.values())) as on_progress:
            for name in people:
                last = done + trials[name]
                report = partial(_tell_trial, on_progress, last)
                simulate(study, folder, name, report, record=record)
                done = last
    except KeyboardInterrupt:
        say(f"stopped; what was measured is in {folder.path}, and the same command goes on there", err=True)
        raise
    say(f"{len(people)} simulated participants have done {done} trials; the data are in {folder.path}")
    return 0
