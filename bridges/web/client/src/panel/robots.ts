/** Robots: who steers each, what it does and why not; a button that stops it. And the button over the scene that stops all. */

import type { Controls } from "../controls";
import { el, icon, key, mark, show, write } from "../dom";
import { capital } from "../format";
import { cssColor } from "../geometry/appearance";
import { robotLine, seenRobots } from "../site/robots";
import type { PanelPart } from "./panel_part";

interface Line {
  readonly item: HTMLLIElement;
  readonly swatch: HTMLElement;
  readonly text: HTMLElement;
  readonly reason: HTMLElement;
  readonly stop: HTMLButtonElement;
}

/** The list of robots in the panel. */
export function robotsPart(controls: Controls): PanelPart {
  const { site } = controls;
  const lines = new Map<string, Line>();
  const list = el("ul", { className: "cards robots" });
  const none = el("p", {
    className: "muted",
    text: "No robot is in this room. What you choose is sent as a goal, for a robot that joins; the quadrotor and the ground robot have scenarios of their own.",
  });
  const element = el(
    "section",
    { className: "part", "aria-labelledby": "s-robots" },
    el("h2", { id: "s-robots", text: "Robots" }),
    none,
    list,
  );

  function make(name: string): Line {
    const swatch = el("span", { className: "swatch", hidden: true });
    const text = el("p", { className: "muted" });
    const reason = el("p", { className: "reason", hidden: true });
    const stop = el(
      "button",
      {
        type: "button",
        className: "halt",
        "aria-label": `Stop ${name}`,
        onclick: () => void controls.stopRobots([name]),
      },
      icon("stop"),
      el("span", { text: "Stop" }),
    );
    const item = el("li", {}, el("div", {}, el("strong", {}, swatch, name), text, reason), stop);
    list.append(item);
    return { item, swatch, text, reason, stop };
  }

  return {
    element,
    update() {
      const robots = seenRobots(site);
      const isMissing = robots.length === 0 && controls.isPresent("goal", controls.user);
      show(element, robots.length > 0 || isMissing);
      show(none, isMissing);
      for (const [name, { item }] of lines) {
        if (robots.some((robot) => robot.name === name)) continue;
        item.remove();
        lines.delete(name);
      }
      for (const { name, state } of robots) {
        const line = lines.get(name) ?? make(name);
        const color = site.people.get(state.user)?.profile?.cursor_color;
        lines.set(name, line);
        mark(line.item, "data-phase", state.phase);
        show(line.swatch, color !== undefined);
        if (color) line.swatch.style.background = cssColor(color);
        write(line.text, capital(robotLine(state)));
        write(line.reason, state.reason);
        show(line.reason, state.reason !== "");
        show(line.stop, controls.mayStop);
      }
    },
  };
}

/** The button over the scene; `host` keeps its place. */
export function stopAll(host: HTMLElement, controls: Controls): { update(): void } {
  const which = el("span", { className: "which" });
  host.append(
    el(
      "button",
      {
        type: "button",
        className: "halt",
        "aria-keyshortcuts": "R",
        onclick: () => void controls.stopRobots(),
      },
      icon("stop"),
      el("span", { text: "Stop" }),
      " ",
      which,
      key("R"),
    ),
  );
  return {
    update() {
      const { stoppable } = controls;
      show(host, stoppable.length > 0);
      write(which, stoppable.length > 1 ? "all robots" : (stoppable[0] ?? ""));
    },
  };
}
