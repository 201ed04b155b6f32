// Surface of the body, which can be rotated, and its frames, with vtk.js.
import '@kitware/vtk.js/Rendering/OpenGL/Profiles/Geometry.js';
import vtkActor from '@kitware/vtk.js/Rendering/Core/Actor.js';
import vtkColorTransferFunction from '@kitware/vtk.js/Rendering/Core/ColorTransferFunction.js';
import vtkDataArray from '@kitware/vtk.js/Common/Core/DataArray.js';
import vtkInteractorStyleTrackballCamera from '@kitware/vtk.js/Interaction/Style/InteractorStyleTrackballCamera.js';
import vtkMapper from '@kitware/vtk.js/Rendering/Core/Mapper.js';
import vtkOpenGLRenderWindow from '@kitware/vtk.js/Rendering/OpenGL/RenderWindow.js';
import vtkPolyData from '@kitware/vtk.js/Common/DataModel/PolyData.js';
import vtkRenderWindow from '@kitware/vtk.js/Rendering/Core/RenderWindow.js';
import vtkRenderWindowInteractor from '@kitware/vtk.js/Rendering/Core/RenderWindowInteractor.js';
import vtkRenderer from '@kitware/vtk.js/Rendering/Core/Renderer.js';
import { data, heat, metal, svg, unpacked } from './numbers.js';

export function canDraw() {
  if (!data.body) return false;
  try {
    const context = document.createElement('canvas').getContext('webgl2');
    context?.getExtension('WEBGL_lose_context')?.loseContext();
    return Boolean(context);
  } catch {
    return false;
  }
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const plus = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const unit = (a) => {
  const length = Math.sqrt(dot(a, a)) || 1;
  return [a[0] / length, a[1] / length, a[2] / length];
};

/** Vertices and triangles of a mesh. */
function unpackMesh(mesh) {
  const places = Float32Array.from(unpacked(mesh.places, Uint16Array), (n, k) => mesh.low_mm[k % 3] + n * mesh.step_mm);
  return { places, triangles: unpacked(mesh.triangles, Uint16Array) };
}

/** Vertices at rest, triangles, and the displacement of each frame. */
function unpack() {
  const { body } = data;
  const { places: rest, triangles } = unpackMesh(body);
  const frames = body.frames.map((frame) => {
    const u = Float32Array.from(unpacked(frame.displacement, Int8Array), (n) => n * frame.step_mm);
    const size = new Float32Array(u.length / 3);
    for (let v = 0; v < size.length; ++v) size[v] = Math.hypot(u[3 * v], u[3 * v + 1], u[3 * v + 2]);
    return { u, size, depth: frame.depth_mm, tool: frame.tool_mm, turned: frame.tool_turned ?? [0, 0, 0, 1] };
  });
  return { rest, triangles: turnedOutwards(rest, triangles), frames };
}

function normalsOf(places, triangles, normals) {
  normals.fill(0);
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = [3 * triangles[t], 3 * triangles[t + 1], 3 * triangles[t + 2]];
    const ux = places[b] - places[a], uy = places[b + 1] - places[a + 1], uz = places[b + 2] - places[a + 2];
    const vx = places[c] - places[a], vy = places[c + 1] - places[a + 1], vz = places[c + 2] - places[a + 2];
    const n = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    for (const corner of [a, b, c]) for (let k = 0; k < 3; ++k) normals[corner + k] += n[k];
  }
  for (let v = 0; v < normals.length; v += 3) {
    const length = Math.hypot(normals[v], normals[v + 1], normals[v + 2]) || 1;
    for (let k = 0; k < 3; ++k) normals[v + k] /= length;
  }
}

/** Triangles with those turned back that the reduction of the surface turned over: their back would appear black. */
function turnedOutwards(places, triangles) {
  const normals = new Float32Array(places.length);
  normalsOf(places, triangles, normals);
  const at = (array, v) => [array[3 * v], array[3 * v + 1], array[3 * v + 2]];
  const outwards = triangles.slice();
  for (let t = 0; t < triangles.length; t += 3) {
    const corners = triangles.subarray(t, t + 3);
    const [a, b, c] = Array.from(corners, (v) => at(places, v));
    const own = cross(plus(b, a, -1), plus(c, a, -1));
    const around = Array.from(corners, (v) => at(normals, v)).reduce((sum, n) => plus(sum, n));
    if (dot(own, around) < 0) [outwards[t + 1], outwards[t + 2]] = [triangles[t + 2], triangles[t + 1]];
  }
  return outwards;
}

function cells(triangles) {
  const list = new Uint32Array((triangles.length / 3) * 4);
  for (let t = 0; t < triangles.length / 3; ++t) list.set([3, triangles[3 * t], triangles[3 * t + 1], triangles[3 * t + 2]], 4 * t);
  return list;
}

/** Direction normal to the approach direction. */
function across(push) {
  const least = push.map(Math.abs).indexOf(Math.min(...push.map(Math.abs)));
  return unit(cross(push, [0, 1, 2].map((k) => (k === least ? 1 : 0))));
}

const rgb = (hex) => [1, 3, 5].map((from) => parseInt(hex.slice(from, from + 2), 16) / 255);

/** Mesh in which each triangle has its own corners, so that edges are sharp. */
function flat({ places, triangles }) {
  const own = Float32Array.from({ length: 3 * triangles.length }, (_, k) => places[3 * triangles[Math.floor(k / 3)] + (k % 3)]);
  const normals = new Float32Array(own.length);
  const inOrder = Uint32Array.from(triangles, (_, k) => k);
  normalsOf(own, inOrder, normals);
  return polyData(own, normals, inOrder).made;
}

function polyData(places, normals, triangles) {
  const made = vtkPolyData.newInstance();
  made.getPoints().setData(places, 3);
  made.getPolys().setData(cells(triangles));
  const array = vtkDataArray.newInstance({ name: 'normals', numberOfComponents: 3, values: normals });
  made.getPointData().setNormals(array);
  return { made, array };
}

/** View of overview.png: from above, and somewhat from the side of the contact. */
function lookFrom(rest) {
  const up = data.tool.push.map((x) => -x);
  const middle = [0, 1, 2].map((k) => {
    let low = Infinity, high = -Infinity;
    for (let i = k; i < rest.length; i += 3) (low = Math.min(low, rest[i])), (high = Math.max(high, rest[i]));
    return (low + high) / 2;
  });
  let front = plus(data.tool.centre_mm, middle, -1);
  front = plus(front, up, -dot(front, up));
  if (Math.sqrt(dot(front, front)) < data.tool.radius_mm) front = across(data.tool.push);
  front = unit(front);
  const side = cross(up, front);
  const turned = plus([0, 1, 2].map((k) => Math.cos(0.35) * front[k]), side, Math.sin(0.35));
  const elevation = (40 * Math.PI) / 180;
  return { up, middle, toward: plus([0, 1, 2].map((k) => Math.sin(elevation) * up[k]), turned, Math.cos(elevation)) };
}

/** Arrows to left, posterior and superior (or their opposites) that turn with the camera. */
function compass(camera) {
  const picture = svg('svg', { viewBox: '-38 -38 76 76', class: 'compass', 'aria-hidden': 'true' });
  const turn = () => {
    picture.replaceChildren();
    const toward = unit(plus(camera.getPosition(), camera.getFocalPoint(), -1));
    const up = unit(camera.getViewUp());
    const right = unit(cross(up, toward));
    const above = cross(toward, right);
    for (const [k, letters] of [['L', 'R'], ['P', 'A'], ['S', 'I']].entries()) {
      const flip = toward[k] < -0.2 || (Math.abs(toward[k]) <= 0.2 && above[k] + 0.5 * right[k] < 0);
      const sign = flip ? -1 : 1;
      const [x, y] = [24 * sign * right[k], -24 * sign * above[k]];
      const length = Math.hypot(x, y) || 1;
      picture.append(
        svg('line', { x1: 0, y1: 0, x2: x, y2: y }),
        svg('text', { x: x + (9 * x) / length, y: y + (9 * y) / length + 4, 'text-anchor': 'middle' }, letters[flip ? 1 : 0]),
      );
    }
  };
  camera.onModified(turn);
  turn();
  return picture;
}

/** Draws the body in `place`; returns the function that shows a frame. */
export function body(place) {
  const { rest, triangles, frames } = unpack();
  const places = Float32Array.from(rest);
  const normals = new Float32Array(rest.length);
  const surface = polyData(places, normals, triangles);
  const size = vtkDataArray.newInstance({ name: 'displacement', values: new Float32Array(rest.length / 3) });
  surface.made.getPointData().setScalars(size);
  const most = Math.max(...frames.map((frame) => frame.size.reduce((a, b) => Math.max(a, b), 0)), 1e-9);

  const colours = vtkColorTransferFunction.newInstance();
  heat.forEach((hex, k) => colours.addRGBPoint((most * k) / (heat.length - 1), ...rgb(hex)));
  const mapper = vtkMapper.newInstance({ scalarVisibility: true, useLookupTableScalarRange: true, lookupTable: colours });
  mapper.setInputData(surface.made);
  const actor = vtkActor.newInstance();
  actor.setMapper(mapper);
  actor.getProperty().set({ ambient: 0.15, diffuse: 0.9, specular: 0.12, specularPower: 24 });

  const toolMapper = vtkMapper.newInstance({ scalarVisibility: false });
  toolMapper.setInputData(flat(unpackMesh(data.tool)));
  const toolActor = vtkActor.newInstance();
  toolActor.setMapper(toolMapper);
  toolActor.setOrigin(...data.tool.centre_mm);
  // The setter of an actor's colour sets all three of its colours.
  toolActor.getProperty().setColor(...rgb(metal));
  toolActor.getProperty().set({ ambient: 0.25, diffuse: 0.8, specular: 0.15, specularPower: 24 });

  const renderer = vtkRenderer.newInstance({ background: [1, 1, 1] });
  renderer.addActor(actor);
  renderer.addActor(toolActor);
  const window3d = vtkRenderWindow.newInstance();
  window3d.addRenderer(renderer);
  const view = vtkOpenGLRenderWindow.newInstance();
  view.setContainer(place);
  window3d.addView(view);

  const camera = renderer.getActiveCamera();
  const { up, middle, toward } = lookFrom(rest);
  camera.setParallelProjection(true);
  const reset = () => {
    camera.setFocalPoint(...middle);
    camera.setPosition(...plus(middle, toward, 500));
    camera.setViewUp(...up);
    renderer.resetCamera(actor.getBounds());
    camera.setParallelScale(camera.getParallelScale() * 0.78);
  };

  // The wheel scrolls the page; with Ctrl it zooms.
  place.addEventListener('wheel', (event) => event.ctrlKey || event.stopImmediatePropagation(), { capture: true });
  const interactor = vtkRenderWindowInteractor.newInstance();
  interactor.setView(view);
  interactor.initialize();
  interactor.setContainer(place);
  interactor.setInteractorStyle(vtkInteractorStyleTrackballCamera.newInstance());

  const fit = () => {
    const ratio = Math.max(window.devicePixelRatio || 1, 1);
    view.setSize(Math.round(place.clientWidth * ratio), Math.round(place.clientHeight * ratio));
    window3d.render();
  };
  const show = (k) => {
    const frame = frames[k];
    for (let i = 0; i < rest.length; ++i) places[i] = rest[i] + frame.u[i];
    normalsOf(places, triangles, normals);
    size.setData(frame.size);
    surface.made.getPoints().modified();
    surface.array.modified();
    surface.made.modified();
    toolActor.setPosition(...frame.tool);
    toolActor.setOrientationFromQuaternion(frame.turned);
    window3d.render();
  };
  show(frames.length - 1);
  reset();
  fit();
  place.append(compass(camera));
  new ResizeObserver(fit).observe(place);
  return { show, depths: frames.map((frame) => frame.depth), most, reset: () => (reset(), window3d.render()) };
}
