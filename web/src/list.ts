// The list of jobs: a picture, the name, what was made of it, and when.

import * as address from "./address";
import { type Job, isHierarchical, isLive, json, nameOf } from "./api";
import { byId, count, make } from "./dom";
import { WORDS, kindOf } from "./kinds";
import { makeThumbnails, thumbnail } from "./thumbnails";
import { isDeleted } from "./trash";
import { describe } from "./words";

const ago = (time: string): string => {
  const seconds = (Date.now() - Date.parse(time)) / 1000;
  if (seconds < 60) return "now";
  if (seconds < 3600) return `${Math.floor(seconds / 60)} min ago`;
  if (seconds < 86_400) return `${Math.floor(seconds / 3600)} h ago`;
  return new Date(time).toLocaleDateString();
};

function summary(job: Job): string {
  // the numbers of a running job are beside its picture
  if (isLive(job)) return describe(job).replace(/(:| ·).*/, "");
  if (job.state !== "succeeded") return job.state;
  const { algorithm } = job.parameters;
  return isHierarchical(algorithm)
    ? "any number"
    : `${count(job.result?.clusters ?? 0)} ${WORDS[kindOf(job)].clusters}`;
}

/** Writes the list, where it changed; gives the jobs that the service names, the newest ones. */
export async function list(): Promise<Job[]> {
  const { jobs: all } = await json<{ jobs: Job[] }>("/v1/jobs?limit=50");
  const jobs = all.filter((job) => !isDeleted(job.id));
  const box = byId("jobs");
  const shown = jobs.map((job) => [job.id, summary(job), ago(job.created_at), thumbnail(job.id)?.length]);
  const text = JSON.stringify([shown, location.hash]);
  if (box.dataset["shown"] !== text) write(box, jobs);
  box.dataset["shown"] = text;
  const isInSight = (item?: Element): boolean => (item?.getBoundingClientRect().top ?? Infinity) < innerHeight;
  makeThumbnails(jobs.filter((_, i) => isInSight(box.children[i])));
  return all;
}

function write(box: HTMLElement, jobs: Job[]): void {
  const current = address.read().job;
  const focused = document.activeElement?.getAttribute("href");
  box.replaceChildren(
    ...jobs.map((job) => {
      const picture = thumbnail(job.id);
      const image = picture ? make("img", { src: picture, alt: "" }) : make("span", { class: "no-picture" });
      const told = `${summary(job)} · ${ago(job.created_at)}`;
      const text = make("span", { class: "text" }, make("strong", {}, nameOf(job)), make("small", {}, told));
      const link = make("a", { href: address.ofJob(job.id) }, image, text);
      link.dataset["state"] = job.state;
      if (job.id === current) link.setAttribute("aria-current", "page");
      return make("li", {}, link);
    }),
  );
  if (jobs.length === 0) box.append(make("li", { class: "none" }, "Your jobs appear here."));
  const link = [...box.querySelectorAll("a")].find((a) => a.getAttribute("href") === focused);
  if (focused?.startsWith("#/jobs/")) link?.focus({ preventScroll: true });
}
