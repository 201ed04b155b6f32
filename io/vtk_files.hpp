#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "io/label_image.hpp"
#include "io/types.hpp"

namespace dimple {

/// Named values on points. Unit goes into the file as VTK's UNITS_LABEL.
struct Field {
  std::string name;                         ///< lower snake case, without the unit
  std::string unit;                         ///< "mm", "N", "Pa", "kg", "" for a number
  Eigen::MatrixXd values;                   ///< [components x N]
  std::vector<std::string> components = {}; ///< component names; empty: VTK's own
  enum class Type { real32, real64, int32 } type = Type::real32;
};

/// Points with fields: nodes or integration points. Positions in LPS mm.
struct PointFile {
  Points position_mm;
  std::vector<Field> fields;
  /// The field of that name, or nullptr.
  const Field* find(const std::string& name) const;
};

/// A triangle surface with fields on its points. Positions in LPS mm.
struct SurfaceFile {
  Points position_mm;
  Triangles triangles;
  std::vector<Field> fields;
};

/// .vtu with one VTK_VERTEX per point, appended raw + zlib; `exact` keeps positions in double precision.
/// All writers here write beside the final name, then rename; they throw OutputError.
void write_vtu(const std::filesystem::path& file, const PointFile& points, double time_s, bool exact = false);
/// .vtp
void write_vtp(const std::filesystem::path& file, const SurfaceFile& surface, double time_s, bool exact = false);
/// .vti with Direction: the image as ParaView shows it in LPS mm, cropped to the labels and a tenth more.
void write_vti(const std::filesystem::path& file, const LabelImage& image);
/// Throw InputError: missing, not of this kind, holds no point, non-finite position.
PointFile read_vtu(const std::filesystem::path& file);
SurfaceFile read_vtp(const std::filesystem::path& file);

/// A .pvd list of one file per time, rewritten whole each time a frame is added, so that it is always valid.
class TimeSeries {
 public:
  /// `pvd` is e.g. out/nodes.pvd; frames go to out/nodes/nodes_0000.vtu and so on.
  TimeSeries(std::filesystem::path pvd, std::string suffix);
  /// The path for the next frame; creates its folder.
  std::filesystem::path next_frame() const;
  /// Lists the frame just written (it must exist) under its time.
  void add(double time_s);

 private:
  std::filesystem::path pvd_;
  std::string suffix_;
  std::vector<std::pair<double, std::string>> frames_;
};

}  // namespace dimple
