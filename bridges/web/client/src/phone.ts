/** The phone's page: the phone is one person's wrist and their button. */

import "./phone.css";
import { sentence } from "./format";
import { chime } from "./sound";
import { speakerFields } from "./phone/speaker_fields";
import { Speaker } from "./speaker";
import { Voice } from "./voice";
import { STEPS } from "./keys";
import type { Feedback, Step } from "./messages";
import type { Cue } from "./wire";
import { watchBattery } from "./phone/battery";
import { Link, type Heard, type LinkState } from "./phone/link";
import { Pace, Rate } from "./phone/pace";
import { Screen } from "./phone/screen";
import { NoOrientation, objection, sense, type Sensing } from "./phone/sensing";
import { Taps, type Gesture } from "./phone/taps";
import { Wake } from "./phone/wake";
import { withNames } from "./words";
import { figures, linkWords, pressWords, stateWords } from "./phone/words";

const CENTRE = "Point at the middle of the room with your arm straight, then tap.";
const GO_ON = "Stopped, because this page was out of sight. Tap to go on.";
/** Movement of the finger that makes a swipe, px. */
const SWIPE_PX = 40;
/** How often, ms, it is looked whether something is to be said, or a touch has become a hold. */
const TICK_MS = 40;

class Wrist {
  private readonly screen = new Screen();
  private readonly link = new Link({
    heard: (part) => this.hear(part),
    changed: (state) => this.changed(state),
  });
  private readonly pace = new Pace();
  private readonly rate = new Rate();
  private readonly taps = new Taps();
  private readonly wake = new Wake();
  private sensing: Sensing | null = null;
  private isStarting = false;
  private session = 0;
  private charge: number | null = null;
  private stage: "before" | "centre" | "button" | "over" = "before";
  private cue: Cue | null = null;
  /** Ids of the map's lamps, which the person sees by their names. */
  private lamps: readonly string[] = [];
  private hasArm = true;
  private readonly speaker = new Speaker(document.getElementById("name")!, (spoken, problem) => {
    const may = this.link.state === "open";
    if (may) this.ask("report_voice", "voice", { spoken, problem });
    return may;
  });
  private awaited = new Map<number, string>();
  private readonly voice = new Voice({
    hearing: (text) => this.screen.say(`… ${text}`),
    said: (words) => {
      this.screen.say(`“${words.map(({ text }) => text).join(" ")}”`);
      this.ask("speak", "speak", { words });
    },
    turned: (isOn, problem) => {
      this.screen.write("listen", isOn ? "Do not listen" : "Listen");
      if (problem) this.screen.say(problem);
    },
  });
  private ticking: ReturnType<typeof setInterval> | undefined;
  private figuresAt = 0;

  constructor() {
    const { screen } = this;
    screen.stage("before");
    const reason = objection();
    screen.offerStart(!reason, "Start");
    screen.trouble(reason);
    screen.onTap("start", () => void this.start());
    this.showSpeaker();
    screen.onTap("skip", () => this.enter("button"));
    screen.onTap("centre", () => this.enter("centre"));
    screen.onTap("place", () => this.findPlace());
    screen.onTap("listen", () => this.voice.toggle());
    screen.onTap("let-go", () => this.changeHands());
    this.listenToButton();
    document.addEventListener("visibilitychange", () => {
      if (document.visibilityState === "hidden") this.stop(GO_ON);
    });
    addEventListener("pagehide", () => this.stop(GO_ON));
    void watchBattery((charge) => {
      this.charge = charge;
      this.showFigures();
    });
  }

  /** Within the tap on Start: permission, sound and the lock of the screen need one. */
  private async start(): Promise<void> {
    if (this.isStarting || this.sensing) return;
    this.isStarting = true;
    this.screen.trouble("");
    this.screen.offerStart(false, "Starting …");
    try {
      const sensing = sense({
        turned: (q, t) => {
          this.pace.read(q, t);
          this.say();
        },
        ended: () => this.stop("The sensor has stopped. Tap to start it again."),
      });
      chime("tick");
      this.speaker.unlock();
      navigator.vibrate?.(30);
      this.wake.want(true);
      this.sensing = await sensing;
    } catch (error) {
      this.wake.want(false);
      this.screen.trouble(
        error instanceof NoOrientation ? error.message : `The sensor cannot be started: ${String(error)}.`,
      );
      return;
    } finally {
      this.isStarting = false;
      this.screen.offerStart(true, "Start");
    }
    if (document.visibilityState === "hidden") return this.stop(GO_ON);
    this.session = crypto.getRandomValues(new Uint32Array(1))[0]!;
    this.hasArm = true;
    this.link.start();
    this.ticking = setInterval(() => this.tick(), TICK_MS);
    this.enter("centre");
  }

  private stop(why: string, isOver = false): void {
    if (!this.sensing && !isOver) return;
    this.sensing?.stop();
    this.sensing = null;
    this.pace.stop();
    this.voice.stop();
    clearInterval(this.ticking);
    if (!isOver) this.link.stop();
    this.wake.want(false);
    this.screen.trouble(why);
    this.enter(isOver ? "over" : "before");
  }

  private enter(stage: typeof this.stage): void {
    this.stage = stage;
    this.screen.stage(stage);
    this.screen.show("listen", this.voice.isOn || (stage === "button" && this.voice.isThere));
    this.show();
    if (stage === "centre" || stage === "button") this.screen.big.focus({ preventScroll: true });
  }

  private tick(): void {
    this.say();
    const gesture = this.taps.wait(performance.now());
    if (gesture) this.press(gesture);
    if (performance.now() - this.figuresAt > 1000) this.showFigures();
  }

  /** Say how the phone is turned, when it is worth it. */
  private say(): void {
    if (this.link.state !== "open") return;
    const now = performance.now();
    const due = this.pace.due(now, this.link.buffered);
    if (!due) return;
    const { q, t } = due;
    if (this.link.say({ kind: "turn", q, t_ms: t, session: this.session, battery: this.charge }))
      this.rate.tick(now);
  }

  private choose(choice: string): void {
    navigator.vibrate?.(25);
    this.ask("choose_act", "choice", { choice });
  }

  private ask(
    deed: "choose_act" | "press" | "step" | "take" | "give" | "centre" | "speak" | "report_voice",
    what: string,
    query: Record<string, unknown> = {},
  ): void {
    this.await(this.link.ask({ deed, key: "", name: "", query }), what);
  }

  private await(id: number | null, what: string): void {
    if (id === null) this.screen.say("Not connected; try again in a moment.");
    else this.awaited.set(id, what);
  }

  private press(gesture: Gesture): void {
    this.screen.big.classList.remove("is-down");
    navigator.vibrate?.(gesture === "hold" ? 80 : 25);
    if (this.stage === "centre") {
      if (gesture !== "hold") this.ask("centre", "centre");
    } else if (this.stage === "button") {
      this.ask("press", "press", { gesture });
    }
  }

  private findPlace(): void {
    const isSearching = this.cue?.state === "localizing";
    const key = `localizer/{user}/${isSearching ? "cancel" : "start"}`;
    this.await(this.link.ask({ deed: null, key, name: "", query: {} }), "place");
  }

  private changeHands(): void {
    this.ask(this.hasArm ? "give" : "take", this.hasArm ? "give" : "take");
  }

  private hear(part: Heard): void {
    if (part.kind === "hello") {
      this.screen.write("who", part.user);
      this.speaker.setUsual(part.speaks, part.language);
      this.lamps = part.lamps;
      this.show();
    } else if (part.kind === "answer") {
      const what = this.awaited.get(part.id);
      this.awaited.delete(part.id);
      if (part.error) this.screen.say(this.shown(part.error));
      else if (what === "voice" && part.reply?.["message"]) this.screen.say(String(part.reply["message"]));
      else if (what === "give" || what === "take") this.hasArm = what === "take";
      else if (what === "centre") this.enter("button");
      this.show();
    } else {
      this.cue = part;
      this.screen.big.style.touchAction = part.has_names ? "none" : ""; // a swipe up or down steps, and scrolls nothing
      if (part.announced) this.speaker.say(part.announced);
      if (part.has_names) this.speaker.sayStep(this.shown(part.next_step));
      if (part.chime) chime(part.chime as Feedback["chime"]);
      if (part.haptic_ms.length) navigator.vibrate?.(part.haptic_ms);
      if (part.has_lost_arm) this.hasArm = false;
      if (part.text) this.screen.say(part.text === part.next_step ? "" : this.shown(part.text));
      this.show();
    }
  }

  private changed(state: LinkState): void {
    if (state === "unpaired" || state === "replaced") this.stop(linkWords(state), true);
    if (state !== "open") this.awaited.clear();
    this.screen.mark("link", state);
    this.screen.write("link", state === "unpaired" || state === "replaced" ? "Ended" : linkWords(state));
    this.showFigures();
  }

  private show(): void {
    const { screen, cue, stage } = this;
    // A set-up finds the zero of the phone by lamps
    if (stage === "centre" && cue?.is_guided) return this.enter("button");
    const state = cue?.state ?? "";
    screen.mark("state", state);
    screen.write("state", stage === "centre" ? "First" : stateWords(state));
    const next = stage === "centre" ? CENTRE : this.shown(cue?.next_step ?? "");
    screen.next(next, stage === "button" ? (cue?.progress ?? null) : null);
    const isGuided = stage === "button" && (cue?.is_guided ?? false);
    screen.offer(isGuided ? (cue?.choices ?? []) : [], (id) => this.choose(id));
    for (const id of ["centre", "place", "let-go"] as const) screen.show(id, stage === "button" && !isGuided);
    screen.write("big-name", stage === "centre" ? "Centre" : "Press");
    screen.write(
      "big-note",
      stage === "centre" ? "this is straight ahead" : cue ? pressWords(cue.press) : "",
    );
    screen.write("place", state === "localizing" ? "Call off" : "Find my place");
    screen.write("let-go", this.hasArm ? "Let go" : "Take my arm");
  }

  /** A service's text as a sentence for the person. */
  private shown(text: string): string {
    return sentence(withNames(text, this.lamps));
  }

  private showFigures(): void {
    const now = performance.now();
    this.figuresAt = now;
    this.screen.write(
      "figures",
      this.sensing && this.link.state === "open"
        ? figures(
            this.rate.at(now),
            this.link.roundTrip,
            this.charge,
            this.sensing.source,
            this.link.transport === "post",
          )
        : "",
    );
  }

  private showSpeaker(): void {
    document.getElementById("speaker")!.replaceChildren(speakerFields(this.speaker));
  }

  /** Go to the thing left (-1) or right (1) of the announced one, or above or below, or to the nearest. */
  private step(by: number, to: Step["to"]): void {
    navigator.vibrate?.(15);
    this.ask("step", "step", { by, to });
  }

  private listenToButton(): void {
    const { big } = this.screen;
    let downX = 0;
    let downY = 0;
    const down = () => {
      big.classList.add("is-down");
      this.taps.down(performance.now());
    };
    const up = () => {
      big.classList.remove("is-down");
      const gesture = this.taps.up(
        performance.now(),
        this.stage === "button" && (this.cue?.wants_double ?? false),
      );
      if (gesture) this.press(gesture);
    };
    big.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || !event.isPrimary) return;
      big.setPointerCapture(event.pointerId);
      downX = event.clientX;
      downY = event.clientY;
      down();
    });
    big.addEventListener("pointermove", (event) => {
      const right = event.clientX - downX;
      const down = event.clientY - downY;
      const isAcross = Math.abs(right) >= Math.abs(down);
      if (
        !this.cue?.has_names ||
        this.stage !== "button" ||
        !big.classList.contains("is-down") ||
        Math.max(Math.abs(right), Math.abs(down)) < SWIPE_PX
      )
        return;
      big.classList.remove("is-down");
      this.taps.cancel();
      this.step(Math.sign(isAcross ? right : down), isAcross ? "beside" : "row");
    });
    addEventListener("keydown", (event) => {
      const step = STEPS[event.key];
      if (!step || this.stage !== "button" || !this.cue?.has_names) return;
      event.preventDefault();
      this.step(...step);
    });
    big.addEventListener("pointerup", up);
    big.addEventListener("pointercancel", () => {
      big.classList.remove("is-down");
      this.taps.cancel();
    });
    big.addEventListener("contextmenu", (event) => event.preventDefault());
    // Keys, switches and screen readers click without a pointer.
    big.addEventListener("click", (event) => {
      if (event.detail === 0) this.press("press");
    });
  }
}

new Wrist();
