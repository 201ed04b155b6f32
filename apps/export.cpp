#include "apps/export.hpp"

#include <fmt/format.h>

#include <cmath>

#include "apps/log.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "preprocess/tetrahedra.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

std::string chosen_format(const std::string& format, const fs::path& file) {
  const std::string suffix = file.extension().string();
  if (format == "calculix" || format == "febio") return format;
  if (!format.empty())
    throw UsageError({.fact = fmt::format("'{}' is no format of another program", format),
                      .where = "--format",
                      .why = "known are calculix and febio",
                      .remedy = "choose one of these"});
  if (suffix == ".inp") return "calculix";
  if (suffix == ".feb") return "febio";
  throw UsageError({.fact = fmt::format("'{}' does not say for which program it is", file.string()),
                    .where = "-o",
                    .why = "CalculiX reads .inp, FEBio .feb",
                    .remedy = "name it so, or give --format calculix or --format febio"});
}

}  // namespace

ElementModel element_model(const Config& config) {
  const Material material = material_of(config);
  if (!config.tissue.empty() || !material.ogden.empty() || !material.prony.empty() || material.as_printed)
    throw UsageError({.fact = "only one neo-Hookean tissue can be exported",
                      .where = "material",
                      .why = "other laws are not written alike by these programs",
                      .remedy = "leave out tissues, presets, --stress printed, Ogden and Prony numbers"});
  const SegmentedBody body = segment(config);
  const BodySurface& surface = body.surface;
  ModelOptions options = model_options(config);
  // The paper's even cloud would need a hundred thousand tetrahedra to follow the rim.
  if (config.cloud.rim <= 0.0) options.cloud.grading.rim = 0.15;
  const double first = config.cloud.spacing_mm > 0.0
                           ? config.cloud.spacing_mm
                           : tetrahedra_spacing_for_count(surface, options.cloud.count, {});
  const Boundary boundary = find_boundary(surface, options.boundary, first);
  const Sizing sizing(surface, boundary, options.cloud.grading);
  const double spacing = config.cloud.spacing_mm > 0.0
                             ? config.cloud.spacing_mm
                             : tetrahedra_spacing_for_count(surface, options.cloud.count, sizing);
  const TetrahedralMesh mesh = make_tetrahedra(surface, boundary, sizing, spacing);
  const Loading loading = loading_of(config);
  ElementModel model;
  model.X = surface.to_world() * mesh.X.colwise().homogeneous();
  model.tetrahedra = mesh.tetrahedra;
  model.base = mesh.base;
  model.circle = mesh.circle;
  model.mu = material.mu;
  model.kappa = material.kappa;
  model.push = surface.to_world().linear() * boundary.push + Vec3::Zero();
  model.depth_mm = config.load.depth_mm;
  model.bonded = loading.contact == Contact::bonded;
  model.frames = static_cast<int>(config.solver.frames);
  model.remarks = {
      fmt::format("{}, indented by {:.6g} mm ({}); written by dimple {}",
                  fs::path(config.image.file).filename().string(), config.load.depth_mm, config.load.contact,
                  DIMPLE_VERSION),
      fmt::format("{} nodes ({} corners), {} tetrahedra, edges of {:.4g} mm, {:.4g} mm at the circle's rim; "
                  "{:.2f} cm3, "
                  "the surface's {:.2f} cm3",
                  mesh.X.cols(), mesh.corner_count, mesh.tetrahedra.cols(), spacing,
                  spacing * options.cloud.grading.rim, mesh.volume_mm3 / 1e3, surface.volume() / 1e3),
      fmt::format("base: {} nodes, {}", mesh.base.size(), boundary.base_reason),
      fmt::format("circle: {} nodes, {}", mesh.circle.size(), boundary.circle_reason)};
  return model;
}

Outcome export_model(const Config& config, const std::string& format, const fs::path& file) {
  const std::string known = chosen_format(format, file);
  const ElementModel model = element_model(config);
  for (const std::string& line : model.remarks) say(fmt::format("export   {}", line));
  write_file(file, known == "febio" ? febio_input(model) : calculix_input(model));
  const std::string command = known == "febio"
                                  ? fmt::format("febio4 -i {}", file.string())
                                  : fmt::format("ccx {}", (file.parent_path() / file.stem()).string());
  return {.summary_json =
              fmt::format("{{\"file\": \"{}\", \"format\": \"{}\", \"nodes\": {}, \"elements\": {}}}\n",
                          file.string(), known, model.X.cols(), model.tetrahedra.cols()),
          .headline = fmt::format("{} nodes, {} tetrahedra; run it with: {}", model.X.cols(),
                                  model.tetrahedra.cols(), command)};
}

}  // namespace dimple
