import assert from "node:assert/strict";
import { mock, test } from "node:test";
import { Speaker } from "./speaker";

mock.timers.enable({ apis: ["setTimeout"] });

/** A speaker in a browser with these voices; what it tells, and what it was asked to speak. */
function make(voices: { lang: string }[], stored: object = {}) {
  const kept = new Map([["pointit-speaker", JSON.stringify(stored)]]);
  const told: unknown[] = [];
  const spoken: { text: string; lang: string; onstart?(): void; onerror?(event: object): void }[] = [];
  const synthesis = Object.assign(new EventTarget(), {
    getVoices: () => voices,
    cancel() {},
    speak: (utterance: (typeof spoken)[0]) => spoken.push(utterance),
  });
  Object.assign(globalThis, {
    window: { speechSynthesis: synthesis },
    localStorage: {
      getItem: (key: string) => kept.get(key) ?? null,
      setItem: (key: string, value: string) => kept.set(key, value),
    },
    SpeechSynthesisUtterance: class {
      lang = "";
      constructor(readonly text: string) {}
    },
  });
  const speaker = new Speaker({ textContent: "" } as never, (...news) => told.push(news) > 0);
  return { speaker, told, spoken, kept, synthesis };
}

test("languages that the browser learns late are offered, and another rate keeps the chosen one", () => {
  const voices: { lang: string }[] = [];
  const { speaker, synthesis, kept, spoken } = make(voices, { on: true, lang: "it-IT", rate: 1 });
  let changes = 0;
  speaker.onChange = () => {
    changes += 1;
  };
  voices.push({ lang: "de-DE" }, { lang: "it-IT" });
  synthesis.dispatchEvent(new Event("voiceschanged"));
  assert.deepEqual([speaker.languages, changes], [["", "de-DE", "it-IT"], 1]);
  speaker.keep({ rate: 1.5 });
  speaker.say("lamp");
  assert.deepEqual(
    [JSON.parse(kept.get("pointit-speaker")!), spoken.at(-1)!.lang],
    [{ on: true, lang: "it-IT", rate: 1.5 }, "it-IT"],
  );
});

test("a name counts once the browser has begun to speak it", () => {
  const { speaker, told, spoken } = make([{ lang: "de-DE" }]);
  speaker.setUsual(true, "de");
  speaker.say("Lampe");
  assert.deepEqual([told, spoken.at(-1)!.lang], [[], "de"]);
  spoken.at(-1)!.onstart!();
  spoken.at(-1)!.onerror!({ error: "interrupted" });
  assert.deepEqual(told, [[1, ""]]);
  spoken.at(-1)!.onerror!({ error: "not-allowed" });
  assert.deepEqual(told.at(-1), [0, "silent"]);
});

test("a next step is spoken once, cuts off no name and counts as none", () => {
  const { speaker, told, spoken, synthesis } = make([{ lang: "de-DE" }]);
  let cuts = 0;
  synthesis.cancel = () => {
    cuts += 1;
  };
  speaker.setUsual(true, "de");
  speaker.say("Lampe");
  for (const step of ["", "Point at a box.", "Point at a box.", "Press."]) speaker.sayStep(step);
  assert.deepEqual([spoken.map(({ text }) => text), cuts], [["Lampe", "Point at a box.", "Press."], 1]);
  spoken.at(-1)!.onstart?.();
  assert.deepEqual(told, []);
  speaker.sayStep("Point at a box.");
  assert.equal(spoken.at(-1)!.text, "Point at a box.", "again after another one");
});

test("a browser without voices, or without one of the language, says so by itself and again once it has one", () => {
  const voices: { lang: string }[] = [];
  const { speaker, told, synthesis } = make(voices);
  speaker.setUsual(true, "de");
  mock.timers.tick(3000);
  assert.deepEqual(told, [[0, "none"]]);
  for (const lang of ["en-US", "de_DE"]) {
    voices.push({ lang });
    synthesis.dispatchEvent(new Event("voiceschanged"));
  }
  assert.deepEqual(told.slice(1), [
    [0, "language"],
    [0, ""],
  ]);
  speaker.say("Lampe");
  mock.timers.tick(3000);
  assert.deepEqual(told.at(-1), [0, "silent"]);
});
