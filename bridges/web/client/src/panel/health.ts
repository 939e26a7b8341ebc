/** Health of the site: latency, rates, losses, uncertainty, findings, services. */

import type { Controls } from "../controls";
import { el, icon, renew, section, show, write } from "../dom";
import { figureOf, losses, rates } from "../site/figures";
import { byName, bytes, duration, figure, milliseconds, rendererName } from "../format";
import type { ViewStats } from "../view";
import { LatencyGraph } from "./graph";
import type { PanelPart } from "./panel_part";

interface Tile {
  element: HTMLElement;
  set(text: string): void;
}

function tile(name: string): Tile {
  const value = el("dd", { text: "–" });
  return { element: el("div", {}, el("dt", { text: name }), value), set: (text) => write(value, text) };
}

function tiles(...all: Tile[]): HTMLElement {
  return el("dl", { className: "tiles" }, ...all.map((each) => each.element));
}

const RENEW_MS = 1000;
const SEVERITIES = { error: "error", warning: "warning", note: "info" } as const;

export function healthPart(controls: Controls, stats: () => ViewStats | null): PanelPart {
  const { site } = controls;
  const p50 = tile("median");
  const p95 = tile("95 %");
  const p99 = tile("99 %");
  const graph = new LatencyGraph();
  const imu = tile("wrist");
  const ray = tile("ray");
  const cursor = tile("cursor");
  const frame = tile("light");
  const dropped = el("p", { className: "muted" });
  const place = tile("place ±");
  const yaw = tile("direction ±");
  const drift = tile("drift");
  const age = tile("set right");
  const certainty = section("How surely they point", tiles(place, yaw, drift, age));
  const battery = tile("battery");
  const rate = tile("readings/s");
  const gaps = tile("gaps");
  const signal = tile("signal");
  const wrist = section("The device on their wrist", tiles(battery, rate, gaps, signal));
  const findings = el("ul", { className: "findings" });
  const folded = el("ul", { className: "findings" });
  const more = el("details", {}, el("summary", { text: "What follows from it" }), folded);
  const services = el("ul", { className: "services" });
  const page = el("p", { className: "muted" });
  const faults = el("p", { className: "fault", hidden: true });
  const record = el(
    "a",
    { className: "button", href: "/recording.mcap", download: "pointit.mcap" },
    icon("download"),
    el("span", { text: "Download the last minute" }),
  );
  const element = el(
    "div",
    {},
    section(
      "From wrist to screen",
      tiles(p50, p95, p99),
      graph.element,
      el(
        "p",
        { className: "legend muted" },
        el("i", { className: "whole" }),
        "median ",
        el("i", { className: "broken" }),
        "99 % of each second",
      ),
    ),
    section("Messages a second", tiles(imu, ray, cursor, frame), dropped),
    certainty,
    wrist,
    section("Warnings", findings, more),
    section("Services", services),
    section("This page", page, faults, record),
  );
  let renewed = -Infinity;

  function showCertainty(): void {
    const health = site.health.get(`localizer.${controls.user}`);
    const sigma = figureOf(health, "position σ");
    const turn = figureOf(health, "yaw σ");
    const rate = figureOf(health, "yaw drift") ?? figureOf(health, "drift");
    const since = figureOf(health, "anchor age");
    place.set(sigma === null ? "–" : sigma < 1 ? `${figure(sigma * 100)} cm` : `${figure(sigma)} m`);
    yaw.set(turn === null ? "–" : `${figure(turn)}°`);
    drift.set(rate === null ? "–" : `${figure(rate)}°/min`);
    age.set(since === null ? "–" : `${duration(since)} ago`);
    show(
      certainty,
      [sigma, turn, rate, since].some((each) => each !== null),
    );
  }

  function showWrist(): void {
    const health = site.health.get(`imu-bridge.${controls.user}`);
    const charge = figureOf(health, "battery");
    const hertz = figureOf(health, "rate");
    const pauses = figureOf(health, "gaps");
    const last = figureOf(health, "latest gap");
    const dbm = figureOf(health, "signal");
    battery.set(charge === null ? "–" : `${figure(charge)} %`);
    rate.set(hertz === null ? "–" : figure(hertz));
    gaps.set(
      pauses === null ? "–" : `${figure(pauses)}/min${pauses && last !== null ? `, ${figure(last)} ms` : ""}`,
    );
    signal.set(dbm === null ? "–" : `${figure(dbm)} dBm`);
    show(
      wrist,
      [charge, hertz, dbm].some((each) => each !== null),
    );
  }

  function showFindings(): void {
    const all = site.status?.findings ?? [];
    const lines = (isFolded: boolean): HTMLElement[] =>
      all
        .filter(({ follows }) => follows === isFolded)
        .map(({ severity, service, sentence, remedy }) =>
          el(
            "li",
            { "data-severity": SEVERITIES[severity] },
            icon(severity === "note" ? "info" : "warning"),
            el(
              "div",
              {},
              el("strong", {
                text: [severity === "note" ? "Note" : severity === "error" ? "Error" : "Warning", service]
                  .filter(Boolean)
                  .join(": "),
              }),
              el("p", { text: sentence }),
              remedy ? el("p", { className: "muted", text: remedy }) : null,
            ),
          ),
        );
    renew(folded, JSON.stringify(all), () => lines(true));
    show(more, folded.childElementCount > 0);
    renew(findings, JSON.stringify(all), () =>
      all.length
        ? lines(false)
        : [el("li", { "data-severity": "fine" }, icon("check"), el("div", { text: "Nothing is wrong." }))],
    );
  }

  function showServices(): void {
    const all = [...(site.status?.services ?? [])].sort(
      (a, b) => Number(a.present) - Number(b.present) || byName(a.instance, b.instance),
    );
    renew(services, all.map((each) => `${each.instance} ${each.present}`).join(), () =>
      all.map(({ instance, present }) =>
        el(
          "li",
          { "data-up": String(present) },
          icon(present ? "check" : "close"),
          el("span", { text: instance }),
          el("span", { className: "muted since" }),
        ),
      ),
    );
    all.forEach(({ present, since_s: since }, index) => {
      const text = services.children[index]?.querySelector(".since");
      if (text) write(text, `${present ? "up" : "down"} ${duration(since)}`);
    });
  }

  return {
    element,
    update() {
      const now = performance.now();
      if (!element.offsetParent) {
        renewed = -Infinity;
        return;
      }
      if (now - renewed < RENEW_MS) return;
      renewed = now;
      const { latency } = controls.connection;
      const total = latency.total(now);
      p50.set(milliseconds(total.p50));
      p95.set(milliseconds(total.p95));
      p99.set(milliseconds(total.p99));
      graph.show(latency.bySecond(now));
      const found = rates(site.health.values(), controls.user, site.people.size);
      const hertz = (value: number | null): string => (value === null ? "–" : `${Math.round(value)}`);
      imu.set(hertz(found.imu));
      ray.set(hertz(found.ray));
      cursor.set(hertz(found.cursor));
      frame.set(hertz(found.frame));
      const gone = losses(site.health.values());
      write(
        dropped,
        `Since the start: ${gone.dropped} outdated, ${gone.lost} lost, ${gone.invalid} invalid; ${gone.errors} errors.`,
      );
      showCertainty();
      showWrist();
      showFindings();
      showServices();
      const view = stats();
      const viewers = site.status?.viewers ?? 1;
      const { traffic } = site;
      write(
        page,
        [
          view
            ? `${Math.round(view.fps)} frames/s with ${rendererName(view.renderer)}${view.software ? " (drawn simply: no graphics processor)" : ""}`
            : "no view",
          `${traffic.batches} updates/s, ${bytes(traffic.bytes)}/s`,
          traffic.dropped ? `${traffic.dropped} events missed` : "",
          `${viewers} ${viewers === 1 ? "page looks on" : "pages look on"}`,
          `PointIt ${site.hello?.version ?? ""}`,
        ]
          .filter(Boolean)
          .join(" · "),
      );
      show(faults, site.faults.count > 0);
      write(
        faults,
        `${site.faults.count} ${site.faults.count === 1 ? "fault" : "faults"} of this page; the last: ${site.faults.last}`,
      );
      show(record, site.connected && site.hello?.role === "operator");
    },
  };
}
