#include "apps/run/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <stdexcept>
#include <string_view>

#include "apps/run/steps.hpp"
#include "apps/run/summary.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/file.hpp"

namespace dimple {

/// Text of apps/report/template.html, embedded by the build.
extern const std::string_view report_template;

namespace {

namespace fs = std::filesystem;
static_assert(std::endian::native == std::endian::little, "numbers in the page are of little endian");

constexpr std::string_view data_place = "<!--dimple:data-->", chart_place = "<!--dimple:explanation-->";

// ------------------------------------------------------------------------------------------------------
// slices

// Plane of a slice: the image axes to the right and down, and whether down is opposite to the second.
struct Plane {
  const char* name;
  int right, down;
  bool flipped;
  std::array<const char*, 4> letters;
};
// Radiological views: from the feet, from the front, from the left.
constexpr std::array<Plane, 3> planes = {{{"sagittal", 1, 2, true, {"A", "P", "S", "I"}},
                                          {"coronal", 0, 2, true, {"R", "L", "S", "I"}},
                                          {"axial", 0, 1, false, {"R", "L", "A", "P"}}}};

// Most pixels along the longer side.
constexpr Index most_pixels = 480;

// Map from places in mm along the image's axes, between two corners, to places on a plane.
Eigen::Affine3d onto(const Plane& plane, const Vec3& low, const Vec3& high, double through) {
  const int out = 3 - plane.right - plane.down;
  Eigen::Affine3d place = Eigen::Affine3d::Identity();
  Mat3 turn = Mat3::Zero();
  turn(0, plane.right) = 1.0;
  turn(1, plane.down) = plane.flipped ? -1.0 : 1.0;
  turn(2, out) = 1.0;
  place.linear() = turn;
  place.translation() << -low[plane.right], plane.flipped ? high[plane.down] : -low[plane.down], -through;
  return place;
}

Slice empty_slice(const Plane& plane, const Vec3& low, const Vec3& high) {
  Slice slice{.name = plane.name};
  for (std::size_t k = 0; k < plane.letters.size(); ++k) slice.letters[k] = plane.letters[k];
  slice.width_mm = high[plane.right] - low[plane.right];
  slice.height_mm = high[plane.down] - low[plane.down];
  return slice;
}

// Fills a slice with the labels of the nearest voxels in a box.
void fill(Slice& slice, const Plane& plane, const LabelImage& image, const VoxelBox& box, Index through) {
  const int out = 3 - plane.right - plane.down;
  const auto extent = [&](int axis) {
    return box.high[static_cast<std::size_t>(axis)] - box.low[static_cast<std::size_t>(axis)] + 1;
  };
  const Index stride = (std::max(extent(plane.right), extent(plane.down)) + most_pixels - 1) / most_pixels;
  slice.columns = (extent(plane.right) + stride - 1) / stride;
  slice.rows = (extent(plane.down) + stride - 1) / stride;
  slice.label.reserve(static_cast<std::size_t>(slice.columns * slice.rows));
  std::array<Index, 3> at{};
  at[static_cast<std::size_t>(out)] = through;
  for (Index row = 0; row < slice.rows; ++row)
    for (Index column = 0; column < slice.columns; ++column) {
      const auto right = static_cast<std::size_t>(plane.right), down = static_cast<std::size_t>(plane.down);
      at[right] = std::min(box.low[right] + column * stride + stride / 2, box.high[right]);
      const Index steps = std::min(row * stride + stride / 2, box.high[down] - box.low[down]);
      at[down] = plane.flipped ? box.high[down] - steps : box.low[down] + steps;
      slice.label.push_back(image.at(at[0], at[1], at[2]));
    }
  // The cells of the last row and column may extend beyond the box.
  const Vec3 spacing = image.spacing();
  slice.width_mm = static_cast<double>(slice.columns * stride) * spacing[plane.right];
  slice.height_mm = static_cast<double>(slice.rows * stride) * spacing[plane.down];
}

// -----------------------------------------------------------------------------------------------------
// numbers

// Bytes of whole numbers of 1 or 2 bytes, as in memory.
template <class Number>
std::string packed(const std::vector<Number>& numbers) {
  std::string bytes(numbers.size() * sizeof(Number), '\0');
  if (!numbers.empty()) std::memcpy(bytes.data(), numbers.data(), bytes.size());
  return base64(bytes);
}

double rounded(double x, double per_unit) {
  return std::round(x * per_unit) / per_unit + 0.0;
}

// Place on a slice in hundredths of a millimetre.
Json hundredths(const Vec3& place) {
  return {static_cast<std::int64_t>(std::lround(100.0 * place.x())),
          static_cast<std::int64_t>(std::lround(100.0 * place.y()))};
}

// Line segments as four numbers each, in hundredths of a millimetre.
template <class Place>
Json hundredths_of(const std::vector<std::array<Place, 2>>& pieces) {
  Json numbers = Json::array();
  for (const auto& piece : pieces)
    for (const Place& place : piece)
      for (const Json& number : hundredths(Vec3(place.x(), place.y(), 0.0))) numbers.push_back(number);
  return numbers;
}

// -------------------------------------------------------------------------------------------------------
// parts

// Motion of the tool at a time [mm]: along its press direction, in space with the displacement by the loads,
// and its turn. Linear between samples.
struct ToolMotion {
  double depth = 0.0;
  Vec3 displacement = Vec3::Zero();
  Eigen::Quaterniond turned = Eigen::Quaterniond::Identity();
};

ToolMotion tool_motion_at(const History& history, const Vec3& approach, double time_s) {
  const std::vector<ForceSample>& force = history.force;
  const auto of = [&](const ForceSample& s) {
    return ToolMotion{1e3 * s.depth, 1e3 * (history.carried + s.depth * approach + Vec3(s.aside.data())),
                      Eigen::Quaterniond(rotation(Vec3(s.turned.data())))};
  };
  if (force.empty()) return {};
  const auto after =
      std::find_if(force.begin(), force.end(), [&](const ForceSample& s) { return s.t >= time_s; });
  if (after == force.end()) return of(force.back());
  if (after == force.begin()) return of(*after);
  const ToolMotion a = of(*(after - 1)), b = of(*after);
  const double fraction = (time_s - (after - 1)->t) / (after->t - (after - 1)->t);
  return {a.depth + fraction * (b.depth - a.depth),
          a.displacement + fraction * (b.displacement - a.displacement), a.turned.slerp(fraction, b.turned)};
}

// Radius of the tool: of a contacting tool half of its width, else that of the bonded patch [m].
double tool_radius(const ReportInput& input) {
  return input.indenter ? input.indenter->shape.radius : input.model.tool.radius;
}

// Outline of the tool at the end: its extreme points in each direction of the slice. It is drawn no higher
// than three radii above its tip.
Json silhouette(const Slice& slice, const ReportInput& input) {
  constexpr int directions = 48;
  const Vec3 approach = input.model.tool.approach;
  const ToolMotion at_end = tool_motion_at(input.history, approach, std::numeric_limits<double>::infinity());
  const Vec3 displacement = at_end.displacement;
  Points places = input.tool.position_mm;
  if (places.cols() == 0) return Json::array();
  if (input.indenter && at_end.turned.vec() != Vec3::Zero()) {
    const Vec3 foot = 1e3 * input.indenter->pose.tip;
    places = (at_end.turned.toRotationMatrix() * (places.colwise() - foot)).colwise() + foot;
  }
  const double tip = (approach.transpose() * places).maxCoeff(), highest = 3e3 * tool_radius(input);
  for (auto place : places.colwise())
    place += displacement + approach * std::max(0.0, tip - approach.dot(place) - highest);
  const Points seen = (slice.place.linear() * places).colwise() + slice.place.translation();
  Json list = Json::array();
  for (int k = 0; k < directions; ++k) {
    const double angle = 2.0 * std::numbers::pi * k / directions;
    Index farthest = 0;
    (std::cos(angle) * seen.row(0) + std::sin(angle) * seen.row(1)).maxCoeff(&farthest);
    for (const Json& number : hundredths(seen.col(farthest))) list.push_back(number);
  }
  return list;
}

Json slice_json(const Slice& slice, const ReportInput& input, double slab_mm) {
  const Model& model = input.model;
  Json result = {{"name", slice.name},
                 {"letters", slice.letters},
                 {"width_mm", rounded(slice.width_mm, 1e3)},
                 {"height_mm", rounded(slice.height_mm, 1e3)},
                 {"columns", slice.columns},
                 {"rows", slice.rows}};
  Json runs = Json::array();  // label, count, label, ...
  for (std::size_t first = 0, last = 0; first < slice.label.size(); first = last) {
    while (last < slice.label.size() && slice.label[last] == slice.label[first]) ++last;
    runs.push_back(slice.label[first]);
    runs.push_back(last - first);
  }
  result["labels"] = std::move(runs);

  const auto moved = [&](const Points& places_mm) {
    return Points((slice.place.linear() * places_mm).colwise() + slice.place.translation());
  };
  const Points nodes = moved(model.X * 1e3);
  std::vector<bool> base(static_cast<std::size_t>(nodes.cols())), bonded_patch(base);
  for (const Index a : model.base) base[static_cast<std::size_t>(a)] = true;
  for (const Index a : model.bonded_patch) bonded_patch[static_cast<std::size_t>(a)] = true;
  Json free = Json::array(), held = Json::array(), on_patch = Json::array();
  for (Index a = 0; a < nodes.cols(); ++a) {
    if (!(std::abs(nodes(2, a)) <= 0.5 * slab_mm)) continue;
    Json& list = bonded_patch[static_cast<std::size_t>(a)] ? on_patch
                 : base[static_cast<std::size_t>(a)]       ? held
                                                           : free;
    for (const Json& number : hundredths(nodes.col(a))) list.push_back(number);
  }
  result["nodes"] = {{"free", free}, {"base", held}, {"circle", on_patch}};

  const Surface& surface = input.frames.body;
  if (!surface.empty()) {
    result["outline_at_rest"] = hundredths_of(crossings(moved(surface.vertex_mm), surface.triangles));
    if (input.surface_displacement_mm.cols() == surface.vertex_mm.cols())
      result["outline_at_end"] = hundredths_of(
          crossings(moved(surface.vertex_mm + input.surface_displacement_mm), surface.triangles));
  }
  if (input.walls) result["walls"] = hundredths_of(wall_on(slice, input.walls));
  result["tool"] = silhouette(slice, input);
  return result;
}

// Places and triangles as whole numbers of two bytes.
Json mesh_json(const Points& places, const Triangles& triangles) {
  const Vec3 low = places.rowwise().minCoeff();
  const double step = std::max((places.colwise() - low).maxCoeff() / 65535.0, 1e-9);
  std::vector<std::uint16_t> place, corner;
  for (Index v = 0; v < places.cols(); ++v)
    for (int c = 0; c < 3; ++c)
      place.push_back(
          static_cast<std::uint16_t>(std::clamp(std::lround((places(c, v) - low[c]) / step), 0L, 65535L)));
  for (const Index c : triangles.reshaped()) corner.push_back(static_cast<std::uint16_t>(c));
  return {{"low_mm", {low.x(), low.y(), low.z()}},
          {"step_mm", step},
          {"places", packed(place)},
          {"triangles", packed(corner)}};
}

// Surface at rest, and each frame's displacement as whole numbers of one byte.
Json body_json(const ReportInput& input) {
  Json frames = Json::array();
  for (const BodyFrames::Frame& frame : input.frames.frame) {
    const double largest = frame.displacement_mm.allFinite() && frame.displacement_mm.size() > 0
                               ? static_cast<double>(frame.displacement_mm.cwiseAbs().maxCoeff())
                               : 0.0;
    std::vector<std::int8_t> moved;
    for (const float u : frame.displacement_mm.reshaped())
      moved.push_back(static_cast<std::int8_t>(largest > 0.0 ? std::lround(127.0 * u / largest) : 0L));
    const ToolMotion tool = tool_motion_at(input.history, input.model.tool.approach, frame.time_s);
    frames.push_back({{"depth_mm", rounded(tool.depth, 1e6)},
                      {"tool_mm", {tool.displacement.x(), tool.displacement.y(), tool.displacement.z()}},
                      {"step_mm", largest / 127.0},
                      {"displacement", packed(moved)}});
    const Eigen::Quaterniond& turned = tool.turned;  // about the tip; x,y,z,w
    if (turned.vec() != Vec3::Zero())
      frames.back()["tool_turned"] = {turned.x(), turned.y(), turned.z(), turned.w()};
  }
  Json result = mesh_json(input.frames.body.vertex_mm, input.frames.body.triangles);
  result["frames"] = std::move(frames);
  return result;
}

Json tool_json(const ReportInput& input) {
  const ToolPlace& tool = input.model.tool;
  Json result = mesh_json(input.tool.position_mm, input.tool.triangles);
  const Vec3 centre = 1e3 * (input.indenter ? input.indenter->pose.tip : tool.centre);
  result["centre_mm"] = {centre.x(), centre.y(), centre.z()};
  result["push"] = {tool.approach.x(), tool.approach.y(), tool.approach.z()};
  result["radius_mm"] = 1e3 * tool_radius(input);
  return result;
}

// Force curve; of a long march every so many samples, and the last.
Json curve_json(const ReportInput& input) {
  const History& history = input.history;
  const ErrorBounds& error_bounds = input.error_bounds;
  const std::optional<Comparison>& comparison = input.comparison;
  constexpr std::size_t most = 400;
  const std::size_t count = history.force.size(), stride = (count + most - 1) / most;
  const std::vector<double> lower = lower_bounds(history.force, error_bounds);
  Json depth = Json::array(), force = Json::array(), low = Json::array(), high = Json::array(),
       time = Json::array(), lateral = Json::array();
  double largest = 0.0;
  for (std::size_t k = 0; k < count; ++k) {
    const ForceSample& sample = history.force[k];
    const double across = input.over_time ? lateral_force(sample, input.model.tool.approach) : 0.0;
    largest = std::max(
        {largest, std::abs(sample.force) + (error_bounds.known() ? error_bounds.half[k] : 0.0), across});
    if (k % stride != 0 && k + 1 != count) continue;
    depth.push_back(1e3 * sample.depth);
    force.push_back(sample.force);
    time.push_back(sample.t);
    lateral.push_back(across);
    if (error_bounds.known()) low.push_back(lower[k]), high.push_back(sample.force + error_bounds.half[k]);
  }
  if (comparison)
    for (const double measured : comparison->measured.force) largest = std::max(largest, std::abs(measured));
  const Written axis = force_written(largest);
  Json curve = {{"depth_mm", depth}, {"force_N", force},  {"low_N", low},
                {"high_N", high},    {"unit", axis.unit}, {"per_unit", axis.per_unit}};
  if (input.over_time) curve["time_s"] = time, curve["lateral_N"] = lateral;
  return curve;
}

Json comparison_json(const std::optional<Comparison>& comparison) {
  if (!comparison || comparison->measured.depth.empty()) return nullptr;
  const MeasuredCurve& measured = comparison->measured;
  Json depth = Json::array();
  for (const double d : measured.depth) depth.push_back(1e3 * d);
  return {
      {"name", measured.name}, {"depth_mm", depth}, {"force_N", measured.force}, {"rows", measured.row_name}};
}

// Words of the page for the summary, by the functions of terminal and picture. Each place in it gets a
// number, its unit, and the units per unit of the summary. Forces together have the unit of `size`; 0: each
// its own.
void write_words(Json& words, const Json& part, const std::string& place, double size) {
  for (const auto& [name, value] : part.items()) {
    const std::string here = place.empty() ? name : place + '.' + name;
    if (value.is_structured()) write_words(words, value, here, size);
    if (!value.is_number()) continue;
    const double x = value;
    const auto add = [&](const Written& w) { words[here] = {w.number(x), w.unit, w.per_unit}; };
    if (name.ends_with("_N")) add(force_written(size == 0.0 || here.starts_with("walls.") ? x : size));
    if (name.ends_with("_mm")) add(length_written(x));
    if (name.ends_with("_mm3")) add(volume_written(x));
    if (name == "value" && part.value("unit", "") == "%") add(percent_written(x));
    if (name.ends_with("_Pa")) {
      const std::string text = stress_in_words(x);
      const std::size_t blank = text.find(' ');
      const std::string unit = text.substr(blank + 1);
      words[here] = {text.substr(0, blank), unit, unit == "Pa" ? 1.0 : unit == "kPa" ? 1e-3 : 1e-6};
    }
  }
}

Json words_of(const Json& summary) {
  Json words = Json::object();
  const Json& of_force = summary.contains("largest_force") ? summary.at("largest_force") : summary;
  write_words(words, summary, "", of_force.value("force_N", 0.0));
  return words;
}

// JSON text that cannot end the script element of the page.
std::string within_script(const Json& json) {
  std::string text = json.dump(-1, ' ', false, Json::error_handler_t::replace), safe;
  safe.reserve(text.size());
  for (const char c : text)
    if (c == '<')
      safe += "\\u003c";
    else
      safe += c;
  return safe;
}

constexpr std::string_view end_of_script = "</script>\n";

std::string head_of(const char* id) {
  return fmt::format("<script type=\"application/json\" id=\"{}\">", id);
}

std::string script(const char* id, const Json& json) {
  return head_of(id) + within_script(json) + std::string(end_of_script);
}

void replace_script(std::string& page, const char* id, const Json& json) {
  const std::size_t from = page.find(head_of(id));
  if (from == std::string::npos) return;
  const std::size_t to = page.find(end_of_script, from) + end_of_script.size();
  page.replace(from, to - from, script(id, json));
}

// The body's axes in the order and sense nearest to the patient's: left, posterior, superior.
Mat3 nearest_to_patient(const Mat3& axes) {
  std::array<int, 3> order = {0, 1, 2};
  Mat3 best = axes;
  double most = -1.0;
  do {
    Mat3 now;
    for (int k = 0; k < 3; ++k) {
      const Vec3 axis = axes.col(order[static_cast<std::size_t>(k)]);
      now.col(k) = axis[k] < 0.0 ? Vec3(-axis) : axis;
    }
    if (now.trace() > most + 1e-9) most = now.trace(), best = now;
  } while (std::next_permutation(order.begin(), order.end()));
  return best;
}

}  // namespace

std::vector<std::array<Vec3, 2>> crossings(const Points& on_slice, const Triangles& triangles) {
  std::vector<std::array<Vec3, 2>> pieces;
  for (const auto& t : triangles.colwise()) {
    std::array<Vec3, 2> end;
    std::size_t found = 0;
    for (int e = 0; e < 3; ++e) {
      const Vec3 a = on_slice.col(t[e]), b = on_slice.col(t[(e + 1) % 3]);
      if ((a.z() < 0.0) != (b.z() < 0.0) && found < 2) end[found++] = a + (b - a) * (a.z() / (a.z() - b.z()));
    }
    if (found == 2 && end[0].allFinite() && end[1].allFinite()) pieces.push_back(end);
  }
  return pieces;
}

std::vector<std::array<Eigen::Vector2d, 2>> wall_on(const Slice& slice, const GapAt& gap) {
  if (!gap) return {};
  constexpr double cells = 150.0;  // along the longer side
  const Eigen::Affine3d to_world = slice.place.inverse();
  return zero_pieces(slice.width_mm, slice.height_mm, std::max(slice.width_mm, slice.height_mm) / cells,
                     [&](const Eigen::Vector2d& p) { return gap(to_world * Vec3(p.x(), p.y(), 0.0)); });
}

double tilt_degrees(const Mat3& axes) {
  const double least = nearest_to_patient(axes).diagonal().minCoeff();
  return std::acos(std::clamp(least, -1.0, 1.0)) * 180.0 / std::numbers::pi;
}

std::vector<Slice> slices_through(const Vec3& centre, const Model& model, const LabelImage& image) {
  std::vector<Slice> slices(planes.size());
  if (image.row_offset.empty()) {
    const Mat3 axes = nearest_to_patient(model.axes);
    const Points& shape = model.surface.empty() ? Points(1e3 * model.X) : model.surface.vertex_mm;
    const Points along = axes.transpose() * shape;
    const Vec3 low = along.rowwise().minCoeff(), high = along.rowwise().maxCoeff();
    const Vec3 room = Vec3::Constant(0.03 * (high - low).maxCoeff());
    for (std::size_t k = 0; k < planes.size(); ++k) {
      const Plane& plane = planes[k];
      slices[k] = empty_slice(plane, low - room, high + room);
      const Vec3 through = axes.transpose() * centre;
      slices[k].place =
          onto(plane, low - room, high + room, through[3 - plane.right - plane.down]) * axes.transpose();
    }
    return slices;
  }
  VoxelBox box = foreground_box(image);
  const Vec3 spacing = image.spacing(), at = image.to_world.inverse() * centre;
  std::array<Index, 3> through{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<Index>(axis);
    const auto margin = static_cast<Index>(std::ceil(3.0 / spacing[a]));
    box.low[axis] = std::max<Index>(box.low[axis] - margin, 0);
    box.high[axis] = std::min<Index>(box.high[axis] + margin, image.size[axis] - 1);
    through[axis] = std::clamp<Index>(std::lround(at[a]), 0, image.size[axis] - 1);
  }
  // Along the image's axes in mm, from the corner of the box.
  const Eigen::Affine3d along = Eigen::Scaling(spacing) * image.to_world.inverse();
  Vec3 low, high;
  for (Index a = 0; a < 3; ++a) {
    const auto axis = static_cast<std::size_t>(a);
    low[a] = (static_cast<double>(box.low[axis]) - 0.5) * spacing[a];
    high[a] = (static_cast<double>(box.high[axis]) + 0.5) * spacing[a];
  }
  for (std::size_t k = 0; k < planes.size(); ++k) {
    const Plane& plane = planes[k];
    const int out = 3 - plane.right - plane.down;
    slices[k] = empty_slice(plane, low, high);
    fill(slices[k], plane, image, box, through[static_cast<std::size_t>(out)]);
    slices[k].place = onto(plane, low, high, (along * centre)[out]) * along;
  }
  return slices;
}

void keep(BodyFrames& frames, BodyFrames::Frame frame) {
  const auto left_out = [&](const BodyFrames::Frame& kept) { return kept.number % frames.every != 0; };
  if (!frames.frame.empty() && left_out(frames.frame.back())) frames.frame.pop_back();  // it was the last
  frames.frame.push_back(std::move(frame));
  if (frames.frame.size() <= most_frames_shown) return;
  frames.every *= 2;
  BodyFrames::Frame last = std::move(frames.frame.back());
  frames.frame.pop_back();
  std::erase_if(frames.frame, left_out);
  frames.frame.push_back(std::move(last));
}

Json report_data(const ReportInput& input) {
  const Model& model = input.model;
  Json data;
  data["options"] = input.options;
  data["curve"] = curve_json(input);
  data["beside"] = comparison_json(input.comparison);
  // Nodes of a slab: in dense parts a few layers.
  const double far_mm = model.spacing.size() > 0 ? 1e3 * model.spacing.maxCoeff() : 0.0;
  const double slab_mm = std::clamp(0.5 * far_mm, 0.2e3 * model.tool.radius, 1e3 * model.tool.radius);
  data["slab_mm"] = slab_mm;
  data["slices"] = Json::array();
  for (const Slice& slice : input.slices) data["slices"].push_back(slice_json(slice, input, slab_mm));
  data["tilt_degrees"] = rounded(tilt_degrees(model.axes), 10.0);
  if (!input.frames.frame.empty()) {
    data["body"] = body_json(input);
    data["tool"] = tool_json(input);
  }
  if (!input.picture.empty()) data["picture"] = "data:image/png;base64," + base64(input.picture);
  return data;
}

void write_report(const fs::path& file, const Json& summary, const Json& data) {
  const std::size_t at = report_template.find(data_place);
  if (at == std::string_view::npos) throw std::logic_error("the page has no place for its data");
  write_file(file, std::string(report_template.substr(0, at)) + script("dimple-summary", summary) +
                       script("dimple-words", words_of(summary)) + script("dimple-data", data) +
                       std::string(report_template.substr(at + data_place.size())));
}

void amend_report(const fs::path& file, const Json& summary, const std::string& chart_svg) {
  std::error_code ignored;
  if (!fs::is_regular_file(file, ignored)) return;
  std::string page = read_file(file);
  replace_script(page, "dimple-summary", summary);
  replace_script(page, "dimple-words", words_of(summary));
  if (const std::size_t at = page.find(chart_place); at != std::string::npos && !chart_svg.empty())
    page.replace(at, chart_place.size(), chart_svg);
  write_file(file, page);
}

}  // namespace dimple
