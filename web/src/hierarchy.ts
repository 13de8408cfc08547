// The file of a hierarchy (src/hierarchy/stored.rs), and cuts made of it here: the merges and moves of the run done
// again, as far as it takes. Labels are the same as those of the service.

import { type Job, type Labels, output, request } from "./api";
import { FREE } from "./pixels";

/** Bytes of content in a block of the file, and of the checksum after each. */
const [BLOCK, SUM] = [1 << 16, 32];

/** Bytes of the first numbers, of a round, a merge, a move, a label and of what a merge made. */
const [FIXED, ROUND, MERGE, MOVE, LABEL] = [44, 32, 16, 8, 4];

const VERSION = 3;

/** Rounds after which labels are kept, at most: a cut begins at the last of them. */
const KEPT = 16;

/** Where the file is. */
export interface Source {
  /** Bytes from the beginning of the file on; it may end with more. */
  bytes(length: number): Promise<ArrayBuffer>;
}

interface Round {
  clusters: number;
  mergesEnd: number;
  movesEnd: number;
  energy: number;
}

export const ofJob = (job: Job, signal: AbortSignal): Source => ({
  async bytes(length) {
    const headers = { range: `bytes=0-${length - 1}` };
    return await (await request(output(job, "hierarchy", { format: "tsr" }), { signal, headers })).arrayBuffer();
  },
});

/** Length of the file up to some content. */
const framed = (content: number): number => content + Math.ceil(content / BLOCK) * SUM;

export class Hierarchy {
  private readonly rounds: Round[] = [];
  private readonly into: Uint32Array;
  private readonly from: Uint32Array;
  private readonly costs: Float64Array;
  private readonly moved: Uint32Array;
  private readonly to: Uint32Array;
  /** The cluster of each face after some rounds, by their number. */
  private readonly kept = new Map<number, Uint32Array>();
  private readonly parent: Uint32Array;
  private readonly numbers: Uint32Array;

  private constructor(
    content: DataView,
    readonly faces: number,
    /** The items that are faces here, and how many there are with those that a mask leaves out; null without a mask. */
    private readonly members: Uint32Array | null,
    private readonly items: number,
    at: number,
    merges: number,
    rounds: number,
    moves: number,
  ) {
    this.into = new Uint32Array(merges);
    this.from = new Uint32Array(merges);
    this.costs = new Float64Array(merges);
    this.moved = new Uint32Array(moves);
    this.to = new Uint32Array(moves);
    this.parent = new Uint32Array(faces);
    this.numbers = new Uint32Array(faces);
    const checkpoints: boolean[] = [];
    for (let round = 0; round < rounds; round++, at += ROUND) {
      const [clusters, mergesEnd] = [content.getUint32(at, true), content.getUint32(at + 4, true)];
      const movesEnd = Number(content.getBigUint64(at + 8, true));
      this.rounds.push({ clusters, mergesEnd, movesEnd, energy: content.getFloat64(at + 16, true) });
      checkpoints.push(content.getUint32(at + 24, true) === 1);
    }
    let [merge, move] = [0, 0];
    for (const [round, { mergesEnd, movesEnd }] of this.rounds.entries()) {
      for (; merge < mergesEnd; merge++, at += MERGE) {
        this.into[merge] = content.getUint32(at, true);
        this.from[merge] = content.getUint32(at + 4, true);
        this.costs[merge] = content.getFloat64(at + 8, true);
      }
      for (; move < movesEnd; move++, at += MOVE) {
        this.moved[move] = content.getUint32(at, true);
        this.to[move] = content.getUint32(at + 4, true);
      }
      if (checkpoints[round]) at += LABEL * faces;
    }
  }

  /** Reads what cuts need, which is less than half of the file. */
  static async read(source: Source): Promise<Hierarchy> {
    const first = new DataView(await source.bytes(FIXED));
    const number = (at: number): number => first.getUint32(at, true);
    if (number(8) !== VERSION)
      throw new Error(`the file of the hierarchy has a version that is not known: ${number(8)}`);
    const [header, faces, merges, rounds, checkpoints] = [12, 16, 20, 24, 28].map(number) as [
      number,
      number,
      number,
      number,
      number,
    ];
    const moves = Number(first.getBigUint64(32, true));
    const items = number(40);
    const [mask, start] = [FIXED + header, FIXED + header + (items > faces ? Math.ceil(items / 8) : 0)];
    const length = start + rounds * ROUND + merges * MERGE + moves * MOVE + checkpoints * faces * LABEL;
    const file = new Uint8Array(await source.bytes(framed(length)));
    const content = new Uint8Array(length);
    for (let at = 0, from = 0; at < length; at += BLOCK, from += BLOCK + SUM) {
      content.set(file.subarray(from, from + Math.min(BLOCK, length - at)), at);
    }
    const isMember = (item: number): boolean => (((content[mask + (item >> 3)] ?? 0) >> (item & 7)) & 1) === 1;
    const members = items > faces ? new Uint32Array(faces) : null;
    for (let item = 0, member = 0; members && item < items; item++) if (isMember(item)) members[member++] = item;
    return new Hierarchy(new DataView(content.buffer), faces, members, items, start, merges, rounds, moves);
  }

  /** Clusters that are left at the end. */
  get least(): number {
    return this.rounds.at(-1)?.clusters ?? this.faces;
  }

  /** Labels at a number of clusters, numbered by the first face that has them. */
  cut(clusters: number): Labels {
    const { rounds, faces, into, from, moved, to, kept, parent, numbers } = this;
    const after = rounds.findIndex((round) => round.clusters < clusters);
    const end = after < 0 ? rounds.length : after;
    let round = [...kept.keys()].filter((number) => number <= end).reduce((a, b) => Math.max(a, b), 0);
    for (let face = 0; face < faces; face++) parent[face] = face;
    const labels = kept.get(round)?.slice() ?? parent.slice();
    const root = (cluster: number): number => {
      for (let above = parent[cluster] ?? 0; above !== cluster; above = parent[cluster] ?? 0) {
        parent[cluster] = parent[above] ?? 0;
        cluster = above;
      }
      return cluster;
    };
    const before = rounds[round - 1];
    let [merge, move] = [before?.mergesEnd ?? 0, before?.movesEnd ?? 0];
    const step = Math.ceil(rounds.length / KEPT);
    for (; round < end; round++) {
      const { mergesEnd = 0, movesEnd = 0 } = rounds[round] ?? {};
      if (round > 0 && round % step === 0 && !kept.has(round)) {
        for (let face = 0; face < faces; face++) labels[face] = root(labels[face] ?? 0);
        kept.set(round, labels.slice());
      }
      for (; merge < mergesEnd; merge++) parent[from[merge] ?? 0] = into[merge] ?? 0;
      for (; move < movesEnd; move++) labels[moved[move] ?? 0] = to[move] ?? 0;
    }
    let { clusters: left, energy } = rounds[end - 1] ?? { clusters: faces, energy: 0 };
    // the cheapest of the next round, which come first
    for (; left > clusters; left--, merge++) {
      parent[from[merge] ?? 0] = into[merge] ?? 0;
      energy += this.costs[merge] ?? 0;
    }
    numbers.fill(0);
    let seen = 0;
    for (let face = 0; face < faces; face++) {
      const cluster = root(labels[face] ?? 0);
      numbers[cluster] ||= ++seen;
      labels[face] = (numbers[cluster] ?? 0) - 1;
    }
    if (!this.members) return { numbers: labels, energy };
    const all = new Uint32Array(this.items).fill(FREE);
    for (let face = 0; face < faces; face++) all[this.members[face] ?? 0] = labels[face] ?? FREE;
    return { numbers: all, energy };
  }
}
