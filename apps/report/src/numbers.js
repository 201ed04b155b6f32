// Numbers of the page: each is read from the summary, and says from where.

const read = (id) => JSON.parse(document.getElementById(id).textContent);

export const summary = read('dimple-summary');
export const data = read('dimple-data');

/** What stands at "counts.circle_centre_mm.0"; undefined: nothing does. */
export function at(key) {
  return key.split('.').reduce((value, part) => (value === undefined || value === null ? undefined : value[part]), summary);
}

export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children.filter((child) => child !== undefined && child !== null));
  return made;
}

/** A word of the summary. */
export function word(key) {
  return element('span', { 'data-key': key }, String(at(key)));
}

/** A number of the summary times `scale`; one that is smaller than `least`, but is not nothing, is only said to be so. */
export function number(key, { scale = 1, decimals, digits = 3, plain = false, least = 0 } = {}) {
  const value = at(key);
  if (typeof value !== 'number') return element('span', {}, '–');
  const shown = value * scale;
  const places = decimals ?? decimalsFor(shown, digits);
  // Nothing small is shown as nothing, unless it is an error or a place.
  const lost = !plain && shown !== 0 && Math.abs(shown) < 0.5 * 10 ** -places;
  const text = shown !== 0 && Math.abs(shown) < least ? `< ${least}` : lost ? shown.toExponential(1) : shown.toFixed(places).replace(/^-(0(\.0*)?)$/, '$1');
  return element('span', { class: 'number', 'data-key': key, 'data-scale': String(scale) }, text.replace('-', '−'));
}

/** Digits after the point that leave so many figures, three at most. */
export function decimalsFor(value, digits = 3) {
  if (!(Math.abs(value) > 0)) return 0;
  return Math.min(Math.max(digits - 1 - Math.floor(Math.log10(Math.abs(value))), 0), digits);
}

/** As the program writes forces of that size: N with four decimals from 0.01 N on, else mN or uN. */
export function forceUnit(newtons) {
  const size = Math.abs(newtons);
  if (size >= 0.01 || size < 1e-7 || !Number.isFinite(size)) return { unit: 'N', scale: 1, decimals: size >= 0.01 || size === 0 ? 4 : undefined };
  return size >= 1e-4 ? { unit: 'mN', scale: 1e3, decimals: decimalsFor(1e3 * size) } : { unit: 'uN', scale: 1e6, decimals: decimalsFor(1e6 * size) };
}

/** A force with its unit, written like one of the size of `like`. */
export function force(key, like = at(key), withUnit = true) {
  const { unit, ...how } = forceUnit(like);
  const made = element('span', { class: 'quantity' }, number(key, how));
  if (withUnit) made.append(` ${unit}`);
  return made;
}

/** A volume of the summary, given in mm3. */
export function volume(key) {
  const small = Math.abs(at(key)) < 100 && at(key) !== 0;
  return element('span', { class: 'quantity' }, number(key, small ? {} : { scale: 1e-3, decimals: 2 }), small ? ' mm³' : ' cm³');
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

/** Whole numbers from base64, little endian. */
export function unpacked(text, Type) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Type(bytes.buffer);
}

/** Pale to dark through yellow, red and purple: also reads in grey. As overview.png has it. */
export const heat = ['#ECEBE6', '#F9DFA3', '#F9B768', '#EE7F52', '#CB4A5C', '#8C2B6B', '#47175A'];
