// Loads other than the tool, supports other than the base, and the steps of a scene.
import { at, element, number, place3, quantity, there, written } from './numbers.js';

const isNothing = (key) => at(key).every((x) => x === 0);

/** Line for each entry of `where`: its name, and the text of `words`. */
const lines = (where, words) => Object.keys(at(where) ?? {}).map((name) => element('div', {}, element('strong', {}, name), ': ', ...words(`${where}.${name}`).flat()));

const membrane = (its) => [
  ...(at(`${its}.stiffness_N_per_m`) > 0 ? [written(`${its}.thickness_mm`), ' thick, mu ', written(`${its}.mu_Pa`), ', ', quantity(`${its}.stiffness_N_per_m`, 'N/m'), ', '] : []),
  ...(at(`${its}.tension_N_per_m`) > 0 ? ['tension ', quantity(`${its}.tension_N_per_m`, 'N/m'), ', '] : []),
  'on ', quantity(`${its}.area_mm2`, 'mm²', { decimals: 0 }), at(`${its}.wrinkles`) ? '' : ', bears compression',
];

const support = (its) => [
  number(`${its}.nodes`, { decimals: 0 }), ' nodes, ', at(`${its}.hold`) ?? 'held', isNothing(`${its}.moved_mm`) ? '' : [', moved by ', place3(`${its}.moved_mm`, 2), ' mm'], '; force of the tissue on it ', place3(`${its}.force_N`, 3), ' N',
];

const wall = (its) => [there(`${its}.friction`) ? ['friction ', String(at(`${its}.friction`))] : 'without friction', at(`${its}.largest_overlap_at_rest_mm`) > 0 ? [', overlaps the body at rest by up to ', written(`${its}.largest_overlap_at_rest_mm`)] : ''];

function preload() {
  const where = ['largest displacement ', written('loads.settled_mm')];
  if (there('loads.circle_moved_mm') && !isNothing('loads.circle_moved_mm')) where.push(', of the contact patch ', place3('loads.circle_moved_mm', 2), ' mm');
  if (there('loads.unloaded')) where.push('; the image shows the body under these loads; the load-free nodes are up to ', written('loads.unloaded.taken_back_mm'), ' away');
  return where;
}

/** Rows of the table of assumptions. */
export function loadRows() {
  const films = lines('membranes', membrane), held = lines('supports', support), beside = lines('walls', wall);
  return [
    there('loads') && !isNothing('loads.gravity_m_per_s2') && ['Gravity', place3('loads.gravity_m_per_s2', 2), ' m/s²'],
    there('loads') && Object.keys(at('loads.pressure_Pa')).length > 0 && ['Pressure', ...lines('loads.pressure_Pa', (its) => [quantity(its, 'Pa')])],
    there('loads.fluid_lost') && ['Fluid lost', 'above ', number('loads.fluid_lost.level_mm', { decimals: 1, place: true }), ' mm along ', place3('loads.fluid_lost.up', 2)],
    there('loads') && ['Preload', ...preload()],
    films.length > 0 && ['Membrane', ...films],
    held.length > 0 && ['Supports', ...held],
    beside.length > 0 && ['Walls', ...beside],
  ];
}

/** Moving part of a step, and its displacement. */
function way(step) {
  if (there(`${step}.cut`)) return ['cut'];
  const turns = there(`${step}.turn_deg`) ? [' turned by ', place3(`${step}.turn_deg`, 1), '°'] : [];
  if (isNothing(`${step}.move_mm`)) return turns.length > 0 ? [at(`${step}.moves`), ...turns] : ['hold'];
  return [at(`${step}.moves`), ' ', place3(`${step}.move_mm`, 2), ...turns];
}

export function steps() {
  const names = ['step', 'moves by, LPS mm', 'ends at, s', 'depth', 'force', 'across the approach direction', 'largest'];
  const table = element('table', { class: 'list' }, element('tr', {}, ...names.map((name, k) => element('th', { scope: 'col', class: k < 2 ? 'text' : '' }, name))));
  for (const k of at('scene').keys()) {
    const step = `scene.${k}`;
    table.append(element('tr', {}, element('td', { class: 'text' }, String(at(`${step}.name`))), element('td', { class: 'text' }, ...way(step)),
      element('td', {}, number(`${step}.time_s`)), ...['indentation_mm', 'force_N', 'lateral_force_N', 'largest_force_N'].map((key) => element('td', {}, written(`${step}.${key}`)))));
  }
  return table;
}
