/** Chimes of cues, made of tones; nothing is loaded. */

import type { Feedback } from "./messages";

/** Frequency in Hz, start and length in s. */
type Tone = readonly [number, number, number];

const CHIMES: Record<Exclude<Feedback["chime"], "">, readonly Tone[]> = {
  up: [
    [523, 0, 0.09],
    [784, 0.09, 0.14],
  ],
  down: [
    [784, 0, 0.09],
    [523, 0.09, 0.14],
  ],
  single: [[659, 0, 0.16]],
  double: [
    [659, 0, 0.1],
    [988, 0.13, 0.18],
  ],
  buzz: [[140, 0, 0.28]],
  tick: [
    [880, 0, 0.06],
    [1319, 0.06, 0.16],
  ],
  tock: [
    [587, 0, 0.08],
    [392, 0.08, 0.14],
  ],
};
const LOUDNESS = 0.12;

let context: AudioContext | null = null;

/** Play a chime; silent until the person has touched the page once, as browsers want it. */
export function chime(name: Feedback["chime"]): void {
  if (!name || !navigator.userActivation?.hasBeenActive) return;
  context ??= new AudioContext();
  if (context.state === "suspended") void context.resume();
  for (const [frequency, start, length] of CHIMES[name] ?? []) {
    const from = context.currentTime + start;
    const tone = context.createOscillator();
    const gain = context.createGain();
    tone.type = name === "buzz" ? "sawtooth" : "sine";
    tone.frequency.value = frequency;
    gain.gain.setValueAtTime(0, from);
    gain.gain.linearRampToValueAtTime(LOUDNESS, from + 0.01);
    gain.gain.exponentialRampToValueAtTime(0.001, from + length);
    tone.connect(gain).connect(context.destination);
    tone.start(from);
    tone.stop(from + length + 0.02);
  }
}
