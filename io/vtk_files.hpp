#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "io/label_image.hpp"
#include "io/types.hpp"

namespace dimple {

/// Named values on points. The unit is part of the name, and goes into the file as VTK's UNITS_LABEL.
struct Field {
  std::string name;                          ///< snake case, with the unit behind it: "displacement_mm"
  std::string unit;                          ///< "mm", "N", "Pa", "kg", "" for a number
  Eigen::MatrixXd values;                    ///< [components x N]
  std::vector<std::string> components = {};  ///< component names; empty: VTK's own
  enum class Type { real32, real64, int32 } type = Type::real32;
};

/// Points with fields: nodes or integration points. Positions in LPS mm.
struct PointFile {
  Points position_mm;
  std::vector<Field> fields;
  bool small = false;            ///< see SurfaceFile
  bool even_if_stopped = false;  ///< written also if the work must end (io/stop.hpp)
  /// The field of that name, or nullptr.
  const Field* find(const std::string& name) const;
};

/// A triangle surface with fields on its points. Positions in LPS mm.
struct SurfaceFile {
  Points position_mm;
  Triangles triangles;
  std::vector<Field> fields;
  std::vector<Field> on_triangles = {};
  std::vector<Field> facts = {};  ///< of the whole, one column each: VTK's field data
  /// Packed by zlib and not by LZ4: shorter, and slower to write.
  bool small = false;
  bool even_if_stopped = false;  ///< see PointFile
};

/// All writers here write inline base64 data packed by LZ4 (or zlib), next to the final name, then rename.
/// They throw OutputError (disk, permissions) and std::invalid_argument (a field that does not match the
/// points: an error of the caller). The unit of each array is its UNITS_LABEL, the time the field data
/// TimeValue; a field "displacement_mm" is the active vector. `exact` keeps positions in double precision,
/// else they are Float32.

/// .vtu with one VTK_VERTEX per point.
void write_vtu(const std::filesystem::path& file, const PointFile& points, double time_s, bool exact = false);
/// .vtp with one polygon per triangle.
void write_vtp(const std::filesystem::path& file, const SurfaceFile& surface, double time_s,
               bool exact = false);
/// Writes a .vti with Origin, Spacing and Direction in LPS mm. The labels are the point array "label" (the
/// first of int8, int16, uint16 or int32 that holds them), cropped to the foreground and two voxels around.
/// The format supports no shear. If two voxel axes have a cosine above 1e-4, the labels are sampled by
/// nearest neighbour on a grid along L, P and S. It has the same spacings: every label remains in its place.
void write_vti(const std::filesystem::path& file, const LabelImage& image);

/// Points and their fields; cells are ignored, integers wider than 32 bits become real64. Throws InputError:
/// missing, not of this kind, damaged, holds no point or a text array, non-finite position.
PointFile read_vtu(const std::filesystem::path& file);
/// Surface and the fields on its points only; triangle strips are converted, in their order behind the
/// polygons. Text arrays are ignored; if SPACE of the field data is RAS, x and y are negated. Throws
/// InputError as read_vtu(), and also if it holds no triangle, or polygons of other kinds.
SurfaceFile read_vtp(const std::filesystem::path& file);

/// A .pvd list of one file per time, rewritten whole each time a frame is added, so that it is always valid.
class TimeSeries {
 public:
  /// `pvd` is e.g. out/nodes.pvd, `suffix` ".vtu"; frames go to out/nodes/nodes_0000.vtu and so on.
  TimeSeries(std::filesystem::path pvd, std::string suffix);
  /// The path for the next frame; creates its folder. Throws OutputError.
  std::filesystem::path next_frame() const;
  /// Continues after frames that an earlier run has written at these times; those beyond them are removed.
  /// Throws OutputError: one does not exist.
  void resume(const std::vector<double>& times_s);
  /// Lists the frame just written under its time. Throws OutputError, also if that frame is not there.
  void add(double time_s);

 private:
  std::filesystem::path frame(std::size_t number) const;
  void write_list() const;
  [[noreturn]] void disappeared(const std::filesystem::path& frame) const;

  std::filesystem::path pvd_;
  std::string suffix_;
  std::vector<std::pair<double, std::string>> frames_;
};

}  // namespace dimple
