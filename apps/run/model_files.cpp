#include "apps/run/model_files.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <sstream>

#include "apps/scene/option.hpp"
#include "apps/scene/scene.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/table.hpp"
#include "io/text.hpp"
#include "io/units.hpp"
#include "io/words.hpp"
#include "preprocess/nodes/neighbours.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr int base_bit = 1, patch_bit = 2;

Points to_mm(const Points& x) {
  return x.unaryExpr(&millimetres);
}
Points to_m(const Points& x) {
  return x.unaryExpr(&metres);
}

Field node_set_field(const Discretisation& model) {
  Field field{.name = "node_set",
              .unit = "",
              .values = Eigen::MatrixXd::Zero(1, model.node_count()),
              .components = {},
              .type = Field::Type::int32};
  for (const Index a : model.base) field.values(0, a) += base_bit;
  for (const Index a : model.bonded_patch) field.values(0, a) += patch_bit;
  return field;
}

[[noreturn]] void refuse(const fs::path& file, const std::string& fact, const std::string& why,
                         const std::string& remedy) {
  throw InputError({.fact = fact, .where = file.string(), .why = why, .remedy = remedy});
}

PointFile read_points(const fs::path& file) {
  if (file.extension() == ".vtu") {
    PointFile points = read_vtu(file);
    // Earlier versions wrote names without units, and without the array its numbers would be estimated.
    for (const auto& [before, now] :
         {std::pair{"spacing", "spacing_mm"}, {"volume", "volume_mm3"}, {"spread", "spread_mm2"}})
      if (points.find(before) && !points.find(now))
        refuse(file, fmt::format("its array '{}' has no unit in its name", before),
               "the file was written by an earlier version or by something else",
               fmt::format("make the model again with `dimple model`, or name the array {}", now));
    return points;
  }
  if (file.extension() != ".csv")
    refuse(file, fmt::format("'{}' is neither .vtu nor .csv", file.filename().string()),
           "the suffix determines the format of a list", "give nodes and points as .vtu or .csv");
  const Table table = read_csv(file);
  if (table.rows() == 0)
    refuse(file, "the list is empty", "it has a header and no rows", "give at least a few hundred locations");
  PointFile points;
  points.position_mm.resize(3, static_cast<Index>(table.rows()));
  const std::array<const char*, 3> axes = {"x_mm", "y_mm", "z_mm"};
  for (int d = 0; d < 3; ++d) {
    const auto* column = table.find(axes[static_cast<std::size_t>(d)]);
    if (!column)
      refuse(file, fmt::format("there is no column {}", axes[static_cast<std::size_t>(d)]),
             "locations need three coordinates", "name the columns x_mm,y_mm,z_mm");
    points.position_mm.row(d) =
        Eigen::Map<const Eigen::RowVectorXd>(column->data(), points.position_mm.cols());
  }
  for (const char* name : {"spacing_mm", "node_set", "volume_mm3"})
    if (const auto* column = table.find(name))
      points.fields.push_back(
          {.name = name,
           .unit = "",
           .values = Eigen::Map<const Eigen::RowVectorXd>(column->data(), points.position_mm.cols())});
  return points;
}

// Numbers of a list must be possible for a body: a damaged file, or another unit, is refused here and not by
// a later computation.
void require_places(const fs::path& file, const Points& position_mm) {
  constexpr double farthest_mm = 1e6;
  for (Index n = 0; n < position_mm.cols(); ++n)
    if (!(position_mm.col(n).cwiseAbs().maxCoeff() <= farthest_mm))
      refuse(file,
             fmt::format("location {} is ({:.6g}, {:.6g}, {:.6g}) mm", n, position_mm(0, n),
                         position_mm(1, n), position_mm(2, n)),
             "no organ is more than a kilometre from the origin",
             "correct that location, or the unit of the list");
}

// A millionth of a millimetre is zero on the grid of files.
void require_positive(const fs::path& file, const Field& field, const std::string& what,
                      const std::string& why) {
  for (const double value : field.values.row(0))
    if (!(value > 1e-6) || !std::isfinite(value))
      refuse(file, fmt::format("{} is {}, not positive", what, value), why,
             "correct the column, or leave it out");
}

void require_whole(const fs::path& file, const Field& field, double most) {
  for (const double value : field.values.row(0))
    if (!(value >= 0.0 && value <= most) || value != std::floor(value))
      refuse(file, fmt::format("{} is {}", field.name, value),
             fmt::format("it is a whole number from 0 to {}", most), "correct the column, or leave it out");
}

// Mean distance to the six nearest neighbours, the spacing of even nodes in make_node_set().
Eigen::VectorXd estimate_spacing(const Points& X) {
  const Neighbours tree(X);
  Eigen::VectorXd spacing(X.cols());
  for (Index a = 0; a < X.cols(); ++a) {
    double sum = 0.0;
    const auto near = tree.nearest(X.col(a), 7);
    for (const int b : near) sum += (X.col(b) - X.col(a)).norm();
    spacing[a] = sum / static_cast<double>(std::max<std::size_t>(near.size() - 1, 1));
  }
  // Nodes on the surface have half a neighbourhood; the median represents all nodes.
  std::vector<double> sorted(spacing.begin(), spacing.end());
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                   sorted.end());
  return Eigen::VectorXd::Constant(X.cols(), metres(1e3 * sorted[sorted.size() / 2]));
}

// Volume of a regular grid's cell, from the median distance to the nearest point.
double estimate_cell_volume(const Points& points_mm) {
  const Neighbours tree(points_mm);
  std::vector<double> nearest;
  for (Index q = 0; q < points_mm.cols(); ++q)
    nearest.push_back(tree.distance_to_nearest(points_mm.col(q), static_cast<int>(q)));
  std::nth_element(nearest.begin(), nearest.begin() + static_cast<std::ptrdiff_t>(nearest.size() / 2),
                   nearest.end());
  return std::pow(nearest[nearest.size() / 2], 3);
}

// Node sets of lists of locations without them. The base is the flat end towards which the tool moves, the
// bonded patch is what the tool meets first.
void choose_sets_by_place(ModelFiles& files) {
  Discretisation& model = files.places;
  const Vec3 approach = model.tool.approach;
  const double h = model.spacing[0];
  const Eigen::VectorXd depth = model.X.transpose() * approach;
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 d = model.X.col(a) - model.tool.centre;
    const double lateral = (d - d.dot(approach) * approach).norm();
    if (depth.maxCoeff() - depth[a] < 0.35 * h)
      model.base.push_back(a);
    else if (lateral <= model.tool.radius * (1.0 + 1e-9) && std::abs(d.dot(approach)) < 0.35 * h)
      model.bonded_patch.push_back(a);
  }
  files.notes.push_back(
      fmt::format("nodes have no node_set: {} within a third of a spacing of the far end are the base, {} "
                  "within the contact patch and as near to its plane are the tool's",
                  model.base.size(), model.bonded_patch.size()));
}

Vec3 vector_of(const toml::table& table, const std::string& section, const std::string& key,
               const fs::path& file) {
  const toml::array* list = table[section][key].as_array();
  Vec3 v;
  bool good = list && list->size() == 3;
  for (std::size_t d = 0; good && d < 3; ++d) {
    const auto number = (*list)[d].value<double>();
    good = number && std::isfinite(*number);
    if (good) v[static_cast<Index>(d)] = *number;
  }
  if (!good)
    refuse(file, fmt::format("{}.{} is not a list of three numbers", section, key), "the model needs it",
           fmt::format("write for instance {} = [0.0, 0.0, -1.0] under [{}]", key, section));
  return v;
}

toml::table table_of(const fs::path& file) {
  if (!fs::exists(file))
    refuse(file, "there is no model in this folder", "a model is a folder with a model.toml",
           "make one with `dimple model IMAGE -o MODEL`");
  toml::table table;
  try {
    table = toml::parse(read_file(file, most_bytes_of_text), file.string());
  } catch (const toml::parse_error& error) {
    refuse(file, fmt::format("not valid TOML: {}", error.description()),
           fmt::format("line {}, column {}", error.source().begin.line, error.source().begin.column),
           "correct that line");
  }
  if (table["format"].value_or(std::string()) != "dimple model 1")
    refuse(file, "the format is not \"dimple model 1\"",
           "the file was made by something else, or by another version",
           "add format = \"dimple model 1\" if it follows it");
  return table;
}

fs::path next_to(const fs::path& file, const toml::table& table, const char* key) {
  const auto name = table[key].value<std::string>();
  if (!name || name->empty())
    refuse(file, fmt::format("it does not name the file of the {}", key),
           fmt::format("the key {} is missing", key), fmt::format("add {} = \"{}.vtu\" or a .csv", key, key));
  return file.parent_path() / *name;
}

void take_spacing(const fs::path& file, const PointFile& nodes, ModelFiles& files) {
  Discretisation& model = files.places;
  if (const Field* spacing = nodes.find("spacing_mm")) {
    require_positive(file, *spacing, "a node's spacing", "supports are sized by it");
    model.spacing = spacing->values.row(0).transpose().unaryExpr(&metres);
    return;
  }
  model.spacing = estimate_spacing(model.X);
  if (!(model.spacing[0] > 0.0))
    refuse(file, "most nodes are at one place", "their spacing is derived from their distances",
           "give each node a place of its own");
  files.notes.push_back(
      fmt::format("nodes have no spacing: {:.3f} mm is used, the median distance to the six nearest",
                  millimetres(model.spacing[0])));
}

// A list of locations may have been written by hand.
void require_each_node_once(const fs::path& file, const Points& X) {
  if (file.extension() != ".csv" || X.cols() < 2) return;
  const Neighbours tree(X);
  for (Index a = 0; a < X.cols(); ++a)
    for (const Index b : tree.nearest(X.col(a), 2))
      if (b != a && X.col(b) == X.col(a))
        refuse(file,
               fmt::format("nodes {} and {} are both at {}", std::min(a, b), std::max(a, b),
                           in_words(to_mm(X.col(a)))),
               "two nodes at one place cannot move apart", "leave one of them out");
}

void take_volume(const fs::path& file, const PointFile& points, ModelFiles& files) {
  Discretisation& model = files.places;
  if (const Field* volume = points.find("volume_mm3")) {
    require_positive(file, *volume, "a point's volume", "each point represents a volume of tissue");
    model.volume = volume->values.row(0).transpose().unaryExpr(&cubic_metres);
    return;
  }
  const double cell = estimate_cell_volume(points.position_mm);
  if (!(cell > 1e-6) || !std::isfinite(cell))
    refuse(file, "most points are at one place, or there is only one",
           "their volume is derived from their distances",
           "give each point a place of its own, or a volume_mm3");
  model.volume = Eigen::VectorXd::Constant(model.point_count(), cubic_metres(cell));
  files.notes.push_back(
      fmt::format("points have no volume: each is a cell of {:.3f} mm^3, the cube of their distance", cell));
}

void take_axes(const fs::path& file, const toml::table& table, Mat3& to) {
  const toml::array* axes = table["axes"].as_array();
  if (!axes || axes->size() != 3) return;
  for (int d = 0; d < 3; ++d)
    if (const toml::array* axis = (*axes)[static_cast<std::size_t>(d)].as_array(); axis && axis->size() == 3)
      for (int i = 0; i < 3; ++i)
        to(i, d) = (*axis)[static_cast<std::size_t>(i)].value_or(i == d ? 1.0 : 0.0);
  if (!((to.colwise().norm().array() - 1.0).abs().maxCoeff() < 1e-6) || !to.allFinite())
    refuse(file, "axes are not three unit vectors", "the points' cells are aligned with them",
           "write axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], or leave the line out");
}

void take_labels(const fs::path& file, const PointFile& points, Discretisation& model) {
  model.label = Eigen::VectorXi::Zero(model.point_count());
  if (const Field* label = points.find("label")) {
    require_whole(file, *label, std::numeric_limits<int>::max());
    model.label = label->values.row(0).transpose().cast<int>();
  }
}

void take_spread(const fs::path& file, const PointFile& points, ModelFiles& files) {
  Discretisation& model = files.places;
  if (const Field* spread = points.find("spread_mm2"); spread && spread->values.rows() == 6) {
    if (!spread->values.allFinite())
      refuse(file, "a point's spread is not finite", "it is the size of the point's cell",
             "correct the column, or leave it out");
    model.second_moments = spread->values.unaryExpr(&square_metres);
    return;
  }
  model.second_moments = SecondMoments::Zero(6, model.point_count());
  for (int d = 0; d < 3; ++d)
    model.second_moments.row(d) = model.volume.transpose().array().pow(2.0 / 3.0) / 12.0;
  files.notes.push_back("points have no spread: each is a cube of its volume");
}

void take_tool(const fs::path& file, const toml::table& table, ToolPlace& tool) {
  tool.centre = to_m(vector_of(table, "indenter", "centre_mm", file));
  tool.approach = vector_of(table, "indenter", "push", file);
  if (!(std::abs(tool.approach.norm() - 1.0) < 1e-6)) {
    if (!(tool.approach.stableNorm() > 0.0))
      refuse(file, "indenter.push is zero", "the tool must move somewhere", "write push = [0.0, 0.0, -1.0]");
    tool.approach.stableNormalize();
  }
  const double diameter_mm = table["indenter"]["diameter_mm"].value_or(10.0);
  if (!(diameter_mm > 1e-6 && diameter_mm <= 1000.0))
    refuse(file, fmt::format("indenter.diameter_mm is {}", diameter_mm),
           "the contact patch is above 0 to 1000 mm wide", "write for instance diameter_mm = 10");
  tool.radius = metres(0.5 * diameter_mm);
}

void take_sets(const fs::path& file, const PointFile& nodes, ModelFiles& files) {
  Discretisation& model = files.places;
  if (const Field* set = nodes.find("node_set")) {
    require_whole(file, *set, base_bit | patch_bit);
    for (Index a = 0; a < model.node_count(); ++a) {
      const int bits = static_cast<int>(set->values(0, a));
      if (bits == (base_bit | patch_bit))
        refuse(file,
               fmt::format("node {} at {} belongs to the base and to the contact patch", a,
                           in_words(to_mm(model.X.col(a)))),
               "its node_set is 3, and the base is fixed while the contact patch moves",
               "set its node_set to 1 or to 2");
      if (bits & base_bit) model.base.push_back(a);
      if (bits & patch_bit) model.bonded_patch.push_back(a);
    }
  } else {
    choose_sets_by_place(files);
  }
  if (model.base.empty())
    refuse(file, "no node belongs to the base", "node_set has no odd number, or no node is at the far end",
           "set node_set to 1 for the nodes to hold");
  if (model.bonded_patch.empty())
    refuse(file, "no node belongs to the contact patch",
           "node_set has no 2, or the contact patch misses the nodes",
           "set node_set to 2 for the nodes to move, or correct indenter.centre_mm");
}

std::string scheme_named_in(const fs::path& file, const toml::table& table, const Scheme& otherwise) {
  std::string name = table["scheme"].value_or(std::string(otherwise.name));
  if (!scheme_named(name))
    refuse(file, fmt::format("there is no scheme '{}'", name), "it defines the use of the points",
           "write scheme = \"converging\" or \"horton2007\"");
  return name;
}

// Scheme of a model, with the supports of its file.
Scheme scheme_in(const fs::path& file, const toml::table& table, const std::string& name) {
  ModelChoices choices;
  if (const auto node = table["support"]["radius_factor"]; node) {
    std::ostringstream shown;
    node.visit([&](auto&& v) { shown << v; });
    set_value({.key = "support.radius_factor",
               .value = &choices.support_radius_factor,
               .most = 10.0,
               .help = "support radius in spacings; 0: as the scheme has it"},
              shown.str(), file.string());
  }
  for (const auto& [key, word] : {std::pair{"basis", "linear"}, std::pair{"weight", "quartic"}})
    if (table["support"][key].value_or(std::string(word)) != word)
      refuse(file, fmt::format("support.{} is not '{}'", key, word), "earlier versions had other values",
             fmt::format("remove support.{}", key));
  choices.scheme = name;
  Scheme scheme = scheme_of(choices);
  double& interpolation = scheme.support.interpolation;
  interpolation = table["support"]["interpolation"].value_or(0.0);
  if (!(interpolation >= 0.0 && interpolation <= 1.0))
    refuse(file, fmt::format("support.interpolation is {}", interpolation), "it is a number from 0 to 1",
           "write interpolation = 0.01");
  return scheme;
}

}  // namespace

void write_model(const fs::path& folder, const Discretisation& model, const Scheme& scheme,
                 const std::map<std::string, std::string>& provenance, double facing_fraction) {
  using Type = Field::Type;
  make_folder(folder);
  write_vtu(folder / "nodes.vtu",
            {.position_mm = to_mm(model.X),
             .fields = {{.name = "spacing_mm",
                         .unit = "mm",
                         .values = model.spacing.transpose().unaryExpr(&millimetres),
                         .type = Type::real64},
                        node_set_field(model)},
             .small = true},
            0.0, true);
  std::vector<Field> fields = {
      {.name = "volume_mm3",
       .unit = "mm^3",
       .values = model.volume.transpose().unaryExpr(&cubic_millimetres),
       .type = Type::real64},
      {.name = "label", .unit = "", .values = model.label.transpose().cast<double>(), .type = Type::int32}};
  if (model.second_moments.cols() > 0)
    fields.push_back({.name = "spread_mm2",
                      .unit = "mm^2",
                      .values = model.second_moments.unaryExpr(&square_millimetres),
                      .components = {"XX", "YY", "ZZ", "XY", "YZ", "XZ"},
                      .type = Type::real64});
  write_vtu(folder / "points.vtu", {.position_mm = to_mm(model.point), .fields = fields, .small = true}, 0.0,
            true);
  if (!model.surface.empty())
    write_vtp(folder / "surface.vtp",
              {.position_mm = model.surface.vertex_mm,
               .triangles = model.surface.triangles,
               .fields = {},
               .small = true},
              0.0, true);

  const auto list = [](const Vec3& v) {
    std::ostringstream out;
    out << toml::array{v.x(), v.y(), v.z()};
    return out.str();
  };
  std::string text =
      "# A model for `dimple solve`. Positions are LPS, in millimetres.\nformat = \"dimple model 1\"\n" +
      fmt::format("scheme = \"{}\"\n", scheme.name) +
      "nodes = \"nodes.vtu\"    # or a .csv with columns x_mm,y_mm,z_mm (and spacing_mm, node_set: 1 base, 2 "
      "indenter)\n"
      "points = \"points.vtu\"  # or a .csv with columns x_mm,y_mm,z_mm (and volume_mm3)\n";
  if (!model.surface.empty()) text += "surface = \"surface.vtp\"\n";
  text +=
      fmt::format("facing_share = {}  # of the surface: what faces another part of it across 4 mm or less\n",
                  facing_fraction);
  const Vec3 centre = to_mm(model.tool.centre);
  if (!model.axes.isIdentity(0.0))
    text += fmt::format("axes = [{}, {}, {}]  # of the image, as unit vectors\n", list(model.axes.col(0)),
                        list(model.axes.col(1)), list(model.axes.col(2)));
  text += fmt::format("\n[indenter]\ncentre_mm = {}\npush = {}\ndiameter_mm = {}\n", list(centre),
                      list(model.tool.approach), 2.0 * millimetres(model.tool.radius));
  text += fmt::format("\n[support]\nradius_factor = {}\ninterpolation = {}\n", scheme.support.radius_factor,
                      scheme.support.interpolation);
  text += "\n[made_from]\n";
  for (const auto& [key, value] : provenance) text += fmt::format("{} = {}\n", key, toml_string(value));
  write_file(folder / "model.toml", text);
}

ModelFiles read_model(const fs::path& path) {
  const fs::path file = fs::is_directory(path) ? path / "model.toml" : path;
  const toml::table table = table_of(file);
  ModelFiles files;
  Discretisation& model = files.places;
  const fs::path node_file = next_to(file, table, "nodes"), point_file = next_to(file, table, "points");
  const PointFile nodes = read_points(node_file), points = read_points(point_file);
  require_places(node_file, nodes.position_mm);
  require_places(point_file, points.position_mm);
  model.X = to_m(nodes.position_mm);
  model.point = to_m(points.position_mm);
  require_each_node_once(node_file, model.X);
  take_spacing(node_file, nodes, files);
  take_volume(point_file, points, files);
  const std::string scheme = scheme_named_in(file, table, files.scheme);
  take_axes(file, table, model.axes);
  take_labels(point_file, points, model);
  if (scheme_named(scheme)->averaged_gradients) take_spread(point_file, points, files);
  take_tool(file, table, model.tool);
  take_sets(node_file, nodes, files);
  files.scheme = scheme_in(file, table, scheme);
  files.facing_fraction = table["facing_share"].value_or(0.0);
  if (const auto surface = table["surface"].value<std::string>()) {
    SurfaceFile read = read_vtp(file.parent_path() / *surface);
    model.surface = {std::move(read.position_mm), std::move(read.triangles)};
  }
  if (const toml::table* made = table["made_from"].as_table())
    for (const auto& [key, value] : *made)
      if (const auto text = value.value<std::string>()) files.provenance[std::string(key.str())] = *text;
  return files;
}

}  // namespace dimple
