// Numbers of the page: each is read from the summary and marked with its key.

const read = (id) => JSON.parse(document.getElementById(id).textContent);

export const summary = read('dimple-summary');
export const data = read('dimple-data');
const words = read('dimple-words'); // numbers of the summary as the program writes them: number, unit, factor from the summary's unit

/** Value of a key such as "counts.circle_centre_mm.0"; undefined if there is none. */
export function at(key) {
  return key.split('.').reduce((value, part) => (value === undefined || value === null ? undefined : value[part]), summary);
}

export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children.filter((child) => child !== undefined && child !== null));
  return made;
}

export const section = (id) => document.getElementById(id);
export const there = (key) => at(key) !== undefined && at(key) !== null;
export const baseName = (path) => path.split('/').pop();

/** Table of facts; rows without a value are left out. */
export function facts(rows, css = 'facts') {
  const table = element('table', { class: css });
  for (const [name, ...value] of rows.filter(Boolean)) table.append(element('tr', {}, element('th', { scope: 'row' }, name), element('td', {}, ...value.flat().filter((part) => part !== false))));
  return table;
}

export function place3(key, decimals = 1) {
  return element('span', {}, '(', ...[0, 1, 2].flatMap((k) => [k > 0 ? ', ' : '', number(`${key}.${k}`, { decimals, place: true })]), ')');
}

/** Word of the summary. */
export function word(key) {
  return element('span', { 'data-key': key }, String(at(key)));
}

const marked = (key, scale, text) => element('span', { class: 'number', 'data-key': key, 'data-scale': String(scale) }, text.replace('-', '−'));

/** Number of the summary times `scale`. */
export function number(key, { scale = 1, decimals, digits = 3, place = false } = {}) {
  const value = at(key);
  if (typeof value !== 'number') return element('span', {}, '–');
  const shown = value * scale;
  const places = decimals ?? decimalsFor(shown, digits);
  // A small number is not shown as 0, except in a position.
  const lost = !place && shown !== 0 && Math.abs(shown) < 10 ** -places;
  return marked(key, scale, lost ? `< ${(10 ** -places).toFixed(places)}` : shown.toFixed(places).replace(/^-(0(\.0*)?)$/, '$1'));
}

/** Decimals that give `digits` significant digits; `digits` at most. */
function decimalsFor(value, digits) {
  if (!(Math.abs(value) > 0)) return 0;
  return Math.min(Math.max(digits - 1 - Math.floor(Math.log10(Math.abs(value))), 0), digits);
}

/** Force, volume, length, modulus or fraction with its unit, as the program writes it everywhere. */
export function written(key, withUnit = true) {
  if (!words[key]) return element('span', {}, '–');
  const [text, unit, scale] = words[key];
  return element('span', { class: 'quantity' }, marked(key, scale, text), withUnit ? ` ${unit.replace('3', '³')}` : undefined);
}

export function quantity(key, unit, how) {
  return element('span', { class: 'quantity' }, number(key, how), ` ${unit}`);
}

export function svg(name, attributes = {}, ...children) {
  const made = document.createElementNS('http://www.w3.org/2000/svg', name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/** Integers from base64, little endian. */
export function unpacked(text, Type) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Type(bytes.buffer);
}

/** Colours of overview.png, from pale to dark through yellow, red and purple, also readable in grey. */
export const metal = '#4F9DA6'; // the tool, as in overview.png
export const heat = ['#ECEBE6', '#F9DFA3', '#F9B768', '#EE7F52', '#CB4A5C', '#8C2B6B', '#47175A'];
