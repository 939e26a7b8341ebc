/** Feedback to the person who points with this page, and to those who read by ear: toasts, sounds, spoken names. */

import type { Controls } from "../controls";
import { write } from "../dom";
import { capital } from "../format";
import type { SelectionEvent } from "../messages";
import { phaseOf, steeredBy } from "../site/robots";
import { siteNow, type SiteEvent } from "../site/site";
import { chime } from "../sound";
import type { Speaker } from "../speaker";
import { called, friendly, nextStepOf, outcome, stateTitle } from "../words";

/** A name that began longer ago is not spoken: the page has just come, or was in the background, ns. */
const LATE_NS = 1.5e9;

type Feedback = Extract<SiteEvent, { feedback: unknown }>;

export class SiteFeedback {
  private announced = "";
  private namedNs = 0;

  /**
   * @param region element whose changes are read out.
   * @param selected called with an object that the person has selected.
   */
  constructor(
    private readonly region: HTMLElement,
    private readonly controls: Controls,
    private readonly speaker: Speaker,
    private readonly selected: (event: SelectionEvent) => void,
  ) {}

  tell(change: SiteEvent): void {
    if ("feedback" in change) this.tellFeedback(change);
    else this.tellSelection(change.event);
  }

  /** Speak the name that is announced to the person. */
  speakName(): void {
    const { site, person } = this.controls;
    const announced = person?.announced;
    const began = Number(announced?.began_ns ?? 0);
    if (!announced?.object_id || began === this.namedNs) return;
    this.namedNs = began;
    if (!site.timeline && siteNow(site) - began < LATE_NS * site.speed) this.speaker.say(announced.label);
  }

  /** Have a change of the interaction read out; gauges and figures are not. */
  announce(): void {
    const now = this.interactionText();
    if (now === this.announced) return;
    this.announced = now;
    write(this.region, now);
  }

  /** Have a text read out. */
  read(text: string): void {
    write(this.region, text);
  }

  private interactionText(): string {
    const { site, user, person } = this.controls;
    if (!person?.interaction) return "";
    const robot = steeredBy(site, user);
    const steers = robot ? ` ${robot.name}: ${phaseOf(robot.state)}. ${robot.state.reason}` : "";
    const step = site.timeline ? "" : nextStepOf(site, person);
    return `${user}: ${stateTitle(person.interaction.state)}. ${step}${steers}`;
  }

  private tellFeedback({ user, feedback }: Feedback): void {
    const { controls } = this;
    const { site, settings, toasts } = controls;
    const { cue } = feedback;
    const text = capital(friendly(site, feedback.text));
    // A text of `feedback say` from any service; targets of a localization have an id, or wait for one
    const isText = cue === "target" && !feedback.target_id && !feedback.waits;
    if (isText && user === this.follower) {
      if (settings.sound) chime(feedback.chime);
      toasts.show("info", text);
      return;
    }
    if (!controls.isOwn({ user, stampNs: feedback.stamp_ns })) return;
    // Whether a selection deserves praise depends on the object, which its event has
    if (settings.sound && (cue !== "selected" || feedback.point_m)) chime(feedback.chime);
    // Told are cues of a place, or of a robot, whose press may have to be repeated; those of objects by their events
    const isOfRobot = controls.mine?.steering != null && (cue === "refused" || cue === "deselected");
    const isTold = feedback.point_m !== null || isOfRobot;
    if (isTold && feedback.text) toasts.show(cue === "selected" ? "done" : "info", text);
  }

  private tellSelection(event: SelectionEvent): void {
    const { controls } = this;
    if (controls.tellTakenBack(event) || event.user !== this.follower) return;
    const isLeaving = event.event === "dispatched" || event.event === "left";
    const isMine = controls.isOwn({ user: event.user, stampNs: event.stamp_ns });
    const isOwn = isMine && (!isLeaving || controls.hasSelected(event.object_id));
    if (event.event === "selected") this.tellSelected(event, isOwn);
    else if (isLeaving) this.tellLeft(event, isOwn);
    else if (event.event === "deselected") this.tellDeselected(event, isOwn);
    else if (event.event === "refused" && isOwn) this.tellRefused(event);
  }

  private tellSelected(event: SelectionEvent, isOwn: boolean): void {
    const { controls } = this;
    const isWrong = !controls.isWanted(event.kind);
    if (isOwn) {
      controls.setSelected(event.object_id, true);
      // What runs for long has only started
      const isDone = event.status !== "pending";
      if (isDone && event.cause !== "undo" && event.cause !== "release") this.selected(event);
      if (controls.settings.sound) chime(selectionChime(isWrong, isDone));
    }
    this.say(event, isWrong ? "Not wanted" : outcome(controls.site, event), isOwn, isWrong);
  }

  private tellLeft(event: SelectionEvent, isOwn: boolean): void {
    const { controls } = this;
    if (controls.isWanted(event.kind)) return;
    if (isOwn && controls.settings.sound) chime("buzz");
    const bay = event.bay ? ` at bay ${event.bay}` : "";
    this.say(event, `Not wanted, and left${bay}`, isOwn, true);
  }

  private tellDeselected(event: SelectionEvent, isOwn: boolean): void {
    const ended = outcome(this.controls.site, event);
    this.controls.setSelected(event.object_id, false);
    if (ended) this.say(event, ended, isOwn);
  }

  private tellRefused(event: SelectionEvent): void {
    const { site, toasts } = this.controls;
    const reason = friendly(site, event.reason) || "it could not be selected.";
    const name = capital(called(site, event.object_id, event.kind));
    toasts.show("info", `${name} did not change: ${reason}`);
  }

  /** Tell what came of an object: this page's own as a toast, which is read out, others' only by ear. */
  private say(event: SelectionEvent, result: string, isOwn: boolean, isWrong = false): void {
    const { site, toasts } = this.controls;
    const who = isOwn ? "" : `${event.user}: `;
    const text = `${who}${result}: ${called(site, event.object_id, event.kind)}`;
    if (isOwn) toasts.show(isWrong ? "wrong" : "done", text);
    else this.read(text);
  }

  /** The person whose events are told here: the one that this page moves, else the chosen one. */
  private get follower(): string {
    return this.controls.mine?.user || this.controls.user;
  }
}

/** Sound of a selection: of one that was not wanted, one that is done, and one that has only started. */
function selectionChime(isWrong: boolean, isDone: boolean): "buzz" | "tick" | "single" {
  if (isWrong) return "buzz";
  return isDone ? "tick" : "single";
}
