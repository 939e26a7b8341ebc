// The room from above: x to the right and y up, in metres. Its scale includes all that was in it so far.
const SPACE = "http://www.w3.org/2000/svg";
const MARGIN_M = 0.5;
const FAR_M = 30;
let bounds = null;
let room = "";

function include([x, y]) {
  bounds = bounds ? [Math.min(bounds[0], x), Math.min(bounds[1], y), Math.max(bounds[2], x), Math.max(bounds[3], y)] : [x, y, x, y];
}

function mark(name, attributes) {
  const element = document.createElementNS(SPACE, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}

export function draw(svg, live) {
  svg.parentElement.hidden = !live;
  if (!live) return;
  const now = JSON.stringify(live.lines);
  if (now !== room) {
    room = now;
    bounds = null;
    live.lines.flat().forEach(include);
  }
  const { person, eyes, direction, cursor, target } = live;
  [person, eyes, target].filter(Boolean).forEach(include);
  if (!bounds) return;
  const [left, low, right, high] = bounds;
  const size = Math.max(right - left, high - low) + 2 * MARGIN_M;
  const dot = size / 60;
  svg.setAttribute("viewBox", `${left - MARGIN_M} ${-high - MARGIN_M} ${right - left + 2 * MARGIN_M} ${high - low + 2 * MARGIN_M}`);
  const parts = live.lines.map((line) => mark("polyline", { points: line.map(([x, y]) => `${x},${-y}`).join(" ") }));
  if (target) parts.push(mark("circle", { class: "target", cx: target[0], cy: -target[1], r: 1.6 * dot }));
  if (eyes && direction) {
    const [x, y] = cursor ?? [eyes[0] + FAR_M * direction[0], eyes[1] + FAR_M * direction[1]];
    parts.push(mark("path", { class: "ray", d: `M${eyes[0]},${-eyes[1]}L${x},${-y}` }));
  }
  if (cursor) {
    const [x, y] = [cursor[0], -cursor[1]];
    parts.push(mark("path", { class: "cursor", d: `M${x - dot},${y - dot}l${2 * dot},${2 * dot}m0,${-2 * dot}l${-2 * dot},${2 * dot}` }));
  }
  if (person) parts.push(mark("circle", { class: "person", cx: person[0], cy: -person[1], r: dot }));
  svg.replaceChildren(...parts);
}
