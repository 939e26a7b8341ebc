import assert from "node:assert/strict";
import { test } from "node:test";
import { encode } from "@msgpack/msgpack";
import { decodeBatch } from "../site/batch";
import type { Playing } from "../wire";
import { RecordedSocket, unpacked, type Frame } from "./recorded";

const bytes = (each: number): Uint8Array => Uint8Array.of(each);
/** A pose each second; ben's is gone from 2 s on, an event is at 1 s. */
const FRAMES: Frame[] = [
  [
    0,
    [
      ["map", "", bytes(9)],
      ["pose", "anna", bytes(0)],
      ["pose", "ben", bytes(5)],
    ],
    [],
    "status 0",
  ],
  [1, [["pose", "anna", bytes(1)]], [["selected", "", bytes(7)]], ""],
  [
    2,
    [
      ["pose", "anna", bytes(2)],
      ["pose", "ben", null],
    ],
    [],
    "status 2",
  ],
];

/** A socket that has begun, and what it has said since it was asked last. */
function opened() {
  const socket = new RecordedSocket("hello", '{"began_ns":1e18}', FRAMES, true);
  const heard: (string | ArrayBuffer)[] = [];
  socket.onmessage = ({ data }: MessageEvent<string | ArrayBuffer>) => void heard.push(data);
  socket.open();
  const said = () => {
    const all = heard.splice(0);
    const texts = all.filter((each) => typeof each === "string");
    const isPlaying = (each: string) => each.startsWith('{"kind":"playing"');
    const batches = all
      .filter((each) => typeof each !== "string")
      .map((each) => decodeBatch(new Uint8Array(each)));
    const states = batches.flatMap((batch) =>
      batch.states.map(({ topic, name, payload }) => [topic, name, payload?.[0] ?? null]),
    );
    return {
      texts: texts.filter((each) => !isPlaying(each)),
      playing: texts.filter(isPlaying).map((each) => JSON.parse(each) as Playing),
      batches,
      states,
    };
  };
  return { socket, said };
}

test("a recording in the page begins as a server does, and stands at its end", () => {
  const { socket, said } = opened();
  const first = said();
  assert.deepEqual(first.texts, ["hello", '{"began_ns":1e18}', "status 0"]);
  assert.deepEqual(
    [first.batches.length, first.batches[0]!.n, first.batches[0]!.sentNs, first.states.length],
    [1, 1, 1e18, 3],
  );
  socket.advance(60); // it was in the background, and goes on where it was
  const second = said();
  assert.deepEqual([second.states, second.batches[0]!.events.length], [[["pose", "anna", 1]], 1]);
  assert.deepEqual(second.playing, [
    { kind: "playing", at_s: 1, is_playing: true, speed: 1, has_jumped: false },
  ]);
  for (let tick = 0; tick < 6; tick += 1) socket.advance(0.2);
  const third = said();
  assert.deepEqual(third.states, [
    ["pose", "anna", 2],
    ["pose", "ben", null],
  ]);
  assert.deepEqual(
    third.playing.map(({ at_s, is_playing }) => [at_s, is_playing]),
    [[2, false]],
  );
  socket.advance(1);
  assert.deepEqual(said().batches, []);
});

test("a recording may begin to play in its middle, with all that is there", () => {
  const socket = new RecordedSocket("hello", '{"began_ns":1e18}', FRAMES, true, 1.5);
  const heard: unknown[] = [];
  socket.onmessage = ({ data }: MessageEvent) => void heard.push(data);
  socket.open();
  const { at_s, is_playing } = JSON.parse(
    heard.find((each) => String(each).startsWith('{"kind":"playing"')) as string,
  ) as Playing;
  assert.deepEqual([at_s, is_playing], [1.5, true]);
  const { states, events } = decodeBatch(new Uint8Array(heard.at(-1) as ArrayBuffer));
  assert.deepEqual([states.map(({ payload }) => payload?.[0]), events], [[9, 1, 5], []]);
});

test("a jump brings the differences and no event, forth and back; a step pauses", () => {
  const { socket, said } = opened();
  said();
  const play = (wish: object): void => socket.send(JSON.stringify({ kind: "play", ...wish }));
  play({ at_s: 2, speed: 4 });
  const forth = said();
  assert.deepEqual(forth.states, [
    ["pose", "anna", 2],
    ["pose", "ben", null],
  ]);
  assert.deepEqual([forth.batches[0]!.events, forth.batches[0]!.speed, forth.texts], [[], 4, ["status 2"]]);
  assert.deepEqual(forth.playing, [
    { kind: "playing", at_s: 2, is_playing: true, speed: 4, has_jumped: true },
  ]);
  play({ at_s: 0.5 });
  assert.deepEqual(said().states, [
    ["pose", "anna", 0],
    ["pose", "ben", 5],
  ]);
  play({ step: 1 });
  const stepped = said();
  assert.deepEqual(
    [stepped.states, stepped.playing[0]!.at_s, stepped.playing[0]!.is_playing],
    [[["pose", "anna", 1]], 1, false],
  );
  socket.advance(0.2);
  assert.deepEqual(said().batches, []);
  play({ step: -1 });
  assert.equal(said().playing[0]!.at_s, 0);
  play({ step: -1 });
  socket.send('{"kind":"ack","n":1}');
  assert.deepEqual([said().states, said().batches], [[], []]);
});

test("the recording is unpacked as it was packed", async () => {
  const stream = new Blob(["hello", "timeline", FRAMES[1]].map((each) => encode(each)))
    .stream()
    .pipeThrough(new CompressionStream("gzip"));
  const packed = new Uint8Array(await new Response(stream).arrayBuffer());
  assert.deepEqual(await unpacked(btoa(String.fromCharCode(...packed))), ["hello", "timeline", FRAMES[1]]);
});
