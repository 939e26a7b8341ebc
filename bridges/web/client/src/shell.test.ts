import assert from "node:assert/strict";
import { test } from "node:test";
import { columnsOf } from "./ui/columns";
import { bytes, duration, figure, latencyTick, milliseconds, rendererName, typedNumber } from "./format";
import { fingerprintLines } from "./people/pairing";
import {
  command,
  foundDevices,
  foundHomes,
  freeName,
  freeStrips,
  isConnected,
  wristFigures,
} from "./devices/found";
import { fitSentence } from "./devices/wearing";
import type { Health } from "./messages";
import { wordsOf } from "./shell/glossary_words";
import { readSettings } from "./settings";
import { Controls } from "./controls";
import { emptyPerson, emptySite } from "./site/site";
import { listed, pressTitle, rememberedSentence } from "./words";

test("numbers as people read them", () => {
  assert.deepEqual([5.9, 61, 7500, 200_000].map(duration), ["5 s", "1 min", "2 h 05 min", "2 d"]);
  assert.deepEqual([null, 12.4, 1234].map(milliseconds), ["–", "12 ms", "1.2 s"]);
  assert.deepEqual(
    [0, 200, 1000, 10_000, 12_500].map(latencyTick),
    ["0", "200", "1 s", "10 s", "12.5 s"],
    "as the axis has room",
  );
  assert.deepEqual([0, 12.34, -1.25, 0.123, 0.0123, -0.0001].map(figure), [
    "0",
    "12",
    "-1.3",
    "0.12",
    "0.012",
    "0.000",
  ]);
  assert.deepEqual([999, 1234, 45_678, 2.5e6].map(bytes), ["999 B", "1.2 kB", "46 kB", "2.5 MB"]);
  assert.equal(fingerprintLines("ab:cd:01"), "AB CD 01");
});

test("found devices have the command that connects them, whatever else is in the reply", () => {
  const wrist = {
    kind: "wrist" as const,
    plugin: "band",
    address: "F1:22",
    label: "Wristband",
    pixels: 0,
    use: "--imu band:F1:22",
  };
  const light = {
    ...wrist,
    kind: "light" as const,
    plugin: "ddp",
    address: "kitchen",
    pixels: 60,
    use: "--output ddp:kitchen",
  };
  assert.deepEqual(
    foundDevices({ devices: [wrist, light, null, 1, { ...wrist, kind: "robot" }, { ...wrist, use: 1 }, {}] }),
    [wrist, light],
  );
  for (const bad of [{}, { devices: null }, { devices: "x" }]) assert.deepEqual(foundDevices(bad), []);
  assert.equal(command(wrist), "pointit person add NAME --imu band:F1:22");
  assert.equal(command(light), "pointit output add ddp:kitchen");
});

test("a Home Assistant has the command that imports from it, whatever else is in the reply", () => {
  const home = {
    label: "Home, 2025.4.4",
    command: "pointit map import home-assistant --url http://192.168.1.5:8123",
  };
  assert.deepEqual(foundHomes({ homes: [home, null, { label: 1 }, { ...home, command: 2 }] }), [home]);
  for (const bad of [{}, { homes: null }, { homes: "x" }]) assert.deepEqual(foundHomes(bad), []);
});

test("a light is offered the strips that no other shows, and a wearer a name that nobody has", () => {
  const line = {
    id: "light 0",
    kind: "light" as const,
    name: "0",
    plugin: "ddp",
    address: "kitchen",
    label: "",
    pixels: 60,
    is_on: true,
    said: "",
    problem: "",
  };
  assert.deepEqual(
    freeStrips([{ id: "10" }, { id: "0" }, { id: "2" }], [line, { ...line, kind: "wrist", name: "2" }]).map(
      ({ id }) => id,
    ),
    ["2", "10"],
  );
  assert.ok(isConnected({ ...line, use: "" }, [line]));
  assert.ok(!isConnected({ ...line, address: "hall", use: "" }, [line]));
  assert.equal(freeName(["user1", "anna", "user3"]), "user2");
});

test("a connected wrist shows what it tells of its rate, its battery and its fit", () => {
  const figures = [
    { name: "rate", value: 99.6, unit: "Hz" },
    { name: "battery", value: 82, unit: "%" },
    { name: "gaps", value: 3, unit: "/min" },
  ];
  const health = {
    stamp_ns: 0,
    service: "imu-bridge",
    user: "anna",
    warnings: [],
    figures,
  } as unknown as Health;
  assert.equal(wristFigures(health), "100 Hz · battery 82 %");
  assert.equal(wristFigures(undefined), "");
  assert.equal(
    fitSentence({ about_arm_deg: -90.2, off_axis_deg: 3.1 }),
    "It sits turned by 90° about the arm and 3° off its axis; that is corrected from now on.",
  );
  assert.equal(fitSentence({ about_arm_deg: 2, off_axis_deg: 3 }), "It sits as assumed.");
  assert.equal(fitSentence({}), "It is measured, and used from now on.");
});

test("a renderer by its name", () => {
  assert.equal(
    rendererName(
      "ANGLE (Google, Vulkan 1.3.0 (SwiftShader Device (Subzero) (0x0000C0DE)), SwiftShader driver)",
    ),
    "SwiftShader",
  );
  assert.equal(
    rendererName("ANGLE (NVIDIA, NVIDIA GeForce RTX 3060 (0x00002504) Direct3D11 vs_5_0 ps_5_0, D3D11)"),
    "NVIDIA GeForce RTX 3060",
  );
  assert.equal(
    rendererName("ANGLE (Apple, ANGLE Metal Renderer: Apple M2, Unspecified Version)"),
    "Apple M2",
  );
  assert.equal(rendererName("Mali-G78"), "Mali-G78");
  assert.equal(rendererName("SVG"), "SVG");
});

test("settings survive what is not theirs", () => {
  const usual = readSettings(null);
  for (const bad of ["", "no json", "[]", '{"theme":7,"sound":"yes"}', "null"])
    assert.deepEqual(readSettings(bad), usual);
  assert.equal(readSettings('{"theme":"dark","sound":false}').theme, "dark");
  assert.equal(readSettings('{"theme":"dark","sound":false}').sound, false);
});

test("the button says what it does", () => {
  const titles = (["start", "cancel", "stop", "confirm", ""] as const).map((press) => pressTitle({ press }));
  assert.deepEqual(
    [pressTitle(null), ...titles],
    ["Start pointing", "Start pointing", "Stop localizing", "Stop pointing", "Confirm", ""],
  );
});

test("what earlier localizations told of the elevation is said until it is forgotten", () => {
  const sentence = (localizations: number) =>
    rememberedSentence({ remembered_bias: { localizations } as never });
  assert.equal(sentence(3), "The elevation bias of 3 localizations by a robot is remembered.");
  assert.match(sentence(1), / of 1 localization by a robot is remembered\.$/);
  assert.deepEqual(
    [
      rememberedSentence({ remembered_bias: null }),
      rememberedSentence(null),
      rememberedSentence({} as never),
    ],
    ["", "", ""],
    "of an old recording, too",
  );
});

test("to forget it is a request of the chosen person's localizer, if the page may cancel", () => {
  const site = emptySite();
  const asked: object[] = [];
  const controls = new Controls(
    site,
    {} as never,
    { ask: (wish: object) => (asked.push(wish), Promise.resolve({})) } as never,
    {} as never,
    () => {},
  );
  site.people.set("ada", emptyPerson("ada")).set("bea", emptyPerson("bea"));
  const appears = (requests: string[]) =>
    Object.assign(site, {
      connected: true,
      hello: { deeds: [], requests },
      status: { services: [{ instance: "localizer.bea", present: true }] },
    });
  appears([]);
  controls.choose("bea");
  controls.cancel({ forget_bias: true });
  assert.deepEqual(asked, []);
  appears(["localizer/{user}/cancel"]);
  controls.cancel({ forget_bias: true });
  assert.deepEqual(asked, [{ key: "localizer/{user}/cancel", name: "bea", query: { forget_bias: true } }]);
});

test("the glossary is plain text, of the first table only", () => {
  const table =
    "# G\n\n| word | meaning |\n|---|---|\n| `pui` | computes [cursors](x.md) |\n| extra | libraries ([list](extras.md)) |\n\n## Of the source\n\n| word | meaning |\n|---|---|\n| shard | a second instance |\n";
  assert.deepEqual(wordsOf(table), [
    { word: "pui", meaning: "computes cursors" },
    { word: "extra", meaning: "libraries" },
  ]);
});

test("options stand in even rows", () => {
  const columns = (...labels: string[]): number =>
    columnsOf(labels.map((label) => ({ value: label, label })));
  assert.deepEqual(
    [
      columns("1"),
      columns("1", "2", "3", "4"),
      columns("Gauge", "Hold", "Fraction"),
      columns("Gauge", "Hold", "Fraction", "Estimate"),
    ],
    [1, 4, 3, 2],
  );
  assert.deepEqual(
    [
      columns("red", "green", "blue", "pink", "gold"),
      columns("a very long name indeed", "another"),
      columns(),
    ],
    [3, 1, 1],
  );
  assert.equal(
    columnsOf(["Red", "Green", "Blue", "Gold"].map((label) => ({ value: label, label, swatch: "red" }))),
    2,
  );
});

test("a typed value is read with a comma or its unit, and nothing else", () => {
  assert.deepEqual(
    ["1.5", "1,5", " 1.5 m/s", "1.5M/S", ".5", "2.", "-1", "+3", "\u22121"].map((text) =>
      typedNumber(text, "m/s"),
    ),
    [1.5, 1.5, 1.5, 1.5, 0.5, 2, -1, 3, -1],
  );
  for (const bad of ["", " ", "fast", "1,2,3", "1.2.3", "1e3", "0x10", "NaN", "1 km/h", "m/s", "."])
    assert.equal(typedNumber(bad, "m/s"), null, bad);
  assert.deepEqual([typedNumber("80 %", "%"), typedNumber("12°", "°")], [80, 12]);
});

test("many names are counted", () => {
  assert.deepEqual(
    [listed(["a"]), listed(["a", "b", "c", "d"]), listed(["a", "b", "c", "d", "e"])],
    ["a", "a, b, c, d", "a, b, c and 2 more"],
  );
});
