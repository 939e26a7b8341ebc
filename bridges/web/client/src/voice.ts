/**
 * Words of the browser's recogniser (Web Speech API). It tells when speech begins and ends, and no times of words: they are
 * spread over that time by their lengths. A recogniser that streams has shown a word after it was said, which bounds its end.
 */

/** As it is sent: times are ages when it is sent, s. */
export interface SaidWord {
  text: string;
  start_s: number;
  end_s: number;
  confidence: number | null;
}

/** As much of the API as is used; the types of the DOM lack it. */
interface Recognition {
  continuous: boolean;
  interimResults: boolean;
  lang: string;
  onspeechstart: (() => void) | null;
  onspeechend: (() => void) | null;
  onresult: ((event: RecognitionEvent) => void) | null;
  onerror: ((event: { error: string }) => void) | null;
  onend: (() => void) | null;
  start(): void;
  abort(): void;
}
interface RecognitionEvent {
  resultIndex: number;
  results: ArrayLike<ArrayLike<{ transcript: string; confidence: number }> & { isFinal: boolean }>;
}
type Browser = Partial<Record<"SpeechRecognition" | "webkitSpeechRecognition", new () => Recognition>>;

/** A letter takes so long, and a word as long as two more, s: slow commands; silence before or after is not spread over. */
const LETTER_S = 0.09;
/** A recogniser shows its first guess so long after the onset, s, where it does not tell when speech begins. */
const GUESS_S = 0.6;
const MOST_WORDS = 64;
const OLDEST_S = 60;

const weight = (word: string): number => word.length + 2;

/**
 * Times of the words of an utterance.
 * @param began time of its onset, s; ended: of its end, now: when it is sent, of the same clock.
 * @param shown by word: when it was first shown, s.
 */
export function timed(
  text: string,
  confidence: number | null,
  began: number,
  ended: number,
  now: number,
  shown: readonly number[],
): SaidWord[] {
  const words = text.split(/\s+/).filter(Boolean).slice(0, MOST_WORDS);
  const all = words.reduce((sum, word) => sum + weight(word), 0);
  const letter = Math.min(Math.max(ended - began, 0) / Math.max(all, 1), LETTER_S);
  let at = began;
  const age = (time: number): number => Math.min(Math.max(now - time, 0), OLDEST_S);
  return words.map((word, index) => {
    const start = Math.min(at, shown[index] ?? at);
    const end = Math.min(at + letter * weight(word), shown[index] ?? Infinity);
    at += letter * weight(word);
    return { text: word.slice(0, 64).toLowerCase(), start_s: age(start), end_s: age(end), confidence };
  });
}

const PROBLEMS: Readonly<Record<string, string>> = {
  "not-allowed":
    "The microphone was refused: allow it for this page in the browser's settings, then tap Listen again.",
  "service-not-allowed":
    "This browser may not recognise speech: allow dictation in the device's settings, or use Chrome, then tap Listen again.",
  "audio-capture": "No microphone was found: connect one, then tap Listen again.",
  network:
    "The browser recognises speech by the internet, which it does not reach: connect this device to it, then tap Listen again.",
};
const INSECURE =
  "Browsers give a page the microphone only over https, or on the computer that runs PointIt: open the page there.";

/** A problem of the recogniser with its remedy. */
export function problemOf(error: string, isSecure: boolean): string {
  if (error === "not-allowed" && !isSecure) return INSECURE;
  return PROBLEMS[error] ?? `The browser's recogniser fails (${error}): load the page again, or use Chrome.`;
}

export interface Heard {
  /** What is heard now, as it may still change. */
  hearing(text: string): void;
  said(words: SaidWord[]): void;
  /** It began to listen or stopped, with the reason if that is a problem. */
  turned(isOn: boolean, problem: string): void;
}

/** Listens from one tap to the next. */
export class Voice {
  private readonly make =
    (window as Browser).SpeechRecognition ?? (window as Browser).webkitSpeechRecognition;
  private recognition: Recognition | null = null;
  private problem = "";

  constructor(private readonly heard: Heard) {}

  /** Whether this browser recognises speech. */
  get isThere(): boolean {
    return this.make !== undefined;
  }

  get isOn(): boolean {
    return this.recognition !== null;
  }

  toggle(): void {
    if (this.recognition) this.stop();
    else if (this.make) this.begin(new this.make());
  }

  stop(): void {
    const ended = this.recognition;
    this.recognition = null;
    ended?.abort();
    if (ended) this.heard.turned(false, this.problem);
  }

  private begin(recognition: Recognition): void {
    const seconds = (): number => performance.now() / 1000;
    let began: number | null = null;
    let ended: number | null = null;
    let shown: number[] = [];
    this.recognition = recognition;
    this.problem = "";
    Object.assign(recognition, { continuous: true, interimResults: true, lang: "en-US" });
    recognition.onspeechstart = () => {
      began ??= seconds();
    };
    recognition.onspeechend = () => {
      ended = seconds();
    };
    recognition.onresult = ({ resultIndex, results }) => {
      const now = seconds();
      for (let index = resultIndex; index < results.length; index++) {
        const result = results[index]!;
        const best = result[0]!;
        const text = best.transcript.trim();
        began ??= now - GUESS_S;
        const words = text.split(/\s+/).filter(Boolean).length;
        while (shown.length < words) shown.push(now);
        if (!result.isFinal) {
          this.heard.hearing(text);
          continue;
        }
        const said = timed(text, best.confidence || null, began, ended ?? now, now, shown);
        if (said.length) this.heard.said(said);
        began = ended = null;
        shown = [];
      }
    };
    recognition.onerror = ({ error }) => {
      if (error === "no-speech" || error === "aborted") return; // begins again below
      this.problem = problemOf(error, isSecureContext);
      this.stop();
    };
    recognition.onend = () => {
      // browsers end it after a silence
      began = ended = null; // noise gave no words
      shown = [];
      if (this.recognition === recognition) recognition.start();
    };
    recognition.start();
    this.heard.turned(true, "");
  }
}
