// Small pictures of the archive's entries: those that are in view, drawn by the server when they are first seen.

import { ask } from "./server.js";
import { el } from "./page.js";

const AT_ONCE = 20;
const keyOf = (row) => JSON.stringify([row.path, row.date, row.rows, row.state, row.error, row.verdict]);

export class Pictures {
  /** `place`: the element that scrolls. */
  constructor(place) {
    this.known = new Map();
    this.waiting = new Map();
    this.watch = new IntersectionObserver((seen) => {
      for (const { target, isIntersecting } of seen) if (isIntersecting) this.waiting.set(target.dataset.of, target);
      this._ask();
    }, { root: place });
  }

  clear() {
    this.watch.disconnect();
    this.waiting.clear();
  }

  /** An element that shows the picture of a row once it is in view. */
  of(row) {
    const key = keyOf(row), image = el("img", { class: "picture", alt: "", hidden: true });
    const place = el("span", { class: "picture", "data-of": row.path }, image);
    place.key = key;
    if (this.known.has(key)) this._show(place, this.known.get(key));
    else this.watch.observe(place);
    return place;
  }

  async _ask() {
    if (this.asking) return;
    this.asking = true;
    try {
      while (this.waiting.size) {
        const some = [...this.waiting].slice(0, AT_ONCE), query = some.map(([path]) => `path=${encodeURIComponent(path)}`).join("&");
        const { pictures, later } = await ask(`/api/archive/pictures?${query}`);
        for (const [path, asked] of some) {
          if (path in pictures) this.known.set(asked.key, pictures[path]);
          // The list may have been made anew meanwhile: with another element for the row, or with another state of it.
          const place = this.waiting.get(path);
          if (place && this.known.has(place.key)) this._show(place, this.known.get(place.key));
          if (later || !place || this.known.has(place.key)) this.waiting.delete(path);
        }
      }
    } catch {
      this.waiting.clear(); // the list itself says what is wrong
    }
    this.asking = false;
  }

  _show(place, svg) {
    this.watch.unobserve(place);
    if (!svg) return;
    const image = place.firstChild;
    image.src = `data:image/svg+xml,${encodeURIComponent(svg)}`;
    image.alt = place.title = new DOMParser().parseFromString(svg, "image/svg+xml").querySelector("title").textContent;
    image.hidden = false;
  }
}
