/** Devices: those connected, and those within reach of the page's machine, to connect. */

import type { Controls } from "../controls";
import { el, enable, icon, isEnabled, renew, section, show, write } from "../dom";
import { capital } from "../format";
import type { PanelPart } from "../panel/panel_part";
import type { DeviceLine } from "../wire";
import {
  command,
  type FoundDevice,
  foundDevices,
  type FoundHome,
  foundHomes,
  freeName,
  freeStrips,
  isConnected,
  wristFigures,
} from "./found";
import { wearingDialog } from "./wearing";

/** Duration of a search, ms, and the most that it may take. */
const SEARCH_MS = 3_500;
const PATIENCE_MS = 15_000;
/** A connection may first end a process, or write the map. */
const CONNECT_MS = 20_000;
const NEW_STRIP = "";
/** Id of the button that searches. */
export const LOOK_ID = "look-for-devices";

export function devicesPart(controls: Controls): PanelPart {
  const { site } = controls;
  const wearing = wearingDialog(controls);
  const connected = el("ul", { className: "devices" });
  const look = el(
    "button",
    { type: "button", id: LOOK_ID, onclick: () => void search() },
    icon("watch"),
    el("span", { text: "Look for devices" }),
  );
  const progress = el("progress", { max: 1, value: 0, "aria-label": "Search for devices", hidden: true });
  const state = el("p", {
    className: "muted",
    role: "status",
    text: "Wristbands, trackers, lights and Home Assistants near the machine that serves this page.",
  });
  const list = el("ul", { className: "devices" });
  const why = el("ul", { className: "muted devices" });
  const problems = el("details", { hidden: true }, el("summary", {}, "Not searched", icon("chevron")), why);
  const element = section("Devices", connected, look, progress, state, list, problems);
  const states = new Map<string, HTMLElement>();
  let found: FoundDevice[] = [];
  let homes: FoundHome[] = [];
  let canConnect = false;
  /** The wrist whose person is about to appear, to be shown how to wear it. */
  let awaited = "";

  const lines = (): readonly DeviceLine[] => site.status?.devices ?? [];

  async function search(): Promise<void> {
    enable(look, false);
    write(state, "Looking …");
    const began = performance.now();
    const timer = setInterval(() => {
      progress.value = (performance.now() - began) / SEARCH_MS;
    }, 100);
    show(progress, true);
    const reply = await controls.ask({ deed: "find_devices" }, PATIENCE_MS);
    clearInterval(timer);
    show(progress, false);
    enable(look, true);
    found = foundDevices(reply ?? {});
    homes = foundHomes(reply ?? {});
    canConnect = reply?.["can_connect"] === true;
    const listed: unknown = reply?.["problems"];
    const reasons = Array.isArray(listed) ? listed.map(String) : [];
    why.replaceChildren(...reasons.map((text) => el("li", { text })));
    show(problems, reasons.length > 0);
    problems.open = found.length + homes.length === 0;
    write(
      state,
      !reply
        ? ""
        : found.length + homes.length === 0
          ? `None found${reasons.length ? " by the searches that could run" : ""}. Is it switched on, and in the same network?`
          : canConnect
            ? ""
            : "This page belongs to no run: a command connects a device, in a terminal on that machine.",
    );
    controls.changed();
  }

  async function connect(
    device: FoundDevice | DeviceLine,
    name: string,
    button: HTMLButtonElement,
  ): Promise<void> {
    enable(button, false);
    const { kind, plugin, address } = device;
    const reply = await controls.askAloud(
      { deed: "connect_device", query: { kind, plugin, address, name } },
      CONNECT_MS,
    );
    enable(button, true);
    if (reply && kind === "wrist") awaited = String(reply["id"]);
  }

  function offer(device: FoundDevice): HTMLElement {
    const title = el("strong", { text: device.label });
    const kind = el("p", { className: "muted", text: device.plugin });
    if (!canConnect) return el("li", {}, title, kind, el("code", { text: command(device) }));
    const button = el("button", { type: "submit" }, icon("plus"), el("span", { text: "Connect" }));
    const field =
      device.kind === "wrist"
        ? el("input", {
            type: "text",
            value: freeName([...site.people.keys()]),
            maxlength: 64,
            required: true,
            autocomplete: "off",
            spellcheck: "false",
          })
        : el(
            "select",
            {},
            ...freeStrips(site.map?.strips ?? [], lines()).map(({ id, pixels }) =>
              el("option", { value: id, text: `${id} (${pixels})` }),
            ),
            el("option", { value: NEW_STRIP, text: "A new strip in the map" }),
          );
    const form = el(
      "form",
      {
        onsubmit: (event) => {
          event.preventDefault();
          if (isEnabled(button)) void connect(device, field.value || newStrip(device), button);
        },
      },
      el(
        "label",
        {},
        el("span", { className: "muted", text: device.kind === "wrist" ? "Who wears it" : "Shows strip" }),
        field,
      ),
      button,
    );
    return el("li", {}, title, kind, form);
  }

  function home({ label, command: line }: FoundHome): HTMLElement {
    return el(
      "li",
      {},
      el("strong", { text: label }),
      el("p", { className: "muted", text: "Home Assistant" }),
      el("code", { text: line }),
    );
  }

  /** Name of a strip for a light, after the light's own. */
  function newStrip({ label }: FoundDevice): string {
    const base = label.split(",")[0]!.trim().slice(0, 60) || "light";
    const taken = site.map?.strips.map(({ id }) => id) ?? [];
    for (let number = 1; ; number++) {
      const name = number === 1 ? base : `${base} ${number}`;
      if (!taken.includes(name)) return name;
    }
  }

  function item(line: DeviceLine): HTMLElement {
    const isWrist = line.kind === "wrist";
    const again = el(
      "button",
      {
        type: "button",
        "aria-label": `Connect ${line.name} again`,
        onclick: () => void connect(line, line.name, again),
      },
      el("span", { text: "Again" }),
    );
    const act =
      line.problem && !line.is_on
        ? again
        : isWrist
          ? el(
              "button",
              {
                type: "button",
                "aria-label": `Fit: how ${line.name} wears it`,
                "aria-disabled": line.is_on ? false : "true",
                onclick: () => wearing.open(line),
              },
              el("span", { text: "Fit" }),
            )
          : el(
              "button",
              {
                type: "button",
                "aria-label": `Test pattern on strip ${line.name}`,
                "aria-disabled": line.is_on ? false : "true",
                onclick: () => void controls.askAloud({ deed: "show_device", query: { id: line.id } }),
              },
              el("span", { text: "Test" }),
            );
    const forget = el(
      "button",
      {
        type: "button",
        "aria-label": `Forget ${line.label}`,
        onclick: () => void controls.askAloud({ deed: "forget_device", query: { id: line.id } }),
      },
      el("span", { text: "Forget" }),
    );
    const state = el("p", {});
    states.set(line.id, state);
    return el(
      "li",
      {},
      el("strong", { text: isWrist ? line.name : `Strip ${line.name}` }),
      el("p", { className: "muted", text: `${line.label} · ${line.plugin}` }),
      state,
      controls.mayDo("forget_device") ? el("div", { className: "pairs" }, act, forget) : null,
    );
  }

  function stateOf(line: DeviceLine): string {
    if (line.problem) return line.problem;
    if (!line.is_on) return "connecting …";
    return (line.kind === "wrist" && wristFigures(site.health.get(`imu-bridge.${line.name}`))) || "connected";
  }

  return {
    element,
    update() {
      show(element, controls.mayDo("find_devices"));
      const all = lines();
      renew(
        connected,
        JSON.stringify(all.map((line) => [line.id, line.label, line.is_on, line.problem && !line.is_on])),
        () => all.map(item),
      );
      for (const line of all) {
        const state = states.get(line.id)!;
        state.className = line.problem ? "reason" : "muted";
        write(state, capital(stateOf(line)));
      }
      const free = found.filter((each) => !isConnected(each, all));
      renew(
        list,
        JSON.stringify([
          canConnect,
          free,
          homes,
          freeStrips(site.map?.strips ?? [], all).map(({ id }) => id),
        ]),
        () => [...free.map(offer), ...homes.map(home)],
      );
      const line = all.find(({ id }) => id === awaited);
      if (line?.is_on) {
        awaited = "";
        wearing.open(line);
      } else if (line?.problem) awaited = "";
      wearing.update();
    },
  };
}
