/**
 * The page: a connection that fills a site, a view and a panel that show it.
 *
 * `window.pointit` has `site` and `stats` for tests and the curious, to be read only.
 */

import "./app.css";
import { Connection, toServer } from "./site/connection";
import { Controls } from "./controls";
import { devicesPart } from "./devices/devices_part";
import { show, write } from "./dom";
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
import { causes } from "./outage";
import { makeRunEnd } from "./run";
import { keepSettings, loadSettings, type Settings } from "./settings";
import { beginning, makeShortcuts } from "./shortcuts";
import { emptySite, type Site } from "./site/site";
import { homePart } from "./setup/home_part";
import { SiteFeedback } from "./shell/feedback";
import { Header } from "./shell/header";
import { Notices } from "./shell/notices";
import { SettingsDialog } from "./shell/settings_dialog";
import { chime } from "./sound";
import { Speaker } from "./speaker";
import { Stage } from "./stage";
import { applyTheme, watchSystem } from "./theme";
import { Toasts } from "./toasts";
import type { ViewStats } from "./view";
import { HeadsetArm } from "./headset_arm";
import { nextStepOf } from "./words";

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
      notices.connectionChanged(isConnected, attempt);
      runEnd.update();
      notices.showLost(runEnd.isOver);
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
const feedback = new SiteFeedback(at("said"), controls, speaker, (event) => guide.selected(event));
const header = new Header(at, controls);
const notices = new Notices(at, controls, () => panel.open(HEALTH));
const timeline = makeTimeline(at("timeline"), controls, (text) => feedback.read(text));
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
  for (const change of site.fresh) feedback.tell(change);
  if (site.fresh.some((change) => "event" in change)) isStale = true;
  feedback.speakName();
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
  if (!site.connected) notices.showLost(runEnd.isOver);
  header.update(runEnd.isOver, notices.isLostTold);
  notices.showOutage(stage.isDrawn);
  feedback.announce();
}

/** Once, by the first key: browsers let a page speak from then on. */
function tellBeginning(): void {
  if (!controls.speaks || site.timeline) return;
  removeEventListener("keydown", tellBeginning);
  speaker.say(beginning(controls));
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
