// Where parts of a result are put. A result of another kind, such as an image or the shape of each cluster, is a section
// of `rest`; what is drawn over the mesh is in `stage`.

export interface Places {
  /** What the view, and what lies over it, is in. */
  stage: HTMLElement;
  /** The line under the title. */
  words: HTMLElement;
  inspector: HTMLElement;
  /** What ends the inspector, below the history of energies. */
  rest: HTMLElement;
}
