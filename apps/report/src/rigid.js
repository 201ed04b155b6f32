// Tables of walls and further tools.
import { at, element, quantity, written } from './numbers.js';

// Table of rigid bodies: force on each, contact area and penetration. `where`: key in the summary.
function rigid(what, where, places, area) {
  const made = element('table', { class: 'list' }, element('tr', {}, ...[what, 'force on it', 'contact area', 'penetration'].map((name) => element('th', { scope: 'col', class: name === what ? 'text' : '' }, name))));
  for (const name of Object.keys(at(where))) {
    const its = `${where}.${name}`;
    made.append(element('tr', {}, element('td', { class: 'text', style: 'white-space:nowrap' }, name), ...(at(`${its}.${places}`) > 0
      ? [element('td', {}, written(`${its}.force_size_N`)), element('td', {}, quantity(`${its}.${area}`, 'mm²', { decimals: 0 })), element('td', {}, written(`${its}.largest_penetration_mm`))]
      : [element('td', { colspan: 3 }, 'not in contact at the end')])));
  }
  return made;
}
export const walls = () => rigid('wall', 'walls', 'places_that_touch', 'area_that_touches_mm2');
export const furtherTools = () => rigid('tool', 'other_tools', 'samples_in_contact', 'contact_area_mm2');
