// States have addresses: `#/jobs/ID?clusters=K&cluster=C&with=OTHER&beside=1`.

export interface Address {
  job: string | null;
  clusters: number | null;
  cluster: number | null;
  with: string | null;
  /** Whether the compared job is shown beside this one; not in its place. */
  beside: boolean;
}

export function read(): Address {
  const [path = "", query = ""] = location.hash.slice(1).split("?");
  const job = /^\/jobs\/([0-9a-f-]+)$/.exec(path)?.[1] ?? null;
  const search = new URLSearchParams(query);
  const number = (name: string): number | null =>
    /^\d{1,10}$/.test(search.get(name) ?? "") ? Number(search.get(name)) : null;
  const other = search.get("with");
  return {
    job,
    clusters: number("clusters"),
    cluster: number("cluster"),
    with: /^[0-9a-f-]+$/.test(other ?? "") ? other : null,
    beside: number("beside") === 1,
  };
}

export const ofJob = (id: string): string => `#/jobs/${id}`;

/** Changes parts of the address without a step back in the history. */
export function amend(change: Partial<Address>): void {
  const { job, beside, ...others } = { ...read(), ...change };
  const rest = { ...others, beside: beside ? 1 : null };
  if (job === null) return;
  const given = Object.entries(rest).filter(([, value]) => value !== null);
  const search = new URLSearchParams(given.map(([key, value]) => [key, String(value)]));
  history.replaceState(null, "", `${ofJob(job)}${search.size > 0 ? `?${search}` : ""}`);
}
