// Bundles src/ into template.html, in which the program inserts the numbers of a run.
import { build } from 'esbuild';
import { readFile, writeFile } from 'node:fs/promises';

const result = await build({
  entryPoints: ['src/main.js'],
  bundle: true,
  minify: true,
  format: 'iife', // modules do not load from file://
  target: 'es2020',
  legalComments: 'none',
  write: false,
});
const script = result.outputFiles[0].text.replaceAll('</script', '<\\/script').replaceAll('<!--', '<\\!--');
const style = (await build({ entryPoints: ['src/page.css'], minify: true, write: false })).outputFiles[0].text;
const page = (await readFile('src/page.html', 'utf8'))
  .replace('/*style*/', () => style.trim())
  .replace('/*script*/', () => script.trim());
for (const place of ['data', 'explanation'])
  if (page.split(`<!--dimple:${place}-->`).length !== 2) throw new Error(`the page needs one place for ${place}`);
if (page.includes(')-page-"')) throw new Error('the page cannot become a string of the program');
await writeFile('template.html', page);
console.log(`template.html: ${Math.round(page.length / 1024)} kB`);
