// The session's storage. Where it is off or full, its texts live as long as the page.

/** Names of pictures begin with it. A picture can be made again. */
export const PICTURE = "picture-";

/** Texts that the session does not take. */
const others = new Map<string, string>();

function attempt<T>(work: () => T): T | null {
  try {
    return work();
  } catch {
    return null;
  }
}

const stored = (): string[] => attempt(() => Object.keys(sessionStorage)) ?? [];

export const keys = (): string[] => [...others.keys(), ...stored()];

export const get = (key: string): string | null => others.get(key) ?? attempt(() => sessionStorage.getItem(key));

export function remove(key: string): void {
  others.delete(key);
  attempt(() => sessionStorage.removeItem(key));
}

/** Keeps a text; pictures make room for it. */
export function set(key: string, text: string): void {
  const keep = (): boolean => (sessionStorage.setItem(key, text), true);
  remove(key);
  if (attempt(keep)) return;
  for (const one of stored()) if (one.startsWith(PICTURE)) remove(one);
  if (!attempt(keep)) others.set(key, text);
}
