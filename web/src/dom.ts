// Elements of the document. Text goes in as text nodes only, so no name or message is ever read as HTML.

type Child = Node | string;
type Attributes = Record<string, string | boolean | ((event: Event) => void)>;

/** Makes an element: attributes, handlers (`onclick`), children. */
export function make<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (typeof value === "boolean") element.toggleAttribute(name, value);
    else element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** The element with this id, which `index.html` has. */
export function byId<T extends HTMLElement>(id: string): T {
  const element = document.getElementById(id);
  if (!element) throw new Error(`no element has the id ${id}`);
  return element as T;
}

/** Says something to readers of screens. */
export function announce(text: string): void {
  byId("live").textContent = text;
}

/** Shows what is wrong, or nothing. */
export function notice(text: string): void {
  const element = byId("notice");
  if (element.textContent !== text) element.textContent = text;
  element.hidden = text === "";
}

/** Shows what an error says. */
export const report = (error: unknown): void => notice(error instanceof Error ? error.message : String(error));

/** Calls at Escape that closed no menu. */
export const onEscape = (work: () => void, signal: AbortSignal): void =>
  document.addEventListener("keydown", (event) => event.key === "Escape" && !event.defaultPrevented && work(), {
    signal,
  });

export function count(number: number): string {
  return number.toLocaleString("en");
}

/** A number with four digits at most; as a product with a power of ten where it would be long otherwise. */
export function digits(number: number, most = 4): string {
  const [short, size] = [Number(number.toPrecision(most)), Math.abs(number)];
  return size !== 0 && (size < 1e-3 || size >= 1e7) ? short.toExponential() : String(short);
}

export function size(bytes: number): string {
  if (bytes < 1000) return `${bytes} B`;
  if (bytes < 1e6) return `${(bytes / 1e3).toPrecision(3)} kB`;
  return `${(bytes / 1e6).toPrecision(3)} MB`;
}

export const option = (value: string, text: string): HTMLOptionElement => make("option", { value }, text);

export function swatch(colour: string): HTMLElement {
  const element = make("span", { class: "swatch" });
  element.style.background = colour;
  return element;
}

/** A duration in seconds, or in milliseconds below a tenth. */
export const duration = (ms: number): string => (ms < 100 ? `${digits(ms, 2)} ms` : `${digits(ms / 1000, 2)} s`);

/** Hands a file over. */
export function save(blob: Blob, name: string): void {
  const url = URL.createObjectURL(blob);
  make("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}
