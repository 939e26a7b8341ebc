/** The timeline of a page that plays the past: transport, position, lanes. */

import type { Controls } from "../controls";
import { el, icon, mark, renew, show, write } from "../dom";
import { time } from "../format";
import { position } from "../site/site";
import type { TimelineLane } from "../wire";
import { clock, eventFrom, HEIGHT, LANE_NAMES, outline, spoken, textAt, ticks, WIDTH } from "./lanes";

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8];
/** How close the pointer must be to an item to name it, px. */
const REACH_PX = 6;
/** Room of a label of the axis, px. */
const LABEL_PX = 70;
/** Time before the end within which *Play* starts from the beginning, s. Positions are rounded. */
const END_S = 0.05;
const SVG = "http://www.w3.org/2000/svg";

export interface Timeline {
  /** Bring everything up to date. */
  update(): void;
  /** Show the position; called in every frame. */
  frame(): void;
  /** Play or pause. */
  toggle(): void;
  /** To the message after, or before. */
  step(by: -1 | 1): void;
  /** To the event after, or before. */
  event(by: -1 | 1): void;
  skip(seconds: number): void;
  faster(by: -1 | 1): void;
}

/** @param say tells in words what is at the position that was gone to. */
export function makeTimeline(host: HTMLElement, controls: Controls, say: (text: string) => void): Timeline {
  const { site, connection } = controls;
  const button = (symbol: string, name: string, shortcut: string, run: () => void): HTMLButtonElement =>
    el(
      "button",
      {
        type: "button",
        "aria-label": name,
        title: `${name} (${shortcut})`,
        "aria-keyshortcuts": shortcut,
        onclick: run,
      },
      icon(symbol),
    );
  const playPause = button("play", "Play", "Space", () => self.toggle());
  const at = el("output", { className: "at" });
  const ofDay = el("span", { className: "muted of-day" });
  const speed = el(
    "select",
    { "aria-label": "Speed", onchange: () => connection.play({ speed: Number(speed.value) }) },
    ...SPEEDS.map((value) => el("option", { value, text: `${value}×` })),
  );
  const problem = el("p", { className: "fault" });
  const slide = el("input", { type: "range", min: 0, max: 1, step: "any", "aria-label": "Position" });
  const rows = el("div", {
    className: "lanes",
    role: "group",
    tabindex: 0,
    "aria-label": "What each person did",
  });
  const axis = el("div", { className: "axis", "aria-hidden": "true" });
  const tip = el("p", { className: "tip", "aria-hidden": "true", hidden: true });
  const tracks = el(
    "div",
    { className: "tracks" },
    el("div", { className: "lane slide" }, el("span", {}), el("span", {}), slide),
    axis,
    rows,
    tip,
  );
  host.append(
    el(
      "div",
      { className: "transport" },
      button("before", "Event before", "Shift+E", () => self.event(-1)),
      button("back", "Message before", ",", () => self.step(-1)),
      playPause,
      button("forth", "Next message", ".", () => self.step(1)),
      button("next", "Next event", "E", () => self.event(1)),
      at,
      ofDay,
      speed,
    ),
    problem,
    tracks,
  );

  /** Where a hand holds the position, s; null: it is let go. */
  let held: number | null = null;
  let wasPlaying = false;
  let isSending = false;

  function hold(seconds: number): void {
    if (held === null) wasPlaying = site.playing?.is_playing ?? false;
    held = Math.min(Math.max(seconds, 0), site.timeline?.read_s ?? 0);
    if (isSending) return;
    isSending = true;
    requestAnimationFrame(() => {
      isSending = false;
      if (held !== null) connection.play({ at_s: held, is_playing: false });
    });
    self.frame();
  }

  function letGo(): void {
    if (held === null) return;
    connection.play({ at_s: held, is_playing: wasPlaying });
    held = null;
  }

  function go(seconds: number): void {
    connection.play({ at_s: Math.min(Math.max(seconds, 0), site.timeline?.read_s ?? 0) });
  }

  slide.addEventListener("input", () => hold(Number(slide.value)));
  slide.addEventListener("change", letGo);

  /** Position under the pointer, s. */
  function under(event: PointerEvent): number {
    const { left, width } = slide.getBoundingClientRect();
    const inset = 8; // half of the slider's thumb, where its travel begins
    return ((event.clientX - left - inset) / Math.max(width - 2 * inset, 1)) * (site.timeline?.length_s ?? 0);
  }

  rows.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !(event.target as Element).closest(".track")) return;
    rows.setPointerCapture(event.pointerId);
    hold(under(event));
  });
  rows.addEventListener("pointermove", (event) => {
    if (rows.hasPointerCapture(event.pointerId)) hold(under(event));
    name(event);
  });
  rows.addEventListener("pointerleave", () => show(tip, false));
  for (const end of ["pointerup", "pointercancel"]) rows.addEventListener(end, letGo);

  /** Show the time under the pointer, and what happened then. */
  function name(event: PointerEvent): void {
    const track = (event.target as Element).closest<HTMLElement>(".track");
    const lane = site.timeline?.lanes[Number(track?.dataset["lane"] ?? -1)];
    show(tip, track !== null && lane !== undefined);
    if (!track || !lane) return;
    const at = under(event);
    const text = textAt(
      lane,
      at,
      (REACH_PX / Math.max(track.clientWidth, 1)) * (site.timeline?.length_s ?? 0),
    );
    write(
      tip,
      [clock(Math.min(Math.max(at, 0), site.timeline?.length_s ?? 0)), text].filter(Boolean).join(" · "),
    );
    const { left, top, width } = tracks.getBoundingClientRect();
    tip.style.left = `${Math.min(Math.max(event.clientX - left - tip.offsetWidth / 2, 0), width - tip.offsetWidth)}px`;
    tip.style.top = `${track.getBoundingClientRect().top - top - tip.offsetHeight - 5}px`;
  }

  function row(
    lane: TimelineLane,
    index: number,
    before: TimelineLane | undefined,
    length: number,
  ): HTMLElement {
    const drawing = document.createElementNS(SVG, "svg");
    for (const [attribute, value] of Object.entries({
      viewBox: `0 0 ${WIDTH} ${HEIGHT}`,
      preserveAspectRatio: "none",
      role: "img",
      "aria-label": `${lane.user || "Site"}, ${LANE_NAMES[lane.kind]}: ${lane.items.length}`,
    })) {
      drawing.setAttribute(attribute, value);
    }
    const kinds = lane.kind === "interaction" ? [...new Set(lane.items.map(([, , text]) => text))] : [""];
    for (const kind of kinds) {
      const path = document.createElementNS(SVG, "path");
      path.setAttribute("class", [lane.kind, kind].filter(Boolean).join(" "));
      path.setAttribute(
        "d",
        outline(
          lane.items.filter(([, , text]) => !kind || text === kind),
          length,
        ),
      );
      drawing.append(path);
    }
    return el(
      "div",
      { className: lane.user === before?.user ? "lane" : "lane first" },
      el("span", { className: "who", text: lane.user === before?.user ? "" : lane.user || "Site" }),
      el("span", { className: "what", text: LANE_NAMES[lane.kind] }),
      el("div", { className: "track", "data-lane": index }, drawing),
    );
  }

  const self: Timeline = {
    update() {
      const { timeline, playing } = site;
      show(host, timeline !== null);
      document.body.classList.toggle("past", timeline !== null);
      if (!timeline) return;
      const lanes = timeline.lanes;
      renew(
        rows,
        JSON.stringify([timeline.length_s, timeline.read_s, lanes.map(({ items }) => items.length)]),
        () => lanes.map((lane, index) => row(lane, index, lanes[index - 1], timeline.length_s)),
      );
      mark(slide, "max", String(timeline.length_s));
      const places = ticks(timeline.length_s, Math.max(2, axis.clientWidth / LABEL_PX));
      renew(axis, JSON.stringify([timeline.length_s, places]), () =>
        places.map((place) => {
          const share = place / Math.max(timeline.length_s, 1e-3);
          const isLast = share > 0.9; // its label is on the other side
          const label = el("span", { className: isLast ? "last" : "", text: clock(place).slice(0, -2) });
          label.style[isLast ? "right" : "left"] = `${100 * (isLast ? 1 - share : share)}%`;
          return label;
        }),
      );
      const isPlaying = playing?.is_playing ?? false;
      const does = isPlaying ? "Pause" : "Play";
      mark(playPause.querySelector("use")!, "href", `#icon-${does.toLowerCase()}`);
      mark(playPause, "aria-label", does);
      playPause.title = `${does} (Space)`;
      if (playing && document.activeElement !== speed) speed.value = String(playing.speed);
      write(problem, timeline.problem);
      show(problem, timeline.problem !== "");
      self.frame();
    },
    frame() {
      const { timeline } = site;
      if (!timeline) return;
      const now = held ?? position(site);
      if (held === null) slide.value = String(now);
      if (held !== null || !site.playing?.is_playing) mark(slide, "aria-valuetext", spoken(now)); // else a screen reader would never stop
      tracks.style.setProperty("--at", String(now / Math.max(timeline.length_s, 1e-3)));
      write(at, `${clock(now)} / ${clock(timeline.length_s)}`);
      write(ofDay, time(timeline.began_ns / 1e6 + now * 1000));
    },
    toggle() {
      const isPlaying = site.playing?.is_playing ?? false;
      const isOver = !isPlaying && position(site) >= (site.timeline?.length_s ?? 0) - END_S;
      connection.play({ is_playing: !isPlaying, ...(isOver ? { at_s: 0 } : {}) });
    },
    step: (by) => connection.play({ step: by }),
    event(by) {
      const found = eventFrom(site.timeline?.lanes ?? [], position(site), by);
      if (!found) return;
      connection.play({ at_s: found.at, is_playing: false });
      say(`${clock(found.at)}: ${found.text}`);
    },
    skip: (seconds) => go(position(site) + seconds),
    faster(by) {
      const now = SPEEDS.indexOf(site.playing?.speed ?? 1);
      connection.play({ speed: SPEEDS[Math.min(Math.max(now + by, 0), SPEEDS.length - 1)]! });
    },
  };
  return self;
}
