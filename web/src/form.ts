// The form for new jobs: files that are dropped or chosen, what to do with them, and how much of them is sent.

import { type Job, isHierarchical, nameOf } from "./api";
import { announce, byId, notice, size } from "./dom";
import { refusalOf } from "./limits";
import { scene } from "./load";
import { type Progress, send } from "./send";

const isMesh = (name: string): boolean => /\.(obj|glb|gltf|ply|stl|off)$/i.test(name);

/** Whether an algorithm has a quality; the others refuse it. */
const hasQuality = (algorithm: string): boolean => ["bb", "pml"].includes(algorithm);

const value = (id: string): string => byId<HTMLInputElement>(id).value;

export class Form {
  private files: File[] = [];
  private sending: AbortController | null = null;
  /** Whether nothing is known against the files. */
  private checked: Promise<boolean> = Promise.resolve(false);

  constructor(
    /** Called with each job, and with what was sent, mesh first. */
    private readonly onSent: (job: Job, files: File[]) => Promise<void>,
    private readonly onFail: (error: unknown) => void,
  ) {
    this.listen();
    this.suit();
  }

  /** Every mesh with what belongs to it: a glTF file with all files that are no mesh. */
  private jobs(): File[][] {
    const others = this.files.filter((file) => !isMesh(file.name));
    const meshes = this.files.filter((file) => isMesh(file.name));
    return meshes.map((mesh) => (/\.gltf$/i.test(mesh.name) ? [mesh, ...others] : [mesh]));
  }

  private choose(chosen: File[]): void {
    if (chosen.length === 0) return;
    this.files = chosen;
    const jobs = this.jobs();
    notice(
      jobs.length > 0 ? "" : `${chosen[0]?.name ?? ""} is no mesh that is known here: OBJ, PLY, STL, GLB, glTF, OFF.`,
    );
    byId("file-name").textContent = chosen.map((file) => `${file.name}, ${size(file.size)}`).join("; ");
    const button = byId<HTMLButtonElement>("submit");
    button.textContent = jobs.length > 1 ? `Cluster ${jobs.length} meshes` : "Cluster";
    button.disabled = jobs.length === 0 || this.sending !== null;
    this.checked = this.check(jobs);
  }

  /** Says why a mesh will be refused, and then sends none. */
  private async check(jobs: File[][]): Promise<boolean> {
    const { files } = this;
    const refusals = (await Promise.all(jobs.map(refusalOf))).filter((words) => words !== "");
    if (refusals.length === 0 || this.files !== files) return refusals.length === 0;
    notice(refusals.join(" "));
    byId<HTMLButtonElement>("submit").disabled = true;
    return false;
  }

  private async start(): Promise<void> {
    if (!(await this.checked) || this.sending) return;
    const button = byId<HTMLButtonElement>("submit");
    const algorithm = value("algorithm");
    const parameters: Record<string, unknown> = { algorithm, keep_mesh: true };
    if (hasQuality(algorithm)) parameters["quality"] = value("quality");
    // a hierarchy is made as a whole, so that the slider has all of it
    if (!isHierarchical(algorithm)) parameters["clusters"] = Number(value("clusters"));
    const jobs = this.jobs();
    button.disabled = true;
    this.sending = new AbortController();
    const { signal } = this.sending;
    byId("sending").hidden = false;
    const gone = (): void => notice("The service does not answer. The mesh is sent again when it is back.");
    try {
      for (const files of jobs) {
        const began = performance.now();
        const tell = (progress: Progress): void => tellSent(progress, (performance.now() - began) / 1000);
        tell({ sent: 0, total: files.reduce((sum, file) => sum + file.size, 0) });
        announce("Sending the mesh");
        const job = await send(files, parameters, signal, tell, gone);
        notice("");
        announce(`${nameOf(job)} is accepted`);
        await this.onSent(job, files);
      }
    } catch (error) {
      if (signal.aborted) announce("The mesh is not sent");
      else this.onFail(error);
    } finally {
      this.sending = null;
      byId("sending").hidden = true;
      button.disabled = this.jobs().length === 0;
    }
  }

  /** Shows the fields that the algorithm has. */
  private suit(): void {
    const algorithm = value("algorithm");
    byId<HTMLSelectElement>("quality").disabled = !hasQuality(algorithm);
    byId<HTMLInputElement>("clusters").disabled = isHierarchical(algorithm);
    for (const element of document.querySelectorAll<HTMLElement>(".of-number"))
      element.hidden = isHierarchical(algorithm);
  }

  private listen(): void {
    const drop = byId("drop");
    const input = byId<HTMLInputElement>("file");
    input.addEventListener("change", () => this.choose([...(input.files ?? [])]));
    for (const name of ["dragover", "drop"]) document.addEventListener(name, (event) => event.preventDefault());
    document.addEventListener("dragover", () => drop.classList.add("over"));
    document.addEventListener("dragleave", () => drop.classList.remove("over"));
    document.addEventListener("drop", (event) => {
      drop.classList.remove("over");
      this.choose([...(event.dataTransfer?.files ?? [])]);
    });
    for (const button of document.querySelectorAll<HTMLButtonElement>("[data-sample]")) {
      button.addEventListener("click", () => {
        const take = async (): Promise<void> => {
          const { sample } = await scene();
          this.choose([sample(button.dataset["sample"] ?? "")]);
          await this.start();
        };
        take().catch(this.onFail);
      });
    }
    byId("algorithm").addEventListener("change", () => this.suit());
    byId("new-job").addEventListener("submit", (event) => {
      event.preventDefault();
      void this.start();
    });
    byId("stop").addEventListener("click", () => this.sending?.abort());
  }
}

/** Says how much of the mesh is sent, and how long the rest takes at the pace so far. */
function tellSent({ sent, total }: Progress, seconds: number): void {
  const bar = byId<HTMLProgressElement>("sent");
  bar.max = total;
  bar.value = sent;
  const rest = Math.ceil((seconds * (total - sent)) / sent);
  const text = sent < total ? `${size(sent)} of ${size(total)}` : `${size(total)} sent, waiting for the answer`;
  byId("sent-text").textContent = sent > 0 && sent < total ? `${text}, ${rest} s left` : text;
}
