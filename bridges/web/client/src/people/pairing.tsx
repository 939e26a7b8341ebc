/** The dialog that makes a phone a person's wrist, or lets it map the room: QR code, steps, fingerprint. */

import { useLayoutEffect, useRef } from "preact/hooks";
import type { Controls } from "../controls";
import { capital } from "../format";
import type { Reply } from "../site/asks";
import { Dialog, placeDialog } from "../ui/dialog";
import { Button, Icon } from "../ui/elements";

/** State of a pairing whose code no phone has used yet, as the server has it. */
const WAITING = "waiting for the phone";
const ASK_TIMEOUT_MS = 15_000;

/** A code for a phone, and what is compared with it. */
interface Offer {
  readonly svg: string;
  readonly url: string;
  readonly fingerprint: string;
}

/** A pairing: what was asked for, the code that is offered, and what the phone does with it. */
export class Pairing {
  isOpen = false;
  user = "";
  offer: Offer | null = null;
  /** The page is being opened to the local network. */
  isOpening = false;
  /** The page cannot be reached by a phone yet. */
  isClosed = false;
  /** What is waited for, in a sentence, or "". */
  status = "";
  private hadPhone = false;
  private isAsking = false;
  private readonly draw = placeDialog(() => <PairingDialog pairing={this} />);

  /** @param deed `pair` for a wrist, `map_room` for a camera that maps the room. */
  constructor(
    readonly controls: Controls,
    private readonly deed: "pair" | "map_room",
  ) {}

  get isWrist(): boolean {
    return this.deed === "pair";
  }

  get title(): string {
    if (!this.isWrist) return "Map this room with a phone";
    const isOneOfMany = this.controls.site.people.size > 1;
    return isOneOfMany ? `Point as ${this.user} with your phone` : "Point with your phone";
  }

  open(): void {
    const { controls } = this;
    this.isOpen = true;
    this.user = controls.user;
    this.hadPhone = ![undefined, "", WAITING].includes(controls.person?.line?.phone);
    this.offer = null;
    this.isClosed = !controls.site.status?.lan_url;
    this.status = this.isClosed && !controls.mayDo("open_lan") ? "Start PointIt with --lan to allow it." : "";
    this.draw();
    if (!this.isClosed) void this.pair();
  }

  /** Follow the site: another page may open it to the network, and the phone comes. */
  update(): void {
    if (!this.isOpen) return;
    const { site, toasts } = this.controls;
    if (this.isClosed && !this.isOpening && site.status?.lan_url) void this.pair();
    const line = this.offer && this.isWrist ? site.people.get(this.user)?.line : null;
    if (!line?.phone) return;
    if (line.moved_by !== "phone") return this.tell(`${capital(line.phone)}.`);
    // The phone is in use: its code stays valid
    this.offer = null;
    this.close();
    toasts.show("done", `The phone points as ${this.user} now.`);
  }

  close(): void {
    if (!this.isOpen) return;
    this.isOpen = false;
    this.draw();
    void this.forget();
  }

  async openLan(): Promise<void> {
    this.isOpening = true;
    this.draw();
    const reply = await this.controls.ask({ deed: "open_lan" }, ASK_TIMEOUT_MS);
    this.isOpening = false;
    this.draw();
    if (reply) await this.pair();
  }

  private async pair(): Promise<void> {
    if (this.isAsking) return;
    this.isAsking = true;
    this.isClosed = false;
    this.tell("One moment …");
    const name = this.isWrist ? this.user : "";
    const reply = await this.controls.ask({ deed: this.deed, name }, ASK_TIMEOUT_MS);
    this.isAsking = false;
    this.offer = reply && offerOf(reply);
    this.tell("");
    if (!reply) this.close();
  }

  /** Withdraw the code that no phone has used: it is not to be seen again. A phone that was paired before stays known. */
  private async forget(): Promise<void> {
    const { controls, deed, user } = this;
    const isUnused = controls.site.people.get(user)?.line?.phone === WAITING;
    const wasOffered = this.offer !== null;
    this.offer = null;
    if (this.isWrist && wasOffered && isUnused && !this.hadPhone)
      await controls.ask({ deed, name: user, query: { off: true } });
    controls.changed();
  }

  private tell(status: string): void {
    this.status = status;
    this.draw();
  }
}

function offerOf(reply: Reply): Offer {
  return {
    svg: String(reply["qr_svg"] ?? ""),
    url: String(reply["url"] ?? ""),
    fingerprint: String(reply["fingerprint"] ?? ""),
  };
}

/** Groups of a certificate's fingerprint, as phones show them. */
export function fingerprintLines(fingerprint: string): string {
  const hex = fingerprint.replaceAll(/[^0-9a-f]/gi, "").toUpperCase();
  return (hex.match(/.{2}/g) ?? []).join(" ");
}

function PairingDialog({ pairing }: { pairing: Pairing }) {
  const { isClosed, isOpen, isWrist, offer, status, title } = pairing;
  return (
    <Dialog title={title} isOpen={isOpen} onClose={() => pairing.close()}>
      {isClosed && <Closed pairing={pairing} />}
      <p role="status">{status}</p>
      {offer && <OfferView offer={offer} isWrist={isWrist} />}
    </Dialog>
  );
}

function Closed({ pairing }: { pairing: Pairing }) {
  return (
    <div>
      <p>
        A phone reaches this page over the local network, encrypted. So far, the page is open to this computer
        only.
      </p>
      {pairing.controls.mayDo("open_lan") && (
        <Button
          name="Open to the local network"
          icon="wifi"
          kind="primary"
          autofocus
          isOff={pairing.isOpening}
          onClick={() => void pairing.openLan()}
        />
      )}
    </div>
  );
}

function OfferView({ offer, isWrist }: { offer: Offer; isWrist: boolean }) {
  return (
    <div class="offer">
      <Code svg={offer.svg} />
      <ol>
        <li>Join the same Wi-Fi with your phone and scan the code.</li>
        <li>
          The phone warns once that it does not know this page: go on. To be sure, compare the fingerprint.
        </li>
        <li>
          {isWrist
            ? "Allow the motion sensors, hold the phone like a remote control, and point."
            : "Allow the camera, and follow the phone's page from view to view."}
        </li>
      </ol>
      <details>
        <summary>
          Address and fingerprint
          <Icon name="chevron" />
        </summary>
        <p>
          <a href={offer.url} target="_blank" rel="noreferrer">
            {offer.url.replace(/[?#].*/, " …")}
          </a>
        </p>
        <p>
          <code>{fingerprintLines(offer.fingerprint)}</code>
        </p>
      </details>
    </div>
  );
}

/** The QR code, which the server draws. */
function Code({ svg }: { svg: string }) {
  const place = useRef<HTMLDivElement>(null);
  useLayoutEffect(() => {
    const code = drawing(svg);
    place.current!.replaceChildren(...(code ? [code] : []));
  }, [svg]);
  return <div class="qr" role="img" aria-label="QR code that opens the phone's page" ref={place} />;
}

/** The drawing in `markup`, or null if it is none; scripts in it would not run. */
function drawing(markup: string): Element | null {
  const root = new DOMParser().parseFromString(markup, "image/svg+xml").documentElement;
  if (root.localName !== "svg") return null;
  const width = root.getAttribute("width") ?? "";
  const height = root.getAttribute("height") ?? "";
  if (width && height && !root.hasAttribute("viewBox"))
    root.setAttribute("viewBox", `0 0 ${parseFloat(width)} ${parseFloat(height)}`);
  root.removeAttribute("width");
  root.removeAttribute("height");
  return root;
}
