/** The side panel: control, set-up and health, as tabs. It is one tree of components, drawn anew by `update`. */

import { render } from "preact";
import type { Controls } from "../controls";
import { Icon } from "../ui/elements";
import { Seldom, type PanelPart } from "../ui/part";

export interface Tab {
  name: string;
  icon: string;
  parts: readonly PanelPart[];
  /** A number at the tab's name, and what it counts, such as `warnings`; 0: none. */
  badge?(): { count: number; meaning: string };
}

/** Tabs in the order in which they stand. */
export const CONTROL = 0;
export const SET_UP = 1;
export const HEALTH = 2;

export class Panel {
  private current = CONTROL;
  /** On a narrow page: only the tabs are seen. */
  private isLow = false;

  /** Fill `host` with tabs. */
  constructor(
    private readonly host: HTMLElement,
    private readonly controls: Controls,
    private readonly tabs: readonly Tab[],
  ) {}

  update(): void {
    for (const { parts } of this.tabs) for (const part of parts) part.follow?.();
    if (!this.isOffered(this.current)) this.current = CONTROL;
    this.host.classList.toggle("low", this.isLow);
    render(this.view(), this.host);
  }

  /** Open a tab at once: what is in it can have the focus then. */
  open(index: number): void {
    this.current = index;
    this.isLow = false;
    this.update();
    this.controls.changed();
  }

  /** Open the next tab that has something to show, or the one before. */
  turn(by: 1 | -1 = 1): void {
    const { length } = this.tabs;
    let next = this.current;
    do next = (next + by + length) % length;
    while (!this.isOffered(next) && next !== this.current);
    this.open(next);
  }

  private isOffered(index: number): boolean {
    return this.tabs[index]!.parts.some((part) => part.isShown());
  }

  private toggleLow(): void {
    this.isLow = !this.isLow;
    this.update();
  }

  private travel(event: KeyboardEvent): void {
    if (event.key !== "ArrowLeft" && event.key !== "ArrowRight") return;
    event.preventDefault();
    event.stopPropagation();
    this.turn(event.key === "ArrowRight" ? 1 : -1);
    document.getElementById(tabId(this.current))?.focus();
  }

  private view() {
    return (
      <>
        <button
          type="button"
          class="handle"
          aria-expanded={!this.isLow}
          aria-label="Controls"
          onClick={() => this.toggleLow()}
        />
        <div role="tablist" aria-label="Panel" class="tabs">
          {this.tabs.map((tab, index) => (
            <TabHead
              key={tab.name}
              tab={tab}
              index={index}
              isOpen={index === this.current}
              isOffered={this.isOffered(index)}
              open={() => this.open(index)}
              travel={(event) => this.travel(event)}
            />
          ))}
        </div>
        {this.tabs.map(({ name, parts }, index) => (
          <div
            key={name}
            role="tabpanel"
            id={pageId(index)}
            aria-labelledby={tabId(index)}
            class="page"
            tabindex={0}
            hidden={index !== this.current}
          >
            <Seldom isSeen={index === this.current} content={() => parts.map((part) => part.draw())} />
          </div>
        ))}
      </>
    );
  }
}

interface TabHeadProps {
  tab: Tab;
  index: number;
  isOpen: boolean;
  isOffered: boolean;
  open(): void;
  travel(event: KeyboardEvent): void;
}

function TabHead({ tab, index, isOpen, isOffered, open, travel }: TabHeadProps) {
  const { count, meaning } = tab.badge?.() ?? { count: 0, meaning: "" };
  return (
    <button
      type="button"
      role="tab"
      id={tabId(index)}
      aria-controls={pageId(index)}
      aria-selected={isOpen}
      tabindex={isOpen ? 0 : -1}
      hidden={!isOffered}
      onClick={open}
      onKeyDown={travel}
    >
      <Icon name={tab.icon} />
      <span>{tab.name}</span>
      {count > 0 && (
        <span class="count" role="img" aria-label={`${count} ${meaning}`}>
          {count}
        </span>
      )}
    </button>
  );
}

function tabId(index: number): string {
  return `tab-${index}`;
}

function pageId(index: number): string {
  return `page-${index}`;
}
