#include "apps/run/organ.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "apps/run/cuts.hpp"
#include "apps/run/folds.hpp"
#include "apps/run/grading.hpp"
#include "apps/run/model_options.hpp"
#include "apps/run/places.hpp"
#include "apps/run/results.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/compatibility.hpp"
#include "apps/scene/option.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/label_names.hpp"
#include "io/text.hpp"
#include "preprocess/scene/cut_face.hpp"
#include "preprocess/surface/label_surface.hpp"

namespace dimple {
namespace {

// ", did you mean 'left lung' or 'right lung'?" for "lung", otherwise a name of similar spelling.
std::string names_like(const std::string& word, const std::vector<std::string>& known) {
  std::vector<std::string> with;
  for (const std::string& name : known)
    if (lower(name).find(lower(word)) != std::string::npos && with.size() < 4)
      with.push_back(fmt::format("'{}'", name));
  return with.empty() ? did_you_mean(word, known)
                      : fmt::format(", did you mean {}?", fmt::join(with, " or "));
}

// Labels given by number or name, as numbers; `present`: those of the image.
std::vector<int> chosen_labels(const LabelImage& image, const std::vector<LabelMeasure>& present,
                               const std::vector<std::string>& requested,
                               const char* option = "--label (image.label)",
                               const char* of = "the image holds") {
  std::vector<int> result;
  for (const std::string& word : requested) {
    if (!word.empty() && word.find_first_not_of("0123456789") == std::string::npos && word.size() < 10) {
      result.push_back(std::stoi(word));
      continue;
    }
    const auto same = [](const std::string& a, const std::string& b) {
      return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                        [](unsigned char x, unsigned char y) { return std::tolower(x) == std::tolower(y); });
    };
    std::vector<std::string> known;
    bool found = false;
    for (const auto& [value, name] : image.names) {
      known.push_back(name);
      if (!same(name, word)) continue;
      result.push_back(value);
      found = true;
    }
    if (found) continue;
    const std::string elsewhere = numbering_with(word);
    throw InputError(
        {.fact = fmt::format("no label is called '{}'{}", word, names_like(word, known)),
         .where = option,
         .why = (known.empty() ? std::string("the image has no label names")
                               : fmt::format("the image names {}", fmt::join(known, ", "))) +
                (elsewhere.empty() ? "" : "; it would be " + elsewhere),
         .remedy =
             elsewhere.empty()
                 ? "choose by number, or give names with --label-names; `dimple info IMAGE` shows the labels"
                 : fmt::format(
                       "add --label-names {} if that made the image; `dimple info IMAGE` shows the labels",
                       elsewhere.substr(elsewhere.rfind(' ') + 1))});
  }
  for (const int value : result)
    if (std::none_of(present.begin(), present.end(), [&](const LabelMeasure& m) { return m.value == value; }))
      throw InputError({.fact = fmt::format("no voxel has label {}", value),
                        .where = option,
                        .why = fmt::format("{} {}", of, in_words(present)),
                        .remedy = "choose one of these"});
  return result;
}

// Labels of an image that form the body.
struct Taken {
  std::vector<int> chosen;  // by --label and not by --cut; none: all
  std::vector<LabelMeasure> labels, cut_out;
};

// Removes the labels label:NAME of a cut. `where`: its option.
void cut_out(const std::vector<std::string>& labels, const std::string& where, const Scene& scene,
             const LabelImage& image, Taken& taken) {
  const std::vector<int> gone =
      chosen_labels(image, taken.labels, labels, where.c_str(),
                    scene.image.label.empty() ? "the image holds" : "--label takes");
  if (gone.empty()) return;
  const auto is_gone = [&](const LabelMeasure& m) {
    return std::find(gone.begin(), gone.end(), m.value) != gone.end();
  };
  std::copy_if(taken.labels.begin(), taken.labels.end(), std::back_inserter(taken.cut_out), is_gone);
  std::erase_if(taken.labels, is_gone);
  if (taken.labels.empty())
    throw InputError({.fact = "nothing of the body is left without these labels",
                      .where = where,
                      .why = "all labels that form the body are cut out",
                      .remedy = "leave one, or choose more with --label"});
  taken.chosen.clear();
  for (const LabelMeasure& m : taken.labels) taken.chosen.push_back(m.value);
}

Taken take_labels(const RunLog& log, const Scene& scene, const LabelImage& image,
                  const std::map<std::string, int>& names) {
  for (const std::string& warning : image.warnings) log.warn(warning);
  const std::vector<LabelMeasure> present = measure_labels(image);
  Taken taken{.chosen = chosen_labels(image, present, scene.image.label), .labels = {}, .cut_out = {}};
  for (const LabelMeasure& label : present)
    if (taken.chosen.empty() ||
        std::find(taken.chosen.begin(), taken.chosen.end(), label.value) != taken.chosen.end())
      taken.labels.push_back(label);
  cut_out(labels_cut_out_of_undeformed_body(scene), "--cut (image.cut)", scene, image, taken);
  const auto has = [](const std::vector<LabelMeasure>& labels, int value) {
    return std::any_of(labels.begin(), labels.end(), [&](const auto& m) { return m.value == value; });
  };
  std::map<std::string, std::string> requested_for;  // where -> label
  for (const TissueOfLabel& tissue : scene.tissues) requested_for["tissue." + tissue.label] = tissue.label;
  for (const Scene::Support& support : scene.supports)
    if (!support.part) requested_for[fmt::format("support.{}.on", support.name)] = support.label;
  for (const auto& [where, label] : requested_for)
    if (const int value = number_of_label(label, names); !has(taken.labels, value))
      throw InputError({.fact = fmt::format("no part of the body has label '{}'", label),
                        .where = where,
                        .why = has(taken.cut_out, value) ? "--cut removes it"
                               : has(present, value)     ? "--label excludes it"
                                                         : "the image has no such label",
                        .remedy = "`dimple info IMAGE` shows the labels; choose several with --label 1,2, or "
                                  "leave --label out"});
  return taken;
}

void say_labels(const RunLog& log, const Scene& scene, const std::vector<int>& chosen,
                const std::vector<LabelMeasure>& taken, const std::map<std::string, int>& names) {
  log.say(fmt::format("labels   {}: {}", chosen.empty() ? "all" : "chosen", in_words(taken)));
  std::vector<LabelMeasure> alike;  // with the material scene.material
  for (const LabelMeasure& label : taken)
    if (std::none_of(scene.tissues.begin(), scene.tissues.end(), [&](const TissueOfLabel& tissue) {
          return number_of_label(tissue.label, names) == label.value;
        }))
      alike.push_back(label);
  if (chosen.empty() && alike.size() > 1)
    log.warn(
        fmt::format("no --label given: {} labels are merged into one body with one material: {}; choose with "
                    "--label {}, or give one its own material, as in --set tissue.{}.mu=300Pa",
                    alike.size(), in_words(alike), alike.front().value, alike.back().value));
}

// The image with its gaps closed, if requested; `sentence` describes it.
std::optional<ClosedImage> closed(const Scene& scene, const LabelImage& image, const std::vector<int>& labels,
                                  const RunLog& log, std::string& sentence) {
  const double width = scene.image.close_mm;
  if (!(width > 0.0)) return std::nullopt;
  log.doing("closing gaps");
  ClosedImage result = close_gaps(image, labels, width);
  sentence = fmt::format("gaps narrower than {:.4g} mm: {} added ({:.1f} %)", width,
                         volume_in_words(result.added_mm3), 100.0 * result.added_mm3 / result.body_mm3);
  log.say("closed   " + sentence);
  if (const double finest = image.spacing().minCoeff(); 0.5 * width < finest)
    log.warn(
        fmt::format("--close {:.4g}mm closes nothing: the narrowest gap between voxels of {:.4g} mm that it "
                    "could close is {:.4g} mm wide; give at least --close {:.4g}mm",
                    width, finest, finest, 2.0 * finest));
  return result;
}

// Narrow gaps that the model keeps open have a large influence on the force.
void warn_of_narrow_gaps(const Scene& scene, double fraction, const RunLog& log) {
  if (fraction <= most_facing || scene.image.close_mm >= narrow_gap_mm) return;
  log.warn(fmt::format(
      "{:.0f} % of the surface faces another part of it across a gap of less than {:.0f} mm: the walls of "
      "these folds {}; --close {:.0f}mm closes such folds: compare the two forces, which may differ much",
      100.0 * fraction, narrow_gap_mm,
      folds_make_contact(scene, fraction) ? "come into contact in equilibrium, without friction"
                                          : "move freely and pass through each other",
      narrow_gap_mm));
}

}  // namespace

std::string name_of_image(const ModelChoices& choices) {
  return choices.image.file.empty() ? "image in memory" : choices.image.file;
}

std::string sha256_of_image(const ModelChoices& choices, const LabelImage& image) {
  if (!choices.image.file.empty()) return sha256_of_file(choices.image.file);
  const auto bytes_of = [](const auto& numbers, std::size_t count) {
    return std::string_view(reinterpret_cast<const char*>(numbers.data()), count * sizeof(numbers.data()[0]));
  };
  std::string bytes(bytes_of(image.size, image.size.size()));
  bytes += bytes_of(image.to_world.matrix(), 16);
  bytes += bytes_of(image.row_offset, image.row_offset.size());
  bytes += bytes_of(image.run, image.run.size());
  return sha256(bytes);
}

Work work_of(const Scene& scene, const LoadedModel& result) {
  const bool placed = result.model.node_count() > 0;
  const double nodes = static_cast<double>(placed ? result.model.node_count() : scene.node_set.nodes);
  const Requested requested = requested_by(scene);
  const auto& size = result.image.size;
  const double radius_mm = scene.tool ? 1e3 * scene.tool->radius : 0.5 * scene.boundary.indenter_diameter_mm;
  return {
      .voxels = static_cast<double>(size[0]) * static_cast<double>(size[1]) * static_cast<double>(size[2]),
      .nodes = nodes,
      .points =
          placed ? static_cast<double>(result.model.point_count()) : nodes * scheme_of(scene).points_per_node,
      .depths = std::max(static_cast<double>(scene.solver.frames),
                         scene.depth_mm / (longest_step_radii(scene) * radius_mm)),
      .picture = requested.picture,
      .error_bounds = scene.error_bounds,
      .refinement = scene.goal.has_value()};
}

void say_default_stiffness(const RunLog& log, const Scene& scene) {
  if (!scene.given.stiffness)
    log.say(
        fmt::format("material mu {} of swine brain (Horton et al. 2007), as no material was given; for other "
                    "tissues give --mu, --young or --preset",
                    stress_in_words(scene.material.mu_Pa)));
}

TissueOptions tissues_of(const Scene& scene, const std::map<std::string, int>& label_names,
                         const Discretisation& places, const std::vector<LabelMeasure>& taken_out) {
  TissueOptions tissues{.of_label = {}, .density = {}};
  for (const Material& material : materials_of(scene)) tissues.density.push_back(material.density);
  int number = 0;
  for (const TissueOfLabel& tissue : scene.tissues) {
    const std::string& label = tissue.label;
    const int value = number_of_label(label, label_names);
    if (!tissues.of_label.emplace(value, ++number).second)
      throw UsageError({.fact = fmt::format("label {} is given two tissues", value),
                        .where = fmt::format("tissue.{}", label),
                        .why = "one is named by the label's number, another by its name",
                        .remedy = "put the options of both into one section"});
    const bool is_gone = std::any_of(taken_out.begin(), taken_out.end(),
                                     [&](const LabelMeasure& m) { return m.value == value; });
    if (!is_gone && !(places.label.array() == value).any())
      throw InputError({.fact = fmt::format("no tissue of the model has label '{}'", label),
                        .where = fmt::format("tissue.{}", label),
                        .why = "no integration point is in it",
                        .remedy = "`dimple info IMAGE` shows the labels; choose them all with --label, or "
                                  "leave --label out; a model made without tissues has only one"});
  }
  return tissues;
}

namespace {

SegmentedBody body_of(const LabelImage& image, const std::vector<int>& labels,
                      const BoundaryOptions& boundary, const BodyModification& change) {
  return make_body_surface(image, labels,
                           {.indenter_diameter_mm = boundary.indenter_diameter_mm,
                            .smoothing = change.smoothing,
                            .outward_mm = change.outward_voxels * std::cbrt(image.voxel_volume())});
}

// Says the size of the body, what was dropped from it, and how its surface differs from the voxels.
void say_body(const RunLog& log, const SegmentedBody& body) {
  const SegmentReport& segment = body.report;
  for (const std::string& warning : segment.warnings) log.warn(warning);
  if (segment.pieces > 1)
    log.say(fmt::format("organ    {} pieces: kept the largest, dropped {} ({:.2f} %)", segment.pieces,
                        volume_in_words(segment.dropped_volume_mm3),
                        100.0 * segment.dropped_volume_mm3 / segment.label_volume_mm3));
  if (segment.dropped_volume_mm3 > 0.05 * segment.label_volume_mm3)
    log.warn(fmt::format(
        "{:.1f} % of the labelled volume was dropped: its pieces are not connected to the largest",
        100.0 * segment.dropped_volume_mm3 / segment.label_volume_mm3));
  const double volume = segment.voxel_volume_mm3;
  log.say("organ    " + volume_in_words(volume));
  log.detail(
      fmt::format("surface  {:.1f} cm2: {} triangles of {:.2f} mm, smoothed by {:.2f} mm; the enclosed "
                  "volume differs from the "
                  "voxels' by {:+.2f} %",
                  body.surface.area() / 1e2, body.surface.triangles().cols(), segment.step_mm,
                  segment.smoothing_mm, 100.0 * (body.surface.volume() / volume - 1.0)));
}

}  // namespace

Organ read_organ(const Case& given, const ModelOptions& options, const RunLog& log, Result& result) {
  const Scene& scene = given.scene;
  if (scene.image.file.empty() && !given.image)
    throw UsageError({.fact = "no label image was given",
                      .where = "command line",
                      .why = "there is nothing to work on",
                      .remedy = "give one: dimple run IMAGE -o OUT"});
  check_materials(scene, options.scheme);
  check_words(options.boundary);
  const Stopwatch reading;
  log.begin(Part::reading, scene);
  result.image = given.image ? *given.image : read_label_image(scene.image.file, scene.image.label_names);
  if (given.change.image) result.image = given.change.image(result.image);
  Organ organ{.options = options, .labels = {}};
  for (const auto& [value, name] : result.image.names) organ.label_names[name] = value;
  const auto [labels, taken, gone] = take_labels(log, scene, result.image, organ.label_names);
  organ.labels = labels;
  check_walls(scene, result.image, labels, organ.label_names);
  result.labels = taken;
  result.cut.labels = gone;
  result.read_s = reading.seconds();
  result.stages.done("read");
  result.image_words =
      fmt::format("{}, {} x {} x {} voxels of {:.4g} x {:.4g} x {:.4g} mm, axes {}", result.image.format,
                  result.image.stored_size[0], result.image.stored_size[1], result.image.stored_size[2],
                  result.image.stored_spacing.x(), result.image.stored_spacing.y(),
                  result.image.stored_spacing.z(), result.image.orientation);
  log.say(fmt::format("image    {}: {}", name_of_image(scene), result.image_words));
  say_labels(log, scene, labels, taken, organ.label_names);
  say_default_stiffness(log, scene);

  const Stopwatch building;
  organ.closed = closed(scene, result.image, labels, log, organ.closing);
  const LabelImage& image = organ.closed ? organ.closed->image : result.image;
  if (organ.closed) {
    result.closed_mm3 = organ.closed->added_mm3;
    result.stages.done("close gaps");
  }
  log.begin(Part::surface, scene);
  organ.options.boundary.voxel_mm = image.spacing().maxCoeff();
  result.voxel_edges_mm = image.to_world.linear();
  organ.body = std::make_shared<const SegmentedBody>(body_of(image, labels, options.boundary, given.change));
  const SegmentedBody& body = *organ.body;
  grade_to_size(body.surface, organ.options);
  result.stages.done("surface");
  result.segment = body.report;
  say_body(log, body);
  result.facing_fraction = facing_fraction(body.surface, narrow_gap_mm);
  warn_of_narrow_gaps(scene, result.facing_fraction, log);
  result.image_warnings = result.warnings.size();
  result.build_s = building.seconds();
  return organ;
}

PreparedOrgan read_once(const Case& given, const RunObserver& observer) {
  Result read;
  Organ organ = read_organ(given, model_options(given.scene), RunLog{observer, read}, read);
  return {std::move(organ), std::move(read)};
}

LabelAt labels_of(const Scene& scene, const Organ& organ, const LabelImage& image) {
  if (scene.tissues.empty() && !names_labels(scene)) return {};
  return label_finder(organ.closed ? organ.closed->image : image, organ.body->surface);
}

namespace {

// A bonded patch holds one piece of surface: the tool would hold a gap through it open or shut.
void refuse_patch_over_cut(const BodySurface& before, const BodySurface& body, const Boundary& at,
                           double gap) {
  const double step = std::max(0.5 * gap, at.radius / 200.0);
  const auto contact_along = [&](const BodySurface& of, const Vec3& x) {
    const std::vector<double> t = of.crossings(x - 2.0 * at.radius * at.approach, at.approach);
    const auto first = std::find_if(t.begin(), t.end(), [](double s) { return s > 0.0; });
    return first == t.end() ? std::numeric_limits<double>::infinity() : *first;
  };
  const Vec3 e = at.approach.unitOrthogonal(), g = at.approach.cross(e);
  const int most = static_cast<int>(at.radius / step);
  for (int i = -most; i <= most; ++i)
    for (int k = -most; k <= most; ++k) {
      const Vec3 x = at.centre + step * (i * e + k * g);
      if ((x - at.centre).norm() > at.radius) continue;
      if (const double whole = contact_along(before, x); !(contact_along(body, x) > whole + 0.01 * gap))
        continue;
      throw ModelError({.fact = "a cut passes under the bonded patch",
                        .where = "--cut (image.cut) and --indent-at (boundary.indent_at)",
                        .why = fmt::format("the nodes of the patch would hold both faces of the cut at {}",
                                           in_words(body.to_world() * x)),
                        .remedy = "move one of them, or use a contacting tool: --tool sphere:5mm",
                        .code = "cut"});
    }
}

void refuse_without_base(const BodySurface& body, const Boundary& at) {
  for (Index t = 0; t < body.triangles().cols(); ++t)
    if (on_base(at, body.vertex().col(body.triangles()(0, t)), body.normal().col(t))) return;
  throw ModelError({.fact = "the tool is on a piece that the cut has separated from the base",
                    .where = "--cut (image.cut)",
                    .why = "nothing holds that piece",
                    .remedy = "let the cut end in the tissue, or give another --base or --indent-at",
                    .code = "cut"});
}

constexpr double widest_over_gap = 25.0;  // node spacings: see sees() of sight.hpp

std::string sentence_of(const Scene& scene, const ImageFacts::Cut& cut) {
  std::string sentence;
  for (const Cut& one : cuts_of_undeformed_body(scene))
    sentence += fmt::format("{}'{}'", sentence.empty() ? "" : ", ", one.text);
  if (cut.area_mm2 > 0.0)
    sentence +=
        fmt::format(": {:.4g} cm2, its faces {:.4g} mm apart", cut.area_mm2 / 1e2, scene.image.cut_gap_mm);
  if (cut.removed_mm3 > 2.0 * cut.area_mm2 * scene.image.cut_gap_mm)  // more than the gaps: a closed region
    sentence += fmt::format("; {} removed", volume_in_words(cut.removed_mm3));
  if (!cut.labels.empty()) sentence += fmt::format("; removed: {}", in_words(cut.labels));
  return sentence;
}

void warn_of_parted(const RunLog& log, const std::vector<CutPiece>& parted) {
  for (const CutPiece& piece : parted)
    log.warn(fmt::format("the cut separates {} at {} from the part under the tool: it is left out",
                         volume_in_words(piece.volume_mm3), in_words(piece.centre)));
}

// Base and tool keep their places on the body before the cut, `uncut`.
void cut_organ(const Scene& scene, const std::vector<TriangleMesh>& blades, const SegmentedBody& uncut,
               Organ& organ, LoadedModel& result) {
  const BodySurface &before = uncut.surface, &body = organ.body->surface;
  Site site{find_boundary(before, organ.options.boundary), {}, {}};
  auto [surface, removed_mm3, area_mm2, parted, taken] =
      cut(body, blades, scene.image.cut_gap_mm, site.boundary.centre);
  refuse_without_base(surface, site.boundary);
  if (!(organ.options.boundary.contact_radius_mm > 0.0))
    refuse_patch_over_cut(before, surface, site.boundary, scene.image.cut_gap_mm);
  for (CutPiece& piece : parted) piece.centre = surface.to_world() * piece.centre;
  result.cut.area_mm2 = area_mm2, result.cut.removed_mm3 = removed_mm3, result.cut.parted = std::move(parted);
  result.cut.took = [all = std::make_shared<const std::vector<BodySurface>>(std::move(taken)),
                     to_body = before.to_world().inverse()](const Vec3& place) {
    const Vec3 x = to_body * place;
    return std::any_of(all->begin(), all->end(), [&](const BodySurface& one) { return one.contains(x); });
  };
  site = find_site(surface, organ.options, nullptr, &before);
  site.uncut = std::shared_ptr<const BodySurface>(organ.body, &body);
  for (const TriangleMesh& blade : blades)
    for (const auto& x : blade.vertex.colwise())
      if (body.contains(x)) result.cut.sizing = std::max(result.cut.sizing, site.sizing(x));
  const double room = distance_to(blades, site.boundary.centre);
  site.boundary.room = std::min(site.boundary.room, room),
  site.graded.room = std::min(site.graded.room, room);
  SegmentReport report = organ.body->report;
  report.voxel_volume_mm3 *= surface.volume() / body.volume();
  organ.site = std::make_shared<const Site>(std::move(site));
  organ.body = std::make_shared<const SegmentedBody>(SegmentedBody{std::move(surface), report});
  result.segment = std::move(report);
  result.stages.done("cut");
}

// The body without the removed labels, in the frame of the whole body.
SegmentedBody without_labels(const LabelImage& image, const SegmentedBody& whole, const Organ& organ) {
  SegmentedBody remaining = body_of(image, organ.labels, organ.options.boundary, {});
  const Eigen::Isometry3d to_frame = whole.surface.to_world().inverse() * remaining.surface.to_world();
  BodySurface surface((to_frame * remaining.surface.vertex().colwise().homogeneous()).eval(),
                      remaining.surface.triangles(), whole.surface.to_world());
  surface.ends_with_image(whole.surface.image_ends());
  return {std::move(surface), remaining.report};
}

}  // namespace

Organ cut_by_steps(const Scene& scene, const Organ& whole, const LabelImage& image, const StepCuts& cuts,
                   const RunLog& log, LoadedModel& result) {
  const Stopwatch cutting;
  Organ organ = whole;
  if (!cuts.labels.empty()) {
    Taken taken{.chosen = {}, .labels = result.labels, .cut_out = {}};
    cut_out(cuts.labels, cuts.where, scene, image, taken);
    result.labels = taken.labels;
    result.cut.labels.insert(result.cut.labels.end(), taken.cut_out.begin(), taken.cut_out.end());
  }
  if (cuts.has_taken_labels) {
    organ.labels.clear();
    for (const LabelMeasure& m : result.labels) organ.labels.push_back(m.value);
    organ.body = std::make_shared<const SegmentedBody>(
        without_labels(organ.closed ? organ.closed->image : image, *whole.body, organ));
    result.segment = organ.body->report;
  }
  std::vector<TriangleMesh> blades = blades_of(scene, *whole.body);
  const Eigen::Isometry3d to_body = whole.body->surface.to_world().inverse();
  for (TriangleMesh sheet : cuts.sheets) {
    sheet.vertex = (to_body * sheet.vertex.colwise().homogeneous()).eval();
    blades.push_back(std::move(sheet));
  }
  const std::size_t parted = result.cut.parted.size();
  try {
    cut_organ(scene, blades, *whole.body, organ, result);
  } catch (const ModelError& error) {
    Report report = error.report;
    report.where = cuts.where;
    throw ModelError(report);
  }
  if (result.cut.parted.size() > parted) warn_of_parted(log, result.cut.parted);
  result.provenance["cut"] = sentence_of(scene, result.cut);
  result.build_s += cutting.seconds();
  return organ;
}

void find_site(const Scene& scene, const RunLog& log, Organ& organ, LoadedModel& result) {
  const Stopwatch finding;
  log.begin(Part::node_set, scene);
  if (has_cuts(scene)) {
    const std::shared_ptr<const SegmentedBody> before = organ.body;
    if (const std::vector<TriangleMesh> blades = blades_of(scene, *before); !blades.empty())
      cut_organ(scene, blades, *before, organ, result);
    log.say("cut      " + (result.provenance["cut"] = sentence_of(scene, result.cut)));
    warn_of_parted(log, result.cut.parted);
  }
  if (!organ.site) organ.site = std::make_shared<const Site>(find_site(organ.body->surface, organ.options));
  result.stages.done("boundary");
  result.build_s += finding.seconds();
}

Discretisation place_nodes(const Scene& scene, const Organ& organ, const ModelOptions& options,
                           const LabelImage& image, const RunLog& log, LoadedModel& result,
                           const Discretised* made) {
  const Stopwatch building;
  const SegmentReport& segment = result.segment;
  log.begin(Part::node_set, scene);
  auto [places, report] =
      made ? *made : discretise(organ.body->surface, options, labels_of(scene, organ, image), *organ.site);
  result.stages.add(report.stages);
  if (options.boundary.is_pressed)
    for (const std::string& warning : report.boundary.warnings) log.warn(warning);
  if (const std::string bends = warning_of_bending(organ.body->surface, report.boundary);
      !bends.empty() && options.boundary.is_pressed)
    log.warn(bends);
  result.build_s += building.seconds();
  log.say(fmt::format("model    {}; {} integration points", nodes_in_words(places.node_count(), report),
                      places.point_count()));
  log.detail(fmt::format(
      "nodes    {} on the surface; nearest node {:.2f} +- {:.2f}, at least {:.2f}, largest gap {:.2f} "
      "spacings",
      report.surface_nodes, report.evenness.mean, report.evenness.spread * report.evenness.mean,
      report.evenness.minimum, report.evenness.fill));
  log.detail(fmt::format(
      "points   in cells of {}{:.3f} mm, {} clipped by the surface, {} slivers merged; volume {}, {:+.3f} % "
      "of the organ's",
      options.scheme.averaged_gradients ? "up to " : "", report.cell_mm, report.clipped, report.merged,
      volume_in_words(report.grid_volume_mm3),
      100.0 * (report.grid_volume_mm3 / segment.voxel_volume_mm3 - 1.0)));
  if (const double apart = result.cut.sizing * report.spacing_mm, gap = scene.image.cut_gap_mm;
      apart > widest_over_gap * gap)
    log.warn(
        fmt::format("a cut extends to nodes {} apart, whose supports bridge a gap of {}; give more --nodes, "
                    "or a wider gap with --set image.cut_gap={:.2g}mm",
                    length_in_words(apart), length_in_words(gap), apart / widest_over_gap));
  const FacesAlongVoxels flat = faces_along_voxels(organ.body->surface, report.boundary);
  if (scene.base_is_held)
    log.say(fmt::format("base     {} nodes: {}{}", places.base.size(), report.boundary.base_reason,
                        flat.base.empty() ? "" : "; " + flat.base));
  if (options.boundary.is_pressed && !flat.tool.empty()) log.say("flat     " + flat.tool);
  const std::string centre = in_words(places.tool.centre * 1e3);
  if (options.boundary.contact_radius_mm > 0.0 && options.boundary.is_pressed)
    log.say(fmt::format(
        "contact  nodes are refined around the expected contact, {:.1f} mm in diameter, at {}: {}",
        2e3 * places.tool.radius, centre, report.boundary.patch_reason));
  else if (options.boundary.is_pressed)
    log.say(fmt::format("contact  {} nodes, {} on the edge, {:.1f} mm across at {}: {}", report.patch_nodes,
                        report.patch_edge_nodes, 2e3 * places.tool.radius, centre,
                        report.boundary.patch_reason));

  const Vec3& approach = places.tool.approach;
  result.chosen = {{"cloud.spacing_mm", fmt::format("{:.4f} mm", report.spacing_mm)},
                   {"cloud.nodes", fmt::format("{} nodes", places.node_count())},
                   {"grid.points", fmt::format("{} points", places.point_count())},
                   {"boundary.base", report.boundary.base_reason},
                   {"boundary.base_depth_mm", fmt::format("{:.3f} mm", report.boundary.base_depth)},
                   {"boundary.indent_at", fmt::format("{}: {}", centre, report.boundary.patch_reason)},
                   {"boundary.direction",
                    fmt::format("({:.4f}, {:.4f}, {:.4f})", approach.x(), approach.y(), approach.z())},
                   {"image.label", in_words(result.labels)}};
  result.provenance["labels"] = result.chosen["image.label"];
  result.provenance["base"] = report.boundary.base_reason;
  result.provenance["circle"] = report.boundary.patch_reason;
  result.provenance["dimple"] = DIMPLE_VERSION;
  if (!organ.closing.empty()) result.provenance["closed"] = organ.closing;
  result.report = std::move(report);
  return std::move(places);
}

}  // namespace dimple
