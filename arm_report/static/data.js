// Numbers, words and colours of the page.

const DATA = JSON.parse(document.getElementById("data").textContent);

function bytes(text) {
  const raw = atob(text), made = new Uint8Array(raw.length);
  for (let k = 0; k < raw.length; k++) made[k] = raw.charCodeAt(k);
  return made.buffer;
}

const decoded = new Map();

/** An array by its number; null for what does not exist. */
function array(number) {
  if (number === null) return null;
  if (!decoded.has(number)) {
    const { low, step, u16, first, f32 } = DATA.arrays[number];
    const values = u16 !== undefined
      ? Array.from(new Uint16Array(bytes(u16)), (k) => (k === 65535 ? null : low + step * k))
      : Array.from(new Float32Array(bytes(f32)), (v) => (Number.isNaN(v) ? null : first + v));
    decoded.set(number, values);
  }
  return decoded.get(number);
}

function el(tag, attributes = {}, ...inside) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) if (value !== null) made.setAttribute(name, value);
  made.append(...inside);
  return made;
}

const DARKNESS = matchMedia("(prefers-color-scheme: dark)");
/** The colour of a theme for one of the palette. */
const shade = (hex) => (DARKNESS.matches && DATA.dark[hex]) || hex;
const styleOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** "time, s" -> ["time", "s"] */
function named(label) {
  const comma = label.lastIndexOf(", ");
  return comma < 0 ? [label, ""] : [label.slice(0, comma), label.slice(comma + 2)];
}

function digits(value) {
  if (value === null || value === undefined) return "-";
  return Number(value.toPrecision(4)).toString();
}

/** Ticks of a logarithmic axis: one to nine times every power of ten from low to high, both above zero. */
function decadeTicks(low, high) {
  const ticks = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power++) {
    for (let times = 1; times < 10; times++) ticks.push(Number(`${times}e${power}`));
  }
  return ticks.filter((tick) => tick >= low && tick <= high);
}

/** Ticks of an axis that is linear up to `linear` on both sides of zero and logarithmic beyond, where 1, 2 and 5 have room. */
function ticksAboutZero(low, high, linear) {
  const beyond = decadeTicks(linear, Math.max(linear, -low, high)).filter((tick) => [1, 2, 5].includes(Number(tick.toExponential()[0])));
  return [...beyond.map((tick) => -tick).reverse(), 0, ...beyond].filter((tick) => tick >= low && tick <= high);
}

const day = (seconds) => new Date(1000 * seconds).toISOString().slice(0, 10);

/** Seconds since 1970 as date or time of day, UTC, as ISO 8601 writes them, for ticks that are `step` s apart. */
const instant = (seconds, step) => {
  const text = new Date(1000 * seconds).toISOString();
  if (step >= 86400) return text.slice(0, 10);
  return step >= 60 ? text.slice(5, 16).replace("T", " ") : text.slice(11, 19);
};

/** Index of the value nearest to x in ascending values without gaps. */
function nearest(values, x) {
  let low = 0, high = values.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (values[middle] <= x) low = middle;
    else high = middle;
  }
  return x - values[low] > values[high] - x ? high : low;
}
