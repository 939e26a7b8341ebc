/** Health of the site: latency, rates, losses, uncertainty, findings, services. */

import type { Controls } from "../controls";
import {
  bytes,
  byName,
  duration,
  figure,
  milliseconds,
  rendererName,
  sentence as asSentence,
} from "../format";
import type { Health as Account } from "../messages";
import { figureOf, losses, rates } from "../site/figures";
import type { Site } from "../site/site";
import type { LatencyHistory } from "../site/timing";
import { Icon, LinkButton, Section, Tile, Tiles } from "../ui/elements";
import { Seldom, type PanelPart } from "../ui/part";
import type { ViewStats } from "../view";
import type { Status } from "../wire";
import { LatencyGraph } from "./latency_graph";

const RENEW_MS = 1000;
const SEVERITIES = {
  error: { name: "Error", look: "error", icon: "warning" },
  warning: { name: "Warning", look: "warning", icon: "warning" },
  note: { name: "Note", look: "info", icon: "info" },
} as const;

export function healthPart(controls: Controls, stats: () => ViewStats | null): PanelPart {
  return {
    isShown: () => true,
    draw: () => (
      <Seldom
        everyMs={RENEW_MS}
        content={(now) => <Health controls={controls} stats={stats()} now={now} />}
      />
    ),
  };
}

interface HealthProps {
  controls: Controls;
  stats: ViewStats | null;
  now: number;
}

export function Health({ controls, stats, now }: HealthProps) {
  const { site, user } = controls;
  return (
    <>
      <Latency history={controls.connection.latency} now={now} />
      <Rates site={site} user={user} />
      <Certainty localizer={site.health.get(`localizer.${user}`)} />
      <Wrist bridge={site.health.get(`imu-bridge.${user}`)} />
      <Findings findings={site.status?.findings ?? []} />
      <Services services={site.status?.services ?? []} />
      <ThisPage site={site} stats={stats} />
    </>
  );
}

function Latency({ history, now }: { history: LatencyHistory; now: number }) {
  const total = history.total(now);
  return (
    <Section title="From wrist to screen">
      <Tiles>
        <Tile name="median">{milliseconds(total.p50)}</Tile>
        <Tile name="95 %">{milliseconds(total.p95)}</Tile>
        <Tile name="99 %">{milliseconds(total.p99)}</Tile>
      </Tiles>
      <LatencyGraph seconds={history.bySecond(now)} />
      <p class="legend muted">
        <i class="whole" />
        median <i class="broken" />
        99 % of each second
      </p>
    </Section>
  );
}

function Rates({ site, user }: { site: Site; user: string }) {
  const found = rates(site.health.values(), user, site.people.size);
  const gone = losses(site.health.values());
  return (
    <Section title="Messages a second">
      <Tiles>
        <Tile name="wrist">{known(found.imu, rounded)}</Tile>
        <Tile name="ray">{known(found.ray, rounded)}</Tile>
        <Tile name="cursor">{known(found.cursor, rounded)}</Tile>
        <Tile name="light">{known(found.frame, rounded)}</Tile>
      </Tiles>
      <p class="muted">
        {`Since the start: ${gone.dropped} outdated, ${gone.lost} lost, ${gone.invalid} invalid; ${gone.errors} errors.`}
      </p>
    </Section>
  );
}

function Certainty({ localizer }: { localizer: Account | undefined }) {
  const place = figureOf(localizer, "position σ");
  const direction = figureOf(localizer, "yaw σ");
  const drift = figureOf(localizer, "yaw drift") ?? figureOf(localizer, "drift");
  const age = figureOf(localizer, "anchor age");
  if ([place, direction, drift, age].every((each) => each === null)) return null;
  return (
    <Section title="How surely they point">
      <Tiles>
        <Tile name="place ±">{known(place, distance)}</Tile>
        <Tile name="direction ±">{known(direction, (degrees) => `${figure(degrees)}°`)}</Tile>
        <Tile name="drift">{known(drift, (rate) => `${figure(rate)}°/min`)}</Tile>
        <Tile name="set right">{known(age, (seconds) => `${duration(seconds)} ago`)}</Tile>
      </Tiles>
    </Section>
  );
}

function Wrist({ bridge }: { bridge: Account | undefined }) {
  const battery = figureOf(bridge, "battery");
  const rate = figureOf(bridge, "rate");
  const gaps = figureOf(bridge, "gaps");
  const latest = figureOf(bridge, "latest gap");
  const signal = figureOf(bridge, "signal");
  if ([battery, rate, signal].every((each) => each === null)) return null;
  const longest = gaps && latest !== null ? `, ${figure(latest)} ms` : "";
  return (
    <Section title="The device on their wrist">
      <Tiles>
        <Tile name="battery">{known(battery, (percent) => `${figure(percent)} %`)}</Tile>
        <Tile name="readings/s">{known(rate, figure)}</Tile>
        <Tile name="gaps">{known(gaps, (count) => `${figure(count)}/min${longest}`)}</Tile>
        <Tile name="signal">{known(signal, (dbm) => `${figure(dbm)} dBm`)}</Tile>
      </Tiles>
    </Section>
  );
}

type Findings = Status["findings"];

function Findings({ findings }: { findings: Findings }) {
  const causes = findings.filter(({ follows }) => !follows);
  const consequences = findings.filter(({ follows }) => follows);
  return (
    <Section title="Warnings">
      <ul class="findings">
        {causes.map((each) => (
          <FindingLine finding={each} />
        ))}
        {findings.length === 0 && (
          <li data-severity="fine">
            <Icon name="check" />
            <div>Nothing is wrong.</div>
          </li>
        )}
      </ul>
      <details hidden={consequences.length === 0}>
        <summary>What follows from it</summary>
        <ul class="findings">
          {consequences.map((each) => (
            <FindingLine finding={each} />
          ))}
        </ul>
      </details>
    </Section>
  );
}

function FindingLine({ finding }: { finding: Findings[number] }) {
  const { severity, service, sentence, remedy } = finding;
  const { name, look, icon } = SEVERITIES[severity];
  return (
    <li data-severity={look}>
      <Icon name={icon} />
      <div>
        <strong>{service ? `${name}: ${service}` : name}</strong>
        <p>
          <Sentence text={sentence} />
        </p>
        {remedy && (
          <p class="muted">
            <Sentence text={remedy} />
          </p>
        )}
      </div>
    </li>
  );
}

/** A sentence of a service, whose words of a program are between backticks. */
export function Sentence({ text }: { text: string }) {
  const parts = asSentence(text).split("`");
  return <>{parts.map((part, index) => (index % 2 === 1 ? <code key={index}>{part}</code> : part))}</>;
}

type Service = Status["services"][number];

/** Services of the site, and those of each person together, folded while all of them are up. */
function Services({ services }: { services: readonly Service[] }) {
  const sorted = [...services].sort(
    (a, b) => Number(a.present) - Number(b.present) || byName(a.instance, b.instance),
  );
  const users = [...new Set(services.map(userOf).filter(Boolean))].sort(byName);
  return (
    <Section title="Services">
      <ul class="services">
        {sorted
          .filter((service) => !userOf(service))
          .map((service) => (
            <ServiceLine key={service.instance} service={service} name={service.instance} />
          ))}
      </ul>
      {users.map((user) => (
        <ServicesOfPerson
          key={user}
          user={user}
          services={sorted.filter((service) => userOf(service) === user)}
        />
      ))}
    </Section>
  );
}

function ServicesOfPerson({ user, services }: { user: string; services: readonly Service[] }) {
  const up = services.filter(({ present }) => present).length;
  const isWhole = up === services.length;
  return (
    <details class="services" key={String(isWhole)} open={!isWhole}>
      <summary>
        <Icon name={isWhole ? "check" : "close"} />
        <span>{user}</span>
        <span class="muted">{isWhole ? `${up} up` : `${up} of ${services.length} up`}</span>
        <Icon name="chevron" />
      </summary>
      <ul class="services">
        {services.map((service) => (
          <ServiceLine
            key={service.instance}
            service={service}
            name={service.instance.slice(0, -user.length - 1)}
          />
        ))}
      </ul>
    </details>
  );
}

function ServiceLine({ service, name }: { service: Service; name: string }) {
  const { present, since_s: since } = service;
  return (
    <li data-up={String(present)}>
      <Icon name={present ? "check" : "close"} />
      <span>{name}</span>
      <span class="muted">{`${present ? "up" : "down"} ${duration(since)}`}</span>
    </li>
  );
}

/** User of an instance such as `localizer.anna`, or "" for a service that all share. */
function userOf({ instance }: Service): string {
  return instance.split(".")[1] ?? "";
}

function ThisPage({ site, stats }: { site: Site; stats: ViewStats | null }) {
  const { faults, traffic } = site;
  const viewers = site.status?.viewers ?? 1;
  const facts = [
    stats ? viewText(stats) : "no view",
    `${traffic.batches} updates/s, ${bytes(traffic.bytes)}/s`,
    traffic.dropped ? `${traffic.dropped} events missed` : "",
    viewers === 1 ? "1 page looks on" : `${viewers} pages look on`,
    `PointIt ${site.hello?.version ?? ""}`,
  ];
  return (
    <Section title="This page">
      <p class="muted">{facts.filter(Boolean).join(" · ")}</p>
      {faults.count > 0 && (
        <p class="fault">
          {`${faults.count === 1 ? "1 fault" : `${faults.count} faults`} of this page; the last: ${faults.last}`}
        </p>
      )}
      {site.connected && site.hello?.role === "operator" && (
        <LinkButton
          name="Download the last minute"
          icon="download"
          href="/recording.mcap"
          download="pointit.mcap"
        />
      )}
    </Section>
  );
}

/** The text of a figure, or null for one that is not known. */
function known(value: number | null, text: (value: number) => string): string | null {
  return value === null ? null : text(value);
}

function rounded(hertz: number): string {
  return String(Math.round(hertz));
}

function distance(metres: number): string {
  return metres < 1 ? `${figure(metres * 100)} cm` : `${figure(metres)} m`;
}

function viewText({ fps, renderer, software }: ViewStats): string {
  const simply = software ? " (drawn simply: no graphics processor)" : "";
  return `${Math.round(fps)} frames/s with ${rendererName(renderer)}${simply}`;
}
