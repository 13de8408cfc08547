// `tesserae serve` in a process of its own, with a folder that outlasts it.
import { spawn } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { setTimeout as pause } from "node:timers/promises";

const PATIENCE_MS = 300_000;

/** Most time until the service has stopped: running jobs get 10 seconds to finish. */
const STOP_MS = 60_000;

/** What is waited for at the moment. */
export const awaited = new Set();

/** What a promise gives, or an error when it takes longer. */
export async function within(what, patience, promise) {
  const timer = new AbortController();
  awaited.add(what);
  try {
    const found = await Promise.race([promise, pause(patience, timer, { signal: timer.signal })]);
    if (found === timer) throw new Error(`not within ${patience} ms: ${what}`);
    return found;
  } finally {
    awaited.delete(what);
    timer.abort();
  }
}

/** Repeats a check until it gives something true; the page refuses the eval that Playwright's own waiting needs. */
export async function until(what, check, patience = PATIENCE_MS) {
  let isOver = false;
  const repeat = async () => {
    for (;;) {
      const found = await check();
      if (found || isOver) return found;
      await pause(50);
    }
  };
  return await within(what, patience, repeat()).finally(() => (isOver = true));
}

async function freePort() {
  const probe = createServer().listen(0, "127.0.0.1");
  await new Promise((resolve) => probe.once("listening", resolve));
  const { port } = probe.address();
  await new Promise((resolve) => probe.close(resolve));
  return port;
}

export class Service {
  constructor(binary) {
    this.binary = binary;
    this.folder = mkdtempSync(join(tmpdir(), "tesserae-page-"));
    this.log = "";
  }

  async start(...options) {
    this.options = options;
    this.port ??= await freePort();
    this.url = `http://127.0.0.1:${this.port}`;
    const command = [
      "serve",
      "--device",
      "cpu",
      "--listen",
      `127.0.0.1:${this.port}`,
      "--data-dir",
      join(this.folder, "data"),
    ];
    this.process = spawn(this.binary, [...command, ...options], { stdio: ["ignore", "pipe", "pipe"] });
    for (const stream of [this.process.stdout, this.process.stderr]) stream.on("data", (text) => (this.log += text));
    this.ended = new Promise((resolve) => this.process.once("exit", resolve));
    await until("the service answers", () =>
      fetch(`${this.url}/healthz`).then(
        (answer) => answer.ok,
        () => false,
      ),
    );
    return this;
  }

  /** Deletes all jobs: of each, every page that is opened later would make a small picture. */
  async empty() {
    const { jobs } = await (await fetch(`${this.url}/v1/jobs?limit=1000`)).json();
    for (const { id } of jobs) await fetch(`${this.url}/v1/jobs/${id}`, { method: "DELETE" });
  }

  async again() {
    return await this.start(...this.options);
  }

  async kill() {
    this.process.kill("SIGKILL");
    await this.ended;
  }

  async stop() {
    this.process.kill("SIGTERM");
    try {
      await within("the service stops, which is killed now", STOP_MS, this.ended);
    } finally {
      await this.kill();
      rmSync(this.folder, { recursive: true, force: true });
    }
  }
}
