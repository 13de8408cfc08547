// Where parts of a result are put.

export interface Places {
  /** What the view, and what lies over it, is in. */
  stage: HTMLElement;
  /** The line under the title. */
  words: HTMLElement;
  inspector: HTMLElement;
  /** What ends the inspector, below the history of energies. */
  rest: HTMLElement;
}
