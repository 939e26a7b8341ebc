"""A session: one participant does what is left of their plan, on a site that the session starts."""

import asyncio
import contextlib
import json
import math
import platform
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pointit
from pointit.errors import ConfigError, PointItError
from pointit.geometry.vector import Vec3
from pointit.study.append_only_csv import AppendOnlyCsv
from pointit.study.lsl import LslOutlets
from pointit.study.measure import Attempt, load_end_rule
from pointit.study.model import Study
from pointit.study.plan import Progress, condition_of, plan_of
from pointit.study.questionnaire import scale_of
from pointit.study.scenario import scenario_file, scenes_of
from pointit.study.study_folder import StudyFolder, check_record
from pointit.study.study_site import SiteOptions, StudySite
from pointit.study.study_step import StudyStep
from pointit.study.table_file import Row, utc
from pointit.study.tasks import StudyScene, StudyTrial
from pointit.study.view import BREAK, StudyCommand, StudyStatus, StudyView

TICK_S = 0.05
CLOCK_APART_S = 0.5
"""Difference between the site's time and the stamps of a wrist above which times are doubtful, s."""


class StoppedError(PointItError):
    """The experimenter has stopped the session; it can go on later."""


def check_simulated(folder: Path, about: Mapping[str, Any], rows: Iterable[Row], *, simulated: bool) -> None:
    """Check that the participant in `folder`, about whom `about` is known, goes on as they have begun.

    Raises: ConfigError: If they are simulated and were a person, or the other way round, or nothing states of
        which of both the `rows` are.
    """
    check_record(folder, about, rows)
    if about.get("simulated", simulated) != simulated:
        owner = "a person" if simulated else "a simulated person"
        raise ConfigError(f"{folder.name} was begun by {owner}; give another participant or --to")


class Session:
    """Session of one participant, who continues their plan."""

    def __init__(
        self, study: Study, folder: StudyFolder, participant: str, view: StudyView, options: SiteOptions
    ) -> None:
        """Read the participant's progress.

        Raises: ConfigError: If the participant has finished, is unknown or runs elsewhere, or a file is
        damaged.
        """
        self._study = study
        self._folder = folder
        self._participant = participant
        self._view = view
        self._setup = options
        self._plan = plan_of(study, participant)
        self._end_rule = load_end_rule(study.end, study.folder)
        self._about: dict[str, Any] = folder.about(participant)
        self._table: AppendOnlyCsv = folder.trials(participant)
        self._progress = Progress(self._plan, self._table.rows)
        data = folder.path / participant
        if not self._progress.left and self._about.get("ended"):
            self._table.close()
            raise ConfigError(f"{participant} has finished; give another one, or move {data} away")
        self._site: StudySite | None = None
        self._scenes: list[StudyScene] = []
        """Scenes of the block, by `Trial.place`."""
        self._lsl: LslOutlets | None = None

    async def run(self) -> None:
        """Run all remaining trials.

        Raises: StoppedError: If the experimenter stops it, or the participant does not agree. PointItError:
        If a service fails, or data cannot be written. Earlier measurements are kept.
        """
        async with contextlib.AsyncExitStack() as stack:
            stack.callback(self._table.close)
            if self._setup.lsl:
                self._lsl = LslOutlets(self._study.name, self._participant)
            await self._begin()
            block = None
            # The site of a block ends before another one starts, and with the session.
            sites = await stack.enter_async_context(contextlib.AsyncExitStack())
            while True:
                trial = self._progress.current
                if trial is None:
                    break
                if trial.block != block:
                    await self._ask_after(trial.block - 1)
                    await self._enter(trial, sites, is_first=block is None)
                    block = trial.block
                await self._do(trial)
            await self._ask_after(self._plan.trials[-1].block)

            # Without a site all trials were done before, and only the end was not stored.
            if self._site is not None:
                ended = utc(self._site.site.now_ns())
            else:
                ended = self._table.rows[-1]["began_utc"]
            self._store_about(ended=ended)

    @property
    def stop_sentence(self) -> str:
        """Position in the study, and how to go on from there."""
        trial = self._progress.current
        where = "after the last trial" if trial is None else f"at trial {trial.number}"
        return f"{self._participant} is stopped {where}; the same command goes on there"

    @property
    def _here(self) -> StudySite:
        if self._site is None:
            raise PointItError("the site has not been started")
        return self._site

    async def _begin(self) -> None:
        simulated = bool(self._setup.person) or not self._setup.imu
        folder = self._folder.path / self._participant
        check_simulated(folder, self._about, self._table.rows, simulated=simulated)
        if "seed" not in self._about:
            self._store_about(
                pseudonym=self._participant,
                simulated=simulated,
                group=self._plan.group,
                seed=self._study.seed,
                order=list(self._plan.order),
                versions={"pointit": pointit.__version__, "python": platform.python_version()},
            )
        if self._study.consent != StudyStep() and not self._about.get("consented"):
            if not await self._view.tell(self._study.consent, go="agree"):
                raise StoppedError(f"{self._participant} does not agree: nothing is measured")
            self._store_about(consented=True)
        if self._study.instruction != StudyStep():
            await self._view.tell(self._study.instruction, go="begin")

    async def _enter(self, trial: StudyTrial, sites: contextlib.AsyncExitStack, *, is_first: bool) -> None:
        """Set the condition of the block of `trial`, and explain it."""
        # A running site takes the settings if they can be changed live; otherwise another one starts.
        block_settings = self._study.services(trial.cell)
        settings: dict[str, Any] = {**block_settings, **self._setup.person}
        self._scenes = scenes_of(self._study, self._plan, trial.block, settings)
        if not self._setup.imu:
            task = self._study.task_in(trial.cell)
            settings |= task.simulated(self._scenes[trial.place :])
        if self._site is not None and self._site.is_live(settings):
            await self._site.use(settings)
        else:
            await self._start_site(trial, settings, sites)
        if self._lsl is not None and self._site is not None:
            self._site.on_message = self._lsl.send

        # People rest between blocks, and read what is new.
        if not is_first and self._study.break_s and not self._setup.person:
            await self._wait(trial, self._study.break_s, is_break=True)
        instructions = self._study.instructions
        steps = [instructions[level] for level in trial.cell.values() if level in instructions]
        if not steps and not is_first:
            steps = [StudyStep(text="The next block begins.")]
        if steps:
            await self._view.tell(*steps, go="begin")

    async def _start_site(
        self, trial: StudyTrial, settings: Mapping[str, Any], sites: contextlib.AsyncExitStack
    ) -> None:
        """End the site of the block before, if there is one, and start another with `settings`."""
        await sites.aclose()
        options = self._setup
        file = self._folder.recording(self._participant) if options.record else None
        run = pointit.run(
            scenario_file(self._study, file),
            users=[self._participant],
            seed=trial.seed % 2**31,
            localize=options.localize,
            imu=options.imu or (),
            output=options.output,
            settings=settings,
            listen=options.listen,
        )
        joining = StudySite.at(run, self._participant, settings)
        self._site = await sites.enter_async_context(joining)
        self._site.truth_tracker = self._study.truth if self._setup.imu else ""

    async def _do(self, trial: StudyTrial) -> None:
        """Run one attempt at `trial`, and write its row."""
        await self._wait(trial, self._study.pause_s)
        if self._progress.current is not trial:
            return  # the experimenter wants the last one again
        if "begun" not in self._about:
            self._store_about(begun=utc(self._here.site.now_ns()))
        scene = self._scenes[trial.place]
        previous_m = self._scenes[trial.place - 1].target_m if trial.place else None
        if self._study.end == "press":
            objects = tuple(item.model_copy(update={"press": True}) for item in scene.objects)
            scene = replace(scene, objects=objects)

        # The row is written before anything else, so that no crash loses it.
        row = {**self._row(trial), "target": scene.name}
        attempt, stop = await self._attempt(trial, row, scene, previous_m)
        row |= attempt.columns()
        self._table.append(row)
        self._mark("trial_end", row, "outcome", "reason")
        self._progress.end(is_done=not attempt.is_repeated)
        self._note(trial, attempt)
        next_trial = self._progress.current
        if stop is not None and next_trial is not None:
            await self._run_command(stop, next_trial)

    async def _attempt(
        self, trial: StudyTrial, row: Mapping[str, object], scene: StudyScene, before_m: Vec3 | None
    ) -> tuple[Attempt, StudyCommand | None]:
        """Run an attempt. Return it, and the command after it that ended it, or None.

        `before_m`: position of the target before, {W}, m.
        """
        room = self._here
        study = self._study
        target, target_m = await room.show(scene)
        attempt = Attempt(
            began_ns=room.site.now_ns(),
            target=target,
            target_m=target_m,
            width_m=scene.width_m,
            end=study.end,
            timeout_s=study.timeout_s,
            end_rule=self._end_rule,
            before_m=before_m,
            stay_s=scene.stay_s,
            names=Counter() if room.has_names else None,
        )
        room.attempt = attempt  # from now on it gets the messages
        self._mark("trial_start", row, *trial.cell, "practice", "target")

        later: StudyCommand | None = None
        try:
            while attempt.outcome is None:
                self._show_status(trial, "pointing", scene)
                await room.site.sleep(TICK_S)
                if scene.packages and attempt.outcome is None:
                    attempt.target_m = room.position(target) or attempt.target_m
                room.problem  # noqa: B018 - raises what has failed in the background
                attempt.tick(room.site.now_ns())
                command = self._view.command()
                if command is None:
                    continue
                if command.name == "skip":
                    attempt.abandon(f"skipped: {command.reason or 'by the experimenter'}")
                    continue
                attempt.repeat(f"{command.name} by the experimenter")
                later = command if command.name in ("pause", "stop") else None
        except asyncio.CancelledError:  # Ctrl-C; simulated people repeat all that they did
            if not self._setup.person and attempt.outcome is None:
                attempt.repeat("interrupted")
                self._table.append({**row, **attempt.columns()})
            raise
        finally:
            await room.hide()
        return attempt, later

    async def _wait(self, trial: StudyTrial, seconds: float, *, is_break: bool = False) -> None:
        """Wait for a time before `trial`, and until the participant points.

        Commands are handled meanwhile.
        """
        site = self._here.site
        end_ns = site.now_ns() + round(seconds * 1e9)
        while True:
            remaining_ns = end_ns - site.now_ns()
            is_over = remaining_ns <= 0
            if is_over and (is_break or not self._here.problem):
                return
            if is_break:
                state = f"{BREAK}{math.ceil(remaining_ns / 1e9)} s left"
            else:
                state = self._here.problem or "pause"
            self._show_status(trial, state)
            await site.sleep(TICK_S)
            command = self._view.command()
            if command is None:
                continue
            await self._run_command(command, trial)
            if self._progress.current is not trial and not is_break:
                return

    async def _run_command(self, command: StudyCommand, trial: StudyTrial) -> None:
        """Obey a command between two attempts. Raises: StoppedError: If it is `stop`."""
        if command.name == "stop":
            raise StoppedError(self.stop_sentence)
        if command.name == "repeat":
            self._progress.repeat()
        elif command.name == "skip":
            reason = f"skipped: {command.reason or 'by the experimenter'}"
            row = {**self._row(trial), "outcome": "skipped", "reason": reason}
            self._table.append({**row, "began_utc": utc(self._here.site.now_ns())})
            self._progress.end(is_done=True)
        elif command.name == "pause":
            self._show_status(trial, "paused")
            next_command = self._view.command()
            while next_command is None:
                await self._here.site.sleep(TICK_S)
                next_command = self._view.command()
            if next_command.name != "pause":  # a second one goes on
                await self._run_command(next_command, trial)

    def _row(self, trial: StudyTrial) -> dict[str, object]:
        """Return the columns of an attempt at `trial` that are known before it."""
        return {
            "participant": self._participant,
            "block": trial.block,
            "trial": trial.number,
            "attempt": self._progress.attempt,
            "practice": trial.practice,
            **trial.cell,
            "task": self._study.task.kind,
            "seed": trial.seed,
            "pointit_version": pointit.__version__,
        }

    def _note(self, trial: StudyTrial, attempt: Attempt) -> None:
        """Store the services' configuration after their start, and warnings about clock skew."""
        configurations: list[dict[str, Any]] = self._about.get("configuration", [])
        services = {name: json.loads(text) for name, text in sorted(self._here.configuration.items())}
        last_services = configurations[-1]["services"] if configurations else {}
        if services and services != last_services:
            configuration = {"from_trial": trial.number, "services": services}
            self._store_about(configuration=[*configurations, configuration])
        if attempt.clock_apart_s > max(CLOCK_APART_S, self._about.get("clock_apart_s", 0.0)):
            self._store_about(clock_apart_s=round(attempt.clock_apart_s, 3))

    async def _ask_after(self, block: int) -> None:
        """Ask the questionnaires about a block unless they are answered."""
        if block < 1 or not self._study.questionnaires:
            return
        with contextlib.closing(self._folder.answers(self._participant)) as table:
            answered = Counter((row["questionnaire"], row["block"]) for row in table.rows)
            blocks = self._plan.trials[-1].block
            name = f"block {block} of {blocks}" if blocks > 1 else ""
            for scale in map(scale_of, self._study.questionnaires):
                if answered[scale.name, str(block)] >= len(scale.items):
                    continue
                condition = self._plan.order[block - 1]
                common = {
                    "participant": self._participant,
                    "questionnaire": scale.name,
                    "block": block,
                    "condition": condition,
                }
                values = await self._view.ask(scale, name)
                rows = [{**common, "item": item, "value": value} for item, value in enumerate(values, 1)]
                table.append(*rows)  # all at once: no crash stores half a questionnaire

    def _show_status(self, trial: StudyTrial, state: str, scene: StudyScene | None = None) -> None:
        last_rows = self._table.rows[:-6:-1]  # the newest first
        outcomes = tuple(f"{row['trial']}: {row['reason'] or row['outcome']}" for row in last_rows)
        scene_name = "" if scene is None else scene.name
        say = "" if scene is None else scene.say
        status = StudyStatus(
            participant=self._participant,
            trial=trial.number,
            block=trial.block,
            condition=condition_of(trial.cell),
            left=self._progress.left,
            target=scene_name,
            say=say,
            state=state,
            trials=len(self._plan.trials),
            outcomes=outcomes,
            quality=self._here.quality,
            live=None if self._setup.person else self._here.live,
        )
        self._view.status(status)

    def _mark(self, event: str, row: Mapping[str, object], *columns: str) -> None:
        """Send a marker with columns of the row of an attempt."""
        if self._lsl is not None:
            fields = {name: row[name] for name in ("trial", "attempt", *columns)}
            self._lsl.mark(event=event, **fields)

    def _store_about(self, **about: object) -> None:
        self._about |= about
        self._folder.put_about(self._participant, self._about)
