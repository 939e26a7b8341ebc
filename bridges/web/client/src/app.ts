/**
 * The page: a connection that fills a site, a view and a panel that show it.
 *
 * `window.pointit` has `site` and `stats` for tests and the curious, to be read only.
 */

import "./app.css";
import { Connection, toServer } from "./site/connection";
import { Controls } from "./controls";
import { devicesPart } from "./devices/devices_part";
import { mark, show, write } from "./dom";
import { capital, milliseconds } from "./format";
import { makeGuide } from "./guide";
import { Help } from "./shell/help";
import { listen, type Shortcut } from "./keys";
import { Mouse } from "./mouse";
import { healthPart } from "./health/health";
import { Belts, beltsPart } from "./belts/belts";
import { mapPart } from "./edit/map_part";
import { messagesPart } from "./health/messages";
import { nowPart } from "./people/now";
import { personPart } from "./people/person";
import { Pairing } from "./people/pairing";
import { HEALTH, Panel } from "./panel/panel";
import { drawStop, robotsPart } from "./robots/robots";
import { speechPart } from "./speech/speech";
import { thingsPart } from "./things/things";
import { Tuning, tuningPart } from "./tuning/tuning";
import { mapRoomPart } from "./edit/map_room";
import { makeTimeline } from "./past/timeline";
import { peoplePart } from "./people/people";
import { whoPointsPart } from "./people/who_points";
import { makeScenario } from "./scenario";
import { causes, isCutOff, outage } from "./outage";
import { makeRunEnd } from "./run";
import { keepSettings, loadSettings, type Settings } from "./settings";
import { beginning, makeShortcuts } from "./shortcuts";
import { phaseOf, steeredBy } from "./site/robots";
import { emptySite, siteNow, type SiteEvent, type Site } from "./site/site";
import { homePart } from "./setup/home_part";
import { SettingsDialog } from "./shell/settings_dialog";
import { chime } from "./sound";
import { Speaker } from "./speaker";
import { Stage } from "./stage";
import { applyTheme, watchSystem } from "./theme";
import { Toasts } from "./toasts";
import type { ViewStats } from "./view";
import { HeadsetArm } from "./headset_arm";
import { called, nextStepOf, outcome, stateTitle, friendly } from "./words";

declare global {
  interface Window {
    /** To be read only. */
    pointit: { readonly site: Site; readonly stats: ViewStats | null };
  }
}

/** Panels are brought up to date so often at most, ms. */
const PANEL_MS = 150;

const at = (id: string): HTMLElement => document.getElementById(id)!;
const site = emptySite();
const settings = loadSettings();
applyTheme(settings.theme);

/** In a page that plays without a server: the recording. */
const recording = document.getElementById("recording");
if (window !== window.parent) {
  document.body.classList.add("framed");
  at("view").addEventListener("wheel", (event) => event.stopPropagation(), true); // it scrolls the page around
}
/** Say why a page that plays without a server cannot. */
function cannotPlay(error: unknown): never {
  show(at("drawing"), false);
  show(at("lost"), true);
  write(at("lost-text"), `This recording cannot be played here: ${String(error)}`);
  throw error;
}
const connection = new Connection(
  site,
  recording
    ? await import("./past/recorded").then(({ play }) => play(recording)).catch(cannotPlay)
    : toServer,
  {
    onUpdate: () => wake(),
    onHello: () => {
      tuning.forget();
      speaker.setUsual(site.hello?.speaks ?? false, site.hello?.language ?? "");
    },
    onStatus: () => {
      controls.follow();
      mouse.update();
      headsetArm.update();
      pairing.update();
      mapRoomPairing.update();
      refresh();
    },
    onState: (isConnected, attempt) => {
      showConnection(isConnected, attempt);
      refresh();
    },
  },
);
const controls = new Controls(site, settings, connection, new Toasts(at("toasts")), () => refresh());
const mouse = new Mouse(controls, () => stage.view, document.querySelector<HTMLElement>(".stage")!);
const headsetArm = new HeadsetArm(controls, (sentence) => {
  stage.view?.immersion?.tell(sentence);
  chime("buzz");
});
const stage: Stage = new Stage(
  at("view"),
  at("cameras"),
  at("chip"),
  ["lost", "outage", "ended", "progress", "guide", "cameras", "stop", "toasts", "chip"].map(at),
  ["guide", "chip"].map(at),
  controls,
  (place) => mouse.aim(place),
  () => {
    mouse.renew();
    wake();
  },
  headsetArm,
  () => {
    if (awake) frame();
  },
);
const pairing = new Pairing(controls, "pair");
const mapRoomPairing = new Pairing(controls, "map_room");
const guide = makeGuide(at("guide"), controls, mouse, pairing);
const scenario = makeScenario(at("scenario"), at("progress"), controls);
const belts = new Belts(controls);
const tuning = new Tuning(controls);
const speaker = new Speaker(at("name"), (spoken, problem) => {
  const may = controls.speaks && controls.person !== null;
  if (may) void controls.askAloud({ deed: "report_voice", name: controls.user, query: { spoken, problem } });
  return may;
});
let namedNs = 0;
const look = new SettingsDialog(controls, speaker, changeLook);
const panel: Panel = new Panel(at("panel"), controls, [
  {
    name: "Control",
    icon: "sliders",
    parts: [
      personPart(controls),
      whoPointsPart(controls, mouse, pairing),
      nowPart(controls),
      thingsPart(controls),
      robotsPart(controls),
      beltsPart(controls, belts),
      speechPart(controls),
    ],
  },
  {
    name: "Set up",
    icon: "map",
    parts: [
      homePart(controls, pairing, () => panel),
      peoplePart(controls, scenario),
      devicesPart(controls),
      mapPart(controls),
      mapRoomPart(controls, mapRoomPairing),
      tuningPart(controls, tuning),
    ],
  },
  {
    name: "Health",
    icon: "pulse",
    badge: () => {
      const count = causes(site).length;
      return { count, meaning: count === 1 ? "warning" : "warnings" };
    },
    parts: [healthPart(controls, () => stage.view?.stats ?? null), messagesPart(controls)],
  },
]);
const runEnd = makeRunEnd(at("ended"), controls);
const timeline = makeTimeline(at("timeline"), controls, (text) => say(text, false));
const help = new Help(
  (): readonly Shortcut[] => shortcuts,
  () => stage.gestures,
);
const shortcuts = makeShortcuts({
  controls,
  mouse,
  stage,
  belts,
  look,
  pairing,
  panel,
  help,
  timeline,
  speaker,
});
addEventListener("keydown", tellBeginning);
listen(shortcuts, () => settings.shortcuts);
at("help").addEventListener("click", () => help.open());
at("settings").addEventListener("click", () => look.open());
at("pill").addEventListener("click", () => panel.open(HEALTH));
at("visit").addEventListener("click", () => connection.visit(site.timeline === null));
at("retry").addEventListener("click", () => connection.hurry());
watchSystem(() => changeLook("theme"));

function changeLook(what: keyof Settings): void {
  keepSettings(settings);
  if (what === "theme") {
    applyTheme(settings.theme);
    stage.theme();
  } else if (what === "view") void stage.make();
  refresh();
}

/** The animation frame that is awaited, or 0. A headset's session has frames instead, and may let none come here. */
let awake = 0;
let refreshed = -Infinity;
let isStale = true;

/** Draw changes in the next animation frame. */
function wake(): void {
  awake ||= requestAnimationFrame(frame);
}

function refresh(): void {
  isStale = true;
  wake();
}

function frame(): void {
  cancelAnimationFrame(awake);
  awake = 0;
  connection.takeOver();
  for (const change of site.fresh) tell(change);
  speakName();
  if (controls.mine?.announced && !site.timeline) speaker.sayStep(nextStepOf(site, controls.mine));
  stage.draw();
  connection.shown();
  timeline.frame();
  site.fresh.length = 0;
  const now = performance.now();
  if (!isStale && now - refreshed < PANEL_MS) return;
  refreshed = now;
  isStale = false;
  const worn = [...site.people.values()].find(({ line }) => line?.is_mine && line.moved_by === "headset");
  if (worn) stage.view?.immersion?.tellStep(nextStepOf(site, worn));
  for (const part of [runEnd, panel, guide, scenario, stage, timeline]) part.update();
  drawStop(at("stop"), controls);
  if (!site.connected) showLost();
  showHeader();
  showOutage();
  announce();
}

/** Give visual and audible feedback to the person who points with this page. */
function tell(change: SiteEvent): void {
  const mine = controls.mine?.user ?? "";
  if ("feedback" in change) {
    const { feedback } = change;
    // a text of `feedback say` from any service; targets of a localization have an id, or wait for one
    if (
      feedback.cue === "target" &&
      !feedback.target_id &&
      !feedback.waits &&
      change.user === (mine || controls.user)
    ) {
      if (settings.sound) chime(feedback.chime);
      controls.toasts.show("info", capital(friendly(site, feedback.text)));
      return;
    }
    if (!controls.isOwn({ user: change.user, stampNs: feedback.stamp_ns })) return;
    // whether a selection deserves praise depends on the object, which its event has
    if (settings.sound && (feedback.cue !== "selected" || feedback.point_m)) chime(feedback.chime);
    // of a place, or of a robot, whose press may have to be repeated; cues of objects are told by their events
    const isTold =
      feedback.point_m !== null ||
      (controls.mine?.steering != null && ["refused", "deselected"].includes(feedback.cue));
    if (isTold && feedback.text)
      controls.toasts.show(
        feedback.cue === "selected" ? "done" : "info",
        capital(friendly(site, feedback.text)),
      );
    return;
  }
  const { event } = change;
  const id = event.object_id;
  isStale = true;
  if (controls.tellTakenBack(event) || event.user !== (mine || controls.user)) return;
  const isLeaving = event.event === "dispatched" || event.event === "left";
  const isOwn =
    controls.isOwn({ user: event.user, stampNs: event.stamp_ns }) && (!isLeaving || controls.hasSelected(id));
  const what = called(site, id, event.kind);
  const isWrong = !controls.isWanted(event.kind);
  const who = isOwn ? "" : `${event.user}: `;
  if (event.event === "selected") {
    if (isOwn) {
      controls.setSelected(id, true);
      const isDone = event.status !== "pending"; // what runs for long has only started
      if (isDone && event.cause !== "undo" && event.cause !== "release") guide.selected(event);
      if (settings.sound) chime(isWrong ? "buzz" : isDone ? "tick" : "single");
    }
    say(`${who}${isWrong ? "Not wanted" : outcome(site, event)}: ${what}`, isOwn, isWrong);
  } else if (isWrong && isLeaving) {
    if (settings.sound && isOwn) chime("buzz");
    say(`${who}Not wanted, and left${event.bay ? ` at bay ${event.bay}` : ""}: ${what}`, isOwn, true);
  } else if (event.event === "deselected") {
    const ended = outcome(site, event);
    controls.setSelected(id, false);
    if (ended) say(`${who}${ended}: ${what}`, isOwn);
  } else if (event.event === "refused" && isOwn) {
    const why = friendly(site, event.reason) || "it could not be selected.";
    controls.toasts.show("info", `${capital(what)} did not change: ${why}`);
  }
}

/** A name that began longer ago is not spoken: the page has just come, or was in the background, ns. */
const LATE_NS = 1.5e9;

/** Speak the name that is announced to the person. */
function speakName(): void {
  const announced = controls.person?.announced;
  const began = Number(announced?.began_ns ?? 0);
  if (!announced?.object_id || began === namedNs) return;
  namedNs = began;
  if (!site.timeline && siteNow(site) - began < LATE_NS * site.speed) speaker.say(announced.label);
}

/** Once, by the first key: browsers let a page speak from then on. */
function tellBeginning(): void {
  if (!controls.speaks || site.timeline) return;
  removeEventListener("keydown", tellBeginning);
  speaker.say(beginning(controls));
}

/** Tell in words: as a toast, which is read out, or only to be read out. */
function say(text: string, isToast: boolean, isWrong = false): void {
  if (isToast) controls.toasts.show(isWrong ? "wrong" : "done", text);
  else write(at("said"), text);
}

let announced = "";

/** Have a change of the interaction read out; gauges and figures are not. */
function announce(): void {
  const interaction = controls.person?.interaction;
  const robot = steeredBy(site, controls.user);
  const steers = robot ? ` ${robot.name}: ${phaseOf(robot.state)}. ${robot.state.reason}` : "";
  const now = interaction
    ? `${controls.user}: ${stateTitle(interaction.state)}. ${site.timeline ? "" : nextStepOf(site, controls.person!)}${steers}`
    : "";
  if (now === announced) return;
  announced = now;
  write(at("said"), now);
}

function showHeader(): void {
  const { timeline: past } = site;
  write(at("site"), [site.hello?.site, past?.title].filter(Boolean).join(" · "));
  showVisit();
  const wrong = causes(site).length;
  const pill = at("pill");
  const isLoading = site.status === null && at("lost").hidden;
  const isLost = !isLoading && (!site.connected || isCutOff(site));
  mark(
    pill,
    "data-state",
    runEnd.isOver
      ? "past"
      : isLoading
        ? "loading"
        : isLost
          ? "lost"
          : wrong
            ? "warning"
            : past
              ? "past"
              : "live",
  );
  mark(
    pill.querySelector("use")!,
    "href",
    `#icon-${runEnd.isOver ? "stop" : isLost ? "close" : wrong ? "warning" : past ? "history" : "live"}`,
  );
  const median = !isLost && !past ? connection.latency.total(performance.now()).p50 : null;
  write(
    at("pill-text"),
    runEnd.isOver
      ? "Ended"
      : isLoading
        ? "Connecting"
        : !site.connected
          ? "Lost"
          : past
            ? "Past"
            : isLost
              ? "Cut off"
              : "Live",
  );
  write(at("pill-latency"), median === null ? "" : `· ${milliseconds(median)}`);
  show(at("recorded"), site.connected && controls.isPresent("recorder") && !past);
  show(at("looks-on"), site.connected && site.hello?.role === "viewer" && !past);
}

/** Offer the way into the past of a running site, or out of it. */
function showVisit(): void {
  const visit = at("visit");
  const isPast = site.timeline !== null;
  show(visit, site.connected && site.hello !== null && !site.timeline?.title);
  visit.classList.toggle("primary", isPast);
  mark(visit, "aria-keyshortcuts", isPast ? "Escape" : "W");
  mark(visit.querySelector("use")!, "href", isPast ? "#icon-live" : "#icon-history");
  const name = isPast ? "Back to live" : "What just happened?";
  write(visit.querySelector("span")!, name);
  mark(visit, "aria-label", name); // narrow pages show the icon only
  visit.title = `${name} (${isPast ? "Esc" : "W"})`;
}

/** Say why the scene stands still, or is not yet there; without `pui` there is no map to draw. */
function showOutage(): void {
  const text = site.connected ? outage(site) : "";
  const isWaiting =
    !stage.isDrawn && !text && (site.status === null || (!site.timeline && controls.isPresent("pui")));
  show(at("drawing"), isWaiting && at("lost").hidden);
  show(at("outage"), text !== "");
  write(at("outage-text"), text);
}

let attempts = 0;

function showConnection(isConnected: boolean, attempt: number): void {
  attempts = attempt;
  runEnd.update();
  showLost();
  document.body.classList.toggle("stale", !isConnected && site.hello !== null);
}

/** Say that the connection is lost; not when the run has ended, which is said instead. */
function showLost(): void {
  const isLost =
    !site.connected && !runEnd.isOver && (site.hello !== null || attempts > 1 || connection.isRefused);
  const attempt = attempts;
  show(at("lost"), isLost);
  const text = connection.isRefused
    ? "PointIt was restarted: open the link that it prints."
    : site.hello && attempt <= 6
      ? "The connection is lost. What you see is old; trying again …"
      : connection.reason
        ? connection.reason
        : attempt > 3
          ? "PointIt does not answer. Open the link that it printed when it was started."
          : "Connecting …";
  write(at("lost-text"), isLost ? text : "");
}

window.pointit = {
  get site() {
    return site;
  },
  get stats() {
    return stage.view?.stats ?? null;
  },
};
void stage.make();
connection.open();
setInterval(refresh, 1000);
