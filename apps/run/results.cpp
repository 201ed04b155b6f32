#include "apps/run/results.hpp"

#include <fmt/format.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>

#include "apps/run/tool.hpp"
#include "apps/run/view.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/memory.hpp"
#include "io/stop.hpp"
#include "io/units.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// Sets as bits: 1 base, 2 bonded patch, 4 the first support, 8 the second, ...
Eigen::MatrixXd node_sets(const Model& model, const std::vector<HeldSet>& supports) {
  Eigen::MatrixXd set = Eigen::MatrixXd::Zero(1, model.node_count());
  for (const Index a : model.base) set(0, a) += 1.0;
  for (const Index a : model.bonded_patch) set(0, a) += 2.0;
  for (std::size_t k = 0; k < supports.size(); ++k)
    for (const Index a : supports[k].node) set(0, a) += std::ldexp(4.0, static_cast<int>(k));
  return set;
}

}  // namespace

Requested requested_by(const Scene& scene) {
  const std::vector<std::string>& list = scene.output.write;
  const bool fine = std::find(list.begin(), list.end(), "fine") != list.end();
  const auto is_requested = [&](const char* word) {
    return (fine && list.size() == 1) || std::any_of(list.begin(), list.end(), [&](const std::string& given) {
             return given == word || given == "all";
           });
  };
  return {.nodes = is_requested("nodes"),
          .points = is_requested("points"),
          .surface = is_requested("surface"),
          .picture = is_requested("picture"),
          .model = is_requested("model"),
          .label = is_requested("label"),
          .report = is_requested("report"),
          .images = std::find(list.begin(), list.end(), "images") != list.end(),
          .fine = fine};
}

// Data of a frame to be written, except for what stays the same.
struct ResultWriter::Packing {
  double time_s, depth, force;  // [s], [m], [N]
  Vec3 carried, aside, turned;  // [m], [m], [rad]
  Points u, reaction = {};      // [mm], [N]
  Eigen::MatrixXd J = {}, sigma = {}, mises = {};
  PointFile contact = {};
};

namespace {

// Rigid objects in contact with the body: the measured tool, if it is one, and the rest in their order.
std::vector<const RigidContact*> rigid_in(const Frame& frame) {
  std::vector<const RigidContact*> all;
  if (frame.tool) all.push_back(frame.tool);
  all.insert(all.end(), frame.walls.begin(), frame.walls.end());
  return all;
}

// Their contact points, with pressure and state.
PointFile contact_of(const Frame& frame, const Points& u_mm) {
  const std::vector<const RigidContact*> rigid = rigid_in(frame);
  Index count = 0;
  for (const RigidContact* one : rigid) count += one->count();
  Points place(3, count), force(3, count);
  Eigen::MatrixXd contact(1, count), pressure(1, count), area(1, count), slid(1, count), whose(1, count);
  Index at = 0;
  double number = frame.tool ? 0.0 : 1.0;
  for (const RigidContact* one : rigid) {
    const ContactSurface& surface = one->body().surface;
    const Index its = one->count();
    place.middleCols(at, its) = surface.place * 1e3 + surface.at_place(u_mm);
    force.middleCols(at, its) = one->forces_on_body();
    for (Index s = 0; s < its; ++s) contact(0, at + s) = static_cast<int>(one->contact(s));
    pressure.middleCols(at, its) = one->pressures().transpose();
    area.middleCols(at, its) = surface.area.transpose() * 1e6;
    if (one->has_friction())
      slid.middleCols(at, its) = one->slid_along().transpose() * 1e3;
    else
      slid.middleCols(at, its).setZero();
    whose.middleCols(at, its).setConstant(number++);
    at += its;
  }
  PointFile file{.position_mm = std::move(place), .fields = {}};
  file.fields = {{.name = "contact", .unit = "", .values = contact, .type = Field::Type::int32},
                 {.name = "pressure_Pa", .unit = "Pa", .values = pressure},
                 {.name = "force_N", .unit = "N", .values = force, .components = {"X", "Y", "Z"}},
                 {.name = "area_mm2", .unit = "mm^2", .values = area}};
  if (std::any_of(rigid.begin(), rigid.end(), [](const RigidContact* one) { return one->has_friction(); }))
    file.fields.push_back({.name = "slid_mm", .unit = "mm", .values = slid});
  if (!frame.walls.empty())
    file.fields.push_back({.name = "touched_by", .unit = "", .values = whose, .type = Field::Type::int32});
  return file;
}

// Numbers of a frame at 200,000 points take 20 MB, and twice that while they are packed.
constexpr Index most_points_in_parallel = 200'000;

bool may_write_in_parallel(const Model& model) {
  using tbb::global_control;
  return model.point_count() <= most_points_in_parallel &&
         global_control::active_value(global_control::max_allowed_parallelism) > 1;
}

}  // namespace

ResultWriter::ResultWriter(fs::path folder, const Model& model, const Requested& requested,
                           const LabelAt& label_at, const std::vector<HeldSet>& supports, double end_s,
                           std::shared_ptr<const RigidBody> indenter)
    : folder_(std::move(folder)),
      model_(model),
      indenter_(std::move(indenter)),
      requested_(requested),
      in_parallel_(may_write_in_parallel(model)),
      nodes_mm_(model.X.unaryExpr(&millimetres)),
      points_mm_(model.point.unaryExpr(&millimetres)),
      node_flags_(node_sets(model, supports)),
      node_series_(folder_ / "nodes.pvd", ".vtu"),
      point_series_(folder_ / "points.pvd", ".vtu"),
      surface_series_(folder_ / "surface.pvd", ".vtp"),
      section_series_(folder_ / "section.pvd", ".vtp"),
      tool_series_(folder_ / "tool.pvd", ".vtp"),
      contact_series_(folder_ / "contact.pvd", ".vtu"),
      end_s_(end_s) {
  requested_.surface = requested.surface && !model.surface.empty();
  if (requested_.nodes) to_nodes_ = node_interpolation(model);
  if (requested_.points) to_points_ = point_interpolation(model);
  if (requested_.surface) {
    section_ = cut_open(model);
    to_section_ = inner_interpolation(model, section_.place * 1e-3);
    on_section_ = make_point_means(points_mm_, section_.place);
    if (label_at) {
      label_.resize(1, section_.triangles.cols());
      for (Index t = 0; t < label_.cols(); ++t)
        label_(0, t) = label_at(section_.place(Eigen::all, section_.triangles.col(t)).rowwise().mean());
    }
    write_file(folder_ / view_file, view_script);
  }
  if (requested_.surface || requested_.picture || requested_.report)
    tool_ = indenter_ ? tool_body(*indenter_) : tool_body(model);
  if (!model.surface.empty() && (requested_.surface || requested_.picture || requested_.report)) take_skins();
}

ResultWriter::~ResultWriter() = default;

ResultWriter::Skin ResultWriter::skin_of(const std::vector<Index>& vertex, const Triangles& triangles) const {
  Skin skin{.undeformed = {model_.surface.vertex_mm(Eigen::all, vertex), triangles},
            .to = surface_interpolation(model_, vertex),
            .mises = {},
            .on_patch = {}};
  if (!requested_.surface) return skin;
  skin.mises = make_point_means(points_mm_, skin.undeformed.vertex_mm);
  skin.on_patch.setZero(1, skin.undeformed.vertex_mm.cols());
  const ToolPlace& tool = model_.tool;
  for (Index m = 0; m < skin.on_patch.cols(); ++m) {
    const Vec3 d = skin.undeformed.vertex_mm.col(m) * 1e-3 - tool.centre;
    const double along = d.dot(tool.approach);
    skin.on_patch(0, m) = (d - along * tool.approach).norm() <= tool.radius && std::abs(along) < tool.radius;
  }
  return skin;
}

// Sets the surface that files, report and picture use.
void ResultWriter::take_skins() {
  const ReducedSurface reduced = reduced_surface(model_.surface, model_.tool, most_triangles_shown);
  skin_ = skin_of(reduced.vertex, reduced.triangles);
  within_mm_ = reduced.within_mm;
  if (requested_.report) shown_.body = skin_.undeformed;
  if (!requested_.surface || !requested_.fine || within_mm_ == 0.0) return;
  std::vector<Index> all(static_cast<std::size_t>(model_.surface.vertex_mm.cols()));
  std::iota(all.begin(), all.end(), Index{0});
  whole_ = skin_of(all, model_.surface.triangles);
}

Json ResultWriter::shown_surface() const {
  return {{"triangles", skin_.undeformed.triangles.cols()}, {"within_mm", within_mm_}};
}

void ResultWriter::resume(const std::vector<double>& frame_time_s) {
  frame_time_s_ = frame_time_s;
  if (requested_.nodes) node_series_.resume(frame_time_s);
  const bool ended = !frame_time_s.empty() && is_last(frame_time_s.back());
  if (requested_.points)
    point_series_.resume(requested_.fine ? frame_time_s
                         : ended         ? std::vector{frame_time_s.back()}
                                         : std::vector<double>{});
  if (requested_.surface)
    for (TimeSeries* series : view_series()) series->resume(frame_time_s);
  if (!requested_.nodes || shown_.body.empty()) return;
  for (std::size_t k = 0; k < frame_time_s.size(); ++k) try {
      const PointFile nodes = read_vtu(folder_ / "nodes" / fmt::format("nodes_{:04d}.vtu", k));
      if (const Field* u = nodes.find("nodal_parameter_mm"))
        keep(shown_, {k, frame_time_s[k], skin_.to(u->values).cast<float>()});
    } catch (const InputError&) {  // then the page has no such frame
    }
}

void ResultWriter::continue_after_cut(const std::vector<double>& frame_time_s) {
  frame_time_s_ = frame_time_s;
  if (requested_.nodes) node_series_.resume(frame_time_s);
  if (requested_.points) point_series_.resume(requested_.fine ? frame_time_s : std::vector<double>{});
  if (requested_.surface)
    for (TimeSeries* series : view_series()) series->resume(frame_time_s);
}

PointStress stress_at_points(const Frame& frame) {
  ForceState forces = frame.forces;  // copied, since its last sweep may have been elsewhere
  forces.stress_sweep(frame.u);
  const auto F = forces.deformation_gradients(), P = forces.stresses();
  const double around = forces.pressure_around();
  PointStress at{Eigen::MatrixXd(1, F.cols()), Eigen::MatrixXd(6, F.cols()), Eigen::MatrixXd(1, F.cols())};
  for (Index q = 0; q < F.cols(); ++q) {
    const Mat3 Fq = Eigen::Map<const Mat3>(F.col(q).data());
    at.J(0, q) = Fq.determinant();
    if (!(at.J(0, q) >= least_J_of_stress)) {
      at.sigma.col(q).setConstant(std::numeric_limits<double>::quiet_NaN());
      at.mises(0, q) = std::numeric_limits<double>::quiet_NaN();
      continue;
    }
    const Mat3 s = Eigen::Map<const Mat3>(P.col(q).data()) * Fq.transpose() / Fq.determinant() -
                   around * Mat3::Identity();
    const Mat3 deviator = s - s.trace() / 3.0 * Mat3::Identity();
    at.sigma.col(q) << s(0, 0), s(1, 1), s(2, 2), s(0, 1), s(1, 2), s(0, 2);
    at.mises(0, q) = std::sqrt(1.5) * deviator.norm();
  }
  return at;
}

void ResultWriter::frame(const Frame& frame, const Vec3& carried) {
  Packing packing{.time_s = frame.t,
                  .depth = frame.depth,
                  .force = frame.contact_force,
                  .carried = carried,
                  .aside = frame.aside,
                  .turned = frame.turned,
                  .u = frame.u.topRows<3>() * 1e3};
  for (const Index a : model_.bonded_patch)
    packing.force += frame.f.col(a).head<3>().dot(model_.tool.approach);
  const Points& u = packing.u;
  if (requested_.nodes) {
    packing.reaction = Points::Zero(3, u.cols());
    for (Index a = 0; a < u.cols(); ++a)
      if (node_flags_(0, a) > 0.0) packing.reaction.col(a) = frame.f.col(a).head<3>();
  }
  if (requested_.points || requested_.surface) {
    PointStress at_points = stress_at_points(frame);
    if (requested_.points) {
      packing.J = std::move(at_points.J);
      packing.sigma = std::move(at_points.sigma);
    }
    packing.mises = std::move(at_points.mises);
  }
  if (requested_.surface && has_contact()) {
    packing.contact = contact_of(frame, u);
    packing.contact.small = !requested_.fine;
  }
  finish_frames();
  last_u_mm_ = u;
  if (over_time_ && (largest_u_mm_.size() == 0 || std::abs(packing.force) > std::abs(largest_.force))) {
    const Vec3 &aside = frame.aside, &turned = frame.turned;
    largest_u_mm_ = u;
    largest_ = {.t = frame.t,
                .depth = frame.depth,
                .force = packing.force,
                .base_force = 0.0,
                .aside = {aside.x(), aside.y(), aside.z()},
                .turned = {turned.x(), turned.y(), turned.z()}};
  }
  pending_time_s_ = frame.t;
  if (in_parallel_) {
    pending_ = std::async(std::launch::async,
                          [this, kept = std::move(packing)]() mutable { write(std::move(kept)); });
  } else {
    write(std::move(packing));
    give_back_memory();
    frame_time_s_.push_back(pending_time_s_);
  }
}

void ResultWriter::finish_frames() {
  if (!pending_.valid()) return;
  pending_.get();
  frame_time_s_.push_back(pending_time_s_);
}

void ResultWriter::write(Packing frame) {
  const std::vector<std::string> xyz = {"X", "Y", "Z"};
  if (requested_.nodes)
    write_vtu(
        node_series_.next_frame(),
        {.position_mm = nodes_mm_,
         .fields =
             {{.name = "displacement_mm", .unit = "mm", .values = to_nodes_(frame.u), .components = xyz},
              {.name = "nodal_parameter_mm", .unit = "mm", .values = frame.u, .components = xyz},
              {.name = "reaction_N", .unit = "N", .values = frame.reaction, .components = xyz},
              {.name = "node_set", .unit = "", .values = node_flags_, .type = Field::Type::int32},
              {.name = "mass_kg", .unit = "kg", .values = model_.mass.transpose()}},
         .small = !requested_.fine},
        frame.time_s);
  if (requested_.surface) write_view(frame);
  if (!shown_.body.empty())
    keep(shown_, {frame_time_s_.size(), frame.time_s, skin_.to(frame.u).cast<float>()});
  // Drawn in this thread, while the error bounds leave a processor idle at times. Two pictures never run in
  // parallel: VTK renders text in one thread only.
  if (requested_.report && in_parallel_ && is_last(frame.time_s))
    body_png_ = body_png(body_of(frame.depth, frame.carried, frame.aside, frame.turned));
  const double time_s = frame.time_s;
  const bool last = is_last(time_s), points_now = requested_.points && (requested_.fine || last);
  if (points_now)
    write_points(std::move(frame));
  else if (requested_.points)
    points_left_ = std::make_unique<Packing>(std::move(frame));
  // Listed when all are written: a run stopped between two files has as many frames in each list.
  if (requested_.nodes) node_series_.add(time_s);
  if (points_now) point_series_.add(time_s);
  if (requested_.surface)
    for (TimeSeries* series : view_series()) series->add(time_s);
}

std::vector<TimeSeries*> ResultWriter::view_series() {
  std::vector<TimeSeries*> all = {&surface_series_, &section_series_, &tool_series_};
  if (has_contact()) all.push_back(&contact_series_);
  return all;
}

void ResultWriter::end_frames() {
  std::exception_ptr stopped;  // within a frame: the one before is the last
  try {
    finish_frames();
  } catch (const Stopped&) {
    stopped = std::current_exception();
  }
  // A stopped run has a second for all that remains to be written.
  const bool is_stopped = stop_requested() != StopReason::none;
  if (points_left_ && !(is_stopped && model_.point_count() > most_points_in_parallel)) {
    const double time_s = points_left_->time_s;
    write_points(std::move(*points_left_), is_stopped);
    point_series_.add(time_s);
  }
  if (stopped) std::rethrow_exception(stopped);
}

void ResultWriter::write_points(Packing frame, bool of_stopped) {
  points_left_.reset();
  PointFile file{
      .position_mm = points_mm_, .fields = {}, .small = !requested_.fine, .even_if_stopped = of_stopped};
  // Added one by one: an initialiser list would copy them.
  file.fields.push_back({.name = "displacement_mm",
                         .unit = "mm",
                         .values = to_points_(frame.u),
                         .components = {"X", "Y", "Z"}});
  file.fields.push_back({.name = "jacobian", .unit = "", .values = std::move(frame.J)});
  file.fields.push_back({.name = "cauchy_stress_Pa",
                         .unit = "Pa",
                         .values = std::move(frame.sigma),
                         .components = {"XX", "YY", "ZZ", "XY", "YZ", "XZ"}});
  file.fields.push_back({.name = "von_mises_Pa", .unit = "Pa", .values = std::move(frame.mises)});
  file.fields.push_back({.name = "volume_mm3", .unit = "mm^3", .values = model_.volume.transpose() * 1e9});
  write_vtu(point_series_.next_frame(), file, frame.time_s);
}

// Files for view.py: the skin, the body cut open, and the tool.
void ResultWriter::write_view(const Packing& frame) {
  const bool small = !requested_.fine;
  const Skin& skin = whole_ ? *whole_ : skin_;
  const std::vector<std::string> xyz = {"X", "Y", "Z"};
  const auto fact = [](const char* name, const char* unit, const Eigen::MatrixXd& value) {
    return Field{.name = name, .unit = unit, .values = value, .type = Field::Type::real64};
  };
  const auto number = [](double value) { return Eigen::MatrixXd::Constant(1, 1, value); };
  {
    const Points u = skin.to(frame.u);
    write_vtp(
        surface_series_.next_frame(),
        {.position_mm = skin.undeformed.vertex_mm + u,
         .triangles = skin.undeformed.triangles,
         .fields =
             {{.name = "displacement_mm", .unit = "mm", .values = u, .components = xyz},
              {.name = "von_mises_Pa", .unit = "Pa", .values = skin.mises(frame.mises)},
              {.name = "indenter_circle", .unit = "", .values = skin.on_patch, .type = Field::Type::int32}},
         .small = small},
        frame.time_s);
  }
  const Points u = to_section_(frame.u);
  SurfaceFile section{.position_mm = section_.place + u,
                      .triangles = section_.triangles,
                      .fields = {{.name = "displacement_mm", .unit = "mm", .values = u, .components = xyz},
                                 {.name = "von_mises_Pa", .unit = "Pa", .values = on_section_(frame.mises)}},
                      .small = small};
  if (label_.size() > 0)
    section.on_triangles.push_back(
        {.name = "label", .unit = "", .values = label_, .type = Field::Type::int32});
  write_vtp(section_series_.next_frame(), section, frame.time_s);
  const ToolPlace& tool = model_.tool;
  const Vec3 displacement = frame.carried + frame.depth * tool.approach + frame.aside;
  SurfaceFile tools = tools_at(frame.time_s, 1e3 * displacement, frame.turned);
  write_vtp(
      tool_series_.next_frame(),
      {.position_mm = std::move(tools.position_mm),
       .triangles = std::move(tools.triangles),
       .fields = {},
       .facts = {fact("indentation_mm", "mm", number(1e3 * frame.depth)),
                 fact("force_N", "N", number(frame.force)),
                 fact("radius_mm", "mm", number(1e3 * (indenter_ ? indenter_->shape.radius : tool.radius))),
                 fact("centre_mm", "mm", 1e3 * tool.centre), fact("carried_mm", "mm", 1e3 * frame.carried),
                 fact("push", "", tool.approach), fact("front", "", section_.front)},
       .small = small},
      frame.time_s);
  if (has_contact()) write_vtu(contact_series_.next_frame(), frame.contact, frame.time_s);
}

}  // namespace dimple
