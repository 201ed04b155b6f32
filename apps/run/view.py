# Shows the results in this folder, wherever it lies, in ParaView 5.11 or later: the last frame, the body cut open,
# the tool. Move through time with ParaView's own buttons.
#
#   File > Load State ... > this file, or    paraview --state=view.py
#   pvpython view.py FIGURE.png [FRAME ...]  a picture, and no window; FRAME counts from 0, without one it is the last;
#                                            further pictures and frames may follow
import csv
import json
import math
import os
import sys

import paraview.simple as pv

# Pale to dark, as in overview.png: the lightness falls evenly, so it also reads in grey.
PALE_TO_DARK = ["ECEBE6", "F9DFA3", "F9B768", "EE7F52", "CB4A5C", "8C2B6B", "47175A"]
# Labels in the order of their numbers, then again from the first: hues that the common colour-vision deficiencies keep
# apart.
OF_LABELS = ["9CC3E6", "E9B44C", "6FB98F", "D98880", "B79AC8", "F4E285", "5F9EA0", "BFBFBF"]
INK, GREY, METAL = [0.15, 0.15, 0.15], [0.6, 0.6, 0.6], [0.31, 0.62, 0.65]
SIZE, WIDER = (2000, 1100), 0.58  # of a picture, and the share of the body's view


def result_folder():
    """Where this script lies: ParaView tells that to a state file, but not to a script."""
    places = [os.environ.get("DIMPLE_RESULTS", "")]
    if "__file__" in globals():
        places.append(os.path.dirname(os.path.abspath(__file__)))
    try:
        with open("/proc/self/cmdline", encoding="utf-8", errors="replace") as line:
            words = [word.split("=", 1)[-1] for word in line.read().split("\0")]
        places += [os.path.dirname(os.path.abspath(word)) for word in words if word.endswith("view.py")]
    except OSError:
        pass
    places.append(os.getcwd())
    for place in places:
        if place and all(os.path.exists(os.path.join(place, name + ".pvd")) for name in ("surface", "section", "tool")):
            return place
    raise RuntimeError("view.py finds no surface.pvd, section.pvd and tool.pvd beside it. Load it by File > Load State, or "
                       "name the folder of the results in DIMPLE_RESULTS; a run writes them with --write surface or all")


def rgb(colour):
    return [int(colour[k:k + 2], 16) / 255.0 for k in (0, 2, 4)]


def read(name):
    return pv.PVDReader(registrationName=name, FileName=os.path.join(FOLDER, name + ".pvd"))


def magnitudes(data, name):
    """Of a point array, where they are numbers, ascending."""
    array = data.GetPointData().GetArray(name)
    size = range(array.GetNumberOfComponents())
    all_of_them = (math.sqrt(sum(array.GetComponent(n, c) ** 2 for c in size)) for n in range(array.GetNumberOfTuples()))
    return sorted(value for value in all_of_them if math.isfinite(value))


def names_of_labels(data):
    """number -> name of the labels in the section; {} if a model's files do not tell."""
    array = data.GetCellData().GetArray("label")
    if array is None:
        return {}
    numbers = sorted({int(array.GetTuple1(t)) for t in range(array.GetNumberOfTuples())})
    try:
        with open(os.path.join(FOLDER, "summary.json"), encoding="utf-8") as file:
            known = {label["value"]: label["name"] for label in json.load(file).get("labels", [])}
    except (OSError, ValueError, KeyError):
        known = {}
    return {number: known.get(number) or f"label {number}" for number in numbers}


def colour_map(name, low, high):
    """One that keeps its range at all times; a body in which all is alike has some range too."""
    table = pv.GetColorTransferFunction(name)
    table.AutomaticRescaleRangeMode = "Never"
    high = high if high > low else low + 1.0
    table.RGBPoints = sum(([low + (high - low) * k / (len(PALE_TO_DARK) - 1)] + rgb(colour)
                           for k, colour in enumerate(PALE_TO_DARK)), [])
    table.ColorSpace = "Lab"
    table.NanColor = GREY
    table.ScalarRangeInitialized = 1.0
    return table


def label_map(names):
    table = pv.GetColorTransferFunction("label")
    table.InterpretValuesAsCategories = 1
    table.AnnotationsInitialized = 1
    table.Annotations = sum(([str(number), name] for number, name in names.items()), [])
    table.IndexedColors = sum((rgb(OF_LABELS[k % len(OF_LABELS)]) for k in range(len(names))), [])
    table.IndexedOpacities = [1.0] * len(names)
    return table


def show(source, view, by=None, colour=None):
    shown = pv.Show(source, view)
    shown.Representation = "Surface"
    if by:
        pv.ColorBy(shown, by)
        shown.SetScalarBarVisibility(view, False)
    else:
        shown.ColorArrayName = [None, ""]
        shown.AmbientColor = shown.DiffuseColor = colour
    return shown


def words_of_forces():
    """Depth in micrometres -> the force there with its band, where force.csv tells one, as the program writes it."""
    try:
        with open(os.path.join(FOLDER, "force.csv"), encoding="utf-8", newline="") as file:
            rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
        words = {}
        for row in rows:
            numbers = [row[name] for name in ("force_N", "low_N", "high_N") if name in row]
            size = abs(numbers[0])
            unit, factor = next(scale for scale in (("N", 1.0), ("mN", 1e3), ("uN", 1e6), ("nN", 1e9))
                                if size == 0.0 or scale[1] * size >= 0.09995 or scale[0] == "nN")
            digits = min(max(2 - math.floor(math.log10(factor * size)), 0), 3) if size > 0.0 else 0
            force, *band = [f"{factor * number:.{digits}f}" for number in numbers]
            words[round(1e3 * row["indentation_mm"])] = f"{force} {unit}" + (
                f", {band[0]} to {band[1]} (discretisation)" if len(band) == 2 and size > 0.0 else "")
        return words
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def write_words(text, view, place, size=18):
    shown = pv.Show(text, view)
    shown.WindowLocation, shown.Position = "Any Location", place
    shown.Color, shown.FontSize = INK, size


def legend(table, view, title, place, length, numbers):
    bar = pv.GetScalarBar(table, view)
    bar.Title, bar.ComponentTitle = title, ""
    bar.Orientation, bar.WindowLocation, bar.Position = "Horizontal", "Any Location", place
    bar.ScalarBarLength, bar.ScalarBarThickness = length, 14
    bar.TitleColor = bar.LabelColor = INK
    bar.TitleFontSize = bar.LabelFontSize = 16
    bar.AutomaticLabelFormat, bar.LabelFormat, bar.RangeLabelFormat = 0, numbers, numbers
    bar.Visibility = 1


def look(view, points, aspect, elevation):
    """From the front and above, as near as all points and a margin for the words allow."""
    c, s = math.cos(math.radians(elevation)), math.sin(math.radians(elevation))
    toward = [c * front[d] + s * up[d] for d in range(3)]
    above = [c * up[d] - s * front[d] for d in range(3)]
    spans = []
    for axis in (right, above, toward):
        along = [sum(axis[d] * p[d] for d in range(3)) for p in points]
        spans.append((min(along), max(along)))
    middle = [0.5 * (low + high) for low, high in spans]
    width, height = (high - low for low, high in spans[:2])
    centre = [middle[0] * right[d] + middle[1] * above[d] + middle[2] * toward[d] for d in range(3)]
    view.CameraParallelProjection = 1
    view.CameraFocalPoint = view.CenterOfRotation = centre
    far = 2.0 * (width + height + spans[2][1] - spans[2][0])
    view.CameraPosition = [centre[d] + far * toward[d] for d in range(3)]
    view.CameraViewUp = above
    scale = view.CameraParallelScale = 0.5 * max(width / (0.92 * aspect), height / (0.68 if elevation else 0.6))
    # A length at the lower right, nearer than the body; it turns with the scene, and is true as long as it lies across.
    most = 0.3 * scale * aspect
    power = 10.0 ** math.floor(math.log10(most))
    length = max(step * power for step in (1, 2, 5) if step * power <= most)
    at = [(0.94 * scale * aspect - part, -0.90 * scale, 0.6 * far) for part in (length, 0.0)]
    ends = [[centre[d] + x * right[d] + y * above[d] + z * toward[d] for d in range(3)] for x, y, z in at]
    ruler = pv.Ruler(registrationName="scale bar", Point1=ends[0], Point2=ends[1])
    shown = pv.Show(ruler, view)
    shown.AxisColor = shown.Color = INK
    shown.AxisLineWidth, shown.NumberOfTicks, shown.FontSize, shown.LabelFormat = 2.5, 2, 16, f"{length:g} mm"


def some_points(data):
    count = data.GetNumberOfPoints()
    return [data.GetPoint(n) for n in range(0, count, max(1, count // 3000))]


# ------------------------------------------------------------------------------------------------------ what is there

FOLDER = result_folder()
pv._DisableFirstRenderCameraReset()
skin, section, tool = (read(name) for name in ("surface", "section", "tool"))
scene = pv.GetAnimationScene()
scene.UpdateAnimationUsingDataTimeSteps()
times = sorted(tool.TimestepValues if hasattr(tool.TimestepValues, "__len__") else [tool.TimestepValues])
scene.AnimationTime = times[-1]
for source in (skin, section, tool):
    source.UpdatePipeline(times[-1])
at_end = {source: pv.servermanager.Fetch(source) for source in (skin, section, tool)}


def fact(name):
    array = at_end[tool].GetFieldData().GetArray(name)
    return [array.GetComponent(0, c) for c in range(array.GetNumberOfComponents())]


centre, front, up = fact("centre_mm"), fact("front"), [-p for p in fact("push")]
right = [up[1] * front[2] - up[2] * front[1], up[2] * front[0] - up[0] * front[2], up[0] * front[1] - up[1] * front[0]]

deepest = max(magnitudes(at_end[skin], "displacement_mm"), default=0.0)
stress = magnitudes(at_end[section], "von_mises_Pa")
# Stress is singular at a sharp rim: its largest values are those of the cloud, not of the tissue.
usual_stress = [stress[int(share * (len(stress) - 1))] for share in (0.02, 0.98)] if stress else [0.0, 0.0]
tool_points = some_points(at_end[tool])
tool_points += [tuple(p[d] + fact("indentation_mm")[0] * up[d] for d in range(3)) for p in tool_points]  # and at first
names = names_of_labels(at_end[section])

# ------------------------------------------------------------------------------------------------------------ pictures

layout = pv.CreateLayout("Dimple")
body_view = pv.CreateRenderView()
pv.AssignViewToLayout(view=body_view, layout=layout, hint=0)
layout.SplitHorizontal(0, WIDER)
stress_view = pv.CreateRenderView()
pv.AssignViewToLayout(view=stress_view, layout=layout, hint=2)
views = {body_view: ("POINTS", "displacement_mm", "Magnitude"), stress_view: ("POINTS", "von_mises_Pa")}
if names:
    layout.SplitVertical(2, 0.5)
    label_view = pv.CreateRenderView()
    pv.AssignViewToLayout(view=label_view, layout=layout, hint=6)
    views[label_view] = ("CELLS", "label")
layout.SetSize(*SIZE)
for view in views:
    view.UseColorPaletteForBackground = 0
    view.Background = [1.0, 1.0, 1.0]
    view.OrientationAxesVisibility = 1
    view.OrientationAxesLabelColor = INK

# What lay behind the section at rest, whatever the surface has become since.
at_rest = " + ".join(f"(coords{a} - displacement_mm_{a} - ({centre[d]!r})) * ({front[d]!r})" for d, a in enumerate("XYZ"))
side = pv.Calculator(registrationName="side of the section", Input=skin, ResultArrayName="side_mm", Function=at_rest)
half = pv.Clip(registrationName="half of the surface", Input=side, ClipType="Scalar", Scalars=["POINTS", "side_mm"],
               Value=0.0, Invert=1)
half_tool = pv.ClipClosedSurface(registrationName="half of the tool", Input=tool, ClippingPlane="Plane")
half_tool.ClippingPlane.Origin = [centre[d] + fact("carried_mm")[d] for d in range(3)]
half_tool.ClippingPlane.Normal = [-x for x in front]
outline = pv.FeatureEdges(registrationName="outline of the section", Input=section, BoundaryEdges=1, FeatureEdges=0,
                          NonManifoldEdges=0, ManifoldEdges=0)
words = pv.PythonAnnotation(registrationName="depth and force", Input=tool, ArrayAssociation="Field Data",
                            # Without braces, which ParaView would fill in.
                            Expression="'indentation %.2f mm,  force ' % indentation_mm[0] + "
                                       f"dict({list(words_of_forces().items())!r})"
                                       ".get(round(1e3 * indentation_mm[0]), '%.4f N' % force_N[0])")
axes = pv.Text(registrationName="what x, y and z are", Text="x left, y posterior, z superior")

lit = show(half, body_view, views[body_view])
lit.Ambient, lit.Diffuse = 0.3, 0.7
for view, by in views.items():
    flat = show(section, view, by)
    flat.Ambient, flat.Diffuse = 1.0, 0.0  # the colours of the legend
    show(outline, view, colour=INK).LineWidth = 1.5
    metal = show(half_tool, view, colour=METAL)
    metal.Ambient, metal.Diffuse = 0.3, 0.6
    aspect = WIDER * SIZE[0] / SIZE[1] if view is body_view else (1.0 - WIDER) * SIZE[0] / SIZE[1] * (2 if names else 1)
    look(view, tool_points + some_points(at_end[skin if view is body_view else section]), aspect,
         28 if view is body_view else 0)

of_displacement = colour_map("displacement_mm", 0.0, deepest)
of_stress = colour_map("von_mises_Pa", *usual_stress)

write_words(words, body_view, [0.03, 0.94])
write_words(axes, body_view, [0.02, 0.01], 14)
legend(of_displacement, body_view, "displacement [mm]", [0.32, 0.04], 0.36, "%.3g")
legend(of_stress, stress_view, "von Mises stress [Pa], 2nd to 98th percentile", [0.25, 0.04], 0.5, "%.3g")
if names:
    legend(label_map(names), label_view, "labels", [0.25, 0.07], 0.5, "%.3g")

pv.SetActiveView(body_view)
wanted = sys.argv[1:] if os.path.basename(sys.argv[0]) == "view.py" else []
for picture, frame in zip(wanted[::2], (wanted + ["-1"])[1::2]):
    scene.AnimationTime = times[int(frame)]
    pv.SaveScreenshot(picture, layout, ImageResolution=SIZE, SeparatorWidth=0)
if not wanted:
    pv.RenderAllViews()
