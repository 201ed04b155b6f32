// overview.png of a run, and what its page shows: the body, the tools and the force curve.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "apps/run/results.hpp"
#include "apps/run/steps.hpp"
#include "apps/scene/tool_words.hpp"
#include "io/digits.hpp"
#include "solver/terms/rigid_motion.hpp"

namespace dimple {

Points ResultWriter::tool_turned(const Vec3& turned) const {
  if (!indenter_ || turned.isZero(0.0)) return tool_.position_mm;
  const Vec3 tip = 1e3 * indenter_->pose.tip;
  return (rotation(turned) * (tool_.position_mm.colwise() - tip)).colwise() + tip;
}

SurfaceFile ResultWriter::tools_at(double time_s, const Vec3& tool_shift_mm, const Vec3& turned) const {
  SurfaceFile all{.position_mm = tool_turned(turned).colwise() + tool_shift_mm,
                  .triangles = tool_.triangles,
                  .fields = {}};
  for (const Rigid& one : further_) {
    if (!one.is_tool) continue;
    const Index vertices = all.position_mm.cols(), triangles = all.triangles.cols();
    all.position_mm.conservativeResize(3, vertices + one.body.position_mm.cols());
    all.position_mm.rightCols(one.body.position_mm.cols()) =
        one.body.position_mm.colwise() + 1e3 * one.displacement(time_s);
    all.triangles.conservativeResize(3, triangles + one.body.triangles.cols());
    all.triangles.rightCols(one.body.triangles.cols()) =
        one.body.triangles.array() + static_cast<int>(vertices);
  }
  return all;
}

// Tip of the tool [mm]. The pose of a contacting tool already includes the displacement by the loads.
Vec3 ResultWriter::axis_at(const Vec3& carried, const Vec3& aside) const {
  return 1e3 * ((indenter_ ? indenter_->pose.tip : Vec3(model_.tool.centre + carried)) + aside);
}

// Body and tool of a picture.
Overview ResultWriter::body_of(double depth, const Vec3& carried, const Vec3& aside,
                               const Vec3& turned) const {
  Overview picture;
  picture.nodes_mm = nodes_mm_;
  picture.displacement_mm = last_u_mm_;
  for (Index a = 0; a < node_flags_.cols(); ++a)
    picture.node_flags.push_back(static_cast<int>(node_flags_(0, a)));
  picture.points_mm = points_mm_;
  picture.surface_mm = skin_.undeformed.vertex_mm;
  if (!skin_.undeformed.empty() && last_u_mm_.cols() > 0)
    picture.surface_displacement_mm = skin_.to(last_u_mm_);
  picture.surface_triangles = skin_.undeformed.triangles;
  picture.tool_mm = tool_turned(turned);
  picture.carried_mm = 1e3 * carried;
  picture.aside_mm = 1e3 * aside;
  picture.axis_mm = axis_at(carried, aside);
  picture.tool_triangles = tool_.triangles;
  picture.centre_mm = model_.tool.centre * 1e3;
  picture.approach = model_.tool.approach;
  picture.radius_mm = model_.tool.radius * 1e3;
  if (indenter_) {
    picture.radius_mm = indenter_->shape.radius * 1e3;
    picture.tool = indenter_->shape.mesh ? indenter_->shape.mesh->name : in_words(indenter_->shape);
  }
  picture.depth_mm = {1e3 * depth};
  picture.two_threads = in_parallel_;
  return picture;
}

// Places all tools of the picture by the motion of the measured one.
void ResultWriter::place_tools(Overview& picture, const ForceSample& at) const {
  const Vec3 aside(at.aside.data());
  picture.aside_mm = 1e3 * aside;
  picture.axis_mm = axis_at(1e-3 * picture.carried_mm, aside);
  const Vec3 tool_shift_mm = picture.carried_mm + 1e3 * at.depth * picture.approach + picture.aside_mm;
  SurfaceFile tools = tools_at(at.t, tool_shift_mm, Vec3(at.turned.data()));
  picture.tool_mm = tools.position_mm.colwise() - tool_shift_mm;
  picture.tool_triangles = std::move(tools.triangles);
}

// Shows the frame with the largest force: at the end of a scene the tool may have left the body.
void ResultWriter::show_largest(Overview& picture) const {
  if (largest_u_mm_.size() == 0) return;
  picture.displacement_mm = largest_u_mm_;
  if (!skin_.undeformed.empty()) picture.surface_displacement_mm = skin_.to(largest_u_mm_);
  picture.depth_mm = {1e3 * largest_.depth};
  place_tools(picture, largest_);
  picture.moment = fmt::format("at {} s", three_digits(largest_.t));
}

Overview ResultWriter::picture_of(const History& history, const ErrorBounds& error_bounds,
                                  const ImageError& image) const {
  Overview picture = body_of(0.0, history.carried);
  picture.depth_mm.clear();
  for (const ForceSample& s : history.force) {
    picture.depth_mm.push_back(1e3 * s.depth);
    picture.force_N.push_back(s.force);
    if (!over_time_) continue;
    picture.time_s.push_back(s.t);
    picture.lateral_N.push_back(lateral_force(s, model_.tool.approach));
  }
  if (error_bounds.known()) picture.half_N = error_bounds.half;
  picture.low_N = lower_bounds(history.force, error_bounds);
  if (image.known()) picture.image_half_N = image.half.back();
  if (history.force.empty()) return picture;
  place_tools(picture, history.force.back());
  for (const Rigid& one : further_)
    if (one.is_tool) picture.tool += ", " + one.name;
  return picture;
}

void ResultWriter::overview(const History& history, const ErrorBounds& error_bounds, const ImageError& image,
                            const std::optional<Comparison>& comparison, const std::string& title,
                            const std::vector<std::string>& lines,
                            const std::vector<std::string>& warnings) const {
  if (!requested_.picture) return;
  Overview picture = picture_of(history, error_bounds, image);
  picture.title = title;
  picture.lines = lines;
  picture.warnings = warnings;
  picture.walls = walls_;
  show_largest(picture);
  if (comparison) {
    const MeasuredCurve& measured = comparison->measured;
    for (const double depth : measured.depth) picture.compared_depth_mm.push_back(1e3 * depth);
    picture.compared_force_N = measured.force;
    picture.compared = measured.row_name.empty() ? "measured" : "paper";
  }
  write_overview(folder_ / "overview.png", picture);
}

nlohmann::ordered_json ResultWriter::report(const History& history, const ErrorBounds& error_bounds,
                                            const ImageError& image,
                                            const std::optional<Comparison>& comparison,
                                            const std::vector<Slice>& slices, const std::string& options,
                                            bool drawn) const {
  const Overview picture = picture_of(history, error_bounds, image);
  return report_data({.model = model_,
                      .tool = tool_,
                      .indenter = indenter_.get(),
                      .slices = slices,
                      .frames = shown_,
                      .history = history,
                      .error_bounds = error_bounds,
                      .comparison = comparison,
                      .surface_displacement_mm = picture.surface_displacement_mm,
                      .options = options,
                      .picture = !drawn               ? ""
                                 : !body_png_.empty() ? body_png_
                                                      : body_png(picture),
                      .walls = walls_,
                      .over_time = over_time_});
}

}  // namespace dimple
