/** The latency of the last minute: median and 99th percentile of each second. */

import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { el, mark } from "../dom";
import { latencyTick, milliseconds } from "../format";
import type { Second } from "../site/timing";

const HEIGHT = 110;

export class LatencyGraph {
  readonly element = el("div", { className: "graph", role: "img", "aria-label": "Latency of the last minute" });
  private plot: uPlot | null = null;
  private theme = "";

  constructor() {
    new ResizeObserver(() => this.fit()).observe(this.element);
  }

  /** Show seconds, oldest first. */
  show(seconds: readonly Second[]): void {
    if (!this.element.clientWidth) return;
    const theme = document.documentElement.dataset.theme ?? "";
    if (!this.plot || theme !== this.theme) this.make(theme);
    const x = seconds.map((_, index) => index - seconds.length + 1);
    this.plot?.setData([x, seconds.map((each) => each.p50), seconds.map((each) => each.p99)]);
    const last = seconds[seconds.length - 2];
    mark(this.element, "aria-label", last?.p50 == null
      ? "Latency of the last minute: nothing to show"
      : `Latency of the last minute; in the last second ${milliseconds(last.p50)}, at worst ${milliseconds(last.p99)}`);
  }

  private make(theme: string): void {
    this.plot?.destroy();
    this.theme = theme;
    const style = getComputedStyle(document.documentElement);
    const color = (name: string): string => style.getPropertyValue(name).trim();
    const axis = { stroke: color("--muted"), grid: { stroke: color("--line"), width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif" };
    this.plot = new uPlot({
      width: this.element.clientWidth, height: HEIGHT, cursor: { show: false }, legend: { show: false },
      padding: [8, 16, 0, 0],
      scales: { x: { time: false, range: [-59, 0] }, y: { range: (_plot, _low, high) => [0, Math.max(40, (high ?? 0) * 1.15)] } },
      axes: [
        { ...axis, size: 20, space: 60, values: (_plot, ticks) => ticks.map((tick) => (tick === 0 ? "now" : `−${-tick} s`)) },
        { ...axis, size: 42, space: 26, values: (_plot, ticks) => ticks.map(latencyTick) },
      ],
      series: [
        {}, { stroke: color("--accent"), width: 2, points: { show: false }, fill: color("--accent-soft") },
        { stroke: color("--second"), width: 1.5, dash: [4, 3], points: { show: false } },
      ],
    }, [[], [], []], this.element);
  }

  private fit(): void {
    if (this.plot && this.element.clientWidth) this.plot.setSize({ width: this.element.clientWidth, height: HEIGHT });
  }
}
