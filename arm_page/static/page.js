// Elements and numbers.

/** An element with properties and children; `on...` are handlers, `class` and `data-...` attributes. */
export function el(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("on")) element[name] = value;
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export const $ = (id) => document.getElementById(id);

/** A number for reading: so many decimals, '–' for none; `times` scales it. */
export const number = (value, digits = 3, times = 1) =>
  value === null || value === undefined || !Number.isFinite(value) ? "–" : (value * times).toFixed(digits).replace(/^-(?=[0.]*$)/, "").replace("-", "−");

export const count = (value) => (value === null || value === undefined ? "–" : value.toLocaleString("en").replaceAll(",", " "));

export function seconds(value) {
  if (value === null || value === undefined) return "–";
  if (value < 100) return `${value.toFixed(1)} s`;
  const minutes = Math.floor(value / 60);
  return minutes < 100 ? `${minutes} min ${Math.round(value % 60)} s` : `${(value / 3600).toFixed(1)} h`;
}

export const bytes = (value) => (value < 1e6 ? `${(value / 1e3).toFixed(0)} kB` : `${(value / 1e6).toFixed(1)} MB`);

export const words = (text) => text.replaceAll("_", " ");

/** Value of a CSS variable of the theme in use. */
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

export const JOINT_COLOURS = ["#3b82c4", "#d9772b", "#2f9e6b", "#b05fc0", "#c2504d", "#8a8d2f", "#4aa5b5", "#8d6e55"];
export const jointColour = (index) => JOINT_COLOURS[index % JOINT_COLOURS.length];

let onTheme = [];
export const whenThemeChanges = (call) => onTheme.push(call);

/** Dark or light: as the system has it, until somebody chooses. */
export function setTheme(chosen) {
  const dark = chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  if (chosen) localStorage.setItem("armscope.theme", chosen);
  onTheme.forEach((call) => call());
}
