// Loads the script that draws. One that could not be loaded is loaded again at the next use, under another address,
// because browsers may remember the failure of an address.

export type Scene = typeof import("./scene");

let loading: Promise<Scene> | null = null;
let failures = 0;

export function scene(): Promise<Scene> {
  const other = `./scene.js?${failures}`;
  loading ??= (failures === 0 ? import("./scene.js") : (import(other) as Promise<Scene>)).catch((error: unknown) => {
    loading = null;
    failures += 1;
    throw error;
  });
  return loading;
}
