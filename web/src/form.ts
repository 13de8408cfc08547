// The form for new jobs: meshes and images that are dropped or chosen, what to do with them, how much of them is sent.

import { type Job, isHierarchical, nameOf } from "./api";
import { announce, byId, notice, size } from "./dom";
import { isImage, isMesh } from "./kinds";
import { refusalOf, refusalOfClusters } from "./limits";
import { scene } from "./load";
import { sizeOf, usualNumber } from "./photo";
import { type Progress, send } from "./send";
import { keptOf } from "./take";

/** Whether an algorithm has a quality; the others refuse it. */
const hasQuality = (algorithm: string): boolean => ["bb", "pml"].includes(algorithm);

const value = (id: string): string => byId<HTMLInputElement>(id).value;

export class Form {
  /** The files of the first job, mesh first, until they are sent. */
  chosen: File[] = [];
  private files: File[] = [];
  private sending: AbortController | null = null;
  /** Whether a number of clusters was written by hand. */
  private isWritten = false;
  /** Whether nothing is known against the files. */
  private checked: Promise<boolean> = Promise.resolve(false);

  constructor(
    /** Called with each job, and with what was sent, mesh first. */
    private readonly onSent: (job: Job, files: File[]) => Promise<void>,
    private readonly onFail: (error: unknown) => void,
    /** Called when files are chosen. */
    private readonly onChosen: () => void,
  ) {
    this.listen();
    this.suit();
  }

  /** Every mesh with what belongs to it, a glTF file with all files that are no mesh; without one, every image. */
  private jobs(): File[][] {
    const isGltf = ({ name }: File): boolean => /\.gltf$/i.test(name);
    const others = this.files.filter((file) => !isMesh(file.name));
    const meshes = this.files.filter((file) => isMesh(file.name));
    const images = this.files.some(isGltf) ? [] : others.filter((file) => isImage(file.name));
    return [...meshes.map((mesh) => (isGltf(mesh) ? [mesh, ...others] : [mesh])), ...images.map((image) => [image])];
  }

  /** Whether there are images, and nothing else: they have fields of their own. */
  private get areImages(): boolean {
    const jobs = this.jobs();
    return jobs.length > 0 && jobs.every(([file]) => isImage(file?.name ?? ""));
  }

  /** What the files are. */
  private get noun(): string {
    if (this.areImages) return "images";
    return this.jobs().some(([file]) => isImage(file?.name ?? "")) ? "files" : "meshes";
  }

  private choose(chosen: File[]): void {
    if (chosen.length === 0) return;
    this.files = chosen;
    const jobs = this.jobs();
    this.chosen = jobs[0] ?? [];
    this.onChosen();
    const others = chosen.filter((file) => !jobs.flat().includes(file)).map(({ name }) => name);
    const are = others.length > 1 ? "are no meshes or images that are" : "is no mesh or image that is";
    const kinds = jobs.length > 0 ? "" : ": OBJ, PLY, STL, GLB, glTF, OFF, PNG, JPEG";
    announce(`${chosen.map(({ name }) => name).join(", ")} chosen`);
    notice(others.length > 0 ? `${others.join(", ")} ${are} known here${kinds}.` : "");
    byId("file-name").textContent = chosen.map((file) => `${file.name}, ${size(file.size)}`).join("; ");
    const button = byId<HTMLButtonElement>("submit");
    button.textContent = jobs.length > 1 ? `Cluster ${jobs.length} ${this.noun}` : "Cluster";
    button.hidden = false;
    button.disabled = jobs.length === 0 || this.sending !== null;
    this.checked = this.check(jobs);
    this.suit();
    void this.propose(chosen);
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

  /** Fills in a number of clusters that suits, as long as nothing else was written there. */
  private async propose(chosen: File[]): Promise<void> {
    const clusters = byId<HTMLInputElement>("clusters");
    const number = this.areImages ? await usualOf(chosen[0]) : Number(clusters.defaultValue);
    if (this.files !== chosen || this.isWritten) return;
    clusters.value = String(number);
  }

  /** What is asked of one file. */
  private async parametersOf(file: File | undefined): Promise<Record<string, unknown>> {
    const quality = value("quality");
    const algorithm = value("algorithm");
    if (isImage(file?.name ?? "")) {
      const clusters = this.areImages ? Number(value("clusters")) : await usualOf(file);
      const method = isHierarchical(algorithm) ? { algorithm: "pml", levels: [clusters] } : { clusters };
      return { ...method, compactness: Number(value("compactness")), quality, ...keptOf(method.algorithm ?? "bb") };
    }
    const method = algorithm === "shapes" ? { energy: algorithm } : { algorithm };
    const parameters: Record<string, unknown> = { ...method, keep_mesh: true };
    if (hasQuality(algorithm)) parameters["quality"] = quality;
    // a hierarchy is made as a whole, so that the slider has all of it
    if (!isHierarchical(algorithm)) parameters["clusters"] = Number(value("clusters"));
    return parameters;
  }

  private async start(): Promise<void> {
    if (!(await this.checked)) return;
    const button = byId<HTMLButtonElement>("submit");
    const jobs = this.jobs();
    const refusals = await Promise.all(jobs.map((files) => this.refusalOfNumber(files[0])));
    if (this.sending) return;
    if (refusals.some((words) => words !== "")) return notice(refusals.join(" ").trim());
    const what = this.areImages ? "image" : "mesh";
    button.disabled = true;
    this.sending = new AbortController();
    const { signal } = this.sending;
    byId("sending").hidden = false;
    const gone = (): void => notice(`The service does not answer. The ${what} is sent again when it is back.`);
    try {
      for (const files of jobs) {
        const began = performance.now();
        const tell = (progress: Progress): void => tellSent(progress, (performance.now() - began) / 1000);
        tell({ sent: 0, total: files.reduce((sum, file) => sum + file.size, 0) });
        announce(`Sending the ${what}`);
        const job = await send(files, await this.parametersOf(files[0]), signal, tell, gone);
        notice("");
        announce(`${nameOf(job)} is accepted`);
        this.chosen = [];
        await this.onSent(job, files);
      }
    } catch (error) {
      if (signal.aborted) announce(`The ${what} is not sent`);
      else this.onFail(error);
    } finally {
      this.sending = null;
      byId("sending").hidden = true;
      button.disabled = this.jobs().length === 0;
    }
  }

  /** Why a mesh cannot have as many clusters as are wanted. */
  private async refusalOfNumber(file: File | undefined): Promise<string> {
    const isGiven = !byId<HTMLInputElement>("clusters").disabled;
    return file && isGiven && isMesh(file.name) ? await refusalOfClusters(file, Number(value("clusters"))) : "";
  }

  /** Shows the fields that images, or the algorithm, have. */
  private suit(): void {
    const { areImages } = this;
    const chosen = byId<HTMLSelectElement>("algorithm");
    // images have two of them
    if (areImages && !hasQuality(chosen.value)) chosen.value = isHierarchical(chosen.value) ? "pml" : "bb";
    const algorithm = chosen.value;
    for (const option of chosen.options) option.hidden = option.disabled = areImages && !hasQuality(option.value);
    const isAny = !areImages && isHierarchical(algorithm);
    byId<HTMLSelectElement>("quality").disabled = !hasQuality(algorithm);
    byId<HTMLInputElement>("clusters").disabled = isAny;
    byId<HTMLInputElement>("compactness").disabled = !areImages;
    for (const element of document.querySelectorAll<HTMLElement>(".of-number")) element.hidden = isAny;
    for (const element of document.querySelectorAll<HTMLElement>(".of-image")) element.hidden = !areImages;
    byId("clusters-label").textContent = areImages ? "Superpixels" : "Clusters";
  }

  private listen(): void {
    const mark = (isOver: boolean): void => void document.body.classList.toggle("over", isOver);
    const input = byId<HTMLInputElement>("file");
    input.addEventListener("change", () => this.choose([...(input.files ?? [])]));
    for (const name of ["dragover", "drop"] as const)
      document.addEventListener(name, (event) => {
        // a link or a text that is dragged is no file
        if (!event.dataTransfer?.types.includes("Files")) return;
        event.preventDefault();
        mark(name === "dragover");
        if (name === "drop") this.choose([...event.dataTransfer.files]);
      });
    // also fired between elements, which have each other as the related one
    document.addEventListener("dragleave", ({ relatedTarget }) => relatedTarget === null && mark(false));
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
    byId("clusters").addEventListener("input", () => (this.isWritten = true));
    byId("algorithm").addEventListener("change", () => this.suit());
    byId("new-job").addEventListener("submit", (event) => {
      event.preventDefault();
      void this.start();
    });
    byId("stop").addEventListener("click", () => this.sending?.abort());
  }
}

/** Superpixels of an image where no number is given. */
async function usualOf(file: File | undefined): Promise<number> {
  const size = file && (await sizeOf(file));
  return usualNumber(size ?? { width: 500, height: 500 });
}

/** Says how much of a file is sent, and how long the rest takes at the pace so far. */
function tellSent({ sent, total }: Progress, seconds: number): void {
  const bar = byId<HTMLProgressElement>("sent");
  bar.max = total;
  bar.value = sent;
  const rest = Math.ceil((seconds * (total - sent)) / sent);
  const text = sent < total ? `${size(sent)} of ${size(total)}` : `${size(total)} sent, waiting for the answer`;
  byId("sent-text").textContent = sent > 0 && sent < total ? `${text}, ${rest} s left` : text;
}
