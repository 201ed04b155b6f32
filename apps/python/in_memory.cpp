#include "apps/python/in_memory.hpp"

#include <fmt/format.h>

#include <exception>

#include "apps/run/archive.hpp"
#include "io/error.hpp"

namespace dimple {

// ---------------------------------------------------------------------------------------------------------
// Options
// ---------------------------------------------------------------------------------------------------------

template <class Archive, Like<ModelChoices::Image> T>
void members(Archive& io, T& image) {
  auto& [file, label, label_names, close_mm, cut_gap_mm] = image;
  io(file, label, label_names, close_mm, cut_gap_mm);
}

template <class Archive, Like<ModelChoices::NodeSet> T>
void members(Archive& io, T& discretisation) {
  auto& [nodes, spacing_mm, patch_edge, seed, jitter] = discretisation;
  io(nodes, spacing_mm, patch_edge, seed, jitter);
}

template <class Archive, Like<ModelChoices::Place> T>
void members(Archive& io, T& place) {
  auto& [base, base_depth_mm, indent_at, indenter_diameter_mm, direction] = place;
  io(base, base_depth_mm, indent_at, indenter_diameter_mm, direction);
}

template <class Archive, Like<Blade> T>
void members(Archive& io, T& blade) {
  auto& [kind, first, second, length, sheet, label, text] = blade;
  int number = static_cast<int>(kind);
  io(number, first, second, length, sheet.vertex, sheet.triangles, label, text);
  if constexpr (!std::is_const_v<T>) kind = static_cast<Blade::Kind>(number);
}

template <class Archive, Like<Cut> T>
void members(Archive& io, T& cut) {
  auto& [blades, text, where] = cut;
  io(blades, text, where);
}

template <class Archive, Like<ModelChoices> T>
void members(Archive& io, T& choices) {
  auto& [image, cut, scheme, discretisation, grid, support_radius_factor, boundary] = choices;
  io(image, cut, scheme, discretisation, grid.points, grid.ratio, support_radius_factor, boundary);
}

template <class Archive, Like<GradingOptions> T>
void members(Archive& io, T& grading) {
  auto& [patch_edge, reach, whole_patch, least, load_exponent, load_slope] = grading;
  io(patch_edge, reach, whole_patch, least, load_exponent, load_slope);
}

template <class Archive, Like<SupportOptions> T>
void members(Archive& io, T& support) {
  auto& [radius_factor, interpolation, through_tissue] = support;
  io(radius_factor, interpolation, through_tissue);
}

template <class Archive, Like<Scheme> T>
void members(Archive& io, T& scheme) {
  auto& [name, averaged_gradients, consistent_gradients, pressure_patches, base_outline, grading,
         points_per_node, support] = scheme;
  std::string named(name);
  io(named, averaged_gradients, consistent_gradients, pressure_patches, base_outline, grading,
     points_per_node, support);
  if constexpr (!std::is_const_v<T>) {
    const Scheme* known = scheme_named(named);
    if (!known) throw std::runtime_error("there is no scheme " + named);
    name = known->name;
  }
}

template <class Archive, Like<NodeSetOptions> T>
void members(Archive& io, T& discretisation) {
  auto& [count, spacing_mm, seed, grading, base_outline, jitter] = discretisation;
  io(count, spacing_mm, seed, grading, base_outline, jitter);
}

template <class Archive, Like<GridOptions> T>
void members(Archive& io, T& grid) {
  auto& [count, ratio, density] = grid;
  auto& [patch_edge, far] = density;
  io(count, ratio, patch_edge, far);
}

template <class Archive, Like<BoundaryOptions> T>
void members(Archive& io, T& boundary) {
  // No model with a contacting tool is kept in memory, so the members after the first seven are left out.
  auto& [base, base_depth_mm, indent_at, indenter_diameter_mm, direction, voxel_mm, contact_radius_mm,
         height_of_tool, path_of_tool, path_of_turning_tool, other_tools, is_pressed] = boundary;
  io(base, base_depth_mm, indent_at, indenter_diameter_mm, direction, voxel_mm, contact_radius_mm);
}

template <class Archive, Like<ModelOptions> T>
void members(Archive& io, T& options) {
  auto& [scheme, discretisation, grid, boundary] = options;
  io(scheme, discretisation, grid, boundary);
}

// ---------------------------------------------------------------------------------------------------------
// Image, surface and input of a model
// ---------------------------------------------------------------------------------------------------------

template <class Archive, Like<LabelImage> T>
void members(Archive& io, T& image) {
  auto& [size, run, row_offset, to_world, names, format, orientation, stored_size, stored_spacing, warnings] =
      image;
  io(size, run, row_offset, to_world.matrix(), names, format, orientation, stored_size, stored_spacing,
     warnings);
}

template <class Archive, Like<ClosedImage> T>
void members(Archive& io, T& closed) {
  auto& [image, added_mm3, body_mm3] = closed;
  io(image, added_mm3, body_mm3);
}

template <class Archive, Like<Cavity> T>
void members(Archive& io, T& cavity) {
  auto& [volume_mm3, centre_mm, filled] = cavity;
  io(volume_mm3, centre_mm, filled);
}

template <class Archive, Like<SegmentReport> T>
void members(Archive& io, T& report) {
  auto& [labels, label_volume_mm3, pieces, dropped_volume_mm3, cavities, voxel_volume_mm3, cut_by_border,
         step_mm, smoothing_mm, warnings] = report;
  io(labels, label_volume_mm3, pieces, dropped_volume_mm3, cavities, voxel_volume_mm3, cut_by_border, step_mm,
     smoothing_mm, warnings);
}

template <class Archive, Like<BodySurface::ImageEnd> T>
void members(Archive& io, T& end) {
  auto& [out, offset, tolerance] = end;
  io(out, offset, tolerance);
}

// Data from which a surface is made; the same data give the same surface.
struct Triangulated {
  Points vertex;
  Triangles triangles;
  Eigen::Isometry3d to_world = Eigen::Isometry3d::Identity();
  std::vector<BodySurface::ImageEnd> image_ends;
};

template <class Archive, Like<Triangulated> T>
void members(Archive& io, T& surface) {
  auto& [vertex, triangles, to_world, image_ends] = surface;
  io(vertex, triangles, to_world.matrix(), image_ends);
}

template <class Archive, Like<CutPiece> T>
void members(Archive& io, T& piece) {
  auto& [volume_mm3, centre] = piece;
  io(volume_mm3, centre);
}

template <class Archive, Like<Organ> T>
void members(Archive& io, T& organ) {
  auto& [options, labels, closed, closing, body, site, label_names] = organ;
  if constexpr (std::is_const_v<T>) {
    const BodySurface& s = body->surface;
    io(options, labels, closed, closing,
       Triangulated{s.vertex(), s.triangles(), s.to_world(), s.image_ends()}, body->report, label_names);
  } else {
    Triangulated from;
    SegmentReport report;
    io(options, labels, closed, closing, from, report, label_names);
    BodySurface surface(std::move(from.vertex), std::move(from.triangles), from.to_world);
    surface.ends_with_image(std::move(from.image_ends));
    body = std::make_shared<const SegmentedBody>(SegmentedBody{std::move(surface), std::move(report)});
    site = std::make_shared<const Site>(find_site(body->surface, options));
  }
}

template <class Archive, Like<Boundary> T>
void members(Archive& io, T& boundary) {
  auto& [down, lowest, height, base_depth, flat_base, base_by_axes, centre, approach, radius, room, over_cut,
         base_reason, patch_reason, warnings] = boundary;
  io(down, lowest, height, base_depth, flat_base, base_by_axes, centre, approach, radius, room, over_cut,
     base_reason, patch_reason, warnings);
}

template <class Archive, Like<LabelMeasure> T>
void members(Archive& io, T& label) {
  auto& [value, name, voxels, volume_mm3, centre_mm, pieces, largest_piece_voxels, meets_border] = label;
  io(value, name, voxels, volume_mm3, centre_mm, pieces, largest_piece_voxels, meets_border);
}

template <class Archive, Like<ImageFacts> T>
void members(Archive& io, T& facts) {
  auto& [image_words, labels, closed_mm3, cut, facing_fraction, voxel_edges_mm, segment] = facts;
  auto& [area_mm2, removed_mm3, sizing, parted, taken_out, took] = cut;  // `took` is only needed for images
  io(image_words, labels, closed_mm3, area_mm2, removed_mm3, sizing, parted, taken_out, facing_fraction,
     voxel_edges_mm, segment);
}

template <class Archive, Like<Origin> T>
void members(Archive& io, T& origin) {
  auto& [choices, organ, image, facts, image_warnings, boundary] = origin;
  io(choices, organ, image, facts, image_warnings, boundary);
}

// ---------------------------------------------------------------------------------------------------------
// Model and result
// ---------------------------------------------------------------------------------------------------------

template <class Archive, Like<CompressedRows> T>
void members(Archive& io, T& rows) {
  auto& [offset, member] = rows;
  io(offset, member);
}

template <class Archive, Like<Discretisation> T>
void members(Archive& io, T& places) {
  auto& [X, spacing, point, volume, second_moments, label, base, bonded_patch, tool, axes, surface] = places;
  auto& [centre, approach, radius] = tool;
  auto& [vertex_mm, triangles, cut_face] = surface;
  io(X, spacing, point, volume, second_moments, label, base, bonded_patch, centre, approach, radius, axes,
     vertex_mm, triangles, cut_face);
}

template <class Archive, Like<ModelInMemory> T>
void members(Archive& io, T& kept) {
  auto& model = kept.model;
  if constexpr (std::is_const_v<T>)
    io(static_cast<const Discretisation&>(model));
  else
    io(static_cast<Discretisation&>(model));
  io(model.scheme, model.support, model.support_report.unseen, kept.label_names, kept.provenance,
     kept.warnings, kept.report_json);
  if constexpr (std::is_const_v<T>) {
    io(kept.origin != nullptr);
    if (kept.origin) io(*kept.origin);
  } else {
    bool has_origin = false;
    io(has_origin);
    if (!has_origin) return;
    auto origin = std::make_shared<Origin>();
    io(*origin);
    kept.origin = std::move(origin);
  }
}

template <class Archive, Like<ErrorBounds> T>
void members(Archive& io, T& error_bounds) {
  auto& [unknown, coarse_nodes, seconds, half, contacting] = error_bounds;
  io(unknown, coarse_nodes, seconds, half, contacting);
}

template <class Archive, Like<Solved> T>
void members(Archive& io, T& solved) {
  auto& [force, error_bounds, warnings, summary_json, model, frame_time, frame_depth, frame_u] = solved;
  io(force, error_bounds, warnings, summary_json, frame_time, frame_depth, frame_u);
}

namespace {

std::string format_of(const char* what) {
  return fmt::format("pydimple {} {}", what, DIMPLE_VERSION);
}

template <class T>
void read(const char* what, const std::vector<std::uint8_t>& bytes, T& value) {
  try {
    from_bytes(format_of(what), bytes, value);
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    throw InputError(
        {.fact = fmt::format("a pickled {} cannot be read", what),
         .where = "pickle",
         .why = fmt::format("it is none of version {}, or damaged: {}", DIMPLE_VERSION, error.what()),
         .remedy = "compute it again, or read it with the version that it was pickled by"});
  }
}

}  // namespace

std::vector<std::uint8_t> bytes_of(const ModelInMemory& model) {
  return to_bytes(format_of("model"), model);
}

ModelHolder model_of(const std::vector<std::uint8_t>& bytes) {
  auto model = std::make_shared<ModelInMemory>();
  read("model", bytes, *model);
  return model;
}

std::vector<std::uint8_t> bytes_of(const Solved& solved) {
  return to_bytes(format_of("result"), solved);
}

std::unique_ptr<Solved> solved_of(const std::vector<std::uint8_t>& bytes, ModelHolder model) {
  auto solved = std::make_unique<Solved>();
  read("result", bytes, *solved);
  solved->model = std::move(model);
  return solved;
}

}  // namespace dimple
