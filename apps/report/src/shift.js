// Page of a brain shift: its head, profile and planes, in place of those of an indentation.
import { curveChart } from './chart.js';
import { at, baseName, data, element, facts, number, place3, section, there, word, written } from './numbers.js';
import { walls } from './rigid.js';

export function head() {
  const image = at('image');
  document.title = `${baseName(image)}: brain shift`;
  section('verdict').remove();
  for (const [id, title] of [['force', 'The shift'], ['body', 'The brain at rest and after it'], ['depends', 'What the shift depends on']]) section(id).querySelector('h2').textContent = title;
  section('head').append(
    element('p', { class: 'subject' }, element('strong', {}, baseName(image)), ', after a craniotomy, by Dimple ', word('version')),
    element('h1', {}, written('shift.middle_mm'), ' at the middle of the opening'),
    element('p', { class: 'band' }, written('shift.middle_along_gravity_mm'), ' of it along gravity; largest at the opening ', written('shift.largest_at_opening_mm'), '. The error is ', word('shift.band')),
  );
}

function table(list, first) {
  const names = [...first, 'place, LPS mm', 'shift', 'along gravity'];
  const made = element('table', { class: 'list' }, element('tr', {}, ...names.map((name) => element('th', { scope: 'col' }, name))));
  for (const k of at(list).keys()) {
    const one = `${list}.${k}`;
    made.append(element('tr', {}, first.length > 0 ? element('td', {}, written(`${one}.depth_mm`)) : undefined, element('td', {}, place3(`${one}.place_mm`)), element('td', {}, written(`${one}.shift_mm`)), element('td', {}, written(`${one}.along_gravity_mm`))));
  }
  return made;
}

export function shift() {
  const place = section('force');
  const points = at('shift.profile');
  const words = element('div', {},
    facts([
      ['at the middle of the opening', written('shift.middle_mm')],
      ['of it along gravity', written('shift.middle_along_gravity_mm')],
      ['largest at the opening', written('shift.largest_at_opening_mm'), there('shift.at_mm') && [', at ', place3('shift.at_mm'), ' mm']],
      ['of that along gravity', written('shift.along_gravity_mm')],
      ['largest of the whole surface', written('shift.largest_of_all_mm')],
      ['error of it', word('shift.band')],
    ]),
    element('h3', {}, 'The skull'), walls());
  place.append(
    element('div', { class: 'beside' },
      element('div', {}, curveChart({ x: points.map((p) => p.depth_mm), y: points.map((p) => p.shift_mm), xLabel: 'distance from the opening towards the middle in mm', yLabel: 'shift in mm' }),
        element('p', { class: 'soft' }, 'Shift along the line from the opening to the middle of the brain (profile.csv).')),
      words));
  if (at('shift.targets').length > 0) place.append(element('h3', {}, 'Targets'), table('shift.targets', []));
  place.append(element('h3', {}, 'In depth'), table('shift.profile', ['depth']));
}

export function slicesOfShift() {
  const place = section('slices');
  place.prepend(element('h2', {}, 'Before and after'), element('img', { style: 'width:100%', src: data.before_after, alt: 'three planes below the opening, before and after' }), element('p', { class: 'soft' }, word('shift.pictured')));
}

export function assumedOfShift() {
  return [
    ['Assumed', ...at('shift.assumed').map((_, k) => element('div', {}, word(`shift.assumed.${k}`)))],
    ['Opening', 'a ball of ', number('shift.opening_mm.3', { decimals: 1 }), ' mm at ', place3('shift.opening_mm'), ' mm in which the skull is open'],
    ['Gravity', 'acts against ', place3('shift.up'), '; fluid lost: ', word('shift.fluid_lost'), ' of the height, to a level of ', number('shift.fluid_level_mm', { decimals: 1, place: true }), ' mm along it'],
    ['Left out', word('shift.left_out')],
  ];
}
