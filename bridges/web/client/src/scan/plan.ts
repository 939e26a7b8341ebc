/** The live picture: strips, lamps, things and cameras from above, with their uncertainty. */

import { draw } from "../plan/svg";
import type { ScanState } from "../wire";

const WIDTH = 640;
const HEIGHT = 360;
const MARGIN = 44;
/** Uncertainty is drawn this many times as large as it is. */
const ENLARGED = 10;
const SURE_M = 0.01;
/** Height of a label, and its usual width. */
const LINE = 20;
const LABEL = 90;

export function drawPlan(host: SVGSVGElement, state: ScanState): void {
  host.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  const title = host.querySelector("title")!;
  const lines = state.strips.filter(({ line_m }) => line_m.length);
  const next = state.next_m ? [state.next_m] : [];
  const points = [...lines.flatMap(({ line_m }) => line_m), ...state.cameras_m, ...next];
  host.replaceChildren(title);
  if (!points.length)
    return void draw(
      host,
      "text",
      { x: WIDTH / 2, y: HEIGHT / 2, "text-anchor": "middle" },
      "The plan appears after the second view.",
    );
  const [xs, ys] = [points.map(([x]) => x), points.map(([, y]) => y)];
  const [left, right, low, high] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const scale = Math.min(
    (WIDTH - 2 * MARGIN) / Math.max(right - left, 0.1),
    (HEIGHT - 2 * MARGIN) / Math.max(high - low, 0.1),
  );
  const place = ([x, y]: readonly number[]) =>
    [WIDTH / 2 + scale * (x! - (left + right) / 2), HEIGHT / 2 - scale * (y! - (low + high) / 2)] as const;
  const labels: { x: number; y: number }[] = [];
  /** A label that lies on no other. */
  const label = (x: number, y: number, text: string) => {
    const at = { x: Math.min(WIDTH - MARGIN, Math.max(MARGIN, x)), y };
    const step = y < HEIGHT / 2 ? LINE : -LINE; // away from the edge
    while (labels.some((other) => Math.abs(other.y - at.y) < LINE && Math.abs(other.x - at.x) < LABEL))
      at.y += step;
    labels.push(at);
    draw(host, "text", { ...at, "text-anchor": "middle" }, text);
  };
  for (const { name, line_m, sigma_m, pixels } of lines) {
    const at = line_m.map(place);
    const isUnsure = pixels > 0 && (sigma_m === null || sigma_m > SURE_M);
    for (const [cx, cy] of pixels ? [at[0]!, at.at(-1)!] : []) {
      if (sigma_m !== null)
        draw(host, "circle", { class: "spread", cx, cy, r: Math.min(60, ENLARGED * scale * sigma_m) });
    }
    draw(host, "polyline", {
      class: pixels ? (isUnsure ? "strip is-unsure" : "strip") : "thing",
      points: at.map((each) => each.join()).join(" "),
    });
    if (pixels)
      draw(host, "circle", {
        class: isUnsure ? "first is-unsure" : "first",
        cx: at[0]![0],
        cy: at[0]![1],
        r: 5,
      });
    const middle = at[at.length >> 1]!;
    const [x, y] = [(at[0]![0] + middle[0]) / 2, (at[0]![1] + middle[1]) / 2];
    label(x, y - 9, name);
  }
  state.cameras_m.forEach((camera, i) => {
    const [x, y] = place(camera);
    draw(host, "circle", { class: "camera", cx: x, cy: y, r: 7 });
    draw(host, "text", { x: x + 11, y: y + 4 }, String(i + 1));
  });
  for (const [x, y] of next.map(place)) {
    draw(host, "path", { class: "next", d: `M${x - 9} ${y}h18M${x} ${y - 9}v18` });
    label(x, y - 14, "next");
  }
}
