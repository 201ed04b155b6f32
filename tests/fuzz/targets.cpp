#include "tests/fuzz/targets.hpp"

#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "apps/run/model_files.hpp"
#include "apps/scene/resolve.hpp"
#include "io/error.hpp"
#include "io/label_image.hpp"
#include "io/label_names.hpp"
#include "io/table.hpp"
#include "io/vtk_files.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

/// A folder of this process; with TMPDIR=/dev/shm it is in memory.
class Folder {
 public:
  Folder() : path_(fs::temp_directory_path() / ("dimple_fuzz_" + std::to_string(::getpid()))) {
    fs::create_directories(path_);
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

const fs::path& folder() {
  static const Folder the_folder;
  return the_folder.path();
}

fs::path file_of(const char* name, std::string_view bytes) {
  fs::path file = folder() / name;
  std::ofstream out(file, std::ios::binary | std::ios::trunc);
  out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return file;
}

void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "finding: not so: %s\n", what);
  std::abort();
}

/// Calls `read`; a refusal must have all four parts. Other exceptions pass: they are findings.
void read_or_refuse(const auto& read) {
  try {
    read();
  } catch (const Error& error) {
    require(error.code == ExitCode::input || error.code == ExitCode::usage, "a bad file ends with 2 or 3");
    const Report& r = error.report;
    require(!r.fact.empty() && !r.where.empty() && !r.why.empty() && !r.remedy.empty(),
            "an error says fact, place, reason and remedy");
  }
}

void check(const LabelImage& image) {
  for (const Index n : image.size) require(n > 1, "an image has two voxels along each axis");
  require(static_cast<Index>(image.row_offset.size()) == image.size[1] * image.size[2] + 1 &&
              image.row_offset.front() == 0 && image.row_offset.back() == image.run.size(),
          "an image has all its rows");
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j) {
      Run before{0, 0, 0};
      for (const Run& run : image.row(j, k)) {
        require(run.label > 0, "labels are positive");
        require(run.begin < run.end && run.end <= image.size[0], "a run lies in its row");
        require(run.begin > before.end || (run.begin == before.end && run.label != before.label),
                "runs ascend and are as long as they can be");
        before = run;
      }
    }
  require(!image.run.empty(), "an image holds an organ");
  require(image.to_world.matrix().allFinite(), "an image lies somewhere");
  require(image.to_world.linear().determinant() > 0.0, "an image is not inside out");
  for (const LabelMeasure& m : measure_labels(image))
    require(m.voxels > 0 && m.pieces > 0 && m.centre_mm.allFinite(), "labels can be measured");
}

void image(const char* name, std::string_view bytes) {
  const fs::path file = file_of(name, bytes);
  read_or_refuse([&] { check(read_label_image(file)); });
}

/// Header and voxels in one file; if the header names two files, both have the same bytes.
void nifti(std::string_view bytes) {
  const bool is_pair = bytes.size() > 347 && bytes.substr(344, 3) == "ni1";
  if (is_pair) file_of("image.img", bytes);
  image(is_pair ? "image.hdr" : "image.nii", bytes);
}

void nrrd(std::string_view bytes) {
  image("image.seg.nrrd", bytes);
}

void metaimage(std::string_view bytes) {
  image("image.mha", bytes);
}

void label_names(std::string_view bytes) {
  const fs::path file = file_of("names.txt", bytes);
  read_or_refuse([&] {
    const auto names = read_label_names(file).names;
    require(!names.empty(), "a table names a label");
    for (const auto& [label, name] : names) require(label > 0 && !name.empty(), "labels have names");
  });
}

void table(std::string_view bytes) {
  const fs::path file = file_of("table.csv", bytes);
  read_or_refuse([&] {
    const Table read = read_csv(file);
    require(!read.header.empty() && read.header.size() == read.column.size(), "each column has a name");
    for (const auto& column : read.column) {
      require(column.size() == read.rows(), "columns are equally long");
      for (const double value : column) require(std::isfinite(value), "a table holds finite numbers");
    }
  });
}

/// Values in a file of options, without the remarks on their origin.
std::string values_in(std::string toml) {
  for (auto at = toml.find("  # "); at != std::string::npos; at = toml.find("  # ", at))
    toml.erase(at, toml.find('\n', at) - at);
  return toml;
}

/// Reads the bytes as a description; reading it, writing it and reading it again gives the same.
void config(std::string_view bytes) {
  const fs::path file = file_of("config.toml", bytes);
  read_or_refuse([&] {
    Description read;
    read_config(read, file);
    const std::string written = to_toml(read, {});
    const fs::path again = file_of("again.toml", written);
    Description second;
    try {
      read_config(second, again);
    } catch (const Error& error) {
      std::fprintf(stderr, "%s\n%s\n%s\n", error.report.fact.c_str(), error.report.where.c_str(),
                   written.c_str());
      require(false, "a configuration that was written is read");
    }
    const bool same =
        values_in(to_toml(second, {})) == values_in(written) && option_values(second) == option_values(read);
    if (!same) std::fprintf(stderr, "%s\n----\n%s\n", written.c_str(), to_toml(second, {}).c_str());
    require(same, "a configuration survives writing and reading");
    for (const Material& material : materials_of(resolve(read)))
      require(material.density > 0.0, "tissue has mass");
  });
}

/// model.toml next to two lists of eight locations each.
void model(std::string_view bytes) {
  static const bool lists_are_there = [] {
    std::string nodes = "x_mm,y_mm,z_mm,spacing_mm,node_set\n", points = "x_mm,y_mm,z_mm,volume_mm3\n";
    for (int c = 0; c < 8; ++c) {
      const std::string at =
          std::to_string(c & 1) + "," + std::to_string(c >> 1 & 1) + "," + std::to_string(c >> 2 & 1);
      nodes += at + ",1," + (c < 4 ? "1\n" : "2\n");
      points += at + ",1\n";
    }
    file_of("nodes.csv", nodes);
    file_of("points.csv", points);
    return true;
  }();
  static_cast<void>(lists_are_there);
  const fs::path file = file_of("model.toml", bytes);
  read_or_refuse([&] {
    const ModelFiles read = read_model(file);
    const Discretisation& m = read.places;
    require(m.X.allFinite() && m.point.allFinite() && m.axes.allFinite(), "a model lies somewhere");
    require(m.spacing.size() == m.X.cols() && m.spacing.minCoeff() > 0.0, "nodes have a spacing");
    require(m.volume.size() == m.point.cols() && m.volume.minCoeff() > 0.0, "points have a volume");
    require(m.tool.radius > 0.0 && std::isfinite(m.tool.radius), "the circle has a size");
    require(m.tool.centre.allFinite() && std::abs(m.tool.approach.norm() - 1.0) < 1e-6, "the tool moves");
    require(!m.base.empty() && !m.bonded_patch.empty(), "some nodes are held and some pushed");
    require(read.scheme.support.interpolation >= 0.0 && std::isfinite(read.scheme.support.interpolation),
            "supports have a weight");
  });
}

/// Reads a fixed model with the bytes as its list of nodes.
void locations(std::string_view bytes) {
  file_of("nodes.csv", bytes);
  file_of("points.csv", bytes);
  const fs::path file =
      file_of("model.toml",
              "format = \"dimple model 1\"\nnodes = \"nodes.csv\"\npoints = \"points.csv\"\n"
              "[indenter]\ncentre_mm = [0.5, 0.5, 1]\npush = [0, 0, -1]\ndiameter_mm = 2\n");
  read_or_refuse([&] {
    const Discretisation m = read_model(file).places;
    require(m.X.allFinite() && m.spacing.size() == m.X.cols(), "each node has a spacing");
    require(m.spacing.allFinite() && m.spacing.minCoeff() > 0.0, "and it is positive");
    require(m.volume.allFinite() && m.volume.minCoeff() > 0.0, "points have a volume");
    for (const Index a : m.base) require(a < m.X.cols(), "the base is made of nodes");
  });
}

void check(const Points& position_mm, const std::vector<Field>& fields) {
  require(position_mm.cols() > 0 && position_mm.allFinite(), "points lie somewhere");
  for (const Field& field : fields) {
    require(field.values.cols() == position_mm.cols(), "a field has a value for each point");
    require(field.components.empty() || static_cast<Index>(field.components.size()) == field.values.rows(),
            "names of components are as many as components");
  }
}

void vtu(std::string_view bytes) {
  const fs::path file = file_of("points.vtu", bytes);
  read_or_refuse([&] {
    const PointFile read = read_vtu(file);
    check(read.position_mm, read.fields);
  });
}

void vtp(std::string_view bytes) {
  const fs::path file = file_of("surface.vtp", bytes);
  read_or_refuse([&] {
    const SurfaceFile read = read_vtp(file);
    check(read.position_mm, read.fields);
    require(read.triangles.cols() > 0 && read.triangles.minCoeff() >= 0 &&
                read.triangles.maxCoeff() < read.position_mm.cols(),
            "triangles have corners");
  });
}

constexpr FuzzTarget targets[] = {
    {"nifti", nifti}, {"nrrd", nrrd},     {"metaimage", metaimage}, {"label_names", label_names},
    {"table", table}, {"config", config}, {"model", model},         {"locations", locations},
    {"vtu", vtu},     {"vtp", vtp}};

}  // namespace

std::span<const FuzzTarget> fuzz_targets() {
  return targets;
}

}  // namespace dimple
