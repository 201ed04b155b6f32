#include "apps/studies/export_mesh.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "apps/run/model_options.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/summary.hpp"
#include "apps/scene/compatibility.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/words.hpp"
#include "preprocess/output/tetrahedra.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr double nu_that_locks = 0.49;  // locking of ten-node tetrahedra

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
  throw UsageError({.fact = fmt::format("'{}' does not name a program's format", file.string()),
                    .where = "-o",
                    .why = "CalculiX reads .inp, FEBio .feb",
                    .remedy = "name it so, or give --format calculix or --format febio"});
}

// Body meshed with finite elements.
struct ElementMesh {
  ElementModel model;                         // only nodes, elements, base and patch, in the surface's frame
  double spacing_mm = 0.0, patch_edge = 1.0;  // edge length far from the patch; relative length at its edge
  double volume_mm3 = 0.0;
};

ElementMesh tetrahedra(const Scene& scene, const BodySurface& surface, const Boundary& boundary,
                       ModelOptions options) {
  // With the even nodes of the paper, a hundred thousand tetrahedra would be needed at the edge of the patch.
  if (scene.node_set.patch_edge <= 0.0) options.node_set.grading.patch_edge = 0.15;
  options.node_set.grading.reach = 3.0;
  options.node_set.grading.load_exponent = 0.0;
  const Sizing sizing(surface, boundary, options.node_set.grading);
  ElementMesh mesh;
  mesh.patch_edge = options.node_set.grading.patch_edge;
  mesh.spacing_mm = scene.node_set.spacing_mm > 0.0
                        ? scene.node_set.spacing_mm
                        : tetrahedra_spacing_for_count(surface, options.node_set.count, sizing);
  TetrahedralMesh made = make_tetrahedra(surface, boundary, sizing, mesh.spacing_mm);
  mesh.model.X = std::move(made.X);
  mesh.model.elements = made.tetrahedra;
  mesh.model.base = std::move(made.base);
  mesh.model.bonded_patch = std::move(made.bonded_patch);
  mesh.volume_mm3 = made.volume_mm3;
  return mesh;
}

}  // namespace

ElementModel element_model(const Scene& scene, const RunObserver& observer) {
  check_pairs(scene, Feature::export_mesh);
  const Material material = material_of(scene);
  Result unused;
  const RunLog log{observer, unused};
  Scene passing = scene;
  passing.self_contact = Scene::SelfContact::off;  // the file has no contact of folds
  const Organ organ = read_organ({.scene = passing}, model_options(scene), log, unused);
  const BodySurface& surface = organ.body->surface;
  const Boundary boundary = find_boundary(surface, organ.options.boundary);
  const ElementMesh mesh = tetrahedra(scene, surface, boundary, organ.options);
  for (const std::string& warning : boundary.warnings) log.warn(warning);
  if (const double off = mesh.volume_mm3 / surface.volume() - 1.0; std::abs(off) > 0.03)
    log.warn(
        fmt::format("the mesh has {} and the body {}: {:.0f} % {}, so that the two are not the same body; "
                    "use more --nodes",
                    volume_in_words(mesh.volume_mm3), volume_in_words(surface.volume()),
                    100.0 * std::abs(off), off > 0.0 ? "more" : "less"));
  if (scene.material.nu > nu_that_locks)
    log.warn(
        fmt::format("ten-node tetrahedra lock at nu {:g}: with up to 18,000 nodes their force was 14 to 76 % "
                    "too large; use a mixed element of the other program, such as C3D10H of Abaqus",
                    scene.material.nu));
  ElementModel model = mesh.model;
  model.X = surface.to_world() * model.X.colwise().homogeneous();
  model.mu = material.mu;
  model.kappa = material.kappa;
  model.approach = surface.to_world().linear() * boundary.approach + Vec3::Zero();
  model.depth_mm = scene.depth_mm;
  model.bonded = scene.contact == Contact::bonded;
  model.frames = static_cast<int>(scene.solver.frames);
  model.remarks = {
      fmt::format("{}, indented by {:.6g} mm ({}); {} {}", fs::path(scene.image.file).filename().string(),
                  scene.depth_mm, name_of(scene.contact), written_by, DIMPLE_VERSION),
      fmt::format("{} nodes, {} tetrahedra, edges of {:.4g} mm, {:.4g} mm at the edge of the contact patch; "
                  "{}, the surface's {}",
                  model.X.cols(), model.elements.cols(), mesh.spacing_mm, mesh.spacing_mm * mesh.patch_edge,
                  volume_in_words(mesh.volume_mm3), volume_in_words(surface.volume())),
      fmt::format("base: {} nodes, {}", model.base.size(), boundary.base_reason),
      fmt::format("contact patch: {} nodes, {}", model.bonded_patch.size(), boundary.patch_reason)};
  return model;
}

Outcome export_model(const Scene& scene, const std::string& format, const fs::path& file,
                     const RunObserver& observer) {
  std::vector<std::string> warnings;
  const RunObserver keeping = {.line = [&](RunObserver::Line kind, const std::string& text) {
    if (kind == RunObserver::Line::warning) warnings.push_back(text);
    if (observer.line) observer.line(kind, text);
  }};
  const std::string known = chosen_format(format, file);
  const ElementModel model = element_model(scene, keeping);
  for (const std::string& line : model.remarks)
    keeping.line(RunObserver::Line::said, fmt::format("export   {}", line));
  stop_if_requested();
  remove_temporaries_of(file);
  write_file(file, known == "febio" ? febio_input(model) : calculix_input(model));
  const std::string command = known == "febio"
                                  ? fmt::format("febio4 -i {}", file.string())
                                  : fmt::format("ccx {}", (file.parent_path() / file.stem()).string());
  return {.summary_json = as_text({{"file", file.string()},
                                   {"format", known},
                                   {"nodes", model.X.cols()},
                                   {"elements", model.elements.cols()},
                                   {"warnings", warnings}}),
          .headline = fmt::format("{} nodes, {} tetrahedra; run it with: {}", model.X.cols(),
                                  model.elements.cols(), command)};
}

}  // namespace dimple
